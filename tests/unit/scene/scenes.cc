#include "tests/unit/scene/scenes.h"

#include "common/base/check.h"

namespace twoport::test {

const char* const kStiffWall = R"(# A hand presses a stiff wall and slides along it, over 50 ms and 5 % loss each way.
name: "stiff wall at 50 ms"
dof: 3
duration_s: 8
rate_hz: 2000
seed: 7
operator {
  hand { mass_kg: 0.02 stiffness_n_per_m: 300 damping_n_s_per_m: 1 }
  path { move_to { position_m: [0.03, 0, 0] duration_s: 1 } }
  path { sine { axis: 1 amplitude_m: 0.04 frequency_hz: 0.5 duration_s: 4 } }
  path { hold { duration_s: 1 } }
}
device { mass_kg: 0.075 damping_n_s_per_m: 0.05 max_force_n: 8.5 }
control {
  architecture: POSITION_FORCE
  virtual_coupling { stiffness_n_per_m: 1000 damping_n_s_per_m: 20 }
  passivity { method: FORCE_PROJECTED }
}
to_slave  { delay_ms: 50 loss: 0.05 }
to_master { delay_ms: 50 loss: 0.05 }
robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { } }
environment { wall { normal: [-1, 0, 0] offset_m: -0.02 stiffness_n_per_m: 5000 } }
expect {
  stable: true
  at_least { key: "min_port_energy_j" value: -1e-4 }
  at_most  { key: "force_direction_error_max_deg" value: 1e-6 }
}
)";

const char* const kHeldSpring = R"(# A sampled spring, nobody holding the handle: unstable above 2.0 kN/m.
name: "held spring"
dof: 1
duration_s: 60
rate_hz: 2000
device { mass_kg: 0.075 damping_n_s_per_m: 0.5 position_m: [0.001] velocity_estimate: BACKWARD_DIFFERENCE }
control { architecture: RENDER passivity { method: NONE } }
environment { spring { stiffness_n_per_m: 2000 damping_n_s_per_m: 0 anchor_m: [0] } }
)";

const char* const kTurning = R"(
dof: 6
duration_s: 2
operator {
  hand { force_n: [0, 0, 0] stiffness_n_per_m: 300 rotational_stiffness_n_m_per_rad: 2 rotational_damping_n_m_s_per_rad: 0.1 }
  path { hold { duration_s: 1 } }
  path { move_to { position_m: [0, 0, 0.1, 0, 1, 0, 0] duration_s: 1 } }
  path { sine { axis: 5 amplitude_m: 0.1 frequency_hz: 1 duration_s: 1 } }
  path { screw { point_m: [0, 0, 1] axis: [0, 0, 1] angle_rad: 0.1 travel_m: 0.1 frequency_hz: 1 duration_s: 1 } }
  tremor { rms_m: 1e-4 }
}
device { mass_kg: 0.1 inertia_kg_m2: 1e-4 rotational_damping_n_m_s_per_rad: 1e-3
         position_m: [0, 0, 0.1, 1, 0, 0, 0] velocity_m_per_s: [0, 0, 0, 0, 0, 1] }
control { virtual_coupling { rotational_stiffness_n_m_per_rad: 5 rotational_damping_n_m_s_per_rad: 0.3 }
          passivity { }
          registration { mode: ABSOLUTE rotation: [0.6, 0.8, 0, 0] position_m: [0.1, 0.2, 0.3] }
          device_limits { force_n: 50 } robot_limits { force_n: 150 }
          transparency { }
          schedule { at_s: 1 transparency { } passivity { method: NONE } } }
to_slave { burst { p: 0.1 r: 0.5 } blackout { start_s: 1 duration_s: 1 } delay_step { at_s: 1 delay_ms: 20 } deadband { ratio: 0.1 } }
to_master { burst { p: 0.1 r: 0.5 } blackout { start_s: 1 duration_s: 1 } delay_step { at_s: 1 delay_ms: 20 } deadband { ratio: 0.1 } }
slave_clock { offset_ms: 3 drift_ppm: 200 }
device_mount { position_m: [0, 0.1, 0] rotation: [1, 0, 0, 0] scale: 2 clutch_button: 1 carried_force_n: [0, 0, 0.4]
  let_go_after_s: 0.3 engage_s: 0.2 }
