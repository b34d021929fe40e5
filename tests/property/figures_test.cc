// What the summary says of a whole run, against what statics, the link and the rows themselves say.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <string>
#include <utility>
#include <vector>

#include "common/base/built_for.h"
#include "common/record/summary.h"
#include "common/scene/load.h"
#include "lab/engine/simulation.h"
#include "lab/run.h"
#include "tests/support/known_numbers.h"

namespace twoport::lab::figures_test {
namespace {

constexpr double kHand = 400.0, kCoupling = 1000.0, kWall = 5000.0;  // [N/m]

/// A hand moves 30 mm towards a wall that is 10 mm away, and presses it to the end. Quiet at any scale: the force that
/// comes back is small, or the way is short.
std::string press_and(const std::string& then) {
  const std::string begin = R"(
  dof: 1 duration_s: 6 rate_hz: 2000
  operator {
    hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 }
    path { hold { duration_s: 0.5 } }
    path { move_to { position_m: [0.03] duration_s: 1 } })",
                    end = R"(
  }
  device { mass_kg: 0.075 damping_n_s_per_m: 0.05 }
  control { architecture: POSITION_FORCE
            virtual_coupling { stiffness_n_per_m: 1000 damping_n_s_per_m: 20 } passivity { method: NONE } }
  to_slave { delay_ms: 2 } to_master { delay_ms: 3 }
  robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { } }
  environment { wall { normal: [-1] offset_m: -0.01 stiffness_n_per_m: 5000 } }
)";
  return begin + then + end;
}
const std::string kPress = press_and("");

Summary summary(const std::string& scene, const std::vector<std::string>& set = {}) {
  return run(parse_scene(scene, "press", set));
}

TEST(Figures, OfAHeldPressAreThoseOfStatics) {
  for (const double force_scale : {1.0, 0.5}) {
    // Coupling and wall in series move by F/Kc + F/Kw, the hand by s_f F/Kh:  30 mm - 10 mm = F (s_f/Kh + 1/Kc + 1/Kw)
    const double f = 0.02 / (force_scale / kHand + 1.0 / kCoupling + 1.0 / kWall);
    const std::vector<std::string> set{"duration_s=60", "control.force_scale=" + std::to_string(force_scale)};
    const Summary s = summary(kPress, set);
    EXPECT_TRUE(s.stable()) << s.verdict();
    EXPECT_NEAR(s.held_force_ratio(), 1.0, 1e-6);  // at rest for a minute
    EXPECT_EQ(s.muted_share(), 0.0);
    // The approach, a second of sixty, is in the mean.
    EXPECT_NEAR(s.environment_force_mean_n(), f, 0.02 * f);
    EXPECT_NEAR(s.penetration_max_m(), f / kCoupling, 0.1 * f / kCoupling);
    EXPECT_NEAR(s.robot_max_force_n(), f, 0.1 * f);
  }
}

TEST(Figures, AreTheSameWhereverTheRobotStands) {
  const Summary here = summary(kPress),
                there = summary(kPress, {"robot.position_m=[0.3]", "environment[0].wall.offset_m=-0.31"});
  EXPECT_NEAR(there.penetration_max_m(), here.penetration_max_m(), 1e-9);
  EXPECT_NEAR(there.felt_force_error_rms_n(), here.felt_force_error_rms_n(), 1e-9);
}

TEST(Figures, OfAPressDoNotImproveWithIdleTime) {
  // The hand waits before it presses, and lets go after it: seconds or minutes.
  const std::string then = "path { hold { duration_s: 2 } } path { move_to { position_m: [0] duration_s: 1 } }";
  const Summary brief = summary(press_and(then)), idle = summary(press_and(then), {"duration_s=60"});
  EXPECT_LT(idle.force_error_rms_n(), 0.5 * brief.force_error_rms_n() + 1e-12);
  EXPECT_NEAR(idle.felt_force_error_rms_n(), brief.felt_force_error_rms_n(), 1e-9);
  EXPECT_NEAR(idle.environment_force_mean_n(), brief.environment_force_mean_n(), 1e-9);
  EXPECT_NEAR(idle.held_force_ratio(), brief.held_force_ratio(), 1e-9);
  EXPECT_GT(idle.free_force_rms_n(), 0.0);
}

