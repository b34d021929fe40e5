#pragma once

#include <Eigen/Cholesky>
#include <memory>
#include <utility>

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

  JointTool(std::shared_ptr<const ArmModel> arm, const Axes& scale)
      : arm_{std::move(arm)}, mobility_{scale.cwiseAbs2().cwiseInverse()} {}

  /// At joint positions.
  struct At {
    Eigen::Vector3d tool;
    Eigen::Matrix3d attitude;                       ///< base from flange
    Eigen::Matrix<double, 6, kJointPort> J;         ///< of joints that there are not: 0
    Eigen::Matrix<double, 3, kJointPort> to_force;  ///< by the translation

    [[nodiscard]] Position<3> position() const noexcept { return Position<3>{tool}; }
    [[nodiscard]] Eigen::Vector3d moved(const Axes& q) const noexcept { return J.topRows<3>() * q; }
    [[nodiscard]] Force<3> force(const Force<kJointPort>& torque) const noexcept {
      return Force<3>{to_force * torque.vec()};
    }
  };
  [[nodiscard]] At at(const Position<kJointPort>& q) const noexcept {
    const auto n = arm_->size();
    const ArmModel::Pose pose = arm_->pose(q.translation().head(n));
    At at;
    at.tool = pose.tool;
    at.attitude = pose.tool_rotation;
    at.J.setZero();
    at.J.leftCols(n) = arm_->jacobian(pose);
    const Eigen::Matrix<double, 3, kJointPort> weighted = at.J.topRows<3>() * mobility_.asDiagonal();
    Eigen::Matrix3d tool_mobility = weighted * at.J.topRows<3>().transpose();
    tool_mobility.diagonal().array() +=
        1e-9 * tool_mobility.trace();  // a tool that an arm cannot move in some direction
    at.to_force = tool_mobility.llt().solve(weighted);
    return at;
  }

  /// The force beside the moment, of six joints or more.
  [[nodiscard]] Force<3> force_beside_moment(const At& at, const Force<kJointPort>& torque) const noexcept {
    const Eigen::Matrix<double, 6, kJointPort> weighted = at.J * mobility_.asDiagonal();
    Eigen::Matrix<double, 6, 6> tool_mobility = weighted * at.J.transpose();
    tool_mobility.diagonal() *= 1.0 + kSingular;
    const Eigen::Matrix<double, 6, 1> wrench = tool_mobility.llt().solve(weighted * torque.vec());
    return Force<3>{wrench.head<3>()};
  }

  /// Do the torques come from a link before the tool, of six joints or more? Joints beyond the link that is touched feel nothing: the force
  /// has next to no lever about the last three, and none at the tool's origin explains the rest. `was`: they did.
  [[nodiscard]] bool is_before_tool(const At& at, const Force<kJointPort>& torque, bool was = false) const noexcept {
    const Eigen::Vector3d f = at.to_force * torque.vec();
    const double lever_m = (was ? 2.0 : 1.0) * kLever_m;
    if (!(torque.vec().segment<kWrist>(arm_->arm_joints() - kWrist).norm() < lever_m * f.norm())) return false;
    const Axes unexplained = torque.vec() - at.J.topRows<3>().transpose() * f;
    return unexplained.norm() > kUnexplained * torque.vec().norm();
  }

 private:
  static constexpr int kWrist = 3;
  static constexpr double kLever_m = 0.01, kUnexplained = 0.2;
  static constexpr double kSingular = 1e-4;  ///< so that a tool that cannot move in some direction has no force there

  std::shared_ptr<const ArmModel> arm_;
  Axes mobility_;  ///< S⁻²
};

}  // namespace twoport
