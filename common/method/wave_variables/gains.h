#pragma once

#include "common/coupling/options.h"

namespace twoport {

/// Wave impedance b, for translation [N s/m] and rotation [N m s/rad], in the master's units.
struct WaveImpedance {
  double translation, rotation;
};

/// What is not given matches the slave's sampled coupling, which then reflects no wave:
///
///     b = s_f s_x (B + K T)      b_r = s_f/s_x (B_r + K_r T)       K, B of the virtual coupling, T of the slave
///
/// Source: impedance matching, Niemeyer, Slotine, IEEE J. Oceanic Engineering 16(1), 1991, with the mobility of a coupling
/// that is sampled with the period T.
inline WaveImpedance wave_impedance(const ControlOptions& o) {
  const double t = o.known.slave_tick.si(), scale = o.force_scale * o.motion_scale,
               turned = o.force_scale / o.motion_scale;
  const CouplingOptions& c = o.coupling;
  const auto matched = [t](double k, double b) { return b + k * t > 0.0 ? b + k * t : 1.0; };
  return {o.wave_variables.impedance_n_s_per_m.value_or(scale * matched(c.stiffness_n_per_m, c.damping_n_s_per_m)),
          o.wave_variables.rotational_impedance_n_m_s_per_rad.value_or(
              turned * matched(c.rotational_stiffness_n_m_per_rad, c.rotational_damping_n_m_s_per_rad))};
}

}  // namespace twoport
