#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "common/base/check.h"
#include "common/page/channel.h"
#include "common/scene/load.h"
#include "drivers/drivers.h"
#include "tests/support/folder.h"

namespace twoport::page_device_test {
namespace {

constexpr double kPeriod = 1e-3;

/// The page's device, driven by commands of a page at 60 Hz.
template <int N>
struct Rig {
  Rig() {
    test::Folder folder;
    const std::string dof = std::to_string(N);
    scene = load_scene(
        folder.write(
            "s.textproto",
            "name: \"s\" dof: " + dof + " rate_hz: 1000 device { mass_kg: 0.1 damping_n_s_per_m: 0.2 max_force_n: 8 " +
                (N == 6 ? "inertia_kg_m2: 1e-3 rotational_damping_n_m_s_per_rad: 1e-3" : "") +
                " } control { architecture: RENDER passivity { method: NONE } } environment { wall { normal: " +
                (N == 1 ? "[-1]" : "[-1, 0, 0]") + " offset_m: -1 stiffness_n_per_m: 1000 } }"),
        {}, SceneFor::live);
    device = all_drivers().devices.open<N>("page", scene, Seconds{kPeriod}, &channel);
  }
  DeviceSample<N> tick(long periods = 1) {
    const DeviceSample<N> sample = device->sense({Instant<MasterClock>{tick_time(k += periods, 1 / kPeriod)},
                                                  Seconds{kPeriod}, Seconds{static_cast<double>(periods) * kPeriod}});
    device->actuate(force);
    return sample;
  }
  void target(std::array<double, 6> to) { channel.hand.try_push({PageCommand::Kind::target, 0, to}); }

