#pragma once

#include "common/base/spatial_vector.h"
#include "common/base/vector.h"
#include "common/scene/scene.h"

namespace twoport::sim {

/// The hand that holds a handle: a spring and damper between the intended motion and the handle.
///
///     f = k (x_h - x) + b (ẋ_h - ẋ)
///
/// x_h moves linearly within a tick. The part that depends on the handle's motion within the tick,
/// -k (x - x(0)) - b ẋ, is added to the handle's stiffness and damping; the rest is a load u + w s at time s of the tick.
template <int N>
class Hand {
 public:
  using Vector = PortVector<N>;

  /// Holds the handle at `start`.
  Hand(const HandSpec& spec, double dt, const Position<N>& start)
      : dt_{dt},
        k_{spec.stiffness_n_per_m, spec.rotational_stiffness_n_m_per_rad},
        b_{spec.damping_n_s_per_m, spec.rotational_damping_n_m_s_per_rad},
        intended_{start} {}

  /// Adds its load on a handle at x with velocity v in a tick at whose end the intended position is `next`.
  void add_load(const Position<N>& next, const Position<N>& x, const Vector& v, Vector& u, Vector& w) noexcept {
    Vector rate = difference(next, intended_);
    rate /= dt_;
    const Vector stretch = difference(intended_, x);
    u += k_ * stretch + b_ * rate;
    w = k_ * rate;
    if constexpr (N == 6) {
      // r = log(R_h Rᵀ) turns as it grows: ṙ = ω_h - ω - ½ r×(ω_h + ω) + (1/12) r×(r×(ω_h - ω)).
      const Eigen::Vector3d &r = stretch.angular, &w_h = rate.angular, &w_d = v.angular;
      w.angular -= k_.angular * r.cross(0.5 * (w_h + w_d) - r.cross(w_h - w_d) / 12.0);
    }
    intended_ = next;
  }

 private:
  double dt_;
  PortScale k_, b_;
  Position<N> intended_;  ///< where the tick begins
};

}  // namespace twoport::sim
