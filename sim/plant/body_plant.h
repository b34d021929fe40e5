#pragma once

#include <memory>

#include "common/contact/environment.h"
#include "common/scene/scene.h"

namespace twoport::sim {

/// Position and velocity of a robot's body, world axes.
template <int N>
struct BodyState {
  Position<N> x;
  Velocity<N> v;
};

/// A body under a held force in an environment, where exact maps do not exist.
template <int N>
class BodyPlant {
 public:
  virtual ~BodyPlant() = default;
  [[nodiscard]] virtual std::unique_ptr<BodyPlant> copy() const = 0;

  /// One tick under the force f.
  virtual BodyState<N> advance(const Force<N>& f) noexcept = 0;
  /// Of the environment on the body.
  [[nodiscard]] virtual Force<N> environment_force() const noexcept = 0;
  /// Adds dv to the velocity.
  virtual void kick(const Velocity<N>& dv) noexcept = 0;
  /// The environment's surfaces have other materials now.
  virtual void surfaces_have_changed() noexcept {}

 protected:
  BodyPlant() = default;
  BodyPlant(const BodyPlant&) = default;
  BodyPlant& operator=(const BodyPlant&) = default;
};

/// By the scene's integrator: RungeKuttaPlant (exact), DormandPrincePlant, or FixedStepPlant. Up to `few` surfaces all are asked, of more
/// those that BroadPhase finds; the results are the same.
template <int N>
std::unique_ptr<BodyPlant<N>> make_body_plant(const RobotSpec& robot,
                                              const std::shared_ptr<const Environment<N>>& environment, double dt,
                                              const BodyState<N>& start, const SimulationSpec& simulation,
                                              std::size_t few = BroadPhase<kAxes<N>>::kFew);

}  // namespace twoport::sim
