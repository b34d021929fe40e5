#pragma once

#include <algorithm>

#include "common/base/time.h"
#include "common/base/vector.h"
#include "common/safety/limits.h"

namespace twoport {

/// Largest share in [0, 1] of `f` that is within the limits of force and torque and within half of what their rate allows in a tick.
/// The rate then never acts (SafetyStage): a force that has to vanish vanishes in the next tick.
///
///     s |f| <= min(force_n, T/2 force_rate),   s |τ| <= min(torque_n_m, T/2 force_rate torque_n_m/force_n)
template <int N>
[[nodiscard]] double unheld_share(const Force<N>& f, const PortLimits& limits, Seconds dt) noexcept {
  const double half = 0.5 * dt.si() * limits.force_rate_n_per_s;
  double share =
      std::min(1.0, std::min(limits.force_n, half) / std::max(f.vec().template head<kAxes<N>>().norm(), 1e-300));
  if constexpr (N == 6) {
    double most = limits.torque_n_m;
    if (most < PortLimits::kNone && limits.force_n < PortLimits::kNone) most *= std::min(1.0, half / limits.force_n);
    share = std::min(share, most / std::max(f.vec().template tail<3>().norm(), 1e-300));
  }
  return share;
}

}  // namespace twoport
