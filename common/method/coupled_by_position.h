#pragma once

#include "common/base/vector.h"
#include "common/coupling/options.h"

namespace twoport {

/// The options of a method that displays the position error whatever the architecture: both sides then have a spring-damper
/// of this stiffness and damping, and the slave reports the robot's position.
inline ControlOptions coupled_by_position(ControlOptions o, const CouplingOptions& coupling) {
  o.architecture = Architecture::position_position;
  o.coupling = coupling;
  return o;
}

/// One number for the translational axes and one for the rotational ones.
template <int N>
typename Force<N>::Vector per_axis(double translation, double rotation) noexcept {
  typename Force<N>::Vector out;
  out.setConstant(translation);
  if constexpr (N == 6) out.template tail<3>().setConstant(rotation);
  (void)rotation;
  return out;
}

/// Stiffness, damping or inertia at the master for one at the slave: with it the same motion shows force_scale times the slave's force.
///
///     s_f s_x; for rotation s_f / s_x        s_f: force_scale, s_x: motion_scale
template <int N>
typename Force<N>::Vector impedance_scale(const ControlOptions& o) noexcept {
  return per_axis<N>(o.force_scale * o.motion_scale, o.force_scale / o.motion_scale);
}

}  // namespace twoport
