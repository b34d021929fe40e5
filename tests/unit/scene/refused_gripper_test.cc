#include <initializer_list>
#include <string>
#include <vector>

#include "tests/unit/scene/scenes.h"

namespace twoport::test {
namespace {

const char* const kGripper = R"(
dof: 3
duration_s: 1
operator { hand { stiffness_n_per_m: 300 } path { hold { duration_s: 1 } } }
device { mass_kg: 0.1 }
control { architecture: POSITION_FORCE virtual_coupling { } passivity { method: FORCE_PROJECTED } }
robot { mass_kg: 0.5 force_sensor { } }
gripper {
  operator { hand { stiffness_n_per_m: 400 } path { hold { duration_s: 1 } } }
  device { mass_kg: 0.05 position_m: [0.06] }
  robot { mass_kg: 0.2 position_m: [0.06] force_sensor { } }
  object { width_m: 0.04 stiffness_n_per_m: 2000 }
}
)";

}  // namespace

TEST(SceneGripper, ReadsAsASceneOfOneAxis) {
  const Scene scene = scene_of(kGripper);
  ASSERT_TRUE(scene.gripper);
  EXPECT_EQ(scene.gripper->dof, 1);
  EXPECT_FALSE(scene_of(kStiffWall).gripper);
}

TEST(SceneGripper, RefusesEveryNumberThatIsNotFinite) {
  std::vector<std::string> paths{"force_scale",
                                 "motion_scale",
                                 "initial_energy_j",
                                 "object.width_m",
                                 "object.stiffness_n_per_m",
                                 "object.damping_n_s_per_m"};
  const auto add = [&](const std::string& block, std::initializer_list<const char*> names) {
    for (const char* name : names) paths.push_back(block + "." + name);
  };
  add("operator.hand", {"mass_kg", "stiffness_n_per_m", "damping_n_s_per_m", "force_n"});
  add("device", {"mass_kg", "damping_n_s_per_m", "position_m", "velocity_m_per_s", "coulomb_friction_n",
                 "position_resolution_m", "max_force_n", "velocity_filter_hz"});
  add("robot", {"mass_kg", "damping_n_s_per_m", "position_m", "velocity_m_per_s"});
  add("robot.force_sensor", {"noise_n", "bias_n", "latency_ms"});
  add("virtual_coupling", {"stiffness_n_per_m", "damping_n_s_per_m", "catch_up_m_per_s"});
  for (const char* limits : {"device_limits", "robot_limits"})
    add(limits, {"force_n", "force_rate_n_per_s", "power_w", "speed_m_per_s", "workspace_m"});
  paths.push_back("robot_limits.set_point_step_m");
  for (const std::string& path : paths)
    for (const std::string value : {"nan", "inf"}) {
      const bool list = path.ends_with("position_m") || path.ends_with("velocity_m_per_s") ||
                        path.ends_with("hand.force_n") || path.ends_with("bias_n");
      EXPECT_TRUE(says(error_of(kGripper, {"gripper." + path + "=" + (list ? "[" + value + "]" : value)}),
                       {": gripper." + path + " is ", value, "finite number"}))
          << path;
    }
}

INSTANTIATE_TEST_SUITE_P(
    Gripper, RefusedScene,
    ::testing::Values(
        Refusal{"dof: 1 duration_s: 1 device { mass_kg: 1 } control { architecture: RENDER } gripper { }",
                {},
                "gripper is given, but control.architecture is RENDER or UNCONTROLLED: it needs a link"},
        Refusal{"dof: 1 duration_s: 1 robot { mass_kg: 1 } gripper { } "
                "control { architecture: UNCONTROLLED passivity { method: NONE } }",
                {},
                "gripper is given, but control.architecture is RENDER or UNCONTROLLED: it needs a link"},
        Refusal{kGripper,
                {"control.schedule={at_s: 0.5 architecture: POSITION_POSITION}"},
                "gripper is given with control.schedule: a gripper has one method"},
        Refusal{kGripper,
                {"to_slave.deadband={ratio: 0.1}"},
                "gripper is given with to_slave.deadband: both reports of a packet are sent together"},
        Refusal{kGripper,
                {"to_master.deadband={ratio: 0.1}"},
                "gripper is given with to_master.deadband: both reports of a packet are sent together"},
        Refusal{kGripper,
                {"gripper.operator.tremor.rms_m=1e-4"},
                "gripper.operator has a tremor; it may have hand, and path or recording"},
        Refusal{kGripper,
                {"gripper.operator={recording: \"hand.mcap\"}"},
                "gripper.operator.recording: scenes/hand.mcap: it is not there, or no regular file"},
        Refusal{kGripper,
                {"gripper.robot.arm.file=\"ur5e.textproto\""},
                "gripper.robot.arm is given; a gripper has mass_kg and damping_n_s_per_m"},
        Refusal{kGripper,
                {"gripper.device.arm.file=\"ur5e.textproto\""},
                "gripper.device.arm is given, but applies to dof 6 only; dof is 1"},
        Refusal{kGripper,
                {"gripper.robot.force_sensor.noise_n=0.01"},
                "gripper.robot.force_sensor.noise_n is 0.01; it must be 0: the force sensor of a gripper has no model "
                "of noise"},
        Refusal{
            kGripper, {"gripper.object={stiffness_n_per_m: 1}"}, "gripper.object.width_m is missing; it must be > 0"},
        Refusal{kGripper, {"gripper.object.width_m=0"}, "gripper.object.width_m is 0; it must be > 0 and at most 1e18"},
        Refusal{kGripper,
                {"gripper.device.position_m=[0, 1, 2]"},
                "gripper.device.position_m is [0, 1, 2]; it must hold 1 number"},
        Refusal{kGripper,
                {"gripper.robot.inertia_kg_m2=[1]"},
                "gripper.robot.inertia_kg_m2 is given, but applies to dof 6 only; dof is 1"},
        Refusal{kGripper,
                {"gripper.initial_energy_j=-1"},
                "gripper.initial_energy_j is -1; it must be >= 0 and at most 1e18"},
        Refusal{kGripper, {"gripper.force_scale=0"}, "gripper.force_scale is 0; it must be > 0 and at most 1e18"}),
    name_of);

}  // namespace twoport::test
