#pragma once

#include <optional>

#include "common/base/option_fields.h"

namespace twoport {

/// `control.passivity.fixed_damping`. An absent number is set by the rule in gains.h.
struct FixedDampingOptions {
  std::optional<double> damping_n_s_per_m, stiffness_n_per_m;
  std::optional<double> rotational_damping_n_m_s_per_rad, rotational_stiffness_n_m_per_rad;
  TWOPORT_OPTIONS_OF_BLOCK(damping_n_s_per_m, stiffness_n_per_m, rotational_damping_n_m_s_per_rad,
                           rotational_stiffness_n_m_per_rad)
};

}  // namespace twoport
