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

}  // namespace twoport::test
