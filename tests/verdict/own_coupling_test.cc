#include <fmt/format.h>
#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <vector>

#include "common/scene/held_coupling.h"
#include "common/scene/load.h"
#include "lab/lanes/lanes.h"
#include "lab/run.h"

// A robot that its own sampled coupling drives: the verdict of a run, alone and in lanes, and what is known before it.
namespace twoport::lab::own_coupling_test {
namespace {

/// A robot follows a path, then rests. `hand`: of the operator; without one the path is imposed on the device, and nothing disturbs it.
Scene follows(double rate_hz, double mass, double own_damping, double stiffness, double damping,
              const std::string& more = "passivity { method: NONE }", const std::string& hand = "") {
  return parse_scene(
      fmt::format(
          "dof: 1 duration_s: 3 rate_hz: {} operator {{ {} path {{ move_to {{ position_m: [0.03] duration_s: 1 }} }} "
          "path "
          "{{ "
          "hold {{ duration_s: 2 }} }} }} device {{ mass_kg: 0.1 damping_n_s_per_m: 0.1 }} to_slave {{ delay_ms: 5 }} "
          "robot {{ mass_kg: {} damping_n_s_per_m: {} }} control {{ architecture: POSITION_FORCE virtual_coupling {{ "
          "stiffness_n_per_m: {} damping_n_s_per_m: {} }} {} }}",
          rate_hz, hand, mass, own_damping, stiffness, damping, more),
      "follows");
}

TEST(OwnCoupling, IsWarnedOfWhereTheRunIsUnstable) {
  for (const double mass : {0.01, 0.5})
    for (const double own : {0.0, 3.0})
      for (const double stiffness : {200.0, 2000.0})
        for (const double part : {0.3, 0.495, 0.505, 1000.0, 1950.0 / stiffness * mass * 1e3, 2.1e6 / stiffness * mass,
                                  4e6 / stiffness * mass}) {
          const double damping = part * stiffness / 1000.0;
          const Scene scene = follows(1000.0, mass, own, stiffness, damping);
          const Summary s = run(scene);
          EXPECT_EQ(s.verdict_kind() != "UNSTABLE", coupling_holds_robot(scene, scene.control.coupling))
              << mass << " kg, " << own << ", " << stiffness << ", " << damping << ": " << s.verdict();
        }
}

const std::string kHand = "hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 }";

/// Runs a scene alone and in lanes, which must say the same.
Summary of_both(const Scene& scene) {
  EXPECT_EQ(why_not_in_lanes(scene), "");
  Summary alone = run(scene);
  const Scene* const one = &scene;
  run_in_lanes({&one, 1}, {.lanes = 2}, [&](std::size_t, const Summary& in_lanes) {
    EXPECT_EQ(in_lanes.verdict(), alone.verdict());
    EXPECT_EQ(in_lanes.verdict_kind(), alone.verdict_kind());
    EXPECT_EQ(in_lanes.coupled_at_end(), alone.coupled_at_end());
  });
  return alone;
}

TEST(OwnCoupling, ThatDrivesTheRobotUnderAControllerIsUnstable) {
  for (const char* method : {"FORCE_PROJECTED", "INTERNAL_MODEL", "CLASSIC"}) {
    const std::string limited = fmt::format("passivity {{ method: {} }}", method);
    Scene scene = follows(1000.0, 0.01, 1.0, 500.0, 30.0, limited, kHand);
    ASSERT_FALSE(coupling_holds_robot(scene, scene.control.coupling));
    const Summary driven = of_both(scene);
    EXPECT_EQ(driven.verdict_kind(), "UNSTABLE") << method << ": " << driven.verdict();
    scene = follows(1000.0, 0.01, 1.0, 500.0, 30.0, limited + " robot_limits { force_n: 20 }", kHand);
    const Summary cut = run(scene);
    EXPECT_EQ(cut.verdict_kind(), "UNSTABLE") << method << ": " << cut.verdict();
    EXPECT_NE(cut.verdict().find("fed by the robot's own coupling"), std::string::npos)
        << method << ": " << cut.verdict();
    EXPECT_LT(cut.robot_min_energy_j(), -0.1);
  }
}

// Sampled, K T/2 > B of a robot with damping of its own: the port dips below zero, and the robot rests.
TEST(OwnCoupling, ThatFeedsARobotWhichComesToRestIsNone) {
  Scene scene = follows(100.0, 0.5, 2.5, 1000.0, 3.0, "passivity { method: INTERNAL_MODEL }", kHand);
  scene.duration_s = 1.05;  // while it still moves
  ASSERT_TRUE(coupling_may_drive_robot(scene));
  const Summary s = of_both(scene);
  EXPECT_LT(s.robot_min_energy_j(), -1e-5);
  EXPECT_EQ(s.verdict_kind(), "STABLE") << s.verdict();
}

}  // namespace
}  // namespace twoport::lab::own_coupling_test
