#pragma once

#include <optional>

#include "common/base/option_fields.h"

namespace twoport {

/// `control.passivity.energy_bounding`: lower bounds of the device's damping. Absent: the scene's device.
struct EnergyBoundingOptions {
  std::optional<double> damping_n_s_per_m, rotational_damping_n_m_s_per_rad;
  TWOPORT_OPTIONS_OF_BLOCK(damping_n_s_per_m, rotational_damping_n_m_s_per_rad)
};

}  // namespace twoport
