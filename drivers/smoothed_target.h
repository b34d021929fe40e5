#pragma once

#include <cmath>

#include "common/base/vector.h"

namespace twoport {

/// Motion of a handle that follows a target which changes in steps, without a step in velocity: per axis critically damped,
///
///     v' = w² (target - x) - 2 w v      implicit Euler, stable at every w T
template <int N>
class SmoothedTarget {
 public:
  using Vector = typename Velocity<N>::Vector;
  explicit SmoothedTarget(double cutoff_hz, const Vector& x = Vector::Zero()) : w_{2.0 * M_PI * cutoff_hz}, x_{x} {}

  void advance(const Vector& target, double dt_s) noexcept {
    v_ = (v_ + dt_s * w_ * w_ * (target - x_)) / (1.0 + 2.0 * w_ * dt_s + w_ * w_ * dt_s * dt_s);
    x_ += dt_s * v_;
  }
  [[nodiscard]] const Vector& x() const noexcept { return x_; }
  [[nodiscard]] const Vector& v() const noexcept { return v_; }

 private:
  double w_;
  Vector x_, v_ = Vector::Zero();
};

/// A position from its coordinates: translation, then rotation vector.
template <int N>
Position<N> position_at(const typename Displacement<N>::Vector& coordinates) {
  return Position<N>{} + Displacement<N>{coordinates};
}

}  // namespace twoport
