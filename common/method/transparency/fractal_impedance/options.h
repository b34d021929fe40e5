#pragma once

#include <optional>

#include "common/base/option_fields.h"

namespace twoport {

/// `control.passivity.fractal_impedance`. An absent number is set by the rule in gains.h.
struct FractalImpedanceOptions {
  std::optional<double> stiffness_n_per_m, rotational_stiffness_n_m_per_rad;
  TWOPORT_OPTIONS_OF_BLOCK(stiffness_n_per_m, rotational_stiffness_n_m_per_rad)
};

}  // namespace twoport
