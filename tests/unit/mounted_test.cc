#include "common/hardware/mounted.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <utility>

#include "sim/plant/position_servo.h"

namespace twoport::mounted_test {
namespace {

constexpr double kPeriod = 1e-3;

/// Hardware that says what the test has set, and remembers what it was asked.
template <int N>
struct Script {
  DeviceInfo info{.name = "script", .max_force_n = 10.0, .mass_kg = 0.4, .buttons = 4};
  DeviceSample<N> sample;
  Force<N> command;
  int commands = 0, releases = 0;
};
template <int N>
class Scripted final : public Device<N> {
 public:
  explicit Scripted(Script<N>& s) : s_{s} {}
  [[nodiscard]] DeviceInfo info() const override { return s_.info; }
  DeviceSample<N> sense(const Tick<MasterClock>&) noexcept override { return s_.sample; }
  void actuate(const Force<N>& f) noexcept override {
    s_.command = s_.sample.applied = f;
    ++s_.commands;
  }
  void release() noexcept override {
    ++s_.releases;
    s_.command = s_.sample.applied = Force<N>{};
  }

 private:
  Script<N>& s_;
};
template <int N>
struct Rig {
  explicit Rig(const DeviceMount& mount = {},
               const DeviceInfo& info = {.name = "script", .max_force_n = 10.0, .mass_kg = 0.4, .buttons = 4})
      : script{.info = info, .sample = {}, .command = {}}, device{std::make_unique<Scripted<N>>(script), mount} {}
  DeviceSample<N> tick(const Force<N>& f = {}) {
    const DeviceSample<N> s = device.sense({Instant<MasterClock>{tick_time(++k, 1.0 / kPeriod)}, Seconds{kPeriod}});
    device.actuate(f);
    return s;
  }
  Script<N> script;
  MountedDevice<N> device;
  long k = 0;
};
Force<3> force(double x, double y, double z) {
  return Force<3>{Eigen::Vector3d{x, y, z}};
}
Position<3> position(double x, double y, double z) {
  return Position<3>{Eigen::Vector3d{x, y, z}};
}

TEST(Mounted, ChangesNothingByDefault) {
  Rig<3> rig;
  rig.script.sample = {.x = position(1.0, 2.0, 3.0), .v = Velocity<3>{Eigen::Vector3d{4.0, 5.0, 6.0}}, .applied = {}};
  const DeviceSample<3> s = rig.tick(force(7.0, 0.1, 0.3));
  EXPECT_EQ(s.x.translation(), (Eigen::Vector3d{1.0, 2.0, 3.0}));
  EXPECT_EQ(s.v.vec(), (Eigen::Vector3d{4.0, 5.0, 6.0}));
  EXPECT_EQ(rig.script.command.vec(), (Eigen::Vector3d{7.0, 0.1, 0.3}));
  EXPECT_EQ(rig.device.info().max_force_n, 10.0);
}

TEST(Mounted, MapsMotionAndForceByOneMapThatKeepsPower) {
  std::mt19937 draw{3};
  std::normal_distribution<double> normal;
  const auto any = [&] { return Eigen::Vector3d{normal(draw), normal(draw), normal(draw)}; };
  for (int i = 0; i < 100; ++i) {
    DeviceMount m;
    m.position_m = any();
    m.rotation = Eigen::Quaterniond{normal(draw), normal(draw), normal(draw), normal(draw)}.normalized();
    m.scale = 0.1 + std::abs(normal(draw));
    Rig<3> rig{m};
    const Eigen::Vector3d x = any(), v = any(), f = any();
    rig.script.sample = {.x = Position<3>{x}, .v = Velocity<3>{v}, .applied = {}};
    const DeviceSample<3> s = rig.tick(Force<3>{f});
    EXPECT_LT((s.x.translation() - (m.scale * (m.rotation * x) + m.position_m)).norm(), 1e-12);
    // Power of the command at the device and in the world.
    EXPECT_NEAR(rig.script.command.vec().dot(v), f.dot(s.v.vec()), 1e-12 * (1.0 + f.norm() * s.v.vec().norm()));
    EXPECT_LT((rig.tick().applied.vec() - f).norm(), 1e-12 * (1.0 + f.norm()));
    EXPECT_NEAR(rig.device.info().max_force_n, 10.0 / m.scale, 1e-12 * 10.0 / m.scale);
    // The same kinetic energy.
    EXPECT_NEAR(rig.device.info().mass_kg * s.v.squared_norm(), 0.4 * v.squaredNorm(), 1e-12 * (1.0 + v.squaredNorm()));
  }
}

TEST(Mounted, TurnsAttitudesWithTheWorldAndKeepsTheirMotion) {
  DeviceMount m;
  m.rotation = rotation({0.3, -1.0, 0.4});
  m.scale = 2.0;
  Rig<6> rig{m};
  const Eigen::Vector3d turn{0.02, 0.01, -0.03};
  rig.script.sample.x = Position<6>{{0.0, 0.0, 0.0}, rotation({0.5, 0.1, 0.2})};
  const DeviceSample<6> a = rig.tick();
  rig.script.sample.x = rig.script.sample.x.moved({0.1, 0.0, 0.0}, turn);
  const DeviceSample<6> b = rig.tick();
  const Displacement<6> moved = b.x - a.x;
  EXPECT_LT((moved.vec().head<3>() - 2.0 * (m.rotation * Eigen::Vector3d{0.1, 0.0, 0.0})).norm(), 1e-12);
  EXPECT_LT((moved.vec().tail<3>() - m.rotation * turn).norm(), 1e-12);
}

TEST(Mounted, ClutchFreesTheHandAndContinuesWithoutAJump) {
  DeviceMount m;
  m.clutch_button = 2;
  m.scale = 3.0;
  m.engage_s = 0.1;
  Rig<3> rig{m};
  const auto at = [&](double x, bool pressed) {
    rig.script.sample.x = position(x, 0.0, 0.0);
    rig.script.sample.v = Velocity<3>{Eigen::Vector3d{1.0, 0.0, 0.0}};
    rig.script.sample.buttons = pressed ? 0b100u : 0b011u;
    return rig.tick(force(1.0, 0.0, 0.0));
  };
  EXPECT_EQ(at(0.10, false).x.translation()[0], 0.30000000000000004);
  EXPECT_DOUBLE_EQ(rig.script.command[0], 3.0);
  // The interval up to the press counts; then the world stands still, as if held, and the hand is free.
  DeviceSample<3> s = at(0.11, true);
  EXPECT_DOUBLE_EQ(s.x.translation()[0], 0.33);
  EXPECT_EQ(s.v.squared_norm(), 0.0);
  EXPECT_DOUBLE_EQ(s.applied[0], 1.0);
  EXPECT_EQ(rig.script.command.squared_norm(), 0.0);
  for (int i = 0; i < 50; ++i) {
    s = at(0.11 - 0.002 * i, true);
    EXPECT_DOUBLE_EQ(s.x.translation()[0], 0.33);
    EXPECT_EQ(rig.script.command.squared_norm(), 0.0);
    if (i > 0) {
      EXPECT_EQ(s.applied[0], 1.0);
    }
  }
  // Back at 12 mm: from there on, force and motion alike over 0.1 s, but for the first period, which has no force.
  s = at(0.012, false);
  EXPECT_DOUBLE_EQ(s.x.translation()[0], 0.33);
  EXPECT_EQ(rig.script.command[0], 0.0);
  s = at(0.013, false);
  EXPECT_EQ(s.applied[0], 0.0);
  EXPECT_NEAR(rig.script.command[0], 0.06, 1e-12);
  EXPECT_NEAR(s.x.translation()[0], 0.33 + 0.01 * 0.003, 1e-15);
  EXPECT_NEAR(s.v[0], 0.02 * 3.0, 1e-12);
  double before = rig.script.command[0];
  for (int i = 0; i < 120; ++i) {
    at(0.013, false);
    EXPECT_LE(rig.script.command[0] - before, 0.03 + 1e-12);
    before = rig.script.command[0];
  }
  EXPECT_DOUBLE_EQ(before, 3.0);
  EXPECT_NEAR(at(0.014, false).x.translation()[0], 0.33 + 0.01 * 0.003 + 0.003, 1e-12);
}

// Whatever the operator does with clutch, locks, scales and re-homing: in each tick the work at the hand is that of the force which
// the account takes for applied.
template <int N>
void keeps_energy() {
  std::mt19937 draw{7};
  std::normal_distribution<double> normal;
  DeviceMount m;
  m.clutch_button = 0;
  m.scale = 1.7;
  m.rotation = N == 1 ? Eigen::Quaterniond::Identity() : rotation({0.3, -0.2, 0.5});
  m.engage_s = 0.02;
  Rig<N> rig{m};
  using Vector = typename Force<N>::Vector;
  const auto any = [&](double size) {
    Vector v;
    for (int i = 0; i < N; ++i) v[i] = size * normal(draw);
    return v;
  };
  DeviceSample<N> before{};
  Position<N> hand_before;
  Vector held = Vector::Zero();
  double hand = 0.0, account = 0.0, yielded = 0.0;
  for (int k = 0; k < 5000; ++k) {
    const bool rehomed = rig.device.transformer()->rehomes();
    if (k % 50 == 49) {
      rig.script.sample.buttons = draw() % 4 == 0 ? 1u : 0u;
      rig.device.control({.clutched = draw() % 4 == 0,
                          .locked = static_cast<std::uint32_t>(draw() % 64),
                          .motion = 0.05 + 0.95 * static_cast<double>(draw() % 100) / 100.0,
                          .force = static_cast<double>(draw() % 101) / 100.0});
      if (draw() % 5 == 0) rig.device.rehome();
    }
    rig.script.sample.x = rig.script.sample.x + Displacement<N>{any(1e-3)};
    const DeviceSample<N> s = rig.tick(Force<N>{any(2.0)});
    if (k > 0) {
      const double at_hand = held.dot((rig.script.sample.x - hand_before).vec());
      const double booked = s.applied.vec().dot((s.x - before.x).vec());
      ASSERT_NEAR(at_hand, booked, 1e-12) << k;
      yielded += rehomed ? (s.x - before.x).vec().norm() : 0.0;
      hand += at_hand, account += booked;
    }
    held = rig.script.command.vec();
    hand_before = rig.script.sample.x;
    before = s;
  }
  EXPECT_NEAR(account, hand, 1e-10);
  EXPECT_GT(yielded, 1e-3);
}
TEST(Mounted, AccountsAreTheHandsUnderAnyUseOfTheControls) {
  keeps_energy<1>();
  keeps_energy<3>();
  keeps_energy<6>();
}

TEST(Mounted, LockedAxesStandAndScalesRamp) {
  DeviceMount m;
  m.engage_s = 0.01;
  Rig<6> rig{m};
  Force<6>::Vector f;
  f << 1.0, 2.0, 3.0, 0.1, 0.2, 0.3;
  rig.tick(Force<6>{f});
  rig.device.control({.locked = 0b100010});
  rig.tick(Force<6>{f});
  EXPECT_EQ(rig.script.command.vec(), (Force<6>::Vector{} << 1.0, 0.0, 3.0, 0.1, 0.2, 0.0).finished());
  rig.device.control({.locked = 0b100010, .motion = 0.5, .force = 0.8});
  const double most = 2.0 * 0.1 * f.norm();  // a tick of the ramps of ratio and force
  Force<6>::Vector before = rig.script.command.vec();
  for (int k = 0; k < 10; ++k) {
    rig.tick(Force<6>{f});
    EXPECT_LT((rig.script.command.vec() - before).norm(), most) << k;
    before = rig.script.command.vec();
  }
  EXPECT_LT((before - (Force<6>::Vector{} << 0.4, 0.0, 1.2, 0.08, 0.16, 0.0).finished()).norm(), 1e-12);
  const DeviceSample<6> a = rig.tick(Force<6>{f});
  rig.script.sample.x = rig.script.sample.x.moved({0.01, 0.02, 0.03}, {0.1, 0.0, 0.2});
  const DeviceSample<6> b = rig.tick(Force<6>{f});
  const Displacement<6> moved = b.x - a.x;
  EXPECT_LT((moved.vec() - (Force<6>::Vector{} << 0.005, 0.0, 0.015, 0.1, 0.0, 0.0).finished()).norm(), 1e-12);
  EXPECT_EQ(moved.vec()[1], 0.0);
  // What is out of range is left as it was.
  rig.device.control({.locked = 0, .motion = 0.0, .force = -1.0});
  rig.device.control({.motion = std::nan(""), .force = 2.0});
  EXPECT_EQ(rig.device.controls(), (HandControls{.motion = 0.5, .force = 0.8}));
}

TEST(Mounted, AClutchNeedsAButtonOfTheDevice) {
  const auto refused = [](int button, int buttons) -> std::string {
    DeviceMount m;
    m.clutch_button = button;
    try {
      const Rig<3> rig{m, {.name = "script", .max_force_n = 10.0, .mass_kg = 0.4, .buttons = buttons}};
    } catch (const ConfigError& e) {
      return e.what();
    }
    return "accepted";
  };
  EXPECT_EQ(refused(0, 0),
            "device_mount.clutch_button is 0, but the device (script) has 0 buttons; it must be -1, for none");
  EXPECT_EQ(
      refused(2, 2),
      "device_mount.clutch_button is 2, but the device (script) has 2 buttons; it must be from 0 to 1, or -1 for none");
  EXPECT_EQ(refused(1, 2), "accepted");
  EXPECT_EQ(refused(-1, 0), "accepted");
}

TEST(Mounted, ClutchKeepsTheAttitude) {
  DeviceMount m;
  m.clutch_button = 0;
  Rig<6> rig{m};
  rig.script.sample.x = Position<6>{{0.1, 0.0, 0.0}, rotation({0.4, 0.0, 0.0})};
  const DeviceSample<6> a = rig.tick();
  rig.script.sample.buttons = 1;
  rig.tick();
  rig.script.sample.x = Position<6>{{0.3, 0.2, 0.0}, rotation({0.0, -0.7, 0.2})};
  rig.tick();
  rig.script.sample.buttons = 0;
  for (int k = 0; k < 110; ++k) EXPECT_LT((rig.tick().x - a.x).vec().norm(), 1e-14);
  rig.script.sample.x = rig.script.sample.x.moved({0.0, 0.0, 0.01}, {0.01, 0.02, 0.03});
  const Displacement<6> moved = rig.tick().x - a.x;
  EXPECT_LT((moved.vec() - (Displacement<6>::Vector{} << 0.0, 0.0, 0.01, 0.01, 0.02, 0.03).finished()).norm(), 1e-12);
}

TEST(Mounted, LetsGoOfADeviceThatFallsSilent) {
  Rig<1> rig;
  const Force<1> f{Force<1>::Vector{2.0}};
  rig.tick(f);
  for (const bool not_finite : {false, true}) {
    const int released = rig.script.releases;
    for (int i = 0; i < 500; ++i) {
      if (not_finite) {
        rig.script.sample.v = Velocity<1>{Velocity<1>::Vector{std::numeric_limits<double>::quiet_NaN()}};
      } else {
        rig.script.sample.status = HardwareStatus::stale;
      }
      const DeviceSample<1> s = rig.tick(f);
      ASSERT_TRUE(all_finite(s.x, s.v, s.applied));
      ASSERT_EQ(s.status, HardwareStatus::stale);
      ASSERT_EQ(s.held, !not_finite && i < 249);
      if (i < (not_finite ? 0 : 249)) {
        ASSERT_EQ(rig.script.releases, released) << i;
      } else {
        ASSERT_EQ(rig.script.releases, released + 1) << i;  // once
      }
    }
    EXPECT_EQ(rig.script.command[0], 0.0);
    rig.script.sample.status = HardwareStatus::ok;
    rig.script.sample.v = Velocity<1>{};
    rig.tick(f);
    EXPECT_NEAR(rig.script.command[0], 0.02, 1e-12);  // 1 ms of the ramp of 0.1 s
    for (int i = 0; i < 110; ++i) rig.tick(f);
    EXPECT_EQ(rig.script.command[0], 2.0);
  }
}

TEST(Mounted, CoolsAMotorAtItsContinuousForce) {
  const double f_c = 2.0, f_max = 10.0;
  Rig<3> rig{DeviceMount{}, {.name = "hot", .max_force_n = f_max, .continuous_force_n = f_c}};
  double heat = 0.0, largest = 0.0;
  int full = 0;
  for (int i = 0; i < 100000; ++i) {
    heat += kPeriod / 10.0 * (rig.script.sample.applied.squared_norm() / (f_c * f_c) - heat);
    rig.tick(force(0.0, 6.0, 8.0));
    const double norm = std::sqrt(rig.script.command.squared_norm());
    ASSERT_NEAR(norm, std::min(f_max, f_c + (f_max - f_c) * std::min(1.0, 5.0 * (1.0 - heat))), 1e-9);
    ASSERT_LT((rig.script.command.vec() / norm - Eigen::Vector3d{0.0, 0.6, 0.8}).norm(), 1e-12);
    largest = std::max(largest, norm);
    full += norm > 9.999 ? 1 : 0;
  }
  EXPECT_EQ(largest, f_max);
  // Full force until the heat is 0.8: -10 s ln(1 - 0.8 f_c²/f_max²) = 325 ms.
  EXPECT_NEAR(full, 325, 2);
  EXPECT_NEAR(std::sqrt(rig.script.command.squared_norm()), f_c, 0.05);  // after 100 s; f_c is approached, not reached
  for (int i = 0; i < 30000; ++i) rig.tick(force(0.0, 1.5, 0.0));
  EXPECT_DOUBLE_EQ(rig.script.command[1], 1.5);  // below f_c nothing is taken

  Rig<3> without_peak{DeviceMount{}, {.name = "hot", .continuous_force_n = f_c}};
  without_peak.tick(force(0.0, 0.0, 5.0));
  EXPECT_EQ(without_peak.script.command[2], 5.0);
  for (int i = 0; i < 100000; ++i) without_peak.tick(force(0.0, 0.0, 5.0));
  EXPECT_NEAR(without_peak.script.command[2], f_c, 0.05);
}

TEST(Mounted, CarriesTheToolBesideTheForceAndBooksTheForceAlone) {
  DeviceMount m;
  m.rotation = rotation({M_PI / 2.0, 0.0, 0.0});  // the world's z is the device's y, backwards
  m.carried_force_n = {0.0, 0.0, 0.5};
  Rig<3> rig{m};
  rig.tick(force(1.0, 0.0, 0.0));
  EXPECT_LT((rig.script.command.vec() - Eigen::Vector3d{1.0, 0.5, 0.0}).norm(), 1e-15);
  EXPECT_LT((rig.tick().applied.vec() - Eigen::Vector3d{1.0, 0.0, 0.0}).norm(), 1e-15);
}

template <int N>
class Holding final : public Robot<N> {
 public:
  explicit Holding(RobotSample<N> sample) : sample_{sample} {}
  [[nodiscard]] RobotInfo info() const override { return {.name = "holding"}; }
  RobotSample<N> sense(const Tick<SlaveClock>&) noexcept override { return sample_; }
  void actuate(const RobotCommand<N>& c) noexcept override { command = c; }
  void release() noexcept override {}

