#pragma once

#include <memory>
#include <type_traits>
#include <variant>

#include "common/contact/plate.h"
#include "common/contact/revolved.h"
#include "common/contact/signed_distance.h"
#include "common/contact/simple_solids.h"
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

/// List of all contact shapes. A shape has
///
///     kName                                     its block in a scene
///     signed_distance<D>(p, feature) noexcept   at p, on `feature` or kNearest
///
/// and shares large data (a mesh, a sampled field) between its copies. The distance changes by no more than p moves, or least_way() says by
/// how much more (common/contact/environment.h).
using Shape = std::variant<Wall, Sphere, Cylinder, Box, Torus, Capsule, Peg, Hole, Cone, Plate, Mesh>;

/// Calls use(std::type_identity<S>{}) for every type S of the list.
template <class Use>
void for_each_shape(Use use) {
  [&]<class... S>(std::type_identity<std::variant<S...>>) {
    (use(std::type_identity<S>{}), ...);
  }(std::type_identity<Shape>{});
}

inline const char* name(const Shape& shape) {
  return std::visit([](const auto& s) { return s.kName; }, shape);
}

/// The same for a shape other than a wall: out of line, so that it does not slow down walls, the most frequent shape.
template <int D>
SignedDistance<D> signed_distance_of_solid(const Shape& shape, Point<D> p, Feature feature) noexcept {
  return std::visit([&](const auto& s) { return s.template signed_distance<D>(p, feature); }, shape);
}
template <int D>
SignedDistance<D> signed_distance(const Shape& shape, const Point<D>& p, Feature feature = kNearest) noexcept {
  if (const Wall* wall = std::get_if<Wall>(&shape)) return wall->signed_distance<D>(p, feature);
  return signed_distance_of_solid<D>(shape, p, feature);
}

}  // namespace twoport
