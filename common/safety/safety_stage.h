#pragma once

#include <algorithm>
#include <cmath>

#include "common/base/time.h"
#include "common/base/vector.h"
#include "common/safety/limits.h"

namespace twoport {

/// The last step before the hardware. It knows no method: whatever a method commands and whatever the other side reports, what
/// leaves it keeps the limits. What it takes away is counted; accounts book what it returns.
///
///     1  |f| <= force_n, |τ| <= torque_n_m         the whole wrench is scaled: its direction stays
///     2  |f - f(k-1)| <= force_rate T              the change is scaled
///     3  |x| > workspace: s f·x <= 0               the part of f along x is removed
///     4  w = v + s T f/m,  |w| <= max(speed, |v|)   f = m (w - v)/(s T) with w shortened; likewise τ, ω and the inertia J
///     5  P = s f·v <= power_w                      the wrench is scaled, which keeps 4
///
/// Of joints, each by itself instead of 3, 4 and the norms of 1:
///
///     |τ_i| <= effort_i                            the whole is scaled: its direction stays
///     |q̇_i| > speed_i: s τ_i q̇_i <= 0              and beyond lower_i or upper_i no torque leads further out
///
/// with s = 1 for a force on the hardware (robot), s = -1 for a force at the master port (the hand is pushed with -f), T the period,
/// m the mass that moves. The force accelerates nothing beyond the speed: |v| <= speed unless something else pushes. Where m
/// is not known: |v| > speed: s f·v <= 0, the part of f along v is removed; a tick
/// may then exceed the speed by T |f|/m. A step is pure computation. Without limits it returns its argument unchanged.
template <int N>
class SafetyStage {
 public:
  /// `mass_kg`, `inertia_kg_m2` (N = 6: the smallest principal moment) of what moves; 0: not known.
  SafetyStage(const PortLimits& limits, double sign, double mass_kg = 0.0, double inertia_kg_m2 = 0.0)
      : o_{limits},
        sign_{sign},
        per_kg_{mass_kg > 0.0 ? 1.0 / mass_kg : 0.0},
        per_kg_m2_{inertia_kg_m2 > 0.0 ? 1.0 / inertia_kg_m2 : 0.0},
        bounds_force_{limits.force_n < PortLimits::kNone || (N == 6 && limits.torque_n_m < PortLimits::kNone) ||
                      has_joint_limits()},
        bounds_more_{has_joint_limits() ||
                     std::min({limits.force_rate_n_per_s, limits.power_w, limits.speed_m_per_s, limits.workspace_m}) <
                         PortLimits::kNone ||
                     (N == 6 && limits.angular_speed_rad_per_s < PortLimits::kNone)},
        bounds_set_point_{has_joint_limits() || std::min({limits.set_point_step_m, limits.workspace_m,
                                                          limits.speed_m_per_s, limits.force_n}) < PortLimits::kNone} {}

  /// The force to be applied until the next tick. `f` is finite.
  Force<N> operator()(const Force<N>& f, const Position<N>& x, const Velocity<N>& v, Seconds dt) noexcept {
    Force<N> out = f;
    if (bounds_force_) out = bounded(out);
    if (bounds_more_) [[unlikely]]
      out = bounded_more(out, x, v, dt.si());
    return out;
  }
  /// The set point to be commanded until the next tick; `from` is the one before. Outside the workspace it moves no further out. A robot that follows it exactly presses with
  /// `held_by`: beyond the limit of force the set point does not move along it; null for other robots.
  [[nodiscard]] Position<N> set_point(const Position<N>& to, const Position<N>& from, Seconds dt,
                                      const Force<N>* held_by) noexcept {
    return bounds_set_point_ ? bounded_set_point(to, from, dt.si(), held_by) : to;
  }
  /// The hardware has been let go: the next force starts from zero.
  void release() noexcept { before_ = Force<N>{}; }

  [[nodiscard]] bool any() const noexcept { return bounds_force_ || bounds_more_ || bounds_set_point_; }
  void note(Limit limit) noexcept { counts_.add(limit); }
  [[nodiscard]] const LimitCounts& counts() const noexcept { return counts_; }

 private:
  [[nodiscard]] bool has_joint_limits() const { return N == kJointPort && !(o_.joints == JointLimits{}); }
  static auto linear(const auto& v) noexcept { return v.template head<kAxes<N>>(); }

  Force<N> bounded(const Force<N>& f) noexcept {
    const double norm = linear(f.vec()).norm();
    if constexpr (N == 6) {
      const double torque = f.vec().template tail<3>().norm();
      if (norm <= o_.force_n && torque <= o_.torque_n_m) return f;
      counts_.add(Limit::force);
      return std::min(norm > o_.force_n ? o_.force_n / norm : 1.0,
                      torque > o_.torque_n_m ? o_.torque_n_m / torque : 1.0) *
             f;
    } else if constexpr (N == kJointPort) {
      const double most = (f.vec().array().abs() / o_.joints.effort).maxCoeff();
      if (most <= 1.0) return f;
      counts_.add(Limit::force);
      return (1.0 / most) * f;
    } else {
      if (norm <= o_.force_n) return f;
      counts_.add(Limit::force);
      return (o_.force_n / norm) * f;
    }
  }

  Force<N> bounded_more(Force<N> f, Position<N> x, Velocity<N> v, double dt) noexcept {
    bound_rate(f, dt);
    if constexpr (N == kJointPort) bound_joints(f, x, v);
    bound_workspace(f, x);
    bound_speed(f, v, dt);
    const double power = sign_ * dot_of(f, v);
    if (power > o_.power_w) {
      f = (o_.power_w / power) * f;
      counts_.add(Limit::power);
    }
    before_ = f;
    return f;
  }
  static double dot_of(const Force<N>& f, const Velocity<N>& v) noexcept { return f.vec().dot(v.vec()); }