  RobotCommand<N> command;

 private:
  RobotSample<N> sample_;
};

/// Follows positions late, before a wall at 20 mm.
class Late final : public Robot<3> {
 public:
  Late(double wall_n_per_m, const Servo& servo, bool sensor = true)
      : wall_{wall_n_per_m}, servo_{servo}, sensor_{sensor}, follower_{servo, {}} {}
  [[nodiscard]] RobotInfo info() const override {
    RobotInfo info{.name = "late", .has_force_sensor = sensor_};
    info.servo = servo_;
    return info;
  }
  RobotSample<3> sense(const Tick<SlaveClock>&) noexcept override {
    follower_.advance(wanted_, kPeriod);
    RobotSample<3> s;
    s.x = follower_.x();
    s.f_environment = force(std::max(0.0, wall_ * (s.x.translation().x() - 0.02)), 0.0, 0.0);
    return s;
  }
  void actuate(const RobotCommand<3>& command) noexcept override { wanted_ = command.x_d; }
  void release() noexcept override {}

 private:
  double wall_;
  Servo servo_;
  bool sensor_;
  sim::PositionServo<3> follower_;
  Position<3> wanted_;
};

/// A coupling of 1 kN/m that ends 20 mm behind the wall: both springs in series, less what the sensor does not count.
TEST(MountedRobot, HoldsAContactOfARobotThatObeysPositionsOnly) {
  const auto servo = [](double hz, double delay_s, double lag_s) {
    return Servo{.period = Seconds{1.0 / hz}, .delay = Seconds{delay_s}, .lag = Seconds{lag_s}};
  };
  for (const double wall : {3e3, 1e4, 2e4})
    for (const Servo& each :
         {servo(125, 0.004, 0.02), servo(125, 0.0, 0.04), servo(500, 0.002, 0.005), servo(500, 0.0, 0.012)}) {
      MountedRobot<3> robot{std::make_unique<Late>(wall, each), {}};
      double least = 1e9, most = 0.0;
      for (int k = 0; k < 10000; ++k) {
        const RobotSample<3> s = robot.sense({Instant<SlaveClock>{tick_time(k, 1.0 / kPeriod)}, Seconds{kPeriod}});
        const double wanted = std::min(0.04, 0.04 * k * kPeriod);
        robot.actuate(
            {.f = force(1000.0 * (wanted - s.x.translation().x()) - 20.0 * s.v[0], 0.0, 0.0), .x_d = {}, .v_d = {}});
        if (k < 8000) continue;
        least = std::min(least, s.f_environment[0]);
        most = std::max(most, s.f_environment[0]);
      }
      ASSERT_TRUE(robot.tool());
      EXPECT_NEAR(robot.tool()->translation().x(), 0.02 + most / wall, 1e-4);
      EXPECT_NEAR(most, 20.0 / (1.0 + 1000.0 / wall), 0.5) << wall << " N/m, lag " << each.lag.si();
      EXPECT_LT(most - least, 0.05) << wall << " N/m, lag " << each.lag.si();
    }
  EXPECT_THROW(MountedRobot<3>(std::make_unique<Late>(1e4, servo(125, 0.0, 0.02), false), {}), ConfigError);
}

/// A robot that was away for a while has stood where the body was not; a stretched coupling then pulls it slowly.
TEST(MountedRobot, TakesUpARobotWhereItIsAfterReadingsThatAreNotFinite) {
  struct Away final : Robot<3> {
    [[nodiscard]] RobotInfo info() const override {
      RobotInfo info{.name = "away"};
      info.servo = Servo{.period = Seconds{kPeriod}, .delay = Seconds{0.004}, .lag = Seconds{0.03}};
      return info;
    }
    RobotSample<3> sense(const Tick<SlaveClock>&) noexcept override {
      RobotSample<3> s;
      s.x = Position<3>{Eigen::Vector3d{away ? std::numeric_limits<double>::quiet_NaN() : x_m, 0.0, 0.0}};
      return s;
    }
    void actuate(const RobotCommand<3>&) noexcept override {}
    void release() noexcept override {}
    bool away = false;
    double x_m = 0.0;
  };
  auto owned = std::make_unique<Away>();
  Away& inner = *owned;
  MountedRobot<3> robot{std::move(owned), {}};
  RobotSample<3> s;
  const auto run = [&](int ticks) {
    for (int k = 0; k < ticks; ++k) {
      s = robot.sense({Instant<SlaveClock>{}, Seconds{kPeriod}});
      robot.actuate({.f = force(1000.0 * (0.1 - s.x.translation().x()), 0.0, 0.0), .x_d = {}, .v_d = {}});
    }
  };
  run(20);
  EXPECT_GT(s.v[0], 0.1);
  inner.away = true;
  run(1);
  EXPECT_EQ(s.v[0], 0.0);
  inner.away = false;
  inner.x_m = -0.1;
  run(1);
  EXPECT_EQ(s.x.translation().x(), -0.1);
  double fastest = 0.0;
  for (int k = 0; k < 2000; ++k, run(1)) fastest = std::max(fastest, s.v[0]);
  EXPECT_NEAR(s.x.translation().x(), 0.1, 1e-3);
  EXPECT_LT(fastest, 0.35);
}

TEST(MountedRobot, IsReleasedWhileItsReadingsAreNotFinite) {
  struct Blinking final : Robot<1> {
    [[nodiscard]] RobotInfo info() const override { return {.name = "blinking"}; }
    RobotSample<1> sense(const Tick<SlaveClock>&) noexcept override {
      RobotSample<1> s;
      s.x = Position<1>{Position<1>::Vector{0.5}};
      s.v = Velocity<1>{Velocity<1>::Vector{1.0}};
      if (++readings == 2) s.f_environment = Force<1>{Force<1>::Vector{std::numeric_limits<double>::infinity()}};
      return s;
    }
    void actuate(const RobotCommand<1>&) noexcept override { ++commands; }
    void release() noexcept override { ++releases; }
    int readings = 0, commands = 0, releases = 0;
  };
  auto owned = std::make_unique<Blinking>();
  Blinking& inner = *owned;
  MountedRobot<1> robot{std::move(owned), {}};
  for (int k = 1; k <= 3; ++k) {
    const RobotSample<1> s = robot.sense({Instant<SlaveClock>{tick_time(k, 1.0 / kPeriod)}, Seconds{kPeriod}});
    robot.actuate({});
    EXPECT_EQ(s.x.translation()[0], 0.5);
    EXPECT_EQ(s.f_environment[0], 0.0);
    EXPECT_EQ(s.status, k == 2 ? HardwareStatus::stale : HardwareStatus::ok);
    EXPECT_EQ(s.v[0], k == 2 ? 0.0 : 1.0);
    EXPECT_EQ(inner.commands, k == 3 ? 2 : 1);
    EXPECT_EQ(inner.releases, k == 1 ? 0 : 1);
  }
}

TEST(MountedRobot, TakesWeightAndBiasFromTheForceSensor) {
  RobotMount m;
  m.tool_mass_kg = 0.5;
  m.tool_center_m = {0.0, 0.02, 0.1};
  m.bias << 0.3, -0.2, 0.1, 0.01, 0.02, -0.03;
  const Eigen::Vector3d g{0.0, 0.0, -9.80665}, pressed{1.0, -2.0, 3.0}, torque{0.1, 0.2, -0.3};
  for (const Eigen::Vector3d& attitude : {Eigen::Vector3d{0.0, 0.0, 0.0}, Eigen::Vector3d{0.4, -1.1, 0.7}}) {
    const Eigen::Quaterniond q = rotation(attitude);
    RobotSample<6> s;
    s.x = Position<6>{{0.1, 0.2, 0.3}, q};
    // The sensor carries the tool: it pushes it up.
    Force<6>::Vector reading;
    reading.head<3>() = pressed - m.tool_mass_kg * g + q * Eigen::Vector3d{m.bias.head<3>()};
    reading.tail<3>() =
        torque + (q * m.tool_center_m).cross(-m.tool_mass_kg * g) + q * Eigen::Vector3d{m.bias.tail<3>()};
    s.f_environment = Force<6>{reading};
    const auto holding = std::make_shared<Holding<6>>(s);
    MountedRobot<6> robot{holding, m};
    const Force<6> f = robot.sense({Instant<SlaveClock>{Duration{0}}, Seconds{kPeriod}}).f_environment;
    EXPECT_LT((f.vec().head<3>() - pressed).norm(), 1e-12);
    EXPECT_LT((f.vec().tail<3>() - torque).norm(), 1e-12);
    robot.actuate({});
    EXPECT_LT((holding->command.not_of_environment.vec() - (reading - f.vec())).norm(), 1e-12)
        << "for a robot that counts the force by itself";
  }
}

/// A robot with a sensor that reads what the test says.
template <int N>
struct Touchy final : Robot<N> {
  [[nodiscard]] RobotInfo info() const override { return {.name = "touchy", .has_force_sensor = has_sensor}; }
  RobotSample<N> sense(const Tick<SlaveClock>&) noexcept override { return sample; }
  void actuate(const RobotCommand<N>&) noexcept override {}
  void release() noexcept override {}
  bool has_sensor = true;
  RobotSample<N> sample;
};
template <int N>
struct SensorRig {
  explicit SensorRig(bool has_sensor = true) : owned{std::make_unique<Touchy<N>>()} {
    owned->has_sensor = has_sensor;
    inner = owned.get();
    robot.emplace(std::move(owned), RobotMount{});
  }
  /// Runs for so long; the last reading. `each(k)` before every tick.
  template <class Each>
  Force<N> run(double seconds, Each each) {
    Force<N> f;
    for (int n = static_cast<int>(std::lround(seconds / kPeriod)); n > 0; --n) {
      each(++k);
      f = robot->sense({Instant<SlaveClock>{tick_time(k, 1.0 / kPeriod)}, Seconds{kPeriod}}).f_environment;
      robot->actuate({.f = coupling, .x_d = {}, .v_d = {}});
    }
    return f;
  }
  Force<N> run(double seconds) {
    return run(seconds, [](int) {});
  }
  ZeroAnswer ask() {
    robot->zero_sensor();
    run(0.6);
    return robot->sensor().answer;
  }
  std::unique_ptr<Touchy<N>> owned;
  Touchy<N>* inner;
  std::optional<MountedRobot<N>> robot;
  Force<N> coupling;
  int k = 0;
};
Force<6> wrench(double x, double y, double z, double about_x = 0.0) {
  Force<6>::Vector f;
  f << x, y, z, about_x, 0.0, 0.0;
  return Force<6>{f};
}

/// The drift is known before anybody asks, is taken away within 0.2 s without a jump, and turns with the tool.
TEST(SensorZero, TakesAwayWhatTheSensorReadsWithoutAPress) {
  SensorRig<6> rig;
  rig.inner->sample.f_environment = wrench(2.0, -1.0, 0.5, 0.02);
  EXPECT_EQ(rig.run(0.6).vec(), wrench(2.0, -1.0, 0.5, 0.02).vec());
  EXPECT_NEAR(rig.robot->sensor().drift_n, std::sqrt(5.25), 1e-9);
  EXPECT_EQ(rig.robot->sensor().answered, 0U);
  rig.robot->zero_sensor();
  rig.run(0.499);
  EXPECT_TRUE(rig.robot->sensor().asked);
  Force<6> last = rig.run(0.002);
  EXPECT_EQ(rig.robot->sensor().answer, ZeroAnswer::zeroed);
  for (int i = 0; i < 210; ++i) {
    const Force<6> f = rig.run(0.001);
    EXPECT_LT((f.vec() - last.vec()).norm(), 1.1 * std::sqrt(5.25) * kPeriod / 0.2);
    last = f;
  }
  EXPECT_LT(last.vec().norm(), 1e-9);
  EXPECT_NEAR(rig.robot->sensor().taken_n, std::sqrt(5.25), 1e-9);
  rig.run(0.6);
  EXPECT_LT(rig.robot->sensor().drift_n, 1e-9);
  // The tool is turned by a quarter about z: the same drift in its axes, and a press of 3 N.
  rig.inner->sample.x =
      Position<6>{Eigen::Vector3d::Zero(), rotation(Eigen::Vector3d{0.0, 0.0, 0.5 * 3.14159265358979})};
  Force<6>::Vector turned;
  turned << 1.0 + 3.0, 2.0, 0.5, 0.0, 0.02, 0.0;
  rig.inner->sample.f_environment = Force<6>{turned};
  EXPECT_LT((rig.run(0.001).vec() - wrench(3.0, 0.0, 0.0).vec()).norm(), 1e-9);
}

TEST(SensorZero, IsRefusedWhereAPressMayBeTaken) {
  using enum ZeroAnswer;
  SensorRig<3> rig;
  rig.inner->sample.f_environment = force(0.4, 0.0, 0.0);
  rig.coupling = force(0.4, 0.0, 0.0);
  rig.run(0.1);
  EXPECT_EQ(rig.ask(), presses);
  EXPECT_LT(rig.robot->sensor().drift_n, 0.0) << "what presses is no drift";
  rig.robot->release();
  rig.coupling = Force<3>{};
  rig.inner->sample.f_environment = force(0.0, 10.1, 0.0);
  EXPECT_EQ(rig.ask(), too_large);
  const auto ask_while = [&](auto each) {
    rig.robot->zero_sensor();
    rig.run(0.6, each);
    return rig.robot->sensor().answer;
  };
  EXPECT_EQ(ask_while([&](int k) { rig.inner->sample.f_environment = force(2e-3 * k, 0.0, 0.0); }), changes);
  rig.inner->sample.f_environment = force(1.0, 0.0, 0.0);
  EXPECT_EQ(ask_while([&](int k) { rig.inner->sample.x = position(1e-4 * k, 0.0, 0.0); }), moves);
  EXPECT_EQ(rig.robot->sensor().zeroed, 0U);
  EXPECT_EQ(rig.robot->sensor().answered, 4U);
  EXPECT_EQ(rig.run(0.3).vec(), force(1.0, 0.0, 0.0).vec()) << "nothing was taken away";
  // A noise of 1 N at rest is none of these.
  std::mt19937 draw{5};
  std::normal_distribution<double> noise{1.0, 1.0};
  EXPECT_EQ(ask_while([&](int) { rig.inner->sample.f_environment = force(noise(draw), 0.0, 0.0); }), zeroed);
  EXPECT_NEAR(rig.robot->sensor().taken_n, 1.0, 0.2);
  SensorRig<1> without{false};
  EXPECT_EQ(without.ask(), no_sensor);
  SensorRig<kJointPort> arm;
  EXPECT_EQ(arm.ask(), joints);
}

/// Readings that are none restart the half second.
TEST(SensorZero, WaitsForReadings) {
  SensorRig<1> rig;
  rig.inner->sample.f_environment = Force<1>{Force<1>::Vector{0.7}};
  rig.run(0.3);
  rig.robot->zero_sensor();
  rig.inner->sample.status = HardwareStatus::stale;
  rig.run(1.0);
  EXPECT_TRUE(rig.robot->sensor().asked);
  rig.inner->sample.status = HardwareStatus::ok;
  rig.run(0.75);
  EXPECT_EQ(rig.robot->sensor().answer, ZeroAnswer::zeroed);
  EXPECT_NEAR(rig.run(0.001)[0], 0.0, 1e-12);
}

// A force that is carried has three axes. What stands behind it in memory is none.
TEST(MountedDevice, CarriesNothingAtJoints) {
  struct {
    DeviceMount mount;
    std::array<double, 8> behind;
  } all;
  all.behind.fill(1.0);
  Rig<kJointPort> rig{all.mount};
  for (int k = 0; k < 5; ++k) rig.tick();
  EXPECT_GT(rig.script.commands, 0);
  EXPECT_EQ(rig.script.command.vec().norm(), 0.0) << rig.script.command.vec().transpose();
}

}  // namespace
}  // namespace twoport::mounted_test
