#pragma once

#include <optional>

#include "common/base/option_fields.h"

namespace twoport {

/// `control.passivity.four_channel`. An absent number is set by the rule in gains.h.
struct FourChannelOptions {
  bool reaction_force_observer = false;  ///< estimates the environment's force instead of measuring it
  std::optional<double> observer_bandwidth_rad_per_s;
  std::optional<double> force_gain;   ///< of both force channels
  bool disturbance_observer = false;  ///< cancels all other forces on handle and robot
  TWOPORT_OPTIONS_OF_BLOCK(reaction_force_observer, observer_bandwidth_rad_per_s, force_gain, disturbance_observer)
};

}  // namespace twoport