robot_mount { tool_mass_kg: 0.5 tool_center_m: [0, 0, 0.1] force_bias_n: [0.1, 0, 0, 0, 0, 0.01] }
robot { mass_kg: 0.5 inertia_kg_m2: [1e-3, 2e-3, 3e-3] rotational_damping_n_m_s_per_rad: 0.01
        position_m: [1, 2, 3] velocity_m_per_s: [4, 5, 6]
        force_sensor { noise_n: 0.01 bias_n: [0, 0, 0, 1, 2, 3] latency_ms: 2 } }
environment { sphere { center_m: [0, 0, -1] radius_m: 0.9 stiffness_n_per_m: 100 damping_n_s_per_m: 1 friction: 0.3
                       viscous_friction_n_s_per_m: 2 } }
environment { cylinder { point_m: [1, 0, 0] axis: [0, 0, 2] radius_m: 0.1 stiffness_n_per_m: 100 } }
environment { box { center_m: [0, 1, 0] half_size_m: [0.1, 0.2, 0.3] stiffness_n_per_m: 100 } }
environment { spring { stiffness_n_per_m: 10 damping_n_s_per_m: 0.5 anchor_m: [0, 0, 0.1]
                       anchor_motion { axis: 2 amplitude_m: 0.01 frequency_hz: 1 } } }
environment { wall { normal: [0, 3, 4] stiffness_n_per_m: 100 } }
environment { torus { center_m: [0, 0, 5] axis: [0, 0, 2] radius_m: 0.05 tube_radius_m: 0.02 stiffness_n_per_m: 100 } }
environment { capsule { start_m: [0, 0, 6] end_m: [0.1, 0, 6] radius_m: 0.05 stiffness_n_per_m: 100 } }
environment { peg { end_m: [0, 0, 7] axis: [0, 2, 0] radius_m: 0.05 length_m: 0.2 chamfer_m: 0.01 stiffness_n_per_m: 100 } }
environment { hole { mouth_m: [0, 0, -8] axis: [0, 0, 1] radius_m: 0.05 depth_m: 0.2 chamfer_m: 0.01 stiffness_n_per_m: 100 } }
environment { cone { apex_m: [0, 0, 9] axis: [0, 0, 1] base_radius_m: 0.05 height_m: 0.2 stiffness_n_per_m: 100 } }
environment { plate { center_m: [0, 0, 10] half_size_m: [0.2, 0.1, 0.01] rotation: [0.6, 0.8, 0, 0]
                      hole { center_m: [0.1, 0] radius_m: 0.05 } stiffness_n_per_m: 100 } }
tool { contact_point { position_m: [0, 0, 0.05] } contact_point { position_m: [0.01, 0, 0.05] }
       part { capsule { start_m: [0, 0, 0] end_m: [0, 0, 0.02] radius_m: 0.005 } spacing_m: 0.01 } }
simulation { integrator: RK4 substeps: 3 }
expect {
  at_least { key: "drift_m" value: 0 } at_most { key: "drift_m" value: 1 }
  of_method { method: NONE verdict: UNSTABLE }
}
)";

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

Scene scene_of(const std::string& text, const Overrides& overrides) {
  return parse_scene(text, "scenes/x.textproto", overrides);
}

std::string error_of(const std::string& text, const Overrides& overrides) {
  try {
    static_cast<void>(scene_of(text, overrides));
    return "";
  } catch (const ConfigError& e) {
    return e.what();
  }
}

::testing::AssertionResult says(const std::string& sentence, const std::vector<std::string>& words) {
  for (const std::string& word : words)
    if (sentence.find(word) == std::string::npos)
      return ::testing::AssertionFailure() << "\"" << sentence << "\" does not say \"" << word << "\"";
  return ::testing::AssertionSuccess();
}

}  // namespace twoport::test
