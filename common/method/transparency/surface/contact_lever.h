#pragma once

#include <Eigen/Core>
#include <algorithm>

#include "common/base/low_pass.h"
#include "common/base/scalar.h"

namespace twoport {

/// Lever b of a point contact from the tool point, in tool axes, from force f and torque τ = (R b) × f of a sensor with noise; the part along f
/// is unknown and taken as zero.
///
///     b = LP_a[Rᵀ(f × τ)]/LP_a[|f|²]      least squares of τ = (R b) × f, weighted by |f|²
///     σ² = LP_0.1s |e(k) - e(k-1)|²/2,    e = Rᵀ(f × τ) - |f|² b: noise of a tick
///     a = T/2 (σ/(LP_a|f|² 0.3 mm))²      noise of b of 0.3 mm; between 10 ms and 0.3 s
///
/// Where f is small, b is all noise: 0.05 N m over 0.3 N are 0.17 m. The weights leave little of that once the force has risen.
class ContactLever {
 public:
  using Vector = Eigen::Vector3d;

  /// `force`, `torque` in tool axes. `contact`: false starts anew.
  void step(const Vector& force, const Vector& torque, bool contact, Seconds dt) noexcept {
    const double weight = force.squaredNorm();
    const Vector moment = force.cross(torque);
    const Vector error = moment - weight * lever_;
    if (!contact || !(weight_ > 0.0)) {
      weight_ = weight;
      moment_ = moment;
      variance_ = 0.0;
    } else {
      low_pass(variance_, 0.5 * (error - error_).squaredNorm(), dt, kNoise_s);
      const double noise_m2 = variance_ / (weight_ * weight_);
      const double a = std::clamp(0.5 * dt.si() * noise_m2 / (kNoise_m * kNoise_m), kLeast_s, kMost_s);
      low_pass(weight_, weight, dt, a);
      low_pass(moment_, moment, dt, a);
    }
    error_ = error;
    if (weight_ > kForce_n * kForce_n) lever_ = moment_ / weight_;
  }
  [[nodiscard]] const Vector& value() const noexcept { return lever_; }

 private:
  static constexpr double kLeast_s = 10e-3, kMost_s = 0.3, kNoise_s = 0.1, kNoise_m = 0.3e-3, kForce_n = 0.1;
  Vector moment_ = Vector::Zero(), lever_ = Vector::Zero(), error_ = Vector::Zero();
  double weight_ = 0.0, variance_ = 0.0;
};

}  // namespace twoport
