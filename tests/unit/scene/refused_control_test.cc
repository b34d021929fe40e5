#include "tests/unit/scene/scenes.h"

namespace twoport::test {

INSTANTIATE_TEST_SUITE_P(
    Control, RefusedScene,
    ::testing::Values(
        Refusal{kStiffWall, {"control.force_scale=0"}, "control.force_scale is 0; it must be > 0 and at most 1e18"},
        Refusal{kStiffWall, {"control.motion_scale=-2"}, "control.motion_scale is -2; it must be > 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"control.virtual_coupling.stiffness_n_per_m=-1"},
                "control.virtual_coupling.stiffness_n_per_m is -1; it must be >= 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"control.virtual_coupling.damping_n_s_per_m=-1"},
                "control.virtual_coupling.damping_n_s_per_m is -1; it must be >= 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"control.virtual_coupling.catch_up_m_per_s=-1"},
                "control.virtual_coupling.catch_up_m_per_s is -1; it must be >= 0 and at most 1e18"},
        Refusal{
            kStiffWall,
            {"control.virtual_coupling.rotational_stiffness_n_m_per_rad=1"},
            "control.virtual_coupling.rotational_stiffness_n_m_per_rad is given, but applies to dof 6 only; dof is 3"},
        Refusal{
            kStiffWall,
            {"control.virtual_coupling.rotational_damping_n_m_s_per_rad=1"},
            "control.virtual_coupling.rotational_damping_n_m_s_per_rad is given, but applies to dof 6 only; dof is 3"},
        Refusal{kTurning,
                {"control.virtual_coupling.rotational_stiffness_n_m_per_rad=-1"},
                "control.virtual_coupling.rotational_stiffness_n_m_per_rad is -1; it must be >= 0 and at most 1e18"},
        Refusal{kTurning,
                {"control.virtual_coupling.rotational_damping_n_m_s_per_rad=-1"},
                "control.virtual_coupling.rotational_damping_n_m_s_per_rad is -1; it must be >= 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"control.passivity.initial_energy_j=-1"},
                "control.passivity.initial_energy_j is -1; it must be >= 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"control.passivity.max_gain=-1"},
                "control.passivity.max_gain is -1; it must be >= 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"control.passivity.wave_variables.impedance_n_s_per_m=0"},
                "control.passivity.wave_variables.impedance_n_s_per_m is 0; it must be > 0 and at most 1e18"},
        Refusal{kStiffWall,
                {"control.passivity.fixed_damping.rotational_damping_n_m_s_per_rad=1"},
                "control.passivity.fixed_damping.rotational_damping_n_m_s_per_rad is given, but applies to dof 6 only; "
                "dof is 3"},
        Refusal{kStiffWall,
                {"control.passivity.round_trip_ms=-1"},
                "control.passivity.round_trip_ms is -1; it must be between 0 and 1000000"},
        Refusal{kStiffWall,
                {"control.passivity.method=FIXED_DAMPING", "control.architecture=POSITION_MEASURED_FORCE"},
                "control.passivity.method is FIXED_DAMPING; it must be another one under POSITION_MEASURED_FORCE: it "
                "displays the position error"},
        Refusal{kStiffWall,
                {"control.passivity.method=ENERGY_BOUNDING", "device.damping_n_s_per_m=0"},
                "control.passivity.method is ENERGY_BOUNDING; it must be another one where device.damping_n_s_per_m is "
                "0, or control.passivity.energy_bounding.damping_n_s_per_m must be given"},
        Refusal{kStiffWall, {"control.engage_s=-1"}, "control.engage_s is -1; it must be between 0 and 1000000"},
        Refusal{
            kStiffWall, {"control.hold_after_s=0"}, "control.hold_after_s is 0; it must be > 0 and at most 1000000"},
        Refusal{kStiffWall,
                {"control.release_after_s=0"},
                "control.release_after_s is 0; it must be > 0 and at most 1000000"},
        Refusal{kStiffWall,
                {"control.hold_after_s=1"},
                "control.hold_after_s is 1; it must be < control.release_after_s (1)"},
        Refusal{kHeldSpring,
                {"control.registration.rotation=[1, 0, 0, 0]"},
                "control.registration.rotation is given, but dof is 1; a rotation needs dof 3 or 6"},
        Refusal{kStiffWall,
                {"control.registration.rotation=[1, 0, 0]"},
                "control.registration.rotation is [1, 0, 0]; it must hold 4 numbers"},
        Refusal{kStiffWall,
                {"control.registration.rotation=[1, 1, 0, 0]"},
                "control.registration.rotation is [1, 1, 0, 0]; it must be of length 1"},
        Refusal{kStiffWall,
                {"control.registration.position_m=[1, 0, 0]"},
                "control.registration.position_m is given, but control.registration.mode is OFFSET; it needs ABSOLUTE"},
        Refusal{kHeldSpring,
                {"control.passivity.accounts=TRANSLATION_ROTATION"},
                "control.passivity.accounts is TRANSLATION_ROTATION; it must be another value: TRANSLATION_ROTATION "
                "needs dof 6, and dof is 1"},
        Refusal{
            kHeldSpring, {"robot.mass_kg=1"}, "robot is given, but control.architecture is RENDER: there is no link"},
        Refusal{kHeldSpring,
                {"to_slave.delay_ms=1"},
                "to_slave is given, but control.architecture is RENDER: there is no link"},
        Refusal{
            kHeldSpring, {"to_master={}"}, "to_master is given, but control.architecture is RENDER: there is no link"}),
    name_of);

}  // namespace twoport::test
