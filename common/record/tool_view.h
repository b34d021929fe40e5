#pragma once

#include <Eigen/Cholesky>
#include <type_traits>

#include "common/arm/arm_model.h"
#include "common/record/row.h"
#include "common/scene/scene.h"

namespace twoport {

/// The tool of an arm whose joints are a port, with the metric S (JointMetric):
///
///     v = J q̇       f = (J S⁻² Jᵀ)⁻¹ J S⁻² τ       J: translation of the tool
///
/// f is the force at the tool that accelerates it as the torques do, with S² for the arm's inertia: f where the torques are Jᵀ f.
class ToolOfArm {
 public:
  using Axes = Eigen::Matrix<double, kJointPort, 1>;
  ToolOfArm(const ArmSpec& arm, const Axes& s) : model_{*arm.parameters}, mobility_{s.cwiseAbs2().cwiseInverse()} {}

  /// At joint positions, in axes of the base.
  struct At {
    Eigen::Vector3d tool;
    Eigen::Matrix3d attitude;                          ///< base from flange
    Eigen::Matrix<double, 3, kJointPort> J, to_force;  ///< of joints that there are not: 0

    [[nodiscard]] Position<3> position() const noexcept { return Position<3>{tool}; }
    [[nodiscard]] Eigen::Vector3d moved(const Axes& q) const noexcept { return J * q; }
    [[nodiscard]] Force<3> force(const Force<kJointPort>& torque) const noexcept {
      return Force<3>{to_force * torque.vec()};
    }
  };
  [[nodiscard]] At at(const Position<kJointPort>& q) const noexcept {
    const ArmModel::Pose pose = model_.pose(q.translation().head(model_.size()));
    At at;
    at.tool = pose.tool;
    at.attitude = pose.tool_rotation;
    at.J.setZero();
    at.J.leftCols(model_.size()) = model_.jacobian(pose).topRows<3>();
    const Eigen::Matrix<double, 3, kJointPort> weighted = at.J * mobility_.asDiagonal();
    Eigen::Matrix3d tool_mobility = weighted * at.J.transpose();
    tool_mobility.diagonal().array() +=
        1e-9 * tool_mobility.trace();  // a tool that an arm cannot move in some direction
    at.to_force = tool_mobility.llt().solve(weighted);
    return at;
  }

 private:
  ArmModel model_;
  Axes mobility_;
};

/// A row as figures of forces and positions see it: of handle and tool. For ports of joints those are the tools of the two arms
/// (ToolOfArm). Energies are the ports'.
template <int N>
class ToolView {
 public:
  static constexpr int kSize = N;
  ToolView() = default;
  explicit ToolView(const Scene&) {}
  const Row<N>& operator()(const Row<N>& row) const noexcept { return row; }
};

template <>
class ToolView<kJointPort> {
 public:
  static constexpr int kSize = 3;
  explicit ToolView(const Scene& scene)
      : leader_{*scene.device->arm, scene.control.joint_scale},
        follower_{*scene.robot->arm, scene.control.joint_scale} {}

  Row<3> operator()(const Row<kJointPort>& r) const noexcept {
    const ToolOfArm::At leader = leader_.at(r.master_x), follower = follower_.at(r.slave_x);
    return {.t_s = r.t_s,
            .master_x = leader.position(),
            .master_v = Velocity<3>{leader.moved(r.master_v.vec())},
            .master_f = leader.force(r.master_f),
            .master_f_wanted = leader.force(r.master_f_wanted),
            .slave_x = follower.position(),
            .slave_v = Velocity<3>{follower.moved(r.slave_v.vec())},
            .slave_f = follower.force(r.slave_f),
            .env_f = follower.force(r.env_f),
            .position_error = Displacement<3>{follower.moved(r.position_error.vec())},
            .master_energy_j = r.master_energy_j,
            .slave_energy_j = r.slave_energy_j,
            .observed_energy_j = r.observed_energy_j,
            .undissipated_j = r.undissipated_j,
            .dissipated_j = r.dissipated_j,
            .mode = r.mode,
            .figures = r.figures,
            .reference = leader.force(r.reference),
            .coupling_energy_j = r.coupling_energy_j,
            .ahead = Displacement<3>{follower.moved(r.ahead.vec())},
            .touching = r.touching,
            .coupled = r.coupled,
            .following = r.following};
  }

 private:
  ToolOfArm leader_, follower_;
};

}  // namespace twoport
