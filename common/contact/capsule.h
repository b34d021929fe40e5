#pragma once

#include <algorithm>

#include "common/contact/sphere.h"

namespace twoport {

/// Solid: closer than the radius to the straight line between two points.
struct Capsule {
  static constexpr const char* kName = "capsule";
  Eigen::Vector3d start_m, end_m;  ///< different
  double radius_m;

  template <int D>
  [[nodiscard]] SignedDistance<D> signed_distance(const Point<D>& p, Feature) const noexcept {
    const Point<D> along = (end_m - start_m).head<D>(), from_start = p - start_m.head<D>();
    const double share = std::clamp(along.dot(from_start) / along.squaredNorm(), 0.0, 1.0);
    return round_distance<D>(from_start - share * along, radius_m);
  }
};

}  // namespace twoport
