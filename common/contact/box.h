#pragma once

#include "common/contact/signed_distance.h"

namespace twoport {

/// Solid, faces along the axes: |p - center| < half_size in each coordinate. Its features are its faces: 2 i for the one
/// towards +i, 2 i + 1 for the one towards -i. Inside, the nearest face is used; outside, the face with the largest
/// distance to its plane. A given face continues smoothly past its edges.
struct Box {
  static constexpr const char* kName = "box";
  Eigen::Vector3d center_m, half_size_m;

  template <int D>
  [[nodiscard]] SignedDistance<D> signed_distance(const Point<D>& p, Feature face) const noexcept {
    const Point<D> from_center = p - center_m.head<D>();
    int axis = face / 2;
    bool negative = face % 2 != 0;
    if (face == kNearest) {
      (from_center.cwiseAbs() - half_size_m.head<D>()).maxCoeff(&axis);
      negative = from_center[axis] < 0.0;
    }
    Point<D> normal = Point<D>::Zero();
    normal[axis] = negative ? -1.0 : 1.0;
    return {normal[axis] * from_center[axis] - half_size_m[axis], normal, static_cast<Feature>(2 * axis + negative)};
  }
};

}  // namespace twoport