TEST(Figures, OfALatePressDoNotImproveHoweverLongItIsHeld) {
  // The felt force is not the environment's: the error of a press for 100 s is that of 10 s but for the approach, which is
  // a tenth of the first.
  std::vector<std::string> set{"control.passivity.method=FORCE_PROJECTED", "to_slave.delay_ms=50",
                               "to_master.delay_ms=50", "duration_s=10"};
  const Summary ten = summary(kPress, set);
  set.back() = "duration_s=100";
  const Summary hundred = summary(kPress, set);
  EXPECT_GT(std::abs(hundred.held_force_ratio() - 1.0), 0.1);
  EXPECT_GT(hundred.felt_force_error_rms_n(), 0.9 * ten.felt_force_error_rms_n());
  EXPECT_GT(hundred.muted_share(), 0.9 * ten.muted_share());
}

TEST(Figures, OfAHeldForceAreMeansBeforeTheHandRetreatsOrTheRunEnds) {
  // Of shipped scenes: when the last rest ends in which the robot touches [s], and the tenth of a second before.
  const auto means_before = [](const Scene& scene, double end_s, double& felt, double& reference) {
    return for_dof(scene.dof, [&]<int N>() {
      Eigen::VectorXd f = Eigen::VectorXd::Zero(N), r = f;
      bool touching = true;
      make_simulation<N>(scene)->run([&](const Row<N>& row) {
        if (row.t_s < end_s - 0.1 - 1e-9 || row.t_s >= end_s - 1e-9) return true;
        f += row.master_f.vec();
        r += row.reference.vec();
        touching = touching && row.touching;
        return true;
      });
      felt = f.head(N == 6 ? 3 : N).norm();
      reference = r.head(N == 6 ? 3 : N).norm();
      return touching;
    });
  };
  for (const auto& [name, end_s] : {std::pair{"one_axis_wall", 3.0},
                                    {"demo", 6.5},
                                    {"two_rates", 8.0},
                                    {"measured_force_50ms", 8.0},
                                    {"render_box", 4.0},
                                    {"six_dof_render", 6.0}}) {
    const Scene scene = load_scene(std::string{TWOPORT_SCENES "/"} + name + ".textproto");
    double felt = 0.0, reference = 0.0;
    ASSERT_TRUE(means_before(scene, end_s, felt, reference)) << name;
    EXPECT_NEAR(run(scene).held_force_ratio(), felt / reference, 1e-12) << name;
  }
  // Hand and felt force balance: 400 N/m hold the handle 3.8 mm from where the hand wants it.
  EXPECT_NEAR(run(load_scene(TWOPORT_SCENES "/one_axis_wall.textproto")).held_force_ratio(), 1.0, 0.03);
}

/// Nothing that is felt moves the handle, which is led into a wall. The sensor's force comes back as it is.
std::string led(const std::string& to) {
  return R"( rate_hz: 2000 duration_s: 3
  control { architecture: POSITION_MEASURED_FORCE passivity { method: NONE } }
  to_slave { delay_ms: 2 }
  operator { path { hold { duration_s: 0.5 } } path { move_to { position_m: )" +
         to + R"( duration_s: 1 } }
             path { sine { axis: 0 amplitude_m: 0.004 frequency_hz: 3 duration_s: 2 } } }
)";
}

