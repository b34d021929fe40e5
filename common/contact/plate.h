#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <vector>

#include "common/contact/signed_distance.h"

namespace twoport {

/// A round hole through a plate, in the plate's own axes.
struct PlateHole {
  Eigen::Vector2d center_m;
  double radius_m;
};

/// Rectangular plate with round holes along its own z axis. The holes lie within it and do not overlap. With q in its own
/// axes from its center, h its half size:
///
///     across   = max(|q_x| - h_x, |q_y| - h_y, radius_i - |q - hole_i|)      outside a corner the distance to it
///     through  = |q_z| - h_z
///     distance = max(across, through) inside, else |(max(across, 0), max(through, 0))|: exact
///
/// Features: 0, 1 the faces towards +z, -z; 2 to 5 the sides towards +x, -x, +y, -y; 6 + i hole i.
struct Plate {
  static constexpr const char* kName = "plate";
  Eigen::Vector3d center_m;
  Eigen::Matrix3d rotation;  ///< turns the plate's axes into the world's
  Eigen::Vector3d half_size_m;
  std::shared_ptr<const std::vector<PlateHole>> holes;  ///< shared by copies

  template <int D>
  [[nodiscard]] SignedDistance<D> signed_distance(const Point<D>& p, Feature feature) const noexcept {
    if constexpr (D == 3) {
      const Eigen::Vector3d q = rotation.transpose() * (p - center_m);
      SignedDistance<3> at = feature == kNearest ? nearest(q) : on(q, feature);
      at.normal = Eigen::Vector3d{rotation * at.normal};
      return at;
    } else {
      return {p[0] - center_m[0], Point<D>::Unit(0)};  // no scene has one with dof 1
    }
  }

 private:
  [[nodiscard]] double distance(const Eigen::Vector3d& q, Feature feature) const noexcept {
    if (feature < 6) {
      const int axis = (feature / 2 + 2) % 3;
      return (feature % 2 == 0 ? q[axis] : -q[axis]) - half_size_m[axis];
    }
    const PlateHole& hole = (*holes)[static_cast<std::size_t>(feature - 6)];
    return hole.radius_m - (q.head<2>() - hole.center_m).norm();
  }
  [[nodiscard]] SignedDistance<3> on(const Eigen::Vector3d& q, Feature feature) const noexcept {
    Eigen::Vector3d normal = Eigen::Vector3d::Zero();
    if (feature < 6) {
      normal[(feature / 2 + 2) % 3] = feature % 2 == 0 ? 1.0 : -1.0;
    } else {
      const Eigen::Vector2d from_axis = q.head<2>() - (*holes)[static_cast<std::size_t>(feature - 6)].center_m;
      const double r = from_axis.norm();
      if (r > 0.0)
        normal.head<2>() = -from_axis / r;
      else
        normal.x() = -1.0;
    }
    return {distance(q, feature), normal, feature};
  }
  [[nodiscard]] SignedDistance<3> nearest(const Eigen::Vector3d& q) const noexcept {
    const Feature x = q.x() < 0.0 ? 3 : 2, y = q.y() < 0.0 ? 5 : 4, z = q.z() < 0.0 ? 1 : 0;
    const double to_x = distance(q, x), to_y = distance(q, y), through = distance(q, z);
    bool corner = to_x > 0.0 && to_y > 0.0;
    Feature part = !corner && to_y > to_x ? y : x;
    double across = corner ? std::hypot(to_x, to_y) : std::max(to_x, to_y);
    for (std::size_t i = 0; i < holes->size(); ++i) {
      const auto hole = static_cast<Feature>(6 + i);
      if (const double wall = distance(q, hole); wall > across) across = wall, part = hole, corner = false;
    }
    if (!(across > through) && !(across > 0.0 && through > 0.0)) return on(q, z);
    const SignedDistance<3> side = corner ? outside(on(q, x), on(q, y)) : on(q, part);
    return through > 0.0 && across > 0.0 ? outside(side, on(q, z)) : side;
  }
  /// From an edge between two parts at right angles, of which both are behind the point.
  static SignedDistance<3> outside(const SignedDistance<3>& a, const SignedDistance<3>& b) noexcept {
    const double distance = std::hypot(a.distance, b.distance);
    return {distance, (a.distance * a.normal + b.distance * b.normal) / distance, a.feature};
  }
};

}  // namespace twoport
