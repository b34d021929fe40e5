#pragma once

#include "common/contact/signed_distance.h"

namespace twoport {

/// The half space normal·p < offset.
struct Wall {
  static constexpr const char* kName = "wall";
  Eigen::Vector3d normal;  ///< outward, of unit length
  double offset_m;

  template <int D>
  [[nodiscard]] SignedDistance<D> signed_distance(const Point<D>& p, Feature) const noexcept {
    return {normal.head<D>().dot(p) - offset_m, normal.head<D>()};
  }
};

}  // namespace twoport
