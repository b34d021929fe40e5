#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <numeric>
#include <utility>
#include <vector>

#include "sim/plant/body.h"

namespace twoport::sim {

/// A body under a held force in an environment, integrated by classical Runge-Kutta steps that end where a contact
/// begins or ends. The general case: curved surfaces, Coulomb friction, several walls, rigid bodies. A tick that needs
/// more than kPieces such steps (friction on a light body) is integrated by RODAS with error control; a body that turns
/// without contact by its Taylor series.
template <int N>
class RungeKuttaPlant final : public BodyPlant<N> {
 public:
  using Vector = typename Body<N>::Vector;
  using Contacts = typename Body<N>::Contacts;

  /// State between two ticks.
  struct State {
    typename Body<N>::Motion motion;
    typename Body<N>::Slope slope;  ///< of motion, under held
    Vector held;                    ///< force
    Contacts touched;
  };

  RungeKuttaPlant(const RobotSpec& robot, std::shared_ptr<const Environment<N>> environment, double dt,
                  const BodyState<N>& start, std::size_t few = BroadPhase<kAxes<N>>::kFew)
      : body_{robot, std::move(environment), few},
        dt_{dt},
        after_{body_.environment().contacts()},
        trial_{after_},
        s_{body_.motion(start), {}, Vector::Zero(), after_} {
    most_mobile_ = 1.0 / body_.mass();
    if constexpr (N == 6) {
      for (const Eigen::Vector3d& arm : body_.environment().tool()) mobility_.push_back(body_.mobility_at(arm));
      for (const double mobility : mobility_) most_mobile_ = std::max(most_mobile_, mobility);
    } else {
      mobility_ = {most_mobile_};
    }
    most_cuts_ = kCuts + std::max(0, static_cast<int>(mobility_.size()) - 1);
    own_rate_ = robot.damping_n_s_per_m / robot.mass_kg;
    surfaces_have_changed();
  }

  void surfaces_have_changed() noexcept override {
    const World& world = body_.environment().world();
    double stiffness = 0.0, damping = 0.0, stiffest = 0.0;
    friction_ = 0.0;
    for (const Surface& s : world.surfaces) {
      stiffness += s.material.stiffness_n_per_m;
      stiffest = std::max(stiffest, s.material.stiffness_n_per_m);
      damping = std::max(damping, s.material.all_damping_n_s_per_m());
      friction_ = std::max(friction_, s.material.friction);
    }
    for (const Spring& s : world.springs) stiffness += s.stiffness_n_per_m;
    rate_of_springs_ = std::sqrt(stiffness * std::accumulate(mobility_.begin(), mobility_.end(), 0.0));
    rate_of_one_ = std::max(std::sqrt(stiffest * most_mobile_), damping * most_mobile_ + own_rate_);
    rate_of_one_ = std::max(rate_of_one_, body_.damping_rate());
    s_.slope = body_.slope(s_.motion, s_.held, s_.touched);
  }

  [[nodiscard]] std::unique_ptr<BodyPlant<N>> copy() const override { return std::make_unique<RungeKuttaPlant>(*this); }
  BodyState<N> advance(const Force<N>& force) noexcept override {
    const Vector f = port_vector<N>(force.vec());
    if constexpr (N == 6)
      s_.slope.p += f - s_.held;
    else
      s_.slope.p += (f - s_.held) / body_.mass();
    s_.held = f;
    // Steps short against the fastest motion: local error below (0.1)^5/120.
    double rate = contact_rate();
    if (friction_ > 0.0) {
      const double pressed = std::max(translation(f).norm(), translation(s_.slope.environment).norm());
      rate = std::max({rate, 0.3 * friction_ * pressed * most_mobile_ / kStictionSpeed, friction_rate()});
    }
    if constexpr (N == 6) rate = std::max(rate, s_.slope.v.angular.norm());
    const double wanted = dt_ * rate / 0.1;
    if (wanted > kPieces) {
      advance_stiff(dt_);
      return body();
    }
    const int pieces = wanted < kPieces ? std::max(1, static_cast<int>(std::ceil(wanted))) : kPieces;
    for (int i = 0; i < pieces; ++i) {
      double left = dt_ / pieces;
      for (int cuts = 0; left > 0.0; ++cuts) {
        if (fastest_rate() > 1.5 * rate) {
          advance_finer(left);
          break;
        }
        left -= step(left, cuts < most_cuts_);
      }
    }
    return body();
  }
  /// From `from`, for `time` seconds under the force f, by RODAS.
  BodyState<N> advance_stiff(const BodyState<N>& from, const Force<N>& force, double time) noexcept {
    s_.motion = body_.motion(from);
    s_.held = port_vector<N>(force.vec());
    s_.slope = body_.slope(s_.motion, s_.held, s_.touched);
    advance_stiff(time);
    return body();
  }
  [[nodiscard]] BodyState<N> body() const noexcept { return {s_.motion.at.x, Velocity<N>{s_.slope.v}}; }
  [[nodiscard]] Force<N> environment_force() const noexcept override { return Force<N>{s_.slope.environment}; }

  void kick(const Velocity<N>& dv) noexcept override {
    const BodyState<N> now = body();
    s_.motion = body_.motion({now.x, now.v + dv});
    s_.slope = body_.slope(s_.motion, s_.held, s_.touched);
  }

 private:
  static constexpr int kPieces = 256;        // of a tick, at most; what is faster is stiff
  static constexpr int kCuts = 4;            // contacts that begin or end within one piece, each met on its own
  static constexpr int kSteps = 20'000;      // of a stiff tick with error control, at most
  static constexpr double kSlowTurn = 1e-3;  // [rad] in a step: below, Runge-Kutta errs by less than rounding

