#pragma once

#include "common/contact/environment.h"
#include "common/scene/scene.h"

namespace twoport::lab {

/// What a robot alone and its environment hold [J].
///
///     ½ m v² + ½ ωᵀ R J Rᵀ ω + Σ ½ K d²
template <int N>
double mechanical_energy(const RobotSpec& robot, const Environment<N>& environment, const Position<N>& x,
                         const Velocity<N>& v) {
  double e = environment.potential(x).si() + 0.5 * robot.mass_kg * v.vec().template head<kAxes<N>>().squaredNorm();
  if constexpr (N == 6) {
    const Eigen::Vector3d turning = x.attitude().conjugate() * Eigen::Vector3d{v.vec().template tail<3>()};
    e += 0.5 * turning.cwiseAbs2().dot(vector<3>(robot.inertia_kg_m2));
  }
  return e;
}

}  // namespace twoport::lab
