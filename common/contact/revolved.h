#pragma once

#include <memory>

#include "common/contact/profile.h"

namespace twoport {

/// A solid of revolution: its profile turned about the axis through `point_m`. z counts along the axis from that point.
struct Revolved {
  Eigen::Vector3d point_m;
  Eigen::Vector3d axis;                    ///< of unit length
  std::shared_ptr<const Profile> profile;  ///< shared by copies

  template <int D>
  [[nodiscard]] SignedDistance<D> signed_distance(const Point<D>& p, Feature feature) const noexcept {
    const Point<D> a = axis.head<D>(), from_point = p - point_m.head<D>();
    const double z = a.dot(from_point);
    Point<D> radial = from_point - z * a;
    const double r = radial.norm();
    if (r > 0.0) {
      radial /= r;
    } else if constexpr (D == 3) {
      radial = a.unitOrthogonal();
    }
    const SignedDistance<2> at = profile->signed_distance({r, z}, feature);
    return {at.distance, at.normal.x() * radial + at.normal.y() * a, at.feature};
  }
};

/// Round peg with the centre of its end at the point; the axis goes from there into the peg.
///
///     0 < z < length,   r < radius,   r < radius - chamfer + z
struct Peg : Revolved {
  static constexpr const char* kName = "peg";
  static Peg of(const Eigen::Vector3d& end_m, const Eigen::Vector3d& axis, double radius_m, double length_m,
                double chamfer_m) {
    return {{end_m, axis,
             std::make_shared<const Profile>(std::vector<Eigen::Vector2d>{
                 {0, 0}, {radius_m - chamfer_m, 0}, {radius_m, chamfer_m}, {radius_m, length_m}, {0, length_m}})}};
  }
};

/// A half space with a round hole, the centre of whose mouth is the point; the axis goes out of the material.
///
///     material: z < 0, without r < radius, -depth < z and without r < radius + chamfer + z
struct Hole : Revolved {
  static constexpr const char* kName = "hole";
  static Hole of(const Eigen::Vector3d& mouth_m, const Eigen::Vector3d& axis, double radius_m, double depth_m,
                 double chamfer_m) {
    const double mouth = radius_m + chamfer_m;
    return {{mouth_m, axis,
             std::make_shared<const Profile>(
                 std::vector<Eigen::Vector2d>{
                     {2 * mouth, 0}, {mouth, 0}, {radius_m, -chamfer_m}, {radius_m, -depth_m}, {0, -depth_m}},
                 true)}};
  }
};

/// Cone with its apex at the point; the axis goes from there to the centre of its base.
///
///     0 < z < height,   r < base_radius z/height
struct Cone : Revolved {
  static constexpr const char* kName = "cone";
  static Cone of(const Eigen::Vector3d& apex_m, const Eigen::Vector3d& axis, double base_radius_m, double height_m) {
    return {{apex_m, axis,
             std::make_shared<const Profile>(
                 std::vector<Eigen::Vector2d>{{0, 0}, {base_radius_m, height_m}, {0, height_m}})}};
  }
};

}  // namespace twoport
