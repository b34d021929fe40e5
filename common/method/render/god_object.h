#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "common/base/vector.h"
#include "common/contact/environment.h"
#include "common/contact/least_distance.h"
#include "common/coupling/options.h"
#include "common/ports/port.h"

namespace twoport {

/// Constraint-based rendering: a proxy of the handle that never enters the environment, and a spring between both. The surfaces
/// are rigid, with Coulomb friction of coefficient μ; the spring is that of control.virtual_coupling, k and k_r. Without friction,
///
///     x_p = argmin U(x_h, x)  where no point of x is inside a surface,  U = k |p_h - p|²/2 + k_r |log(R_h Rᵀ)|²/2,
///     near the last x_p
///     w   = (k (p_p - p_h), k_r log(R_p R_hᵀ)) on the handle: Σ λ_i (n_i, r_i×n_i) with λ_i >= 0, forces of the contacts only
///     f   = max(0, 1 - β w·v) w,   β = (b |w_f|²/k² + b_r |w_τ|²/k_r²)/(2 U)²                   damping along w; never pulls
///
/// -w is the gradient of U(x_h, x_p(x_h)): the force has a potential wherever x_p moves continuously. With one surface, w is k times
/// the depth along the normal.
///
/// With friction each contact i adds a tangential force γ_i on the proxy. Its point slides only where that force is on the friction cone,
/// against it:
///
///     |γ_i| <= μ λ_i,   γ_i = -μ λ_i s_i/|s_i| where the point slips by s_i,   w = Σ λ_i (n_i, r_i×n_i) + (γ_i, r_i×γ_i)
///
/// Friction takes Σ μ λ_i |s_i| >= 0. A point that sticks yields by 1e-11 m |γ_i|/(μ λ_i), which makes γ unique; it has no friction in
/// the tick in which it begins to touch. Where contacts are redundant (four corners on a plane), those that carry the normal
/// forces, N at most, carry the friction. Each step alternates between the normal forces and the least of
///
///     |d - d_goal|²_K/2 + Σ μ λ_i h(s_i)   on the planes that carry,   λ held,
///
/// by Newton's method with a line search, until λ stays (Panagiotopoulos' fixed point). The fixed point need not exist where λ is large
/// and the handle far inside: after kNewtonStepsOfSolution steps of Newton's method each step of the proxy has one alternation of
/// kNewtonStepsBeyond, and takes the friction found by then. The proxy penetrates nothing all the same; unfinished() counts these ticks.
///
/// The proxy moves in steps d = (δp, δθ) of at most 2 mm. Each is the least change of the goal in the metric of the spring
/// (Gauss' principle of least constraint), subject to the surfaces' planes at their nearest points,
///
///     minimize |d - d_goal|_K   subject to   φ_i + n_i·(δp + δθ×r_i) >= 0,
///
/// then distances and planes are computed anew. A plane at which a step ended inside a surface stays until the end of the
/// tick: at a concave edge a point needs both. If a pose without penetration is not found, that of the tick before stays.
/// After Zilles and Salisbury, A constraint-based god-object method for haptic display, IROS 1995; Ortega, Redon, Coquillart,
/// A six degree-of-freedom god-object method for haptic display of rigid bodies, IEEE TVCG 13(3), 2007.
/// Friction cone: Harwin, Melder, Improved haptic rendering for multi-finger manipulation using friction cone based god-objects,
/// Eurohaptics 2002.
///
/// Everything is allocated at construction.
template <int N>
class GodObject {
 public:
  static constexpr double kPenetration_m = 5e-10;  ///< largest depth of the proxy

  /// A point of the proxy that touches, and the force on it.
  struct Contact {
    int index;  ///< point × surfaces + surface
    Point<kAxes<N>> normal, arm;
    double force_n;
  };

