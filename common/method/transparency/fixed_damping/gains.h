#pragma once

#include <algorithm>
#include <cmath>

#include "common/coupling/options.h"

namespace twoport {

/// Springs and dampers of the fixed-damping method, for translation and rotation.
struct FixedDampingGains {
  double stiffness_n_per_m, damping_n_s_per_m, rotational_stiffness_n_m_per_rad, rotational_damping_n_m_s_per_rad;
};

/// Round trip that a spring between two sampled sides sees [s]: the network's delays, and one tick of each side, as each
/// end of each spring is held for a tick.
inline double sampled_round_trip_s(const KnownSystem& known) {
  return (known.round_trip + known.master_tick + known.slave_tick).si();
}

/// What is not given is set so that 4 B_m s B_s >= (s K R)², all in the master's units, with equal dampers B >= K R √s/2:
///
///     K given:  B = max(B_c, K R √s/2)       K not given:  B as given, or that of the virtual coupling, B_c;
///                                                          K = min(K_c, 2 B/(R √s))
///
/// K_c, B_c: of the virtual coupling; R: sampled_round_trip_s; s: impedance_scale. Source: Nuño, Basañez, Ortega, Automatica 47(3), 2011.
inline FixedDampingGains fixed_damping_gains(const ControlOptions& o) {
  const auto spring = [&](std::optional<double> k, std::optional<double> b, double k_coupling, double b_coupling,
                          double scale) {
    const double round_trip = sampled_round_trip_s(o.known) * std::sqrt(scale);
    struct Pair {
      double k, b;
    };
    if (k) return Pair{*k, b.value_or(std::max(b_coupling, 0.5 * *k * round_trip))};
    const double damping = b.value_or(b_coupling);
    return Pair{round_trip > 0.0 ? std::min(k_coupling, 2.0 * damping / round_trip) : k_coupling, damping};
  };
  const FixedDampingOptions& given = o.fixed_damping;
  const auto [k, b] = spring(given.stiffness_n_per_m, given.damping_n_s_per_m, o.coupling.stiffness_n_per_m,
                             o.coupling.damping_n_s_per_m, o.force_scale * o.motion_scale);
  const auto [k_r, b_r] = spring(given.rotational_stiffness_n_m_per_rad, given.rotational_damping_n_m_s_per_rad,
                                 o.coupling.rotational_stiffness_n_m_per_rad,
                                 o.coupling.rotational_damping_n_m_s_per_rad, o.force_scale / o.motion_scale);
  return {k, b, k_r, b_r};
}

}  // namespace twoport
