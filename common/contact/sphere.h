#pragma once

#include "common/contact/signed_distance.h"

namespace twoport {

/// Distance to a surface at `radius` around the point or axis that is `from_center` away.
template <int D>
SignedDistance<D> round_distance(const Point<D>& from_center, double radius) noexcept {
  const double length = from_center.norm();
  Point<D> normal = Point<D>::Unit(0);
  if (length > 0.0) normal = from_center / length;
  return {length - radius, normal};
}

/// Solid: |p - center| < radius. In one dimension an interval.
struct Sphere {
  static constexpr const char* kName = "sphere";
  Eigen::Vector3d center_m;
  double radius_m;

  template <int D>
  [[nodiscard]] SignedDistance<D> signed_distance(const Point<D>& p, Feature) const noexcept {
    return round_distance<D>(p - center_m.head<D>(), radius_m);
  }
};

}  // namespace twoport
