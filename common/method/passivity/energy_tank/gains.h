#pragma once

#include <algorithm>
#include <cmath>

#include "common/coupling/options.h"

namespace twoport {

/// Parameters of the two-layer method.
struct EnergyTankGains {
  Energy desired_level;
  double level_gain_n_s_per_m_per_j;
  double transfer_per_s;
};

/// What is not given: the level holds the energy of the coupling's spring at the device's largest force, F²/(2K), between 10 and
/// 100 mJ; an empty tank is filled by a fifth of the coupling's damping B, so the gain is 0.2 B/H_d; half of the tank is sent in a tenth of
/// a second, or in a round trip if that is longer.
inline EnergyTankGains energy_tank_gains(const ControlOptions& o) {
  const EnergyTankOptions& given = o.energy_tank;
  const double k = std::max(o.coupling.stiffness_n_per_m, 1.0), f = std::min(o.max_force_n, 1e3);
  const double level = given.desired_level_j.value_or(std::clamp(0.5 * f * f / k, 0.01, 0.1));
  return {Energy{level},
          given.level_gain_n_s_per_m_per_j.value_or(level > 0.0 ? 0.2 * o.coupling.damping_n_s_per_m / level : 0.0),
          given.transfer_per_s.value_or(std::log(2.0) / std::max(0.1, o.known.round_trip.si()))};
}

}  // namespace twoport
