#include "tests/unit/scene/scenes.h"

namespace twoport::test {

INSTANTIATE_TEST_SUITE_P(
    Robot, RefusedScene,
    ::testing::Values(
        Refusal{"dof: 3 duration_s: 1 robot { }", {}, "robot.mass_kg is missing; it must be > 0 and at most 1e18"},
        Refusal{kStiffWall, {"robot.mass_kg=0"}, "robot.mass_kg is 0; it must be > 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"robot.damping_n_s_per_m=-1"},
                "robot.damping_n_s_per_m is -1; it must be >= 0 and at most 1e18"},
        Refusal{kStiffWall, {"robot.position_m=[1]"}, "robot.position_m is [1]; it must hold 3 numbers"},
        Refusal{kStiffWall, {"robot.velocity_m_per_s=[1]"}, "robot.velocity_m_per_s is [1]; it must hold 3 numbers"},
        Refusal{kStiffWall,
                {"robot.force_sensor.noise_n=-1"},
                "robot.force_sensor.noise_n is -1; it must be >= 0 and at most 1e18"},
        Refusal{
            kStiffWall, {"robot.force_sensor.bias_n=[1]"}, "robot.force_sensor.bias_n is [1]; it must hold 3 numbers"},
        Refusal{kStiffWall,
                {"robot.force_sensor.latency_ms=-1"},
                "robot.force_sensor.latency_ms is -1; it must be between 0 and 1000000"},
        Refusal{kStiffWall,
                {"robot.inertia_kg_m2=[1]"},
                "robot.inertia_kg_m2 is given, but applies to dof 6 only; dof is 3"},
        Refusal{kStiffWall,
                {"robot.rotational_damping_n_m_s_per_rad=1"},
                "robot.rotational_damping_n_m_s_per_rad is given, but applies to dof 6 only; dof is 3"},
        Refusal{kTurning,
                {"robot.rotational_damping_n_m_s_per_rad=-1"},
                "robot.rotational_damping_n_m_s_per_rad is -1; it must be >= 0 and at most 1e18"},
        Refusal{"dof: 6 duration_s: 1 robot { mass_kg: 1 }",
                {},
                "robot.inertia_kg_m2 is missing; it must hold 1 number, or 3 for the principal moments"},
        Refusal{kTurning,
                {"robot.inertia_kg_m2=[1, 2]"},
                "robot.inertia_kg_m2 is [1, 2]; it must hold 1 number, or 3 for the principal moments"},
        Refusal{kTurning, {"robot.inertia_kg_m2=[0]"}, "robot.inertia_kg_m2 is [0]; it must hold numbers > 0"},
        Refusal{kTurning,
                {"robot.inertia_kg_m2=[1, 2, 3.1]"},
                "robot.inertia_kg_m2 is [1, 2, 3.1]; it must keep the triangle inequality: no principal moment exceeds "
                "the sum of the other two"}),
    name_of);

INSTANTIATE_TEST_SUITE_P(
    Mount, RefusedScene,
    ::testing::Values(
        Refusal{kStiffWall, {"device_mount.scale=0"}, "device_mount.scale is 0; it must be from 0.001 to 1000"},
        Refusal{kStiffWall,
                {"device_mount.rotation=[1, 1, 0, 0]"},
                "device_mount.rotation is [1, 1, 0, 0]; it must be of length 1"},
        Refusal{kStiffWall, {"device_mount.position_m=[1]"}, "device_mount.position_m is [1]; it must hold 3 numbers"},
        Refusal{kStiffWall,
                {"device_mount.clutch_button=32"},
                "device_mount.clutch_button is 32; it must be from 0 to 31, or -1 for none"},
        Refusal{kStiffWall,
                {"device_mount.let_go_after_s=0"},
                "device_mount.let_go_after_s is 0; it must be > 0 and at most 1000000"},
        Refusal{kStiffWall, {"device_mount.engage_s=-1"}, "device_mount.engage_s is -1; it must be from 0 to 60"},
        Refusal{"dof: 1 duration_s: 1",
                {"device_mount.rotation=[1, 0, 0, 0]"},
                "device_mount.rotation is given, but dof is 1; a rotation needs dof 3 or 6"},
        Refusal{"dof: 1 duration_s: 1",
                {"robot_mount.tool_mass_kg=1"},
                "robot_mount.tool_mass_kg is 1; it must be absent with dof 1, whose axis is not vertical"},
        Refusal{
            kStiffWall, {"robot_mount.force_bias_n=[1]"}, "robot_mount.force_bias_n is [1]; it must hold 3 numbers"},
        Refusal{kStiffWall,
                {"robot_mount.tool_center_m=[0, 0, 1]"},
                "robot_mount.tool_center_m is given, but applies to dof 6 only; dof is 3"}),
    name_of);

}  // namespace twoport::test
