#pragma once

#include <tuple>

#include "common/base/vector.h"
#include "common/contact/signed_distance.h"
#include "common/link/payload.h"
#include "common/method/transparency/surface/surface_patch.h"

namespace twoport {

template <int D>
using Direction = Coords<struct DirectionKind, D>;  // unit vector

/// What the slave reports about the surface it touches and its set point, in the master's world and units.
template <int N>
struct SurfaceReport {
  static constexpr int D = kAxes<N>;
  Latest<double> contact;              ///< 1: the robot touches; 0: it is free
  Latest<Direction<D>> normal;         ///< n, into the surface
  Latest<Position<D>> point;           ///< p, on the surface
  Latest<double> stiffness;            ///< K*: surface and coupling in series [N/m]
  Latest<double> friction, curvature;  ///< μ, κ [1/m]
  Latest<Position<N>> echo;            ///< set point of the slave's coupling in the tick of this report
  Latest<Position<D>> robot;           ///< the robot's contact point (N = 1, 3: the robot)
  Latest<Displacement<3>> lever;       ///< N = 6: from the tool point to the contact, in handle axes [m]
  /// Joints whose last one is two fingers: what they hold, of that axis alone; `fingers_side` is its n, 1 or -1.
  Latest<double> fingers_contact, fingers_side, fingers_point, fingers_stiffness;

  auto fields() {
    auto all = std::tie(contact, normal, point, stiffness, friction, curvature, echo, robot);
    if constexpr (N == 6) {
      return std::tuple_cat(all, std::tie(lever));
    } else if constexpr (N == kJointPort) {
      return std::tuple_cat(all, std::tie(fingers_contact, fingers_side, fingers_point, fingers_stiffness));
    } else {
      return all;
    }
  }
  /// Of the fingers alone, which are that axis.
  [[nodiscard]] SurfaceReport<1> of_fingers(int axis) const noexcept {
    SurfaceReport<1> out;
    out.contact = fingers_contact;
    out.normal.value = Direction<1>{Point<1>{fingers_side.value}};
    out.point.value = Position<1>{Point<1>{fingers_point.value}};
    out.stiffness = fingers_stiffness;
    out.echo.value = Position<1>{Point<1>{echo.value.translation()[axis]}};
    out.robot.value = Position<1>{Point<1>{robot.value.translation()[axis]}};
    return out;
  }
};

/// The surface of a report, not checked.
template <int N>
SurfacePatch<kAxes<N>> patch_of(const SurfaceReport<N>& said) noexcept {
  SurfacePatch<kAxes<N>> patch;
  patch.point = said.point.value.translation();
  patch.normal = said.normal.value.vec();
  patch.stiffness = said.stiffness.value;
  patch.friction = said.friction.value;
  patch.curvature = said.curvature.value;
  return patch;
}

/// What the master adds: its set point is x - offset, x the position in the same report; and the force of the surface that the
/// hand feels at x, without the dampers.
template <int N>
struct MasterSays {
  static constexpr int D = kAxes<N>;
  Latest<Displacement<D>> offset;                   ///< o [m], in the master's world
  Latest<Coords<struct SurfaceForceKind, D>> felt;  ///< f_m [N], in the master's units
  auto fields() { return std::tie(offset, felt); }
};

}  // namespace twoport
