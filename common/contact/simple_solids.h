#pragma once

#include <algorithm>
#include <cmath>

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
