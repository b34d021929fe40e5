#pragma once

#include <type_traits>
#include <variant>

#include "common/contact/box.h"
#include "common/contact/capsule.h"
#include "common/contact/cylinder.h"
#include "common/contact/mesh.h"
#include "common/contact/plate.h"
#include "common/contact/revolved.h"
#include "common/contact/sphere.h"
#include "common/contact/torus.h"
#include "common/contact/wall.h"

namespace twoport {

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
