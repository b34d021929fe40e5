#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace twoport {

/// Of the filter y(k) + a1 y(k-1) + a2 y(k-2) = b0 (x(k) - 2 x(k-1) + x(k-2)).
struct HighPassCoefficients {
  double b0, a1, a2;
  HighPassCoefficients(double corner_hz, double rate_hz) {
    const double k = std::tan(std::numbers::pi * std::min(corner_hz / rate_hz, 0.49));
    const double norm = 1.0 / (1.0 + std::numbers::sqrt2 * k + k * k);
    b0 = norm;
    a1 = 2.0 * (k * k - 1.0) * norm;
    a2 = (1.0 - std::numbers::sqrt2 * k + k * k) * norm;
  }
};

/// Second-order Butterworth high-pass filter of D coordinates, by the bilinear transform, in transposed direct form II. The
/// corner frequency is at most 0.49 of the sampling rate.
template <int D>
class HighPass {
 public:
  HighPass(double corner_hz, double rate_hz) {
    const HighPassCoefficients c{corner_hz, rate_hz};
    b0_ = c.b0, a1_ = c.a1, a2_ = c.a2;
  }
  using Vector = Eigen::Matrix<double, D, 1>;
  Vector step(const Vector& x) noexcept {
    const Vector y = b0_ * x + s1_;
    s1_ = -2.0 * b0_ * x - a1_ * y + s2_;
    s2_ = b0_ * x - a2_ * y;
    return y;
  }

 private:
  double b0_, a1_, a2_;
  Vector s1_ = Vector::Zero(), s2_ = Vector::Zero();
};

}  // namespace twoport
