#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/scene/load.h"

namespace twoport {
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
  expect_error(kDevice + "principal_inertia_kg_m2: [1e-4, 0, 3e-4] }", "hold numbers that are each > 0");
  expect_error(kDevice + "principal_inertia_kg_m2: [1e-4, nan, 3e-4] }", "finite number");
  expect_error(kDevice + "inertia_kg_m2: 1e-4 principal_rotational_damping_n_m_s_per_rad: [1, 1, -1] }",
               "hold numbers that are each >= 0");
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
  expect_error(kRobot + "arm { } }", "robot.arm.file is missing");
  expect_error(kRobot + "arm { file: \"nowhere.textproto\" } }", "nowhere.textproto");
  expect_error(kRobot + kArm + "joint_position_rad: [0, 0, 0, 0, 0, 1, 0] } }",
               "lie within the joints' limits; number 4 must be between -3.0481 and -0.1458");
  expect_error("dof: 3 duration_s: 1 robot { " + kArm + "} }", "dof 6 only");
  const Scene scene = parse_scene(kRobot + kArm + "} }", "scene");
  // The smallest effective mass and inertia at the tool, with the motors' rotors.
  EXPECT_GT(scene.robot->mass_kg, 3.0);
  EXPECT_LT(scene.robot->mass_kg, 5.3);
  EXPECT_GT(scene.robot->inertia_kg_m2[0], 0.05);
}

TEST(Scene, KeepsAccountsPerContactWhereAToolIsRendered) {
  const std::string with =
      "dof: 6 duration_s: 1 device { mass_kg: 0.1 inertia_kg_m2: 1e-4 } control { architecture: RENDER passivity { "
      "method: ";
  EXPECT_EQ(parse_scene(with + "FORCE_PROJECTED } }", "scene").control.accounts, Accounts::per_contact);
  EXPECT_EQ(parse_scene(with + "FORCE_PROJECTED accounts: TOTAL } }", "scene").control.accounts, Accounts::total);
  EXPECT_EQ(parse_scene(with + "CLASSIC } }", "scene").control.accounts, Accounts::total);
}

}  // namespace
}  // namespace twoport
