#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "common/contact/revolved.h"
#include "common/contact/simple_solids.h"

namespace twoport {

/// Points on a surface of revolution about the axis through `point`, `spacing` apart at most along its profile, a chain of (r, z),
/// and around the axis: no point of the surface is farther than spacing/√2 from one of them. There is a ring at each corner of the
/// chain; every second ring is turned by half a step.
inline std::vector<Eigen::Vector3d> sample_revolved(const Eigen::Vector3d& point, const Eigen::Vector3d& axis,
                                                    const std::vector<Eigen::Vector2d>& chain, double spacing) {
  std::vector<Eigen::Vector3d> points;
  const Eigen::Vector3d e1 = axis.unitOrthogonal(), e2 = axis.cross(e1);
  int rings = 0;
  const auto ring = [&](const Eigen::Vector2d& at) {
    const double r = std::abs(at.x());
    const int count =
        r > 1e-9 * spacing
            ? std::max(3, static_cast<int>(std::ceil(2.0 * std::numbers::pi * r / spacing * (1.0 - 1e-12))))
            : 1;
    const double start = rings++ % 2 == 0 ? 0.0 : 0.5;
    for (int i = 0; i < count; ++i) {
      const double angle = 2.0 * std::numbers::pi * (i + start) / count;
      points.push_back(point + at.y() * axis + at.x() * (std::cos(angle) * e1 + std::sin(angle) * e2));
    }
  };
  if (chain.empty()) return points;
  ring(chain[0]);
  for (std::size_t k = 1; k < chain.size(); ++k) {
    const Eigen::Vector2d from = chain[k - 1], way = chain[k] - from;
    if (way.norm() == 0.0) continue;
    const int pieces = std::max(1, static_cast<int>(std::ceil(way.norm() / spacing * (1.0 - 1e-12))));
    for (int i = 1; i <= pieces; ++i) ring(from + static_cast<double>(i) / pieces * way);
  }
  return points;
}

/// Of a solid without an end at infinity.
inline std::vector<Eigen::Vector3d> sample(const Revolved& part, double spacing) {
  std::vector<Eigen::Vector2d> chain;
  for (const Profile::Segment& s : part.profile->segments()) {
    if (chain.empty()) chain.push_back(s.origin);
    chain.push_back(s.origin + s.to * s.along);
  }
  return sample_revolved(part.point_m, part.axis, chain, spacing);
}
inline std::vector<Eigen::Vector3d> sample(const Torus& part, double spacing) {
  const int count = std::max(3, static_cast<int>(std::ceil(2.0 * std::numbers::pi * part.tube_radius_m / spacing)));
  std::vector<Eigen::Vector3d> points;
  // One ring at a time: the chords of a chain would leave the circle.
  for (int i = 0; i < count; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / count;
    const Eigen::Vector2d at{part.radius_m + part.tube_radius_m * std::cos(angle),
                             part.tube_radius_m * std::sin(angle)};
    const auto ring = sample_revolved(part.center_m, part.axis, {at}, spacing);
    points.insert(points.end(), ring.begin(), ring.end());
  }
  return points;
}
inline std::vector<Eigen::Vector3d> sample(const Capsule& part, double spacing) {
  const Eigen::Vector3d way = part.end_m - part.start_m;
  const double length = way.norm(), r = part.radius_m;
  std::vector<Eigen::Vector3d> points;
  const auto ring = [&](const Eigen::Vector2d& at) {
    const auto more = sample_revolved(part.start_m, way / length, {at}, spacing);
    points.insert(points.end(), more.begin(), more.end());
  };
  const int quarter = std::max(1, static_cast<int>(std::ceil(0.5 * std::numbers::pi * r / spacing)));
  const int along = std::max(1, static_cast<int>(std::ceil(length / spacing)));
  for (int i = 0; i < quarter; ++i) {
    const double angle = 0.5 * std::numbers::pi * i / quarter;
    ring({r * std::sin(angle), -r * std::cos(angle)});
    ring({r * std::sin(angle), length + r * std::cos(angle)});
  }
  for (int i = 0; i <= along; ++i) ring({r, length * i / along});
  return points;
}

}  // namespace twoport
