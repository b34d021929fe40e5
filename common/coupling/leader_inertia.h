#pragma once

#include <Eigen/Cholesky>
#include <memory>
#include <utility>

#include "common/arm/arm_model.h"
#include "common/coupling/options.h"
#include "common/passivity/velocity_predictor.h"

namespace twoport {

/// The inertia of the leader's joints, in the metric of its node (JointMetric), at each position:
///
///     (S⁻¹ M(q) S⁻¹)⁻¹       |S M⁻¹ Jᵀ|, the most that a force on the tool accelerates the joints
///
/// Null where the model of the arm is not known, and for another port than one of joints.
template <int N>
class LeaderInertia {
 public:
  explicit LeaderInertia(const ControlOptions&) {}
  [[nodiscard]] static const PortInertia<N>* at(const Position<N>&) noexcept { return nullptr; }
};

template <>
class LeaderInertia<kJointPort> {
 public:
  explicit LeaderInertia(const ControlOptions& o) : model_{o.leader}, s_{o.joint_scale} {}

  /// `x` in the metric. It lives until the next call.
  const PortInertia<kJointPort>* at(const Position<kJointPort>& x) noexcept {
    if (model_ == nullptr) return nullptr;
    const auto n = model_->size();
    const Axes q = x.translation().cwiseQuotient(s_);
    const ArmModel::Pose pose = model_->pose(q.head(n));
    const Axes inverse = s_.cwiseInverse();
    Eigen::Matrix<double, kJointPort, kJointPort> M = Eigen::Matrix<double, kJointPort, kJointPort>::Identity();
    M.topLeftCorner(n, n) = inverse.head(n).asDiagonal() * model_->inertia(pose) * inverse.head(n).asDiagonal();
    const Eigen::LLT<Eigen::Matrix<double, kJointPort, kJointPort>> factors{M};
    now_.inverse_mass = factors.solve(Eigen::Matrix<double, kJointPort, kJointPort>::Identity());
    Eigen::Matrix<double, kJointPort, 3> to_joints = Eigen::Matrix<double, kJointPort, 3>::Zero();
    to_joints.topRows(n) = inverse.head(n).asDiagonal() * model_->jacobian(pose).topRows<3>().transpose();
    now_.of_hand = (now_.inverse_mass * to_joints).norm();
    return &now_;
  }

 private:
  using Axes = Eigen::Matrix<double, kJointPort, 1>;
  std::shared_ptr<const ArmModel> model_;
  Axes s_;
  PortInertia<kJointPort> now_;
};

}  // namespace twoport