  GodObject(const CouplingOptions& o, const Environment<N>& environment)
      : stiffness_{o.stiffness_n_per_m},
        rotational_stiffness_{o.rotational_stiffness_n_m_per_rad},
        damping_{o.damping_n_s_per_m},
        rotational_damping_{o.rotational_damping_n_m_s_per_rad},
        length_{N == 6 ? std::sqrt(rotational_stiffness_ / stiffness_) : 1.0},
        surfaces_{environment.world().surfaces},
        tool_{environment.tool()} {
    for (const Eigen::Vector3d& p : tool_) radius_ = std::max(radius_, p.norm());
    const std::size_t contacts = (N == 6 ? tool_.size() : 1) * surfaces_.size();
    rows_.reserve(contacts + kCuts);
    planes_.reserve(contacts + kCuts);
    before_.resize(contacts);
    for (const Surface& s : surfaces_) rough_ = rough_ || (N > 1 && s.material.friction > 0.0);
    if (rough_) anchors_.resize(contacts), moved_anchors_.resize(contacts);
    cuts_.reserve(kCuts);
  }

  /// Moves the proxy towards the handle.
  void follow(const Position<N>& handle) noexcept {
    if (!placed_) proxy_ = handle;
    placed_ = solve(proxy_, handle, placed_) || placed_;
    unfinished_ += newton_steps_ >= kNewtonStepsOfSolution;
    if (!placed_) proxy_ = handle;
    if (rough_) {
      friction_energy_ += solved_friction_energy_;
      anchors_.swap(moved_anchors_);
    }
    touching_ = contacts_ > 0;
  }
  /// The next proxy starts at the handle.
  void release() noexcept { placed_ = false; }

  [[nodiscard]] const Position<N>& proxy() const noexcept { return proxy_; }
  [[nodiscard]] bool touching() const noexcept { return touching_; }
  /// Number of follow() whose friction was not solved for to the end.
  [[nodiscard]] std::uint64_t unfinished() const noexcept { return unfinished_; }
  /// Newton's steps of the last solution: less than kNewtonStepsOfSolution + kNewtonSteps + (kSteps + 1) kNewtonStepsBeyond.
  [[nodiscard]] int newton_steps() const noexcept { return newton_steps_; }
  /// Of the last solution.
  [[nodiscard]] std::span<const Contact> contacts() const noexcept { return {contact_.data(), contacts_}; }

  /// On the handle, whose proxy follow() has moved.
  [[nodiscard]] PortVector<N> force(const Position<N>& handle, const Velocity<N>& v) const noexcept {
    PortVector<N> w = PortVector<N>::Zero();
    if (!touching_) return w;
    const auto apart = difference(proxy_, handle);
    double stored = 0.0, damped = 0.0, power = 0.0;
    if constexpr (N == 6) {
      w = {stiffness_ * apart.linear, rotational_stiffness_ * apart.angular};
      stored = stiffness_ * apart.linear.squaredNorm() + rotational_stiffness_ * apart.angular.squaredNorm();
      damped = damping_ * apart.linear.squaredNorm() + rotational_damping_ * apart.angular.squaredNorm();
      power = w.linear.dot(v.vec().template head<3>()) + w.angular.dot(v.vec().template tail<3>());
    } else {
      w = stiffness_ * apart;
      stored = stiffness_ * apart.squaredNorm();
      damped = damping_ * apart.squaredNorm();
      power = w.dot(v.vec());
    }
    if (!(stored > 0.0)) return PortVector<N>::Zero();
    const double scale = std::max(0.0, 1.0 - damped * power / (stored * stored));
    return scale * w;
  }
  /// U between the handle and its proxy [J].
  [[nodiscard]] Energy potential(const Position<N>& handle) const noexcept { return potential(proxy_, handle); }
  /// Energy that friction has taken since construction [J].
  [[nodiscard]] Energy friction_energy() const noexcept { return friction_energy_; }
  /// U and the energy that friction will have taken with the handle at x.
  [[nodiscard]] Energy energy_after(const Position<N>& x) noexcept {
    if (!placed_) return friction_energy_;
    Position<N> next = proxy_;
    solve(next, x, true);
    return potential(next, x) + friction_energy_ + solved_friction_energy_;
  }

