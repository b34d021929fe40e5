#include "common/hardware/adjustable_environment.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>

#include "common/base/time.h"
#include "common/scene/load.h"
#include "drivers/drivers.h"
#include "sim/sim_robot.h"
#include "tests/support/no_alloc.h"

namespace twoport::adjustable_environment_test {
namespace {

constexpr double kPeriod = 1e-3;

Scene scene(int dof, const std::string& blocks) {
  return parse_scene("dof: " + std::to_string(dof) + " duration_s: 1 rate_hz: 1000 " + blocks, "test");
}

// ---- the law: a change of stiffness does the work that it says

/// Departure of kinetic and elastic energy from the start and the work of the changes, relative to the largest energy: a mass bounces
/// on a wall whose stiffness follows a sine, without dissipation.
template <int N>
double unexplained(const std::string& simulation) {
  constexpr double kMass = 0.5;
  const std::string wall = N == 1 ? "normal: [-1] offset_m: 0" : "normal: [-1, 0, 0] offset_m: 0";
  const std::string start = N == 1   ? "position_m: [0.002] velocity_m_per_s: [0.1]"
                            : N == 3 ? "position_m: [0.002, 0, 0] velocity_m_per_s: [0.1, 0.05, 0]"
                                     : "inertia_kg_m2: [1e-3, 1e-3, 1e-3] position_m: [0.002, 0, 0]";
  const std::string tool = N == 6 ? "tool { contact_point { position_m: [0, 0, 0] } }" : "";
  sim::SimRobot<N> robot{scene(N, "robot { mass_kg: 0.5 " + start + " } environment { wall { " + wall +
                                      " stiffness_n_per_m: 1000 } } environment { spring { anchor_m: [0" +
                                      (N == 1 ? "" : ", 0, 0") + "] stiffness_n_per_m: 50 } } " + tool + simulation),
                         Seconds{kPeriod}};
  const auto energy = [&] {
    const auto v = robot.state().v.vec();
    return 0.5 * kMass * v.template head<(N == 1 ? 1 : 3)>().squaredNorm() +
           robot.environment().potential(robot.state().x).si();
  };
  const double before = energy();
  double work = 0.0, largest = before, worst = 0.0, moved = 0.0;
  for (int k = 0; k < 2000; ++k) {
    const double d = robot.set_surface(0, 1000.0 * (1.0 + 0.9 * std::sin(0.05 * k)), 0.0).si();
    work += d;
    moved = std::max(moved, std::abs(d));
    robot.advance();
    largest = std::max(largest, energy());
    worst = std::max(worst, std::abs(energy() - before - work));
  }
  EXPECT_GT(moved, 1e-5) << "the changes do work";
  return worst / largest;
}

// The exact maps err by rounding; the others by their own tolerance.
TEST(SetSurface, ChangesTheEnergyByTheWorkThatItReturns) {
  EXPECT_LT(unexplained<1>(""), 1e-10);
  EXPECT_LT(unexplained<3>(""), 1e-10);
  EXPECT_LT(unexplained<6>(""), 1e-6);
  EXPECT_LT(unexplained<1>("simulation { integrator: DORMAND_PRINCE }"), 1e-4);
  EXPECT_LT(unexplained<3>("simulation { integrator: DORMAND_PRINCE }"), 1e-4);
  EXPECT_LT(unexplained<3>("simulation { integrator: RK4 substeps: 50 }"), 1e-4);
}

/// The path of a robot whose wall was changed before it began is that of one built with that wall.
template <int N>
void expect_as_built(const std::string& simulation, double friction, double tolerance) {
  const auto robot = [&](double stiffness, double mu) {
    const std::string axes = N == 1 ? "]" : ", 0, 0]";
    const std::string aside = N == 1 ? "]" : ", 0.05, 0]";
    return sim::SimRobot<N>{
        scene(N, "robot { mass_kg: 0.5 position_m: [0.001" + axes + " velocity_m_per_s: [0.1" + aside +
                     " } environment { wall { normal: [-1" + axes + " stiffness_n_per_m: " + std::to_string(stiffness) +
                     " damping_n_s_per_m: 3 friction: " + std::to_string(mu) + " } } " + simulation),
        Seconds{kPeriod}};
  };
  sim::SimRobot<N> built = robot(4000.0, friction), changed = robot(700.0, friction > 0.0 ? 0.1 : 0.0);
  changed.set_surface(0, 4000.0, friction);
  for (int k = 0; k < 200; ++k) {
    built.advance(), changed.advance();
    for (int i = 0; i < N; ++i) {
      ASSERT_NEAR(changed.state().x.translation()[i], built.state().x.translation()[i], tolerance) << k;
      ASSERT_NEAR(changed.environment_force()[i], built.environment_force()[i], 1e5 * tolerance) << k;
    }
  }
}

TEST(SetSurface, MakesTheRobotThatWouldHaveBeenBuilt) {
  expect_as_built<1>("", 0.0, 1e-15);
  expect_as_built<3>("", 0.0, 1e-15);
  expect_as_built<3>("", 0.4, 1e-15);
  expect_as_built<3>("environment { wall { normal: [0, 1, 0] offset_m: -1 stiffness_n_per_m: 1 } }", 0.4, 1e-15);
  expect_as_built<3>("simulation { integrator: DORMAND_PRINCE }", 0.4, 1e-9);
  expect_as_built<3>("simulation { integrator: RK4 substeps: 4 }", 0.4, 1e-15);
}

// ---- the simulated robot as the slave has it

template <int N>
struct Rig {
  explicit Rig(const std::string& blocks)
      : robot{all_drivers().robots.open<N>("sim", scene(N, blocks), Seconds{kPeriod})} {
    robot->start();
  }
  void tick(int ticks = 1) {
    for (int k = 0; k < ticks; ++k, ++at) {
      robot->sense({Instant<SlaveClock>{tick_time(at, 1.0 / kPeriod)}, Seconds{kPeriod}, Seconds{kPeriod}});
      robot->actuate({.f = Force<N>{5.0 * Force<N>::Vector::Unit(0)}, .x_d = {}, .v_d = {}});
    }
  }
  EnvironmentMessage state() {
    EnvironmentMessage m;
    robot->environment()->describe(m);
    return m;
  }
  std::unique_ptr<Robot<N>> robot;
  std::int64_t at = 0;
};

const std::string kWall1 =
    "robot { mass_kg: 0.5 damping_n_s_per_m: 20 } environment { wall { normal: [-1] stiffness_n_per_m: 1000 } }";
const std::string kWalls3 =
    "robot { mass_kg: 0.5 damping_n_s_per_m: 20 } environment { wall { normal: [-1, 0, 0] stiffness_n_per_m: 1000 "
    "friction: "
    "0.3 } } environment { spring { anchor_m: [0, 0, 0] stiffness_n_per_m: 1 } } environment { sphere { center_m: [0, "
    "1, 0] "
    "radius_m: 0.1 stiffness_n_per_m: 500 } }";

// 5 N rest 5 mm deep; from 1000 to 2000 N/m that is 1000 (5 mm)²/2 = 12.5 mJ at once, and 8.5 mJ where the mass yields meanwhile
// as fast as the ramp: ∫ (5 N)²/(2 K²) dK = 6.25 mJ.
TEST(AdjustableEnvironment, IsChangedWithinATenthOfASecondAndItsWorkIsCounted) {
  Rig<1> rig{kWall1};
  rig.tick(3000);
  ASSERT_TRUE(rig.robot->environment()->adjust({.number = 2, .count = 1, .surface = {{{2000.0, -1.0}}}}));
  rig.tick();
  const double soon = rig.state().surface[0].stiffness_n_per_m;
  EXPECT_NEAR(soon, 1010.0, 1e-9) << "a hundredth of the ramp";
  rig.tick(98);
  EXPECT_LT(rig.state().surface[0].stiffness_n_per_m, 2000.0);
  rig.tick(2);
  EXPECT_EQ(rig.state().surface[0].stiffness_n_per_m, 2000.0);
  EXPECT_GT(rig.state().energy_j, 6.25e-3);
  EXPECT_LT(rig.state().energy_j, 12.5e-3);
  rig.tick(3000);
  EXPECT_NEAR(rig.robot->truth()->f_environment[0], -5.0, 1e-6);
  // And back: about as much is taken out again.
  rig.robot->environment()->adjust({.number = 3, .count = 1, .surface = {{{1000.0, -1.0}}}});
  rig.tick(3000);
  EXPECT_LT(std::abs(rig.state().energy_j), 6e-3);
}

TEST(AdjustableEnvironment, TellsItsSurfacesInTheScenesOrder) {
  Rig<3> rig{kWalls3};
  EnvironmentMessage m = rig.state();
  EXPECT_EQ(m.answer, EnvironmentAnswer::adjustable);
  ASSERT_EQ(m.count, 2);
  EXPECT_EQ(m.surface[0].stiffness_n_per_m, 1000.0);
  EXPECT_EQ(m.surface[0].friction, 0.3);
  EXPECT_EQ(m.surface[1].stiffness_n_per_m, 500.0);
  m.surface[0].friction = 0.6, m.surface[1].stiffness_n_per_m = 800.0;
  ASSERT_TRUE(rig.robot->environment()->adjust(m));
  rig.tick(101);
  EXPECT_EQ(rig.state().surface[0].friction, 0.6);
  EXPECT_EQ(rig.state().surface[0].stiffness_n_per_m, 1000.0);
  EXPECT_EQ(rig.state().surface[1].stiffness_n_per_m, 800.0);
  EXPECT_EQ(rig.state().energy_j, 0.0) << "nothing touches the sphere, and friction stores nothing";
}

TEST(AdjustableEnvironment, RefusesWhatNoSceneMayHave) {
  Rig<3> rig{kWalls3};
  const auto accepts = [&](double stiffness, double friction, int count = 1) {
    return rig.robot->environment()->adjust({.number = 2,
                                             .count = static_cast<std::uint8_t>(count),
                                             .surface = {{{stiffness, friction}, {1.0, 0.0}, {1.0, 0.0}}}});
  };
  EXPECT_FALSE(accepts(0.0, 0.1));
  EXPECT_FALSE(accepts(-5.0, 0.1));
  EXPECT_FALSE(accepts(2.0 * kSurfaceStiffnessMost, 0.1));
  EXPECT_FALSE(accepts(100.0, -0.1));
  EXPECT_FALSE(accepts(100.0, 1.1 * kSurfaceFrictionMost));
  EXPECT_FALSE(accepts(100.0, 0.1, 3)) << "there are two";
  rig.tick(200);
  EXPECT_EQ(rig.state().surface[0].stiffness_n_per_m, 1000.0);
  EXPECT_EQ(rig.state().surface[0].friction, 0.3);
}

TEST(AdjustableEnvironment, LeavesASurfaceBeyondTheLimitsOfARequestAsItIs) {
  Rig<3> rig{
      "robot { mass_kg: 0.5 } environment { wall { normal: [-1, 0, 0] stiffness_n_per_m: 2e6 friction: 3 } } "
      "environment { wall { normal: [0, -1, 0] stiffness_n_per_m: 1000 friction: 0.3 } }"};
  EnvironmentMessage m = rig.state();
  m.surface[1].stiffness_n_per_m = 3000.0;
  EXPECT_TRUE(rig.robot->environment()->adjust(m)) << "the other surface is changed";
  m.surface[0].stiffness_n_per_m = 1e6;
  EXPECT_TRUE(rig.robot->environment()->adjust(m)) << "its friction is as before";
  rig.tick(101);
  EXPECT_EQ(rig.state().surface[0].stiffness_n_per_m, 1e6);
  EXPECT_EQ(rig.state().surface[0].friction, 3.0);
  EXPECT_EQ(rig.state().surface[1].stiffness_n_per_m, 3000.0);
  m.surface[0].stiffness_n_per_m = 2e6;
  EXPECT_FALSE(rig.robot->environment()->adjust(m)) << "no longer as it is";
}

TEST(AdjustableEnvironment, SaysWhereFrictionCannotBeChanged) {
  EXPECT_LT(Rig<1>{kWall1}.state().surface[0].friction, 0.0) << "a line has none";
  const std::string wall = "robot { mass_kg: 0.5 } environment { wall { normal: [-1, 0, 0] stiffness_n_per_m: 1000 ";
  Rig<3> viscous{wall + "viscous_friction_n_s_per_m: 1 } }"}, smooth{wall + "} }"};
  EXPECT_LT(viscous.state().surface[0].friction, 0.0) << "the exact maps know one kind of friction";
  EXPECT_TRUE(viscous.robot->environment()->adjust({.number = 2, .count = 1, .surface = {{{1500.0, -1.0}}}}));
  EXPECT_EQ(smooth.state().surface[0].friction, 0.0);
  EXPECT_TRUE(smooth.robot->environment()->adjust({.number = 2, .count = 1, .surface = {{{1500.0, 0.3}}}}));
  Rig<1> empty{"robot { mass_kg: 0.5 }"};
  EXPECT_EQ(empty.state().answer, EnvironmentAnswer::no_surface);
  EXPECT_EQ(empty.state().count, 0);
}

TEST(AdjustableEnvironment, DoesNotAllocate) {
  Rig<3> rig{kWalls3};
  rig.tick(10);
  EnvironmentMessage m = rig.state();
  m.surface[0] = {3000.0, 0.8};
  const NoAlloc guard;
  rig.robot->environment()->adjust(m);
  rig.tick(200);
  m = rig.state();
  EXPECT_EQ(guard.seen(), 0);
}

}  // namespace
}  // namespace twoport::adjustable_environment_test
