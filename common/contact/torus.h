#pragma once

#include <cmath>

#include "common/contact/sphere.h"

namespace twoport {

/// Solid ring: closer than `tube_radius_m` to the circle of `radius_m` around `center_m`, normal to `axis`. With p from the
/// center, across = p - (axis·p) axis:
///
///     distance = |p - radius across/|across|| - tube_radius
struct Torus {
  static constexpr const char* kName = "torus";
  Eigen::Vector3d center_m;
  Eigen::Vector3d axis;  ///< of unit length
  double radius_m, tube_radius_m;

  template <int D>
  [[nodiscard]] SignedDistance<D> signed_distance(const Point<D>& p, Feature) const noexcept {
    const Point<D> a = axis.head<D>(), from_center = p - center_m.head<D>();
    const Point<D> across = from_center - a.dot(from_center) * a;
    const double length = across.norm();
    if (length == 0.0)  // on the axis, outside: the whole circle is as near
      return {std::hypot(radius_m, a.dot(from_center)) - tube_radius_m, a};
    return round_distance<D>(from_center - radius_m / length * across, tube_radius_m);
  }
};

}  // namespace twoport
