#pragma once

#include <Eigen/Core>
#include <cmath>
#include <numbers>

namespace twoport {

/// Translational part of a vector of coordinates. Figures of forces and positions in a summary are of this part.
template <class Vector>
auto translational(const Vector& v) {
  if constexpr (Vector::RowsAtCompileTime == 6) {
    return Eigen::Vector3d{v.template head<3>()};
  } else {
    return v;
  }
}

/// Angle between two vectors [rad], accurate near 0 and π too: atan2(|r| |f|, u·f) with r = u - (u·f/|f|²) f, the part of u
/// perpendicular to f.
template <class Vector>
double angle(const Vector& u, const Vector& f) {
  const double along = u.dot(f), f2 = f.squaredNorm();
  const Vector across = u - (along / f2) * f;
  return std::atan2(across.norm() * std::sqrt(f2), along);
}

/// Square of the angle between u and f [rad²]; u2 = |u|², f2 = |f|². For angles below 1e-7 rad it is |r|²/|u|², with r the
/// part of u perpendicular to f. In one dimension it is 0 or π².
template <class Vector>
double squared_angle(const Vector& u, const Vector& f, double u2, double f2) noexcept {
  const double along = u.dot(f);
  if constexpr (Vector::RowsAtCompileTime == 1) {
    return along < 0.0 ? std::numbers::pi * std::numbers::pi : 0.0;
  } else {
    const double share = along / f2, across2 = u2 - along * share;
    if (along > 0.0 && across2 < 1e-14 * u2) return (u - share * f).squaredNorm() / u2;
    const double a = angle(u, f);
    return a * a;
  }
}

}  // namespace twoport