  Scene scene;
  PageChannel channel;
  std::unique_ptr<Device<N>> device;
  Force<N> force;
  long k = 0;
};

TEST(PageDevice, FollowsThePointerWithoutSteps) {
  Rig<3> rig;
  rig.tick();
  DeviceSample<3> s, before = rig.tick();
  double step = 0.0, jerk = 0.0;
  for (int i = 0; i < 1000; ++i) {
    if (i % 16 == 0) rig.target({0.03, -0.02, 0.01});  // a jump of 37 mm
    s = rig.tick();
    step = std::max(step, (s.x - before.x).vec().norm());
    jerk = std::max(jerk, (s.v - before.v).vec().norm());
    before = s;
  }
  EXPECT_NEAR((s.x.translation() - Eigen::Vector3d{0.03, -0.02, 0.01}).norm(), 0.0, 1e-4);  // less than can be seen
  EXPECT_LT(step, 1.5e-3);          // 1.5 m/s, the hand's largest speed
  EXPECT_LT(jerk / kPeriod, 60.0);  // [m/s²]; a step of the position would be 37 m/s in one period
  EXPECT_TRUE(rig.channel.pointer.held);
}

TEST(PageDevice, AForceDisplacesTheHandByItsStiffness) {
  Rig<1> rig;
  rig.channel.hand.try_push({PageCommand::Kind::grip, 0, {500.0}});
  DeviceSample<1> s;
  rig.force = Force<1>{Force<1>::Vector{2.0}};  // pushes the hand with -2 N
  for (int i = 0; i < 2000; ++i) {
    if (i % 16 == 0) rig.target({0.01});
    s = rig.tick();
  }
  EXPECT_NEAR(s.x.translation()[0], 0.01 - 2.0 / 500.0,
              1e-6);  // static deflection f / k; settled for 20 time constants
  EXPECT_EQ(s.applied[0], 2.0);
}

TEST(PageDevice, WithoutAPageTheHandleIsReleased) {
  Rig<1> rig;
  for (int i = 0; i < 500; ++i) {
    if (i % 16 == 0) rig.target({0.02});
    rig.tick();
  }
  ASSERT_TRUE(rig.channel.pointer.held);
  for (int i = 0; i < 240; ++i) rig.tick();
  EXPECT_TRUE(rig.channel.pointer.held) << "one lost frame is no reason";
  for (int i = 0; i < 20; ++i) rig.tick();
  EXPECT_FALSE(rig.channel.pointer.held) << "250 ms are";
  // Free: the wall's force moves it out, no hand holds against it.
  rig.force = Force<1>{Force<1>::Vector{1.0}};
  const double x = rig.tick().x.translation()[0];
  for (int i = 0; i < 300; ++i) rig.tick();
  EXPECT_LT(rig.tick().x.translation()[0], x - 0.03);
}

/// Any page may set the stiffness: that is no sign of the page whose pointer holds.
TEST(PageDevice, OnlyThePointerConfirmsThatItHolds) {
  for (const auto kind : {PageCommand::Kind::grip, PageCommand::Kind::opening}) {
    Rig<1> rig;
    rig.target({0.02});
    for (int i = 0; i < 300; ++i) {
      if (i % 16 == 0) rig.channel.hand.try_push({kind, 0, {400.0}});
      rig.tick();
    }
    EXPECT_FALSE(rig.channel.pointer.held) << "250 ms without the pointer";
  }
}

TEST(PageDevice, ReleaseLetsGoAtOnceAndComesToRest) {
  Rig<6> rig;
  for (int i = 0; i < 200; ++i) {
    if (i % 16 == 0) rig.target({0.05, 0, 0, 0, 0, 0.5});
    rig.tick();
  }
  rig.channel.hand.try_push({PageCommand::Kind::release, 0, {}});
  rig.tick();
  EXPECT_FALSE(rig.channel.pointer.held);
  DeviceSample<6> s;
  for (int i = 0; i < 1000; ++i) s = rig.tick();
  EXPECT_LT(s.v.vec().norm(), 1e-6);
  EXPECT_NEAR(s.x.attitude().norm(), 1.0, 1e-12);
}

TEST(PageDevice, TurnsWithThePointer) {
  Rig<6> rig;
  DeviceSample<6> s;
  for (int i = 0; i < 1500; ++i) {
    if (i % 16 == 0) rig.target({0, 0, 0, 0.3, 0, 0.4});
    s = rig.tick();
  }
  EXPECT_NEAR((rotation_vector(s.x.attitude()) - Eigen::Vector3d{0.3, 0, 0.4}).norm(), 0.0, 1e-3);
}

/// The gripper is held as long as the handle is, and rests under a force at the opening that the hand intends plus f / k.
TEST(PageDevice, HasTheGripperOfTheScene) {
  PageChannel channel;
  const Scene scene = parse_scene(
      "dof: 1 duration_s: 1 rate_hz: 1000 operator { hand { stiffness_n_per_m: 300 } } device { mass_kg: 0.1 } "
      "control { passivity { method: INTERNAL_MODEL } } robot { mass_kg: 1 force_sensor { } } "
      "gripper { operator { hand { stiffness_n_per_m: 400 } } device { mass_kg: 0.05 position_m: [0.06] } "
      "robot { mass_kg: 0.2 force_sensor { } } }",
      "s", {}, SceneFor::live);
  const std::unique_ptr<Device<1>> device = all_drivers().devices.open<1>("page", scene, Seconds{kPeriod}, &channel);
  EXPECT_TRUE(device->info().gripper);
  Device<1>* const gripper = device->gripper();
  ASSERT_NE(gripper, nullptr);
  long k = 0;
  DeviceSample<1> s;
  const auto run = [&](long ticks, bool holds, double force_n) {
    for (const long end = k + ticks; k < end; ++k) {
      if (holds && k % 16 == 0) channel.hand.try_push({PageCommand::Kind::target, 0, {}});
      const Tick<MasterClock> tick{Instant<MasterClock>{tick_time(k, 1 / kPeriod)}, Seconds{kPeriod}, Seconds{kPeriod}};
      device->sense(tick);
      device->actuate(Force<1>{});
      s = gripper->sense(tick);
      gripper->actuate(Force<1>{Force<1>::Vector{force_n}});
    }
  };
  channel.hand.try_push({PageCommand::Kind::opening, 0, {0.04}});
  run(500, false, 0.0);
  EXPECT_FALSE(s.held);
  EXPECT_EQ(s.x.translation()[0], 0.06);
  run(2000, true, -2.0);
  EXPECT_TRUE(s.held);
  EXPECT_NEAR(s.x.translation()[0], 0.04 + 2.0 / 400.0, 1e-6);  // settled for 20 time constants
  run(300, false, 0.0);
  EXPECT_FALSE(s.held) << "250 ms without the page";
}

/// What the hand's port takes in from a force that only dissipates cannot grow: the handle alone does not create energy
/// at any stiffness and after skipped ticks.
TEST(PageDevice, AReleasedHandleDissipates) {
  Rig<1> rig;
  rig.channel.hand.try_push({PageCommand::Kind::grip, 0, {kPageGripMost}});
  for (int i = 0; i < 300; ++i) {
    if (i % 16 == 0) rig.target({i % 32 == 0 ? 0.02 : -0.02});
    rig.tick(i % 7 == 0 ? 5 : 1);
  }
  rig.channel.hand.try_push({PageCommand::Kind::release, 0, {}});
  double before = std::abs(rig.tick().v[0]);
  for (int i = 0; i < 200; ++i) {
    const double now = std::abs(rig.tick().v[0]);
    ASSERT_LE(now, before);
    before = now;
  }
}

TEST(PageDevice, NeedsAPageAndTakesNoArguments) {
  Rig<1> rig;
  EXPECT_THROW((void)all_drivers().devices.open<1>("page", rig.scene, Seconds{kPeriod}), ConfigError);
  EXPECT_THROW((void)all_drivers().devices.open<1>("page:x", rig.scene, Seconds{kPeriod}, &rig.channel), ConfigError);
}

}  // namespace
}  // namespace twoport::page_device_test
