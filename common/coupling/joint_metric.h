#pragma once

#include "common/base/vector.h"
#include "common/coupling/options.h"
#include "common/hardware/device.h"
#include "common/hardware/robot.h"
#include "common/link/report.h"

namespace twoport {

/// The metric in which a node couples joints. Joints of one arm differ by a factor of 300 in inertia; scaled by the root of it, every axis
/// is one of about 1 kg, and one pair of gains fits all. Hardware, reports and records are in joints:
///
///     x_i = s_i q_i      v_i = s_i q̇_i      f_i = τ_i / s_i           power f·v = τ·q̇
///
/// s: ControlOptions::joint_scale. For another port than one of joints everything is as it is.
template <int N>
class JointMetric {
 public:
  explicit JointMetric(const ControlOptions& o) {
    if constexpr (kJoints) s_ = o.joint_scale;
  }

  /// From joints.
  [[nodiscard]] decltype(auto) scaled(const auto& q) const noexcept {
    if constexpr (kJoints) {
      return to(q);
    } else {
      return (q);
    }
  }
  /// To joints.
  [[nodiscard]] decltype(auto) joints(const auto& x) const noexcept {
    if constexpr (kJoints) {
      return back(x);
    } else {
      return (x);
    }
  }

 private:
  static constexpr bool kJoints = N == kJointPort;
  using Vector = Eigen::Matrix<double, N, 1>;

  [[nodiscard]] Position<N> to(const Position<N>& q) const noexcept {
    return Position<N>{q.translation().cwiseProduct(s_)};
  }
  [[nodiscard]] Position<N> back(const Position<N>& x) const noexcept {
    return Position<N>{x.translation().cwiseQuotient(s_)};
  }
  [[nodiscard]] Velocity<N> to(const Velocity<N>& v) const noexcept { return Velocity<N>{v.vec().cwiseProduct(s_)}; }
  [[nodiscard]] Displacement<N> back(const Displacement<N>& d) const noexcept {
    return Displacement<N>{d.vec().cwiseQuotient(s_)};
  }
  [[nodiscard]] Velocity<N> back(const Velocity<N>& v) const noexcept { return Velocity<N>{v.vec().cwiseQuotient(s_)}; }
  [[nodiscard]] Force<N> to(const Force<N>& f) const noexcept { return Force<N>{f.vec().cwiseQuotient(s_)}; }
  [[nodiscard]] Force<N> back(const Force<N>& f) const noexcept { return Force<N>{f.vec().cwiseProduct(s_)}; }
  [[nodiscard]] DeviceSample<N> to(DeviceSample<N> d) const noexcept {
    d.x = to(d.x), d.v = to(d.v), d.applied = to(d.applied);
    return d;
  }
  [[nodiscard]] RobotSample<N> to(RobotSample<N> r) const noexcept {
    r.x = to(r.x), r.v = to(r.v), r.f_environment = to(r.f_environment);
    return r;
  }
  [[nodiscard]] RobotCommand<N> back(const RobotCommand<N>& c) const noexcept {
    return {back(c.f), back(c.x_d), back(c.v_d)};
  }
  [[nodiscard]] PortReport<N> to(PortReport<N> r) const noexcept {
    r.x = to(r.x), r.v = to(r.v), r.f = to(r.f), r.f_coupling = to(r.f_coupling);
    r.f_environment = to(r.f_environment);
    return r;
  }

  struct Nothing {};
  [[no_unique_address]] std::conditional_t<kJoints, Vector, Nothing> s_;
};

}  // namespace twoport
