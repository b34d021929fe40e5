#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>

#include "common/arm/tool_load.h"
#include "common/contact/environment.h"
#include "common/scene/scene.h"
#include "sim/plant/body_plant.h"

namespace twoport::sim {

/// A hand on the tool of an arm: spring and damper between the intended motion and the tool, and a mass that is held to the tool
/// and whose weight the hand carries.
///
///     f = k (x_h - x) + b (ẋ_h - ẋ) + push        rotation: k_r log(R_h Rᵀ) + b_r (ω_h - ω)
///
/// x_h moves linearly within a tick.
struct HandOnTool {
  HandSpec spec;
  Position<6> intended, next;  ///< where the tick begins and ends
  Velocity<6> rate{};
};

template <int n>
class SerialArm;

/// An arm with the number of joints that its file has. SerialArm (serial_arm.h) says what it computes.
class ArmPlant {
 public:
  virtual ~ArmPlant() = default;
  [[nodiscard]] virtual std::unique_ptr<ArmPlant> copy() const = 0;

  /// One tick under the commanded wrench f.
  virtual BodyState<6> advance(const Force<6>& f) noexcept = 0;
  /// The hand's intended position at the end of the coming tick.
  virtual void lead(const Position<6>& intended) noexcept = 0;
  /// Adds dv to the tool's velocity, with the joint motion of the least kinetic energy.
  virtual void kick(const Velocity<6>& dv) noexcept = 0;
  /// Of environment and hand on the tool.
  [[nodiscard]] virtual Force<6> outside_force() const noexcept = 0;
  /// What the wrist sensor adds to that, in world axes at the tool's origin: the inertia of tool and hand, from their mass.
  [[nodiscard]] virtual Force<6> tool_inertia() const noexcept = 0;
  [[nodiscard]] virtual const Eigen::Matrix3d& attitude() const noexcept = 0;
  /// Energy of the commanded wrench into the arm through the joints [J].
  [[nodiscard]] virtual Energy port_energy() const noexcept = 0;
  /// The one with n joints, if it is that.
  template <int n>
  [[nodiscard]] const SerialArm<n>* joints() const noexcept {
    return dynamic_cast<const SerialArm<n>*>(this);
  }

  static inline const Eigen::Vector3d kGravity{0.0, 0.0, -9.81};

 protected:
  ArmPlant() = default;
  ArmPlant(const ArmPlant&) = default;
  ArmPlant& operator=(const ArmPlant&) = default;
};

[[nodiscard]] std::unique_ptr<ArmPlant> make_arm(const ArmSpec& arm,
                                                 const std::shared_ptr<const Environment<6>>& environment, double dt,
                                                 const Position<6>& start,
                                                 const std::optional<HandOnTool>& hand = std::nullopt);

/// Weight of the tool and bias of the wrist sensor as they were identified before the run, from six attitudes read once
/// each, against the true ones.
class WristCompensation {
 public:
  WristCompensation(const ArmSpec& arm, const ForceSensorSpec& sensor, std::uint64_t seed);
  /// What is left of weight and bias in the reading at the attitude R, in tool axes [N], [N m].
  [[nodiscard]] Eigen::Matrix<double, 6, 1> residual(const Eigen::Matrix3d& R) const noexcept {
    return true_.reading(R, ArmPlant::kGravity) - found_.reading(R, ArmPlant::kGravity);
  }

 private:
  static constexpr std::uint64_t kStream = 0x3715;
  ToolLoad true_, found_;
};

}  // namespace twoport::sim