TEST(Figures, TakeTheEnvironmentsForceAsOldAsTheWayBackMakesIt) {
  // What is felt is the environment's force of one delay ago, to rounding.
  const std::string
      one = "dof: 1" + led("[0.02]") +
            "robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { } } "
            "environment { wall { normal: [-1] offset_m: -0.01 stiffness_n_per_m: 2000 } }",
      three = "dof: 3" + led("[0.02, 0.01, 0]") +
              "robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { } } "
              "environment { wall { normal: [-1, 0.3, 0] offset_m: -0.01 stiffness_n_per_m: 2000 friction: 0.3 } }";
  for (const std::string& scene : {one, three})
    for (const char* back : {"delay_ms=0", "delay_ms=3", "delay_ms=3.3", "delay_ms=40", "jitter_ms=5", "loss=0.3"})
      for (const char* rates : {"2000", "500", "1700"}) {
        const Summary s = summary(scene, {std::string{"to_master."} + back, std::string{"slave_rate_hz="} + rates,
                                          "control.force_scale=0.5"});
        EXPECT_GT(s.environment_force_mean_n(), 1.0);
        EXPECT_LT(s.felt_force_error_rms_n(), 1e-12) << back << ", slave at " << rates << " Hz";
        EXPECT_LT(s.muted_share(), 0.02);  // until the news of the first touch
      }
}

TEST(Figures, HeldForceIsScaledWhereverPositionsAreDisplayed) {
  for (const char* displays : {"architecture=POSITION_POSITION", "passivity.method=FIXED_DAMPING",
                               "passivity.method=SET_POSITION_MODULATION", "passivity.method=FRACTAL_IMPEDANCE"})
    for (const auto& [force, motion] : {std::pair{"1", "0.6"}, std::pair{"3", "0.6"}}) {
      const Summary s =
          summary(kPress, {std::string{"control."} + displays, std::string{"control.force_scale="} + force,
                           std::string{"control.motion_scale="} + motion, "operator.path[1].move_to.position_m=[0.01]",
                           "environment[0].wall.offset_m=-0.003"});
      EXPECT_GT(s.environment_force_mean_n(), 0.1);
      EXPECT_NEAR(s.held_force_ratio(), 1.0, 1e-3) << displays << " " << force << " " << motion;
    }
}

TEST(Figures, TakeTorquesAsOldAsTheWayBackMakesThem) {
  const Summary s = summary("dof: 6" + led("[0.02, 0, 0]") + R"(
    to_master { delay_ms: 5 }
    robot { mass_kg: 0.5 damping_n_s_per_m: 2 inertia_kg_m2: [1e-3, 1e-3, 1e-3] rotational_damping_n_m_s_per_rad: 0.01 force_sensor { } }
    tool { contact_point { position_m: [0, 0.03, 0] } }
    environment { wall { normal: [-1, 0, 0] offset_m: -0.01 stiffness_n_per_m: 500 } })");
  EXPECT_GT(s.environment_force_mean_n(), 0.1);
  EXPECT_LT(s.felt_force_error_rms_n(), 1e-12);
  EXPECT_LT(s.felt_torque_error_rms_n_m(), 1e-12);
  EXPECT_LT(s.torque_direction_error_max_deg(), 1e-9);
  EXPECT_GT(s.torque_chatter_rms_n_m(), 0.0);
  EXPECT_GT(s.attitude_error_rms_rad(), 1e-3);  // the wall turns the tool
}

TEST(Figures, OfALinkThatIsSilentBothWaysSayNothingGood) {
  const Summary s = summary(kPress, {"to_slave.loss=1", "to_master.loss=1"});
  EXPECT_EQ(s.coupled_share(), 0.0);
  EXPECT_EQ(s.touching_share(), 0.0);
  EXPECT_EQ(violations({.stable = {},
                        .at_least = {{"touching_share", 0.1}},
                        .at_most = {{"felt_force_error_rms_n", 10.0},
                                    {"position_error_rms_m", 10.0},
                                    {"drift_m", 10.0},
                                    {"free_force_rms_n", 10.0},
                                    {"force_direction_error_max_deg", 180.0},
                                    {"muted_share", 1.0},
                                    {"penetration_max_m", 1.0}}},
                       s)
                .size(),
            9u);  // each of these, and that it was not coupled at the end
}

/// A dead direction ends no coupling.
const std::string kNoRelease[] = {"control.release_after_s=2000", "control.hold_after_s=1000"};

