#pragma once

#include <cstdint>
#include <optional>

#include "common/base/option_fields.h"

namespace twoport {

/// What a receiver plays when packets are late or lost (receiver.h).
enum class WaveReceiverRule : std::uint8_t {
  energy_limited,  ///< the wave integral, within the energy received
  hold,            ///< the newest wave; not passive when packets are lost
  zero,            ///< the newest wave in the tick in which it arrives, else nothing
};

/// `control.passivity.wave_variables`. An absent number is set by the rule in gains.h.
struct WaveVariablesOptions {
  std::optional<double> impedance_n_s_per_m, rotational_impedance_n_m_s_per_rad;
  WaveReceiverRule receiver = WaveReceiverRule::energy_limited;
  double position_correction_per_s = 0.0;
  TWOPORT_OPTIONS_OF_BLOCK(impedance_n_s_per_m, rotational_impedance_n_m_s_per_rad, receiver, position_correction_per_s)
};

}  // namespace twoport