 private:
  static constexpr int kSteps = 24;          // of a tick
  static constexpr double kStep_m = 2e-3;    // a point's motion in one of them, at most
  static constexpr double kStill_m = 1e-10;  // a step below ends the search
  static constexpr double kRest_m = 1e-14;   // a first step below is not made
  static constexpr std::size_t kCuts = 64;
  static constexpr double kTolerance_m = 1e-14;  // of a condition
  static constexpr double kTouch_m = 1e-8;       // a point that is nearer touches
  static constexpr double kYield_m = 1e-11;      // of a point that sticks
  static constexpr int kAlternations = 30, kNewtonSteps = 40;
  static constexpr int kNewtonStepsOfSolution = 150, kNewtonStepsBeyond = 4;

  using Vector = Eigen::Matrix<double, N, 1>;
  using Where = Point<kAxes<N>>;
  static constexpr auto kMost = static_cast<std::size_t>(N);
  /// normal·(point of the proxy) >= offset
  struct Plane {
    int index;
    Where normal, arm;
    double offset;
  };

  [[nodiscard]] Energy potential(const Position<N>& proxy, const Position<N>& handle) const noexcept {
    const auto apart = difference(proxy, handle);
    if constexpr (N == 6)
      return Energy{0.5 *
                    (stiffness_ * apart.linear.squaredNorm() + rotational_stiffness_ * apart.angular.squaredNorm())};
    else
      return Energy{0.5 * stiffness_ * apart.squaredNorm()};
  }
  /// (δp, length δθ): its square times k/2 is the spring's energy.
  [[nodiscard]] Vector scaled(const Position<N>& to, const Position<N>& from) const noexcept {
    if constexpr (N == 6) {
      SpatialVector d = difference(to, from);
      Vector y;
      y << d.linear, length_ * d.angular;
      return y;
    } else {
      return difference(to, from);
    }
  }
  [[nodiscard]] Position<N> moved(const Position<N>& x, const Vector& y) const noexcept {
    if constexpr (N == 6)
      return x.moved(y.template head<3>(), y.template tail<3>() / length_);
    else
      return Position<N>{x.translation() + y};
  }
  /// A bound of the motion of every point.
  [[nodiscard]] double travel(const Vector& y) const noexcept {
    if constexpr (N == 6)
      return y.template head<3>().norm() + radius_ / length_ * y.template tail<3>().norm();
    else
      return y.norm();
  }
  [[nodiscard]] HalfSpace<N> row(const Plane& plane, const Where& point) const noexcept {
    HalfSpace<N> h;
    if constexpr (N == 6)
      h.a << plane.normal, plane.arm.cross(plane.normal) / length_;
    else
      h.a = plane.normal;
    h.b = plane.offset - plane.normal.dot(point);
    return h;
  }

  /// Planes of all surfaces within `reach` of the pose. Returns the least distance of a point.
  double look(const Position<N>& x, double reach, bool first) noexcept {
    const PoseWithRotation<N> at{x};
    double least = reach;
    int index = 0;
    rows_.clear(), planes_.clear();
    const auto visit = [&](const Where& p, const Where& arm) {
      for (const Surface& s : surfaces_) {
        const SignedDistance<kAxes<N>> d = signed_distance<kAxes<N>>(s.shape, p);
        Before& before = before_[static_cast<std::size_t>(index)];
        const Plane plane{index++, d.normal, arm, d.normal.dot(p) - d.distance};
        if (d.distance <= reach) {
          rows_.push_back(row(plane, p)), planes_.push_back(plane);
          if (d.distance < -kPenetration_m) {
            if (!first && before.within && cuts_.size() < kCuts) cuts_.push_back(before.plane);
            if (cuts_.size() < kCuts) cuts_.push_back(plane);
          }
        }
        before = {plane, d.distance <= reach, d.distance <= kTouch_m};
        least = std::min(least, d.distance);
      }
    };
    if constexpr (N == 6) {
      for (const Eigen::Vector3d& point : tool_) {
        const Eigen::Vector3d arm = at.R * point;
        visit(x.translation() + arm, arm);
      }
      for (Plane plane : cuts_) {
        plane.arm = at.R * tool_[static_cast<std::size_t>(plane.index) / surfaces_.size()];
        rows_.push_back(row(plane, x.translation() + plane.arm)), planes_.push_back(plane);
      }
    } else {
      visit(x.translation(), Where::Zero());
      for (const Plane& plane : cuts_) rows_.push_back(row(plane, x.translation())), planes_.push_back(plane);
    }
    return least;
  }

