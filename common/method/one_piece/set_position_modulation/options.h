#pragma once

#include <optional>

#include "common/base/option_fields.h"

namespace twoport {

/// `control.passivity.set_position_modulation`. An absent number is set by the rule in gains.h.
struct SetPositionModulationOptions {
  std::optional<double> stiffness_n_per_m, damping_n_s_per_m;
  std::optional<double> rotational_stiffness_n_m_per_rad, rotational_damping_n_m_s_per_rad;
  std::optional<double> energy_ceiling_j;
  TWOPORT_OPTIONS_OF_BLOCK(stiffness_n_per_m, damping_n_s_per_m, rotational_stiffness_n_m_per_rad,
                           rotational_damping_n_m_s_per_rad, energy_ceiling_j)
};

}  // namespace twoport
