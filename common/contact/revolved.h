#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <vector>

#include "common/contact/signed_distance.h"

namespace twoport {

/// Boundary of a solid of revolution in the half plane of r >= 0 and z: a chain of straight segments with the material on
/// its left. It ends on the axis, or at infinity at its start. Distance and normal are exact on both sides.
///
/// Features: segment i has the number i, corner j (from 0, at the start of segment j) the number of segments + j. A corner
/// is the nearest part outside where the material is convex there, and inside where it is concave.
class Profile {
 public:
  struct Segment {
    Eigen::Vector2d origin, along;  ///< (r, z); `along` of unit length
    double from, to;                ///< of the parameter along it [m]
    [[nodiscard]] Eigen::Vector2d outward() const noexcept { return {along.y(), -along.x()}; }
  };

  /// Through `corners`, which are (r, z). `endless`: the first segment comes from infinity; then the first corner only
  /// states its direction.
  explicit Profile(const std::vector<Eigen::Vector2d>& corners, bool endless = false) {
    for (std::size_t i = 0; i + 1 < corners.size(); ++i) {
      const Eigen::Vector2d way = corners[i + 1] - corners[i];
      const double length = way.norm();
      if (!(length > 0.0)) continue;
      const bool first = endless && segments_.empty();
      segments_.push_back({first ? corners[i + 1] : corners[i], way / length,
                           first ? -std::numeric_limits<double>::infinity() : 0.0, first ? 0.0 : length});
    }
    // On the axis the chain goes on as its mirror image.
    const auto mirrored = [](const Eigen::Vector2d& along) { return Eigen::Vector2d{along.x(), -along.y()}; };
    for (std::size_t j = 0; j <= segments_.size(); ++j) {
      const Eigen::Vector2d before = j > 0 ? segments_[j - 1].along : mirrored(segments_[0].along);
      const Eigen::Vector2d after = j < segments_.size() ? segments_[j].along : mirrored(segments_.back().along);
      const Eigen::Vector2d at = j < segments_.size() ? at_parameter(segments_[j], segments_[j].from)
                                                      : at_parameter(segments_.back(), segments_.back().to);
      corners_.push_back({at, before.x() * after.y() - before.y() * after.x() < 0.0 ? -1.0 : 1.0});
    }
  }

  [[nodiscard]] const std::vector<Segment>& segments() const noexcept { return segments_; }

  /// Signed distance and its gradient at (r, z).
  [[nodiscard]] SignedDistance<2> signed_distance(const Eigen::Vector2d& p, Feature feature) const noexcept {
    const int count = static_cast<int>(segments_.size());
    if (feature == kNearest) feature = nearest(p);
    if (feature < count) {
      const Segment& s = segments_[static_cast<std::size_t>(feature)];
      const Eigen::Vector2d normal = s.outward();
      return {normal.dot(p - s.origin), normal, feature};
    }
    const Corner& c = corners_[static_cast<std::size_t>(feature - count)];
    const Eigen::Vector2d from = p - c.at;
    const double length = from.norm();
    if (length == 0.0) return {0.0, Eigen::Vector2d::UnitY(), feature};
    return {c.sign * length, c.sign / length * from, feature};
  }

 private:
  struct Corner {
    Eigen::Vector2d at;
    double sign;  ///< of the distance where the corner is the nearest part
  };

  static Eigen::Vector2d at_parameter(const Segment& s, double parameter) {
    return std::isfinite(parameter) ? Eigen::Vector2d{s.origin + parameter * s.along} : s.origin;
  }
  [[nodiscard]] Feature nearest(const Eigen::Vector2d& p) const noexcept {
    const int count = static_cast<int>(segments_.size());
    double least = std::numeric_limits<double>::infinity();
    Feature found = 0;
    for (int i = 0; i < count; ++i) {
      const Segment& s = segments_[static_cast<std::size_t>(i)];
      const double along = s.along.dot(p - s.origin), parameter = std::clamp(along, s.from, s.to);
      const double squared = (p - s.origin - parameter * s.along).squaredNorm();
      if (squared >= least) continue;
      least = squared;
      found = along < s.from ? count + i : along > s.to ? count + i + 1 : i;
    }
    return found;
  }

  std::vector<Segment> segments_;
  std::vector<Corner> corners_;
};

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