  /// Moves x towards the goal. `free`: x is known to penetrate nothing. True if it ends so. With friction moved_anchors_ and
  /// solved_friction_energy_ go with x.
  bool solve(Position<N>& x, const Position<N>& goal, bool free) noexcept;

  /// The step y from x to the goal, both scaled, under normal forces and friction.
  void solve_with_friction(const Position<N>& x, Vector& y) noexcept {
    const Vector goal = y;
    Vector friction = Vector::Zero();
    std::array<Sliding, kMost> last;
    for (int i = 0;; ++i) {
      y = goal + friction;
      if (i == 0 || !solver_.solve_again(rows_, y, kTolerance_m)) solver_.solve(rows_, y, kTolerance_m);
      last = slidings_;
      const std::size_t were = std::exchange(sliding_, 0);
      bool same = true;
      for (std::size_t j = 0; j < solver_.active(); ++j) {
        const Plane& plane = planes_[solver_.index(j)];
        const auto contact = static_cast<std::size_t>(plane.index);
        const double mu = surfaces_[contact % surfaces_.size()].material.friction;
        if (mu == 0.0 || !moved_anchors_[contact].holds) continue;
        const double length = plane.normal.norm();
        const Where from = x.translation() + plane.arm - moved_anchors_[contact].at;
        const Sliding& s = slidings_[sliding_] = {
            solver_.index(j), mu * length * solver_.lambda(j), plane.normal / length, plane.arm, from, Where::Zero()};
        if (same && sliding_ < were && last[sliding_].row == s.row) {
          const bool holds = !slips_ && last[sliding_].force.norm() <= 0.99 * s.most;  // whatever the limit is
          same = std::abs(last[sliding_].most - s.most) <= (holds ? 1e-3 * s.most : 1e-14 + 1e-12 * s.most);
        } else {
          same = false;
        }
        ++sliding_;
      }
      if (i > 0 && same && sliding_ == were) {
        slidings_ = last;
        return;
      }
      if (i >= (newton_steps_ < kNewtonStepsOfSolution ? kAlternations : 1) || (sliding_ == 0 && i == 0)) return;
      friction.setZero();
      if (sliding_ > 0) {
        least_with_friction(goal, i == 0 ? solver_.active_point(rows_) : y);
        for (std::size_t k = 0; k < sliding_; ++k) friction += on_proxy(slidings_[k].arm, slidings_[k].force);
      }
    }
  }
  /// With the limits of friction held and on the active planes, from u on them; sets the forces.
  void least_with_friction(const Vector& goal, Vector u) noexcept {
    double value = 0.0;
    const int most = newton_steps_ < kNewtonStepsOfSolution ? kNewtonSteps : kNewtonStepsBeyond;
    for (int i = 0; i < most; ++i, ++newton_steps_) {
      Vector slope = u - goal;
      Eigen::Matrix<double, N, N> curvature = Eigen::Matrix<double, N, N>::Identity();
      value = 0.5 * slope.squaredNorm();
      for (std::size_t k = 0; k < sliding_; ++k) {
        Sliding& s = slidings_[k];
        const Where slip = slip_after(s, u);
        const double length = slip.norm();
        value += s.most * huber(length);
        s.force = -s.most / std::max(length, kYield_m) * slip;
        slope -= on_proxy(s.arm, s.force);
        if constexpr (N > 1) {
          const Where along = length > kYield_m ? Where{slip / length} : s.normal.unitOrthogonal();
          const Vector across = without_active(on_proxy(s.arm, s.normal.cross(along)));
          curvature += s.most / std::max(length, kYield_m) * across * across.transpose();
          if (length <= kYield_m) {
            const Vector v = without_active(on_proxy(s.arm, along));
            curvature += s.most / kYield_m * v * v.transpose();
          }
        }
      }
      slope = without_active(slope);
      const Vector d = -without_active(curvature.llt().solve(slope));
      double part = 1.0;
      for (int half = 0; half < 30; ++half, part *= 0.5) {
        const Vector to = u + part * d;
        double there = 0.5 * (to - goal).squaredNorm();
        for (std::size_t k = 0; k < sliding_; ++k)
          there += slidings_[k].most * huber(slip_after(slidings_[k], to).norm());
        if (there <= value + 1e-4 * part * slope.dot(d) + 1e-15 * value) break;
      }
      u += part * d;
      if (!(d.cwiseAbs().maxCoeff() > 1e-16)) break;
    }
    slips_ = false;
    for (std::size_t k = 0; k < sliding_; ++k) {
      const Where slip = slip_after(slidings_[k], u);
      slips_ = slips_ || slip.norm() > kYield_m;
      slidings_[k].force = -slidings_[k].most / std::max(slip.norm(), kYield_m) * slip;
    }
  }
  [[nodiscard]] static double huber(double length) noexcept {
    return length <= kYield_m ? 0.5 * length * length / kYield_m : length - 0.5 * kYield_m;
  }
  /// v without its part across the active planes.
  [[nodiscard]] Vector without_active(Vector v) const noexcept {
    for (std::size_t j = 0; j < solver_.active(); ++j) v -= solver_.direction(j).dot(v) * solver_.direction(j);
    return v;
  }

