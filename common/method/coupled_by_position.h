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

}  // namespace twoport