  /// Rate of springs and dampers [1/s]: of all contacts that press, together, and of one that may begin.
  [[nodiscard]] double contact_rate() const noexcept {
    double springs = 0.0, dampers = 0.0;  // times mobility
    for (const Touched& t : s_.touched.all()) {
      const auto [stiffness, damping] = body_.environment().impedance_of(t.index);
      const double mobility = mobility_[static_cast<std::size_t>(body_.environment().point_of(t.index))];
      springs += stiffness * mobility;
      dampers += damping * mobility;
    }
    return std::max({rate_of_one_, std::sqrt(springs), dampers + own_rate_});
  }
  [[nodiscard]] double fastest_rate() const noexcept {
    return friction_ > 0.0 ? std::max(contact_rate(), friction_rate()) : contact_rate();
  }
  /// Rate against which Coulomb friction asks for short steps [1/s]: 0.3 of that at which it damps the body at its
  /// present velocity; while the velocity hardly changes, what keeps a step stable (2 of a limit of 2.8).
  [[nodiscard]] double friction_rate() const noexcept {
    constexpr double kSteady = 1e-7;  // [m/s] in a tick
    double acceleration = translation(s_.slope.p).norm();
    if constexpr (N == 6)
      acceleration = most_mobile_ * acceleration + std::sqrt(most_mobile_) * body_.largest_spin_up(s_.slope.p.angular);
    return (acceleration * dt_ > kSteady ? 0.3 : 0.05) * s_.slope.friction * most_mobile_;
  }
  /// What is left of a piece in which contacts have come to press more than the tick's steps are short for.
  void advance_finer(double left) noexcept {
    for (int cuts = 0; left > 0.0;) {
      const double wanted = std::max(1.0, left * fastest_rate() / 0.1);
      if (wanted * dt_ > kPieces * left) return advance_stiff(left);
      const double part = left / std::ceil(wanted), taken = step(part, cuts < kCuts * kPieces);
      cuts += taken < part;
      left = taken == left ? 0.0 : left - taken;
    }
  }
  /// Where explicit steps would be too many: linearly implicit ones, as long as their own error allows.
  void advance_stiff(double left) noexcept {
    const double shortest = 1e-9 * left, longest = 0.5 / rate_of_springs_;
    double h = std::min(left / kPieces, longest);
    for (int steps = 0, cuts = 0; left > 0.0; ++steps) {
      h = std::min({h, left, longest});
      const bool last = steps >= kSteps;
      if (last) h = std::min(left, dt_ / kPieces);  // as they come, whatever they err by
      const bool may_cut = cuts < kCuts * kPieces && !last;
      const Contacts* among = may_cut ? &s_.touched : nullptr;
      double error = 0.0;
      typename Body<N>::Motion next = body_.rosenbrock(s_.motion, s_.slope, s_.held, among, h, error);
      const double factor = error > 0.0 ? std::clamp(0.9 / std::sqrt(std::sqrt(error)), 0.2, 5.0) : 5.0;
      if (!(error <= 1.0) && !last) {
        if (h > shortest) {
          h *= error > 1.0 ? std::min(factor, 0.9) : 0.2;
          continue;
        }
        if (!std::isfinite(error)) steps = kSteps;
      }
      const double taken = finish(next, h, may_cut, [&](double part) {
        double unused;
        return body_.rosenbrock(s_.motion, s_.slope, s_.held, among, part, unused);
      });
      cuts += taken < h;
      left -= taken;
      h *= factor;
    }
  }

  /// One step of at most h; ends early, if it may, just past the moment at which a contact begins, ends or changes to
  /// another feature. Returns its length.
  double step(double h, bool may_cut) noexcept {
    const Contacts* among = may_cut ? &s_.touched : nullptr;
    if constexpr (N == 6) {
      const bool free = may_cut ? s_.touched.all().empty() : body_.environment().contacts() == 0;
      if (free && h * h * s_.slope.v.angular.squaredNorm() > kSlowTurn * kSlowTurn) {
        const auto fly = [&](double part) { return body_.flight(s_.motion, s_.held, part); };
        return finish(fly(h), h, may_cut, fly);
      }
    }
    const auto go = [&](double part) { return body_.runge_kutta(s_.motion, s_.slope, s_.held, among, part); };
    return finish(go(h), h, may_cut, go);
  }
  /// The step of h that leads to `next`, cut if it may be; go(h) is where one of h leads to. Returns its length.
  template <class Go>
  double finish(typename Body<N>::Motion next, double h, bool may_cut, const Go& go) noexcept {
    typename Body<N>::Slope there = body_.slope(next, s_.held, after_);
    if (may_cut && after_ != s_.touched) {
      double lo = 0.0, hi = h;
      while (hi - lo > 1e-7 * h) {
        const double mid = 0.5 * (lo + hi);
        const auto trial = go(mid);
        const auto slope_of_trial = body_.slope(trial, s_.held, trial_);
        if (trial_ == s_.touched) {
          lo = mid;
        } else {
          hi = mid;
          next = trial;
          there = slope_of_trial;
          std::swap(after_, trial_);
        }
      }
      h = hi;
    }
    s_.motion = next;
    s_.slope = there;
    std::swap(s_.touched, after_);
    return h;
  }

  Body<N> body_;
  double dt_;
  int most_cuts_ = kCuts;         ///< and one more for each further point
  std::vector<double> mobility_;  ///< of each point [1/kg]
  double most_mobile_ = 0.0;      ///< the largest of a point
  double friction_ = 0.0, rate_of_springs_ = 0.0, rate_of_one_ = 0.0;
  double own_rate_ = 0.0;   ///< of the body's damping [1/s]
  Contacts after_, trial_;  ///< of a step; no state
  State s_;
};

}  // namespace twoport::sim
