#pragma once

#include <algorithm>
#include <limits>

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
/// at most m_handle/(2T), and J_handle/(2T), T of the master: a handle m under a held damper b diverges from b = 2m/T on.
///
/// Source: impedance matching, Niemeyer, Slotine, IEEE J. Oceanic Engineering 16(1), 1991, with the mobility of a coupling
/// that is sampled with the period T.
inline WaveImpedance wave_impedance(const ControlOptions& o) {
  const double t = o.known.slave_tick.si(), scale = o.force_scale * o.motion_scale,
               turned = o.force_scale / o.motion_scale;
  const CouplingOptions& c = o.coupling;
  const auto matched = [&](double k, double b, double mass, double scaled) {
    const double held = mass > 0.0 && o.known.master_tick.si() > 0.0 ? 0.5 * mass / o.known.master_tick.si()
                                                                     : std::numeric_limits<double>::infinity();
    return std::min(scaled * (b + k * t > 0.0 ? b + k * t : 1.0), held);
  };
  return {o.wave_variables.impedance_n_s_per_m.value_or(
              matched(c.stiffness_n_per_m, c.damping_n_s_per_m, o.handle_mass_kg, scale)),
          o.wave_variables.rotational_impedance_n_m_s_per_rad.value_or(matched(
              c.rotational_stiffness_n_m_per_rad, c.rotational_damping_n_m_s_per_rad, o.handle_inertia_kg_m2, turned))};
}

}  // namespace twoport