TEST(Figures, OfALinkThatIsSilentOnTheWayBackCallItMuted) {
  const Summary s = summary(kPress, {"to_master.loss=1", kNoRelease[0], kNoRelease[1]});
  const double f = 0.02 / (1.0 / kCoupling + 1.0 / kWall);  // the hand feels nothing and goes all the way
  EXPECT_EQ(s.coupled_share(), 0.0);
  EXPECT_GT(s.muted_share(), 0.999);
  EXPECT_LT(s.held_force_ratio(), 1e-12);
  EXPECT_NEAR(s.felt_force_error_rms_n(), f, 0.1 * f);
  EXPECT_GT(s.position_error_rms_m(), 0.01);  // the slave follows, and hangs behind the wall
}

TEST(Figures, OfABlackoutDoNotCompareWhatIsHeldWithWhatWas) {
  // The way back dies while the hand presses. For a second both sides hold: the robot presses, and the hand feels nothing of it.
  const std::string then = "path { hold { duration_s: 1 } } path { move_to { position_m: [0.05] duration_s: 0.5 } }";
  const std::vector<std::string> dead{"to_master.blackout=[{ start_s: 2.5 duration_s: 100 }]"};
  const Summary alive = summary(press_and(then)), silent = summary(press_and(then), dead);
  EXPECT_LT(alive.felt_force_error_rms_n(), 1.0);
  EXPECT_GT(silent.felt_force_error_rms_n(), 5.0);
  EXPECT_NEAR(silent.muted_share(), 0.9 / 2.7, 0.05);
}

TEST(Figures, RenderedForceIsTheEnvironmentsOwn) {
  const Summary s = run(load_scene(TWOPORT_SCENES "/render_wall_none.textproto"));
  double sum = 0.0, most = 0.0;
  std::uint64_t touching = 0, rows = 0;
  const Scene scene = load_scene(TWOPORT_SCENES "/render_wall_none.textproto");
  make_simulation<3>(scene)->run([&](const Row<3>& row) {
    const double f = row.env_f.vec().norm();
    sum += f, most = std::max(most, f), touching += f > 0.0, ++rows;
    return true;
  });
  EXPECT_GT(touching, 0u);
  EXPECT_NEAR(s.environment_force_mean_n(), sum / static_cast<double>(touching), 1e-9);
  EXPECT_NEAR(s.touching_share(), static_cast<double>(touching) / static_cast<double>(rows), 1e-12);
  for (const auto& [name, value] : known_numbers(s))
    if (name == "coupled_share" || name == "position_error_rms_m" || name == "penetration_max_m" ||
        name == "robot_max_force_n" || name == "two_port_min_energy_j" || name == "packets.to_slave.sent" ||
        name == "rtt_ms.p50" || name == "deadline_misses") {
      EXPECT_FALSE(value) << name;
    }
}

// --- energies ------------------------------------------------------------------------------------

/// Integrals of the rows' own forces and motions.
struct Ports {
  double hand = 0.0, two_port = 0.0, coupling = 0.0;
};
Ports least_energies(const Scene& scene, std::uint64_t rows) {
  Ports least;
  const double scale = scene.control.force_scale / scene.control.motion_scale;
  double hand = 0.0, robot = 0.0, into_link = 0.0;
  std::deque<Row<1>> before;
  make_simulation<1>(scene)->run([&](const Row<1>& row) {
    if (!before.empty()) {
      const Row<1>& b = before.back();
      hand += dot(b.master_f, row.master_x - b.master_x).si();
      robot += dot(b.slave_f, row.slave_x - b.slave_x).si();
      into_link = b.slave_energy_j;
    }
    least.hand = std::min(least.hand, hand);
    least.two_port = std::min(least.two_port, hand - scale * row.slave_energy_j);
    least.coupling = std::min(least.coupling, into_link - robot);
    before.assign(1, row);
    return --rows > 0;
  });
  return least;
}

