#pragma once

#include <algorithm>
#include <cmath>

#include "common/base/vector.h"
#include "common/coupling/options.h"

namespace twoport {

/// Turns reports of position and velocity that may be late, lost or out of step into one commanded motion.
///
///     target(k) = x_rx            when a report has arrived, else target(k-1) + T v_rx
///     v_d(k)    = v_rx + clip((target(k) - x_d(k-1))/T - v_rx, catch_up)
///
/// Over a link without loss x_d is the received position at each tick. A gap is bridged with the last velocity, and the
/// remaining error is corrected at a velocity of at most catch_up, so a loss causes neither an offset nor a jump.
template <int N>
class SetpointTracker {
 public:
  explicit SetpointTracker(const CouplingOptions& o) : catch_up_{o.catch_up_m_per_s} {}

  /// `from` is x_d(k-1), the present command.
  Velocity<N> step(const Position<N>& from, const Position<N>& x_rx, const Velocity<N>& v_rx, bool fresh,
                   Seconds dt) noexcept {
    target_ = fresh ? x_rx : target_ + v_rx * dt;
    return v_rx + clip((target_ - from) / dt - v_rx);
  }

  /// Estimate of the other side's position.
  [[nodiscard]] const Position<N>& target() const noexcept { return target_; }

 private:
  static constexpr double kRadPerMetre = 10.0;  // catch_up of the attitude [rad/s] for each m/s

  Velocity<N> clip(const Velocity<N>& repair) const noexcept {
    typename Velocity<N>::Vector r = repair.vec();
    if constexpr (N == 6) {
      r.template head<3>() *= bounded(r.template head<3>().squaredNorm(), catch_up_);
      r.template tail<3>() *= bounded(r.template tail<3>().squaredNorm(), kRadPerMetre * catch_up_);
    } else {
      r *= bounded(r.squaredNorm(), catch_up_);
    }
    return Velocity<N>{r};
  }
  static double bounded(double norm2, double limit) noexcept {
    return norm2 <= limit * limit ? 1.0 : limit / std::sqrt(norm2);
  }

  double catch_up_;
  Position<N> target_;
};

}  // namespace twoport
