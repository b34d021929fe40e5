#pragma once

#include "common/contact/sphere.h"

namespace twoport {

/// Solid and infinite: closer than the radius to the line through `point_m` along `axis`.
struct Cylinder {
  static constexpr const char* kName = "cylinder";
  Eigen::Vector3d point_m;
  Eigen::Vector3d axis;  ///< of unit length
  double radius_m;

  template <int D>
  [[nodiscard]] SignedDistance<D> signed_distance(const Point<D>& p, Feature) const noexcept {
    const Point<D> a = axis.head<D>(), from_point = p - point_m.head<D>();
    return round_distance<D>(from_point - a.dot(from_point) * a, radius_m);
  }
};

}  // namespace twoport