TEST(Energies, AreThoseOfTheRowsAtAnyScale) {
  for (const char* scales : {"1 1", "5 0.2", "0.2 5", "5 1"}) {
    const std::string text{scales};
    const std::string force = text.substr(0, text.find(' ')), motion = text.substr(text.find(' ') + 1);
    for (const char* method : {"NONE", "FORCE_PROJECTED"}) {
      const std::vector<std::string> set{"control.force_scale=" + force,
                                         "control.motion_scale=" + motion,
                                         std::string{"control.passivity.method="} + method,
                                         "to_slave.delay_ms=20",
                                         "to_master.delay_ms=20",
                                         "duration_s=3"};
      const Scene scene = parse_scene(kPress, "press", set);
      const Summary s = run(scene);
      const Ports least = least_energies(scene, s.steps());
      const double tolerance = 1e-9 * std::max(1.0, std::abs(least.two_port));
      EXPECT_NEAR(s.hand_min_energy_j(), least.hand, tolerance) << scales << method;
      EXPECT_NEAR(s.two_port_min_energy_j(), least.two_port, tolerance) << scales << method;
      EXPECT_NEAR(s.robot_min_energy_j(), least.coupling, tolerance) << scales << method;
      // The hand's own grant, whatever the scales are and whatever the robot holds.
      EXPECT_EQ(s.initial_energy_j(), 1e-3);
      EXPECT_EQ(s.min_port_energy_j(), 1e-3 + s.hand_min_energy_j());
    }
  }
}

TEST(Energies, OfACouplingThatFeedsTheRobotAreThoseOfTheRows) {
  const std::vector<std::string> set{"rate_hz=100",
                                     "to_slave.delay_ms=10",
                                     "to_master.delay_ms=10",
                                     "duration_s=4",
                                     "control.passivity.method=FORCE_PROJECTED",
                                     "control.virtual_coupling.damping_n_s_per_m=99"};
  const Scene scene = parse_scene(kPress, "press", set);
  const Summary s = run(scene);
  const Ports least = least_energies(scene, s.steps());
  EXPECT_LT(least.coupling, -0.1);
  EXPECT_NEAR(s.robot_min_energy_j(), least.coupling, 1e-9 * std::abs(least.coupling));
}

TEST(Energies, DoNotCountWhatTheRobotHoldsAsGivenToTheHand) {
  const Summary s = summary(kPress, {"robot.position_m=[0.02]", "robot.velocity_m_per_s=[0.5]"});
  EXPECT_EQ(s.initial_energy_j(), 1e-3);
  EXPECT_EQ(s.min_port_energy_j(), 1e-3 + s.hand_min_energy_j());
}

TEST(Energies, SayWhenTheSampledCouplingFeedsTheRobot) {
  // At 100 Hz, B T/m = 2 is the limit of a free mass; at 20 kN/m the spring is far beyond it. The hand's port is passive
  // all the while.
  const std::vector<std::string> slow{"rate_hz=100", "to_slave.delay_ms=10", "to_master.delay_ms=10", "duration_s=4",
                                      "control.passivity.method=FORCE_PROJECTED"};
  for (const char* active : {"damping_n_s_per_m=99", "damping_n_s_per_m=105", "stiffness_n_per_m=20000"}) {
    std::vector<std::string> set = slow;
    set.push_back(std::string{"control.virtual_coupling."} + active);
    const Summary s = summary(kPress, set);
    EXPECT_GT(s.min_port_energy_j(), 0.0) << active;
    EXPECT_LT(s.robot_min_energy_j(), -0.1) << active;
    EXPECT_NE(s.verdict().find("the sampled coupling has fed the robot"), std::string::npos) << s.verdict();
  }
  const Summary sound = summary(kPress, slow);
  EXPECT_GT(sound.robot_min_energy_j(), -1e-4);
  EXPECT_EQ(sound.verdict().find("fed the robot"), std::string::npos) << sound.verdict();
}

}  // namespace
}  // namespace twoport::lab::figures_test
