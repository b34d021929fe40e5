#pragma once

#include <cmath>

namespace twoport {

/// Velocity from the counts of an encoder: the steady state of a Kalman filter for white noise of acceleration, an α-β filter whose
/// gains follow from the tracking index Λ = a dt²/σ (P. R. Kalata, IEEE Trans. Aerospace and Electronic Systems 20(2), 1984):
///
///     x⁻ = x + dt v      x = x⁻ + α (z - x⁻)      v = v + β/dt (z - x⁻)
///     r = (4 + Λ - √(8Λ + Λ²))/4      α = 1 - r²      β = 2 (2 - α) - 4 √(1 - α)
///
/// with σ = step/√12 of the counts. tests/unit/joint_velocity_test.cc compares it with others.
class JointVelocity {
 public:
  explicit JointVelocity(double step, double acceleration = kAcceleration)
      : index_{acceleration * std::sqrt(12.0) / step} {}

  /// A reading z, `dt` after the one before. Returns v.
  double add(double z, double dt) noexcept {
    if (!begun_ || !(dt > 0.0)) {
      x_ = begun_ ? x_ : z;
      begun_ = true;
      return v_;
    }
    const double index = index_ * dt * dt, r = (4.0 + index - std::sqrt(index * (8.0 + index))) / 4.0;
    const double alpha = 1.0 - r * r, beta = 2.0 * (2.0 - alpha) - 4.0 * r;
    const double surprise = z - (x_ + dt * v_);
    x_ += dt * v_ + alpha * surprise;
    v_ += beta / dt * surprise;
    return v_;
  }

  static constexpr double kAcceleration = 10.0;  ///< [rad/s²]; more: less lag, more noise

 private:
  double index_, x_ = 0.0, v_ = 0.0;
  bool begun_ = false;
};

}  // namespace twoport
