#include "tests/unit/scene/scenes.h"

namespace twoport::test {

INSTANTIATE_TEST_SUITE_P(
    Device, RefusedScene,
    ::testing::Values(
        Refusal{kStiffWall, {"device.mass_kg=-1"}, "device.mass_kg is -1; it must be >= 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"device.damping_n_s_per_m=-1"},
                "device.damping_n_s_per_m is -1; it must be >= 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"device.coulomb_friction_n=-1"},
                "device.coulomb_friction_n is -1; it must be >= 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"device.position_resolution_m=-1"},
                "device.position_resolution_m is -1; it must be >= 0 and at most 1e18"},
        Refusal{kStiffWall, {"device.max_force_n=0"}, "device.max_force_n is 0; it must be > 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"device.velocity_filter_hz=0"},
                "device.velocity_filter_hz is 0; it must be > 0 and at most 1e18"},
        Refusal{kStiffWall, {"device.position_m=[1]"}, "device.position_m is [1]; it must hold 3 numbers"},
        Refusal{kStiffWall,
                {"device.velocity_m_per_s=[1, 2]"},
                "device.velocity_m_per_s is [1, 2]; it must hold 3 numbers"},
        Refusal{kHeldSpring, {"device.position_m=[1, 2, 3]"}, "device.position_m is [1, 2, 3]; it must hold 1 number"},
        Refusal{kTurning,
                {"device.position_m=[1, 2, 3, 4]"},
                "device.position_m is [1, 2, 3, 4]; it must hold 3 numbers, or 7 with the attitude w x y z"},
        Refusal{kTurning,
                {"device.velocity_m_per_s=[1]"},
                "device.velocity_m_per_s is [1]; it must hold 3 numbers, or 6 with the rotation"},
        Refusal{kTurning,
                {"device.position_m=[0, 0, 0, 1.002, 0, 0, 0]"},
                "device.position_m is [0, 0, 0, 1.002, 0, 0, 0]; it must end in a unit quaternion w x y z, whose "
                "length is 1 and not 1.002"},
        Refusal{kTurning,
                {"device.position_m=[0, 0, 0, 0, 0, 0, 0]"},
                "device.position_m is [0, 0, 0, 0, 0, 0, 0]; it must end in a unit quaternion w x y z, whose length is "
                "1 and not 0"},
        Refusal{kTurning, {"device.inertia_kg_m2=-1"}, "device.inertia_kg_m2 is -1; it must be >= 0 and at most 1e18"},
        Refusal{kTurning,
                {"device.rotational_damping_n_m_s_per_rad=-1"},
                "device.rotational_damping_n_m_s_per_rad is -1; it must be >= 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"device.inertia_kg_m2=1"},
                "device.inertia_kg_m2 is given, but applies to dof 6 only; dof is 3"},
        Refusal{kStiffWall,
                {"device.rotational_damping_n_m_s_per_rad=1"},
                "device.rotational_damping_n_m_s_per_rad is given, but applies to dof 6 only; dof is 3"}),
    name_of);

}  // namespace twoport::test
