#pragma once

#include <cmath>
#include <memory>
#include <utility>

#include "common/arm/arm_model.h"
#include "common/coupling/options.h"
#include "common/passivity/velocity_predictor.h"

namespace twoport {

/// The inertia of the leader's joints, in the metric of its node (JointMetric), at each position:
///
///     S M(q)⁻¹ S       |S M⁻¹ Jᵀ|, the most that a force on the tool, and on fingers, accelerates the joints
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
  explicit LeaderInertia(const ControlOptions& o) : model_{o.leader}, s_{o.joint_scale} {
    now_.inverse_mass.setIdentity();
  }

  /// `q` as the device reads it. It lives until the next call.
  const PortInertia<kJointPort>* at(const Position<kJointPort>& q) noexcept {
    if (model_ == nullptr) return nullptr;
    const auto n = model_->size();
    const ArmModel::Pose pose = model_->pose(q.translation().head(n));
    const auto scale = s_.head(n).asDiagonal();
    const ArmModel::Inertia inverse = scale * InertiaFactors{model_->inertia(pose)}.inverse();
    now_.inverse_mass.topLeftCorner(n, n) = inverse * scale;
    now_.of_hand = inverse.lazyProduct(model_->jacobian(pose).topRows<3>().transpose()).norm();
    if (model_->has_fingers()) now_.of_hand = std::hypot(now_.of_hand, inverse.col(n - 1).norm());
    return &now_;
  }

 private:
  using Axes = Eigen::Matrix<double, kJointPort, 1>;
  std::shared_ptr<const ArmModel> model_;
  Axes s_;
  PortInertia<kJointPort> now_;
};

}  // namespace twoport
