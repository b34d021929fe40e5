#pragma once

#include <memory>

#include "common/contact/signed_distance.h"
#include "common/mesh/distance_field.h"

namespace twoport {

/// A part given by a triangle mesh. Distance and normal are the value and the gradient of one interpolant of its sampled
/// distance (common/mesh/distance_field.h), so that the elastic force has a potential. The gradient's length is 1 up to the
/// interpolation error.
struct Mesh {
  static constexpr const char* kName = "mesh";
  Eigen::Vector3d position_m;                  ///< of the mesh's origin
  Eigen::Matrix3d rotation;                    ///< turns the mesh's axes into the world's
  std::shared_ptr<const DistanceField> field;  ///< shared by copies

  template <int D>
  [[nodiscard]] SignedDistance<D> signed_distance(const Point<D>& p, Feature) const noexcept {
    if constexpr (D == 3) {
      const DistanceField::Sample at = field->at(rotation.transpose() * (p - position_m));
      return {at.distance, Point<3>{rotation * at.gradient}};
    } else {
      return {p[0] - position_m[0], Point<D>::Unit(0)};  // no scene has one with dof 1
    }
  }
};

}  // namespace twoport
