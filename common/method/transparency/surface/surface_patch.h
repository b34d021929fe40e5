#pragma once

#include <cmath>

#include "common/contact/signed_distance.h"

namespace twoport {

/// Depth behind a surface [m], negative in front of it, and the unit normal into the surface there.
template <int D>
struct SurfaceDepth {
  double depth;
  Point<D> normal;
};

/// A surface near a contact, in the master's world and units: a plane, or a sphere through the contact point.
///
///     plane    d(y) = n·(y - p)                         n into the surface: a hand that presses feels the force along n
///     sphere   d(y) = σ (|y - c| - 1/|κ|),  n(y) = σ (y - c)/|y - c|,   c = p - n/κ,  σ = sign κ
///
/// κ < 0: the surface is convex (a ball), κ > 0: hollow.
template <int D>
struct SurfacePatch {
  Point<D> point = Point<D>::Zero();    ///< p, on the surface [m]
  Point<D> normal = Point<D>::Unit(0);  ///< n at p
  double stiffness = 0.0;  ///< K of the surface, or of the surface in series with the slave's coupling [N/m]
  double friction = 0.0;   ///< Coulomb coefficient μ
  double curvature = 0.0;  ///< κ [1/m]

  [[nodiscard]] SurfaceDepth<D> at(const Point<D>& y) const noexcept {
    if (D == 1 || std::abs(curvature) < kFlat) return {normal.dot(y - point), normal};
    const double radius = 1.0 / std::abs(curvature), sign = curvature < 0.0 ? -1.0 : 1.0;
    const Point<D> from_center = y - point + normal / curvature;
    const double distance = from_center.norm();
    if (!(distance > kCenter * radius)) return {normal.dot(y - point), normal};
    return {sign * (distance - radius), (sign / distance) * from_center};
  }

 private:
  static constexpr double kFlat = 0.1;     // [1/m]
  static constexpr double kCenter = 0.05;  // nearer to the center the normal is not defined well
};

}  // namespace twoport