  struct Anchor {
    Where at;
    bool holds = false;  ///< the point touched at the end of the last tick
  };
  /// A contact with a limit of friction; forces over k.
  struct Sliding {
    std::size_t row;
    double most;
    Where normal, arm, from;  ///< from: of the point from its anchor at the pose of the row
    Where force;
  };
  [[nodiscard]] Where slip_after(const Sliding& c, const Vector& y) const noexcept {
    Where s = c.from;
    if constexpr (N == 6)
      s += y.template head<3>() + Where{y.template tail<3>()}.cross(c.arm) / length_;
    else
      s += y;
    return s - c.normal.dot(s) * c.normal;
  }
  /// The scaled motion of the proxy under a force over k at a point.
  [[nodiscard]] Vector on_proxy(const Where& arm, const Where& force) const noexcept {
    if constexpr (N == 6) {
      Vector y;
      y << force, arm.cross(force) / length_;
      return y;
    } else {
      return force;
    }
  }
  /// Of all points that touch at x, where the last look was; books what friction takes.
  void drag_anchors(const Position<N>& x, const Position<N>& goal) noexcept {
    const PoseWithRotation<N> pose{x};
    double taken = 0.0;
    for (std::size_t i = 0; i < moved_anchors_.size(); ++i) {
      Anchor& a = moved_anchors_[i];
      const Before& b = before_[i];
      Where p = x.translation();
      if constexpr (N == 6) p += pose.R * tool_[i / surfaces_.size()];
      if (!b.touches) {
        a.holds = false;
      } else if (!a.holds) {
        a = {p, true};
      } else {
        const Where n = b.plane.normal.normalized(), from = p - a.at, slip = from - n.dot(from) * n;
        const double slides = slip.norm() - kYield_m;
        a.at = p - (slides > 0.0 ? kYield_m / slip.norm() : 1.0) * slip;
        for (std::size_t k = 0; slides > 0.0 && k < sliding_; ++k)
          if (planes_[slidings_[k].row].index == static_cast<int>(i)) taken += slidings_[k].most * slides;
      }
    }
    solved_friction_energy_ = Energy{stiffness_ * taken};
    // No more than the spring has lost while the proxy moved; where the friction is solved for, that holds by itself.
    if (newton_steps_ >= kNewtonStepsOfSolution)
      solved_friction_energy_ = std::min(solved_friction_energy_, positive_part(start_energy_ - potential(x, goal)));
  }
  void tell_contacts() noexcept {
    contacts_ = solver_.active();
    for (std::size_t j = 0; j < contacts_; ++j) {
      const Plane& plane = planes_[solver_.index(j)];
      contact_[j] = {plane.index, plane.normal, plane.arm, stiffness_ * solver_.lambda(j)};
    }
  }

