#pragma once

#include <cmath>

#include "common/contact/simple_solids.h"

namespace twoport {

/// Solid and infinite, with a round bore: its material lies between two radii around the line through `point_m` along
/// `axis`. With p from the point, across = p - (axis·p) axis:
///
///     distance = ||across| - (outer + inner)/2| - (outer - inner)/2
struct Pipe {
  static constexpr const char* kName = "pipe";
  Eigen::Vector3d point_m;
  Eigen::Vector3d axis;  ///< of unit length
  double inner_radius_m, outer_radius_m;

  template <int D>
  [[nodiscard]] SignedDistance<D> signed_distance(const Point<D>& p, Feature) const noexcept {
    const Point<D> a = axis.head<D>(), from_point = p - point_m.head<D>();
    SignedDistance<D> at =
        round_distance<D>(from_point - a.dot(from_point) * a, 0.5 * (outer_radius_m + inner_radius_m));
    if (at.distance < 0.0) at = {-at.distance, -at.normal};  // nearer to the bore
    at.distance -= 0.5 * (outer_radius_m - inner_radius_m);
    return at;
  }
};

}  // namespace twoport
