#include "common/coupling/joint_tool.h"

#include <Eigen/Cholesky>
#include <utility>

namespace twoport {
namespace {

constexpr int kWrist = 3;
constexpr double kLever_m = 0.01, kUnexplained = 0.2;
constexpr double kSingular = 1e-4;  // so that a tool that cannot move in some direction has no force there

}  // namespace

JointTool::JointTool(std::shared_ptr<const ArmModel> arm, const Axes& scale)
    : arm_{std::move(arm)}, mobility_{scale.cwiseAbs2().cwiseInverse()} {}

Eigen::Vector3d JointTool::At::moved(const Axes& q) const noexcept {
  return J.topRows<3>() * q;
}

Force<3> JointTool::At::force(const Force<kJointPort>& torque) const noexcept {
  return Force<3>{to_force * torque.vec()};
}

JointTool::At JointTool::at(const Position<kJointPort>& q) const noexcept {
  const auto n = arm_->size();
  const ArmModel::Pose pose = arm_->pose(q.translation().head(n));
  At at;
  at.tool = pose.tool;
  at.attitude = pose.tool_rotation;
  at.J.setZero();
  at.J.leftCols(n) = arm_->jacobian(pose);
  const Eigen::Matrix<double, 3, kJointPort> weighted = at.J.topRows<3>() * mobility_.asDiagonal();
  Eigen::Matrix3d tool_mobility = weighted * at.J.topRows<3>().transpose();
  tool_mobility.diagonal().array() += 1e-9 * tool_mobility.trace();  // a tool that an arm cannot move in some direction
  at.to_force = tool_mobility.llt().solve(weighted);
  return at;
}

Force<3> JointTool::force_beside_moment(const At& at, const Force<kJointPort>& torque) const noexcept {
  const Eigen::Matrix<double, 6, kJointPort> weighted = at.J * mobility_.asDiagonal();
  Eigen::Matrix<double, 6, 6> tool_mobility = weighted * at.J.transpose();
  tool_mobility.diagonal() *= 1.0 + kSingular;
  const Eigen::Matrix<double, 6, 1> wrench = tool_mobility.llt().solve(weighted * torque.vec());
  return Force<3>{wrench.head<3>()};
}

bool JointTool::is_before_tool(const At& at, const Force<kJointPort>& torque, bool was) const noexcept {
  const Eigen::Vector3d f = at.to_force * torque.vec();
  const double lever_m = (was ? 2.0 : 1.0) * kLever_m;
  if (!(torque.vec().segment<kWrist>(arm_->arm_joints() - kWrist).norm() < lever_m * f.norm())) return false;
  const Axes unexplained = torque.vec() - at.J.topRows<3>().transpose() * f;
  return unexplained.norm() > kUnexplained * torque.vec().norm();
}

}  // namespace twoport
