#pragma once

#include <algorithm>

#include "common/coupling/options.h"

namespace twoport {

/// Springs, dampers and energy ceiling of set-position modulation.
struct SetPositionGains {
  double stiffness_n_per_m, damping_n_s_per_m, rotational_stiffness_n_m_per_rad, rotational_damping_n_m_s_per_rad;
  Energy ceiling;
};

/// What is not given: half of the virtual coupling's spring and damper, as each side has one; ceiling 20 mJ, and s_f s_x times
/// that where the master's spring is so much softer. These set drag against stiffness.
inline SetPositionGains set_position_gains(const ControlOptions& o) {
  const SetPositionModulationOptions& given = o.set_position_modulation;
  const CouplingOptions& c = o.coupling;
  return {given.stiffness_n_per_m.value_or(0.5 * c.stiffness_n_per_m),
          given.damping_n_s_per_m.value_or(0.5 * c.damping_n_s_per_m),
          given.rotational_stiffness_n_m_per_rad.value_or(0.5 * c.rotational_stiffness_n_m_per_rad),
          given.rotational_damping_n_m_s_per_rad.value_or(0.5 * c.rotational_damping_n_m_s_per_rad),
          Energy{given.energy_ceiling_j.value_or(0.02 * std::min(1.0, o.force_scale * o.motion_scale))}};
}

}  // namespace twoport