  struct Before {
    Plane plane;
    bool within = false, touches = false;
  };

  double stiffness_, rotational_stiffness_, damping_, rotational_damping_;
  double length_;        ///< √(k_r/k): of a rotation in the spring's metric [m]
  double radius_ = 0.0;  ///< of the farthest point of the tool
  std::vector<Surface> surfaces_;
  std::vector<Eigen::Vector3d> tool_;
  Position<N> proxy_;
  bool placed_ = false, touching_ = false;
  bool rough_ = false;  ///< has a surface friction?
  Energy friction_energy_;
  // Work space of a solution.
  std::vector<HalfSpace<N>> rows_;
  std::vector<Plane> planes_, cuts_;
  std::vector<Before> before_;
  std::vector<Anchor> anchors_, moved_anchors_;  ///< of all contacts: now, and with the last solution
  std::array<Sliding, kMost> slidings_;
  std::size_t sliding_ = 0;
  bool slips_ = false;  ///< one of them, in the last solution
  int newton_steps_ = 0;
  std::uint64_t unfinished_ = 0;
  Energy solved_friction_energy_, start_energy_;
  LeastDistance<N> solver_;
  std::array<Contact, static_cast<std::size_t>(N)> contact_{};
  std::size_t contacts_ = 0;
};

template <int N>
bool GodObject<N>::solve(Position<N>& x, const Position<N>& goal, bool free) noexcept {
  Position<N> last_free = x;
  bool has_free = free;
  cuts_.clear();
  contacts_ = 0;
  newton_steps_ = 0;
  double step = 0.0;
  if (rough_) {
    solved_friction_energy_ = {};
    start_energy_ = potential(x, goal);
    moved_anchors_ = anchors_;
    if (!free)
      for (Anchor& a : moved_anchors_) a.holds = false;
  }
  for (int i = 0; i <= kSteps; ++i) {
    Vector y = scaled(goal, x);
    const double far = travel(y);
    const double least = look(x, 2.5 * std::min(far, kStep_m) + 1e-4, i == 0);
    if (least >= -kPenetration_m) {
      last_free = x, has_free = true;
      if (i > 0 && step <= kStill_m) {
        if (rough_) drag_anchors(x, goal);
        return true;
      }
    }
    if (i == kSteps) break;
    if (rows_.empty()) {
      contacts_ = 0;
      if (far <= kStep_m) {
        x = goal;
        for (Anchor& a : moved_anchors_) a.holds = false;
        return true;
      }
      y *= kStep_m / far;
      step = travel(y);
      x = moved(x, y);
      continue;
    }
    if (rough_)
      solve_with_friction(x, y);
    else
      solver_.solve(rows_, y, kTolerance_m);
    tell_contacts();
    const double way = travel(y);
    const bool whole = way <= kStep_m;
    if (!whole) y *= kStep_m / way;
    step = travel(y);
    if (i == 0 && has_free && step <= kRest_m) {
      if (rough_) drag_anchors(x, goal);
      return true;
    }
    if (contacts_ == 0 && whole)
      x = goal, step = 0.0;  // checked by the next look
    else if (step > 0.0)
      x = moved(x, y);
  }
  x = last_free;
  if (rough_) drag_anchors(x, goal);
  return has_free;
}

// Compiled once, in method/dof_N.cc.
extern template class GodObject<1>;
extern template class GodObject<3>;
extern template class GodObject<6>;

}  // namespace twoport
