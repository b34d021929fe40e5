#pragma once

#include <Eigen/Core>
#include <memory>

#include "common/arm/arm_model.h"
#include "common/base/vector.h"

namespace twoport {

/// The tool of an arm whose joints are the port: what its joints do there.
///
///     v = J q̇       f = (J S⁻² Jᵀ)⁻¹ J S⁻² τ       S: JointMetric
///
/// J of the tool's translation: f is the force that accelerates it as the torques do, with S² for the arm's inertia; it is f where the
/// torques are Jᵀ f. J of translation and rotation: force and moment are told apart, which needs six joints.
class JointTool {
 public:
  using Axes = Eigen::Matrix<double, kJointPort, 1>;

  JointTool(std::shared_ptr<const ArmModel> arm, const Axes& scale);

  /// At joint positions.
  struct At {
    Eigen::Vector3d tool;
    Eigen::Matrix3d attitude;                       ///< base from flange
    Eigen::Matrix<double, 6, kJointPort> J;         ///< of joints that there are not: 0
    Eigen::Matrix<double, 3, kJointPort> to_force;  ///< by the translation

    [[nodiscard]] Position<3> position() const noexcept { return Position<3>{tool}; }
    [[nodiscard]] Eigen::Vector3d moved(const Axes& q) const noexcept;
    [[nodiscard]] Force<3> force(const Force<kJointPort>& torque) const noexcept;
  };
  [[nodiscard]] At at(const Position<kJointPort>& q) const noexcept;

  /// The force beside the moment, of six joints or more.
  [[nodiscard]] Force<3> force_beside_moment(const At& at, const Force<kJointPort>& torque) const noexcept;

  /// Do the torques come from a link before the tool, of six joints or more? Joints beyond the link that is touched feel nothing: the force
  /// has next to no lever about the last three, and none at the tool's origin explains the rest. `was`: they did.
  [[nodiscard]] bool is_before_tool(const At& at, const Force<kJointPort>& torque, bool was = false) const noexcept;

 private:
  std::shared_ptr<const ArmModel> arm_;
  Axes mobility_;  ///< S⁻²
};

}  // namespace twoport