  void bound_rate(Force<N>& f, double dt) noexcept {
    const double most = o_.force_rate_n_per_s * dt;
    if (!(most < PortLimits::kNone)) return;
    const auto change = (f.vec() - before_.vec()).eval();
    double share = 1.0;
    if (const double norm = linear(change).norm(); norm > most) share = most / norm;
    if constexpr (N == 6) {
      const double most_torque = o_.torque_n_m < PortLimits::kNone && o_.force_n < PortLimits::kNone
                                     ? most * o_.torque_n_m / o_.force_n
                                     : PortLimits::kNone;
      if (const double norm = change.template tail<3>().norm(); norm > most_torque)
        share = std::min(share, most_torque / norm);
    }
    if (share == 1.0) return;
    f = Force<N>{before_.vec() + share * change};
    counts_.add(Limit::force_rate);
  }

  void bound_speed(Force<N>& f, const Velocity<N>& v, double dt) noexcept {
    typename Force<N>::Vector out = f.vec();
    bool acted = keep_slow(out.template head<kAxes<N>>(), linear(v.vec()), o_.speed_m_per_s, per_kg_ * dt);
    if constexpr (N == 6)
      acted =
          keep_slow(out.template tail<3>(), v.vec().template tail<3>(), o_.angular_speed_rad_per_s, per_kg_m2_ * dt) ||
          acted;
    if (!acted) return;
    f = Force<N>{out};
    counts_.add(Limit::speed);
  }
  void bound_joints(Force<N>& f, const Position<N>& q, const Velocity<N>& v) noexcept {
    typename Force<N>::Vector out = f.vec();
    const auto take = [&](int i, Limit limit) {
      out[i] = 0.0;
      counts_.add(limit);
    };
    for (int i = 0; i < N; ++i) {
      const double push = sign_ * out[i], at = q.translation()[i];
      if (push * v[i] > 0.0 && std::abs(v[i]) > o_.joints.speed[i]) take(i, Limit::speed);
      if ((at > o_.joints.upper[i] && push > 0.0) || (at < o_.joints.lower[i] && push < 0.0)) take(i, Limit::workspace);
    }
    f = Force<N>{out};
  }
  void bound_workspace(Force<N>& f, const Position<N>& x) noexcept {
    typename Force<N>::Vector out = f.vec();
    if (!remove_along(out.template head<kAxes<N>>(), x.translation(), o_.workspace_m, sign_)) return;
    f = Force<N>{out};
    counts_.add(Limit::workspace);
  }
  /// Shortens v + s r f, r = T/m, to max(most, |v|) where it is longer, and f with it. r = 0: not known.
  [[nodiscard]] bool keep_slow(auto&& f, const auto& v, double most, double r) const noexcept {
    if (!(most < PortLimits::kNone)) return false;
    if (r == 0.0) return remove_along(f, v, most, sign_);
    const auto w = (v + (sign_ * r) * f).eval();
    const double longest = std::max(most, v.norm()), length = w.norm();
    if (length <= longest) return false;
    f = ((longest / length) * w - v) / (sign_ * r);
    return true;
  }
  /// Where |direction| > most: removes the part of f along it, where that has the sign of `sign`.
  static bool remove_along(auto&& f, const auto& direction, double most, double sign) noexcept {
    const double squared = direction.squaredNorm();
    if (!(squared > most * most)) return false;
    const double along = f.dot(direction);
    if (!(sign * along > 0.0)) return false;
    f -= (along / squared) * direction;
    return true;
  }

  Position<N> bounded_set_point(const Position<N>& to, const Position<N>& from, double dt,
                                const Force<N>* held_by) noexcept {
    using Point = Eigen::Matrix<double, kAxes<N>, 1>;
    Point target = to.translation();
    bool acted = false;
    const double farthest = std::max(o_.workspace_m, Point{from.translation()}.norm());
    if (const double r = target.norm(); r > farthest) {
      target *= farthest / r;
      counts_.add(Limit::workspace);
      acted = true;
    }
    if constexpr (N == kJointPort) {
      // Where it was beyond a limit already it moves no further out.
      const Point within = target.cwiseMin(from.translation().cwiseMax(o_.joints.upper.matrix()))
                               .cwiseMax(from.translation().cwiseMin(o_.joints.lower.matrix()));
      if (within != target) {
        target = within;
        counts_.add(Limit::workspace);
        acted = true;
      }
    }
    Point step = target - Point{from.translation()};
    if constexpr (N == kJointPort) {
      const double share = (step.array().abs() / (o_.joints.speed * dt)).maxCoeff();
      if (share > 1.0) {
        step /= share;
        counts_.add(Limit::set_point_step);
        acted = true;
      }
    }
    const double most = std::min(o_.set_point_step_m, o_.speed_m_per_s * dt);
    if (const double length = step.norm(); length > most) {
      step *= most / length;
      counts_.add(Limit::set_point_step);
      acted = true;
    }
    if (held_by != nullptr && remove_along(step, linear(held_by->vec()), o_.force_n, 1.0)) {
      counts_.add(Limit::force);
      acted = true;
    }
    if (!acted) return to;
    target = Point{from.translation()} + step;
    if constexpr (N == 6) {
      return {target, to.attitude()};
    } else {
      return Position<N>{target};
    }
  }

  PortLimits o_;
  double sign_, per_kg_, per_kg_m2_;
  bool bounds_force_, bounds_more_, bounds_set_point_;
  Force<N> before_;
  LimitCounts counts_;
};

}  // namespace twoport
