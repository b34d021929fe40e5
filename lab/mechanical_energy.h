#pragma once

#include <optional>

#include "common/base/scalar.h"
#include "common/contact/environment.h"
#include "common/scene/scene.h"

namespace twoport::lab {

/// What a robot alone and its environment hold; an ideal robot has no mass.
///
///     ½ m v² + ½ ωᵀ R J Rᵀ ω + Σ ½ K d²
template <int N>
Energy mechanical_energy(const std::optional<RobotSpec>& robot, const Environment<N>& environment, const Position<N>& x,
                         const Velocity<N>& v) {
  double kinetic = 0.0;
  if (robot) kinetic = 0.5 * robot->mass_kg * v.vec().template head<kAxes<N>>().squaredNorm();
  if constexpr (N == 6)
    if (robot) {
      const Eigen::Vector3d turning = x.attitude().conjugate() * Eigen::Vector3d{v.vec().template tail<3>()};
      kinetic += 0.5 * turning.cwiseAbs2().dot(vector<3>(robot->inertia_kg_m2));
    }
  return Energy{kinetic} + environment.potential(x);
}
/// The same of a simulated one.
template <int N>
Energy mechanical_energy([[maybe_unused]] const std::optional<RobotSpec>& spec, const auto& robot) {
  if constexpr (N == kJointPort)
    return robot.environment().potential(Position<6>{});  // it begins at rest
  else
    return mechanical_energy<N>(spec, robot.environment(), robot.state().x, robot.state().v);
}

}  // namespace twoport::lab
