#pragma once

#include <optional>

#include "common/base/option_fields.h"

namespace twoport {

/// `control.passivity.energy_tank`. An absent number is set by the rule in gains.h.
struct EnergyTankOptions {
  std::optional<double> desired_level_j;             ///< H_d of the master's tank
  std::optional<double> level_gain_n_s_per_m_per_j;  ///< α: damping for each joule that is missing
  std::optional<double> transfer_per_s;              ///< share of a tank that is sent in a second
  TWOPORT_OPTIONS_OF_BLOCK(desired_level_j, level_gain_n_s_per_m_per_j, transfer_per_s)
};

}  // namespace twoport
