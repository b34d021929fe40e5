#pragma once

#include "common/base/vector.h"
#include "common/safety/limits.h"

namespace twoport {

/// May a limit turn the coming force at this position and velocity, and not only shorten it (SafetyStage)? Beyond the workspace, and for
/// joints beyond a range or a speed, the part of the force that leads further is taken away. Joints in the metric of `limits`.
template <int N>
[[nodiscard]] bool may_turn(const PortLimits& limits, const Position<N>& x,
                            [[maybe_unused]] const Velocity<N>& v) noexcept {
  if constexpr (N == kJointPort) {
    const JointLimits& j = limits.joints;
    const auto q = x.translation().array(), rate = v.vec().array();
    return (q > j.upper || q < j.lower || rate.abs() > j.speed).any();
  } else {
    return x.translation().norm() > limits.workspace_m;
  }
}

}  // namespace twoport
