#pragma once

#include <Eigen/Core>
#include <cmath>

namespace twoport {

/// Translational part of a vector of coordinates: what "force" and "position" mean in a summary.
template <class Vector>
auto translational(const Vector& v) {
  if constexpr (Vector::RowsAtCompileTime == 6) {
    return Eigen::Vector3d{v.template head<3>()};
  } else {
    return v;
  }
}

/// Angle between two vectors [rad], exact near 0 and π: atan2(|u×f|, u·f), with |u×f| from the rejection of u on f.
template <class Vector>
double angle(const Vector& u, const Vector& f) {
  const double along = u.dot(f), f2 = f.squaredNorm();
  const Vector across = u - (along / f2) * f;
  return std::atan2(across.norm() * std::sqrt(f2), along);
}

}  // namespace twoport
