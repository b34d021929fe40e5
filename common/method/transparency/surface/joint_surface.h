#pragma once

#include <algorithm>
#include <optional>

#include "common/coupling/joint_tool.h"
#include "common/coupling/options.h"
#include "common/method/transparency/surface/surface_estimator.h"

namespace twoport {

/// The surface that a tool touches whose arm's joints are the port, as a plane in their metric. Friction acts along the way of the tool,
/// which is not the way of the joints; in their axes it would tilt the normal whenever the tool turns back, and close a delayed loop.
///
///     p_t, J S⁻¹ v, f_t (JointTool)       at the tool: SurfaceEstimator finds n_t, p_0, K_t, μ
///     m = S⁻¹ Jᵀ n_t,   n = m/|m|,   K = K_t |m|²,   p = x - n n_t·(p_t - p_0)/|m|,   κ = 0
///
/// Two fingers, the last joint, touch something else than the tool: their surface is that of their axis alone.
///
/// The arm's is estimated in the axes of the joints where the arm is not known, where it has fewer than six joints, whose torques do not
/// tell at which link the contact is, and where they tell that it is not at the tool (JointTool::is_before_tool of LP_50ms τ).
class JointSurface {
 public:
  static constexpr int N = kJointPort;

  explicit JointSurface(const ControlOptions& o) : scale_{o.joint_scale}, motion_scale_{o.motion_scale} {
    if (o.follower == nullptr) return;
    if (o.follower->has_fingers()) fingers_axis_ = static_cast<int>(o.follower->size()) - 1;
    if (o.follower->arm_joints() >= 6) tool_.emplace(o.follower, o.joint_scale);
  }

  void reset() noexcept {
    at_tool_.reset();
    in_joints_.reset();
    fingers_.reset();
    before_tool_ = false;
    torque_ = Force<N>{};
  }
  /// `robot` in the slave's world; x, v, f as of SurfaceEstimator, in the metric.
  void step(const Position<N>& robot, const Point<N>& x, Point<N> v, Point<N> f, Seconds dt) noexcept {
    if (fingers_axis_ >= 0) {
      const auto own = [this](const Point<N>& all) { return Point<1>{all[fingers_axis_]}; };
      fingers_.step(own(x), own(v), own(f), dt);
      v[fingers_axis_] = f[fingers_axis_] = 0.0;
    }
    if (!tool_) return step_in_joints(x, v, f, dt);
    const JointTool::At at = tool_->at(Position<N>{robot.translation().cwiseQuotient(scale_)});
    const Force<N> torque{f.cwiseProduct(scale_)};
    low_pass(torque_, torque, dt, kLink_s);
    if (tool_->is_before_tool(at, torque_, before_tool_) != before_tool_) {
      before_tool_ = !before_tool_;
      at_tool_.reset();
      in_joints_.reset();
    }
    if (before_tool_) return step_in_joints(x, v, f, dt);
    const Point<3> p = at.tool / motion_scale_;
    at_tool_.step(p, at.moved(v.cwiseQuotient(scale_)), tool_->force_beside_moment(at, torque).vec(), dt);
    if (!contact()) return;
    const SurfacePatch<3>& found = at_tool_.patch();
    const Point<N> m = (at.J.topRows<3>().transpose() * found.normal).cwiseQuotient(scale_);
    const double size = m.norm();
    if (!(size > kStill)) return;
    patch_.normal = m / size;
    patch_.point = x - found.normal.dot(p - found.point) / size * patch_.normal;
    patch_.stiffness = found.stiffness * size * size;
    patch_.friction = found.friction;
    share_ = std::max(kLeastShare, size * size);
  }

  /// Of the arm.
  [[nodiscard]] bool contact() const noexcept { return at_tool() ? at_tool_.contact() : in_joints_.contact(); }
  [[nodiscard]] const SurfacePatch<N>& patch() const noexcept { return patch_; }
  [[nodiscard]] const SurfaceEstimator<1>& fingers() const noexcept { return fingers_; }  ///< no contact without
  /// A stiffness in the metric over that at the tool: |m|², at least 0.02, or 1 where the surface is not at the tool; of fingers 1/s².
  [[nodiscard]] Point<N> share() const noexcept {
    Point<N> all = Point<N>::Constant(at_tool() ? share_ : 1.0);
    if (fingers_axis_ >= 0) all[fingers_axis_] = 1.0 / (scale_[fingers_axis_] * scale_[fingers_axis_]);
    return all;
  }

 private:
  [[nodiscard]] bool at_tool() const noexcept { return tool_ && !before_tool_; }

  static constexpr double kStill = 1e-6;  ///< no joint moves the tool across the surface
  static constexpr double kLink_s = 50e-3, kLeastShare = 0.02;

  void step_in_joints(const Point<N>& x, const Point<N>& v, const Point<N>& f, Seconds dt) noexcept {
    in_joints_.step(x, v, f, dt);
    patch_ = in_joints_.patch();
  }

  std::optional<JointTool> tool_;
  JointTool::Axes scale_;
  double motion_scale_;
  SurfaceEstimator<3> at_tool_;
  SurfaceEstimator<N> in_joints_;
  SurfaceEstimator<1> fingers_;
  int fingers_axis_ = -1;  ///< -1: there are none
  bool before_tool_ = false;
  Force<N> torque_;  ///< LP_50ms τ
  SurfacePatch<N> patch_;
  double share_ = 1.0;  ///< |m|²
};

}  // namespace twoport
