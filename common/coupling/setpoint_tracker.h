#pragma once

#include <algorithm>
#include <cmath>

#include "common/base/vector.h"
#include "common/coupling/options.h"

namespace twoport {

/// Turns reports of position and velocity that may be late, lost or out of step into one commanded motion.
///
///     target(k) = x_rx            when a report has arrived, else target(k-1) + T v
///     v         = v_rx, and 0 once the last report is older than kBridge
///     v_d(k)    = v + clip((target(k) - x_d(k-1))/T - v, max(catch_up, v_owed))
///
/// Over a link without loss x_d is the received position at each tick. A short gap is bridged with the last velocity, and the
/// remaining error is corrected at a velocity of at most catch_up, so a loss causes neither an offset nor a jump. In a longer gap x_d goes
/// on by at most kBridge v_rx. What x_rx differs from the target when such a gap of t_gap ends is owed; it is made up at v_owed =
/// owed/t_gap, so that gaps that recur do not add up.
template <int N>
class SetpointTracker {
 public:
  static constexpr Seconds kBridge{0.05};

  explicit SetpointTracker(const CouplingOptions& o) : catch_up_{o.catch_up_m_per_s} {}

  /// `from` is x_d(k-1), the present command.
  Velocity<N> step(const Position<N>& from, const Position<N>& x_rx, const Velocity<N>& v_rx, bool fresh,
                   Seconds dt) noexcept {
    if (fresh) {
      if (gap_s_ > kBridge.si()) [[unlikely]]
        owe((x_rx - target_).vec());
      gap_s_ = 0.0;
    } else {
      gap_s_ += dt.si();
    }
    v_ = gap_s_ <= kBridge.si() ? v_rx : Velocity<N>{};
    target_ = fresh ? x_rx : target_ + v_ * dt;
    return v_ + clip((target_ - from) / dt - v_, dt);
  }

  /// Estimate of the other side's position.
  [[nodiscard]] const Position<N>& target() const noexcept { return target_; }
  /// Estimate of the other side's velocity, v.
  [[nodiscard]] const Velocity<N>& velocity() const noexcept { return v_; }

 private:
  static constexpr double kRadPerMetre = 10.0;  // catch_up of the attitude [rad/s] for each m/s

  /// A way that is still to be made up.
  struct Owed {
    double left = 0.0, rate = 0.0;
    void add(double way, double gap_s) noexcept {
      left += way;
      rate = left / gap_s;
    }
    /// The greatest correction in a tick, at least `catch_up`.
    double limit(double catch_up, Seconds dt) noexcept {
      if (left <= 0.0) return catch_up;
      left -= rate * dt.si();
      return std::max(catch_up, rate);
    }
  };

  void owe(const typename Displacement<N>::Vector& error) noexcept {
    way_.add(error.template head<kAxes<N>>().norm(), gap_s_);
    if constexpr (N == 6) turn_.add(error.template tail<3>().norm(), gap_s_);
  }
  Velocity<N> clip(const Velocity<N>& repair, Seconds dt) noexcept {
    typename Velocity<N>::Vector r = repair.vec();
    r.template head<kAxes<N>>() *= bounded(r.template head<kAxes<N>>().squaredNorm(), way_.limit(catch_up_, dt));
    if constexpr (N == 6)
      r.template tail<3>() *= bounded(r.template tail<3>().squaredNorm(), turn_.limit(kRadPerMetre * catch_up_, dt));
    return Velocity<N>{r};
  }
  static double bounded(double norm2, double limit) noexcept {
    return norm2 <= limit * limit ? 1.0 : limit / std::sqrt(norm2);
  }

  double catch_up_, gap_s_ = 0.0;
  Owed way_, turn_;
  Position<N> target_;
  Velocity<N> v_;
};

}  // namespace twoport
