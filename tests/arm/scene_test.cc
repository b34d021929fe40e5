#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/scene/hints.h"
#include "common/scene/load.h"

namespace twoport::scene_test {
namespace {

std::string error_of(const std::string& text) {
  try {
    parse_scene(text, "scene");
  } catch (const ConfigError& e) {
    return e.what();
  }
  return "";
}
void expect_error(const std::string& text, const std::string& words) {
  const std::string error = error_of(text);
  EXPECT_NE(error.find(words), std::string::npos) << "\"" << error << "\" has no \"" << words << "\"";
}

const std::string kDevice =
    "dof: 6 duration_s: 1 control { architecture: RENDER } operator { hand { } } device { mass_kg: 0.1 ";
const std::string kRobot = "dof: 6 duration_s: 1 robot { ";
const std::string kArm = "arm { file: \"" TWOPORT_ARMS "/fr3.textproto\" ";

TEST(SceneOfAHandle, MayHaveThreePrincipalMoments) {
  EXPECT_EQ(error_of(kDevice + "principal_inertia_kg_m2: [1e-4, 2e-4, 3e-4] }"), "");
  expect_error(kDevice + "inertia_kg_m2: 1e-4 principal_inertia_kg_m2: [1e-4, 2e-4, 3e-4] }", "are both given");
  expect_error(kDevice + "principal_inertia_kg_m2: [1e-4, 2e-4] }",
               "device.principal_inertia_kg_m2 is [0.0001, 0.0002]; it must hold 3 numbers");
  expect_error(kDevice + "principal_inertia_kg_m2: [1e-4, 0, 3e-4] }", "hold numbers > 0");
  expect_error(kDevice + "principal_inertia_kg_m2: [1e-4, nan, 3e-4] }", "finite number");
  expect_error(kDevice + "inertia_kg_m2: 1e-4 principal_rotational_damping_n_m_s_per_rad: [1, 1, -1] }",
               "hold numbers >= 0");
  expect_error("dof: 3 duration_s: 1 device { principal_inertia_kg_m2: [1, 1, 1] }", "dof 6 only");
}

TEST(SceneOfAHandle, MayHaveALateForceWithoutAController) {
  EXPECT_EQ(error_of(kDevice + "inertia_kg_m2: 1e-4 force_latency_ms: 1 }"), "");
  expect_error("dof: 1 duration_s: 1 device { mass_kg: 1 force_latency_ms: 1 }",
               "device.force_latency_ms is 1; it must be 0 unless");
}

TEST(SceneOfASpring, MayActOnOnePointOfTheTool) {
  const std::string with = kDevice +
                           "inertia_kg_m2: 1e-4 } tool { contact_point { position_m: [0, 0, 1] } } environment { "
                           "spring { stiffness_n_per_m: 1 contact_point: ";
  EXPECT_EQ(error_of(with + "0 } }"), "");
  expect_error(with + "1 } }", "environment.spring.contact_point is 1; it must be < 1");
  expect_error(with + "-2 } }", "be the index of a contact point of the tool, or -1 for all");
}

TEST(SceneOfAnArm, StandsInPlaceOfABody) {
  EXPECT_EQ(error_of(kRobot + kArm + "} }"), "");
  expect_error(kRobot + kArm + "} mass_kg: 1 }", "robot.mass_kg is given, but so is robot.arm");
  expect_error(kRobot + kArm +
                   "} } environment { spring { stiffness_n_per_m: 1 anchor_m: [0, 0, 0] anchor_motion { "
                   "amplitude_m: 1 frequency_hz: 1 } } }",
               "environment.spring.anchor_motion is given, but robot.arm is too: it needs a robot without joints");
  expect_error(kRobot + "arm { } }", "robot.arm.file is missing");
  expect_error(kRobot + "arm { file: \"\" } }", "robot.arm.file is \"\"; it must be the path of a file");
  expect_error(kRobot + "arm { file: \"nowhere.textproto\" } }", "nowhere.textproto");
  expect_error(kRobot + kArm + "joint_coulomb_friction_n_m: [1, 2] } }",
               "robot.arm.joint_coulomb_friction_n_m is [1, 2]; it must hold 7 numbers");
  expect_error(kRobot + kArm + "joint_coulomb_friction_n_m: [0, 0, 0, 0, 0, 0, -0.1] } }",
               "robot.arm.joint_coulomb_friction_n_m is [0, 0, 0, 0, 0, 0, -0.1]; it must be >= 0 each");
  expect_error(kRobot + kArm + "joint_position_rad: [0, 0, 0, 0, 0, 1, 0] } }",
               "lie within the joints' limits; number 4 must be between -3.0481 and -0.1458");
  expect_error("dof: 3 duration_s: 1 robot { " + kArm + "} }", "dof 6 only");
  const Scene scene = parse_scene(kRobot + kArm + "} }", "scene");
  // The smallest effective mass and inertia at the tool, with the motors' rotors.
  EXPECT_GT(scene.robot->mass_kg, 3.0);
  EXPECT_LT(scene.robot->mass_kg, 5.3);
  EXPECT_GT(scene.robot->inertia_kg_m2[0], 0.05);
}

TEST(SceneOfAnArm, TurnsAsLightAsItMovesUnlessAGainOfTorquesIsGiven) {
  const auto of = [](const std::string& feedback) {
    return parse_scene(kRobot + kArm + "force_feedback { " + feedback + " } } }", "scene").robot.value();
  };
  EXPECT_EQ(of("gain: 3").arm->force_feedback_torque_gain, 3.0);
  EXPECT_EQ(of("gain: 3 torque_gain: 0").arm->force_feedback_torque_gain, 0.0);
  const RobotSpec same = of("gain: 3"), lighter = of("gain: 3 torque_gain: 15");
  EXPECT_NEAR(lighter.mass_kg, same.mass_kg, 1e-12);
  EXPECT_NEAR(lighter.inertia_kg_m2[0], same.inertia_kg_m2[0] / 4.0, 1e-12);
}

TEST(SceneOfAnArm, SaysTheWholeRangeOfANumber) {
  for (const char* gain : {"-1", "1001"})
    expect_error(kRobot + kArm + "force_feedback { gain: " + gain + " } } }",
                 "robot.arm.force_feedback.gain is " + std::string{gain} + "; it must be >= 0 and at most 1000");
  for (const char* gain : {"-1", "1001"})
    expect_error(kRobot + kArm + "force_feedback { torque_gain: " + gain + " } } }",
                 "robot.arm.force_feedback.torque_gain is " + std::string{gain} + "; it must be >= 0 and at most 1000");
  expect_error(kRobot + kArm + "force_feedback { torque_gain: nan } } }",
               "robot.arm.force_feedback.torque_gain is nan; it must be a finite number");
  for (const char* damping : {"-1", "301"}) {
    expect_error(kRobot + kArm + "joint_damping_n_m_s_per_rad: " + damping + " } }", "it must be >= 0 and at most 300");
    expect_error(kRobot + kArm + "null_space_damping_n_m_s_per_rad: " + damping + " } }",
                 "it must be >= 0 and at most 300");
  }
  for (const char* stiffness : {"-1", "10001"})
    expect_error(kRobot + kArm + "null_space_stiffness_n_m_per_rad: " + stiffness + " } }",
                 "it must be >= 0 and at most 10000");
}

TEST(ArmScene, RefusesAToleranceBeyondRounding) {
  for (const char* tolerance : {"0", "1e-16", "1e-3"})
    expect_error(
        "dof: 1 duration_s: 1 simulation { integrator: DORMAND_PRINCE tolerance_m: " + std::string{tolerance} + " }",
        "it must be from 1e-15 to 0.0001");
}

/// Hints of a scene with an arm as robot.
std::vector<std::string> hints_of(const std::string& arm, const std::string& more = "") {
  return hints(parse_scene("dof: 6 duration_s: 1 operator { } device { mass_kg: 0.2 inertia_kg_m2: 1e-3 } robot { " +
                               kArm + arm + " } } " + more,
                           "scene"));
}

TEST(HintsOfAnArm, NameAToolThatItCannotCarry) {
  EXPECT_EQ(hints_of("").size(), 0U);
  EXPECT_EQ(hints_of("tool_mass_kg: 3 tool_center_m: [0, 0, 0.05]").size(), 0U);
  const auto heavy = hints_of("tool_mass_kg: 30");
  ASSERT_EQ(heavy.size(), 1U);
  EXPECT_TRUE(heavy[0].starts_with("robot.arm: joint ")) << heavy[0];
  EXPECT_NE(heavy[0].find("tool_mass_kg is 30, and may be "), std::string::npos) << heavy[0];
  // Ready position: the flange is 0.307 m before the shoulder, and the arm itself needs 1.7 of the shoulder's 87 N m the other way;
  // the wrist has 12 N m for the 88 mm of the last link: 12.1 kg at most.
  const std::size_t at = heavy[0].find("may be ");
  ASSERT_NE(at, std::string::npos) << heavy[0];
  EXPECT_NEAR(std::stod(heavy[0].substr(at + 7)), (12.0 - 1.59) / (0.088 * 9.81), 0.2) << heavy[0];
}

TEST(HintsOfAnArm, NameALowRateAndAnIntegratorThatDoesNotApply) {
  const auto slow = hints_of("", "rate_hz: 50");
  ASSERT_EQ(slow.size(), 1U);
  EXPECT_EQ(slow[0],
            "robot.arm is given at 50 Hz: torques of an arm are held for 20 ms, in which its weight changes; use 200 "
            "Hz or more");
  EXPECT_EQ(hints_of("", "rate_hz: 200").size(), 0U);
  const auto other = hints_of("", "simulation { integrator: DORMAND_PRINCE }");
  ASSERT_EQ(other.size(), 1U);
  EXPECT_EQ(other[0], "simulation.integrator does not apply to robot.arm, which is stepped by RK4");
}

TEST(HintsOfAnArm, NameItsEffectiveMassWhereTheCouplingIsUnstable) {
  const auto unstable = hints_of("", "control { virtual_coupling { stiffness_n_per_m: 1000 damping_n_s_per_m: 1e5 } }");
  ASSERT_EQ(unstable.size(), 1U);
  EXPECT_NE(unstable[0].find("the effective mass of robot.arm, "), std::string::npos) << unstable[0];
  EXPECT_EQ(unstable[0].find("robot.inertia"), std::string::npos) << unstable[0];
}

TEST(ArmScene, KeepsAccountsPerContactWhereAToolIsRendered) {
  const std::string with =
      "dof: 6 duration_s: 1 device { mass_kg: 0.1 inertia_kg_m2: 1e-4 } control { architecture: RENDER passivity { "
      "method: ";
  EXPECT_EQ(parse_scene(with + "FORCE_PROJECTED } }", "scene").control.accounts, Accounts::per_contact);
  EXPECT_EQ(parse_scene(with + "FORCE_PROJECTED accounts: TOTAL } }", "scene").control.accounts, Accounts::total);
  EXPECT_EQ(parse_scene(with + "CLASSIC } }", "scene").control.accounts, Accounts::total);
}

}  // namespace
}  // namespace twoport::scene_test
