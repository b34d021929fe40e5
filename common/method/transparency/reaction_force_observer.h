#pragma once

#include "common/base/time.h"
#include "common/base/vector.h"

namespace twoport {

/// Estimates the force on a mass from its velocity and the other force on it, without differentiation.
///
///     f̂ = LP_g(f - b v + g m v) - g m v        m dv/dt = f - b v - f̂;   LP_g: first order, g rad/s
///
/// Source: reaction force observer, Murakami, Yu, Ohnishi, IEEE T-IE 40(2), 1993.
template <int N>
class ReactionForceObserver {
 public:
  using Vector = typename Force<N>::Vector;
  ReactionForceObserver(const Vector& mass, const Vector& damping, double bandwidth_rad_per_s)
      : mass_{mass}, damping_{damping}, bandwidth_{bandwidth_rad_per_s} {}

  void start(const Velocity<N>& v) noexcept { low_pass_ = bandwidth_ * mass_.cwiseProduct(v.vec()); }
  Force<N> step(const Force<N>& f, const Velocity<N>& v, Seconds dt) noexcept {
    const Vector momentum = bandwidth_ * mass_.cwiseProduct(v.vec());
    const double share = bandwidth_ * dt.si() / (1.0 + bandwidth_ * dt.si());
    low_pass_ += share * (f.vec() - damping_.cwiseProduct(v.vec()) + momentum - low_pass_);
    return Force<N>{low_pass_ - momentum};
  }

 private:
  Vector mass_, damping_, low_pass_ = Vector::Zero();
  double bandwidth_;
};

}  // namespace twoport
