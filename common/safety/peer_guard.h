#pragma once

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "common/base/time.h"
#include "common/link/report.h"
#include "common/safety/limits.h"

namespace twoport {

/// Bounds what the other side claims, by its limits, in its own units and world, before anything uses it. A number beyond a limit is clipped and counted, and the rest of the report is used.
///
///     |v| <= speed, |ω| <= angular_speed
///     |x| <= workspace, |x - x(before)| <= speed (t - t(before) + 50 ms)
///     |f|, |f_coupling| <= force_n, and ten times that for what may be a sensor's reading; torques likewise
///     energy_in <= force_n speed (t - t0 + 1 s)     t0: the session's first report; by this side's clock
///
/// Of joints, each by itself: speed, range with 3 rad around it, ten times the effort.
///
/// A second of energy and 50 ms of motion are granted for what has been under way. Calls are pure computation.
template <int N>
class PeerGuard {
 public:
  PeerGuard() = default;
  explicit PeerGuard(const PortLimits& of_the_other_side)
      : o_{of_the_other_side}, any_{!(of_the_other_side == PortLimits{})} {}

  /// A new session: totals start again from zero.
  void reset() noexcept { started_ = false; }

  /// Calls use(report) with a report that keeps the limits.
  template <class Use>
  void pass(const Report<N>& r, Duration now, Use&& use) noexcept {
    if (!any_) {
      use(r);
      return;
    }
    checked_ = r;
    check(now);
    use(checked_);
  }
  [[nodiscard]] const LimitCounts& counts() const noexcept { return counts_; }

 private:
  static constexpr double kSensorHeadroom = 10.0;  ///< an impact exceeds the force that the robot itself may apply
  static constexpr double kBeyond = 3.0;           ///< of a joint's range that the other arm may have more [rad]
  static constexpr double kAbsurd = 1e12;          ///< beyond it no number of a method has a meaning
  static constexpr Seconds kMotionOnTheWay{0.05}, kEnergyOnTheWay{1.0};

  void check(Duration now) noexcept {
    if (!started_) begin(now);
    if constexpr (N == kJointPort) check_joints();
    bool motion = clip(checked_.v, o_.speed_m_per_s, o_.angular_speed_rad_per_s);
    motion = bound_position(now) || motion;
    motion = clip(checked_.position_error, 2.0 * o_.workspace_m, PortLimits::kNone) || motion;
    if (motion) counts_.add(Limit::peer_motion);
    const double force = kSensorHeadroom * o_.force_n, torque = kSensorHeadroom * o_.torque_n_m;
    bool forces = clip(checked_.f_coupling, o_.force_n, o_.torque_n_m);
    forces = clip(checked_.f, force, torque) || forces;
    forces = clip(checked_.f_environment, force, torque) || forces;
    if (forces) counts_.add(Limit::peer_force);
    const double power_w = N == kJointPort ? (o_.joints.effort * o_.joints.speed).sum() : o_.force_n * o_.speed_m_per_s;
    const double most_j = power_w * (to_seconds(now - since_) + kEnergyOnTheWay).si();
    if (checked_.energy_in_j > most_j) {
      checked_.energy_in_j = most_j;
      counts_.add(Limit::peer_energy);
    }
    for (std::size_t i = 0; i < checked_.words.count; ++i)
      checked_.words.at[i] = std::clamp(checked_.words.at[i], -kAbsurd, kAbsurd);
  }
  void check_joints() noexcept {
    const JointLimits& j = o_.joints;
    const auto clip_each = [](auto& q, const JointLimits::Axes& low, const JointLimits::Axes& high) {
      using Quantity = std::remove_reference_t<decltype(q)>;
      JointLimits::Axes v = joint_numbers(q).array(), within = v.max(low).min(high);
      const bool acted = (within != v).any();
      if (acted) q = Quantity{within.matrix()};
      return acted;
    };
    bool motion = clip_each(checked_.v, -j.speed, j.speed);
    motion = clip_each(checked_.x, j.lower - kBeyond, j.upper + kBeyond) || motion;
    if (motion) counts_.add(Limit::peer_motion);
    const JointLimits::Axes most = kSensorHeadroom * j.effort;
    bool forces = clip_each(checked_.f_coupling, -j.effort, j.effort);
    forces = clip_each(checked_.f, -most, most) || forces;
    forces = clip_each(checked_.f_environment, -most, most) || forces;
    if (forces) counts_.add(Limit::peer_force);
  }
  static const auto& joint_numbers(const Position<N>& x) noexcept { return x.translation(); }
  static const auto& joint_numbers(const auto& v) noexcept { return v.vec(); }
  void begin(Duration now) noexcept {
    started_ = true;
    since_ = at_ = now;
    newest_ = 0;
    x_ = checked_.x;
  }

  /// True when it has clipped.
  template <class Quantity>
  static bool clip(Quantity& q, double linear, double angular) noexcept {
    typename Quantity::Vector v = q.vec();
    bool acted = clip_norm(v.template head<kAxes<N>>(), linear);
    if constexpr (N == 6) acted = clip_norm(v.template tail<3>(), angular) || acted;
    if (acted) q = Quantity{v};
    return acted;
  }
  /// Squares of large numbers overflow: by the largest coordinate first.
  static bool clip_norm(auto v, double most) noexcept {
    if (!(most < PortLimits::kNone)) return false;
    bool acted = false;
    if (const double largest = v.cwiseAbs().maxCoeff(); largest > most) v *= most / largest, acted = true;
    if (const double norm = v.norm(); norm > most) v *= most / norm, acted = true;
    return acted;
  }

  bool bound_position(Duration now) noexcept {
    using Point = Eigen::Matrix<double, kAxes<N>, 1>;
    Point p = checked_.x.translation();
    bool acted = clip_norm(p.template head<kAxes<N>>(), o_.workspace_m);
    if (checked_.sequence > newest_) {
      Point step = p - Point{x_.translation()};
      if (newest_ != 0 && clip_norm(step.template head<kAxes<N>>(),
                                    o_.speed_m_per_s * (to_seconds(now - at_) + kMotionOnTheWay).si())) {
        p = Point{x_.translation()} + step;
        acted = true;
      }
    }
    if constexpr (N == 6) {
      Eigen::Quaterniond q = checked_.x.attitude();
      if (!(std::abs(q.squaredNorm() - 1.0) < 1e-6)) {
        const double largest = q.coeffs().cwiseAbs().maxCoeff();
        q = largest > 1e-3 ? Eigen::Quaterniond{q.coeffs() / largest}.normalized() : Eigen::Quaterniond::Identity();
        acted = true;
      }
      if (acted) checked_.x = {p, q};
    } else {
      if (acted) checked_.x = Position<N>{p};
    }
    if (checked_.sequence > newest_) {
      newest_ = checked_.sequence;
      at_ = now;
      x_ = checked_.x;
    }
    return acted;
  }

  PortLimits o_;
  bool any_ = false, started_ = false;
  Duration since_{0}, at_{0};
  std::uint64_t newest_ = 0;
  Position<N> x_;
  Report<N> checked_;
  LimitCounts counts_;
};

}  // namespace twoport
