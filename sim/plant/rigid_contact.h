#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <utility>

#include "sim/plant/body.h"

namespace twoport::sim {

/// A body under a held force in an environment, integrated by classical Runge-Kutta steps that end where a contact
/// begins or ends. The general case: curved surfaces, Coulomb friction, several walls, rigid bodies.
template <int N>
class RungeKuttaPlant {
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
                  const BodyState<N>& start)
      : body_{robot, std::move(environment)},
        dt_{dt},
        any_(static_cast<std::size_t>(body_.environment().contacts()), kNearest),
        after_{any_},
        trial_{any_},
        s_{body_.motion(start), {}, Vector::Zero(), any_} {
    // Mobility at the contacts: of all points together, and the largest of one point.
    double all_points = 1.0 / body_.mass();
    mobility_ = all_points;
    if constexpr (N == 6) {
      all_points = 0.0;
      for (const Eigen::Vector3d& arm : body_.environment().tool()) {
        const double mobility = body_.mobility_at(arm);
        all_points += mobility;
        mobility_ = std::max(mobility_, mobility);
      }
    }
    double stiffness = 0.0, damping = 0.0;
    for (const Surface& s : body_.environment().world().surfaces) {
      stiffness += s.material.stiffness_n_per_m;
      damping += s.material.damping_n_s_per_m + s.material.viscous_friction_n_s_per_m;
      friction_ = std::max(friction_, s.material.friction);
    }
    for (const Spring& s : body_.environment().world().springs) {
      stiffness += s.stiffness_n_per_m;
      damping += s.damping_n_s_per_m;
    }
    rate_ = std::max(std::sqrt(stiffness * all_points), damping * all_points + robot.damping_n_s_per_m / robot.mass_kg);
    rate_ = std::max(rate_, body_.damping_rate());
    s_.slope = body_.slope(s_.motion, s_.held, s_.touched);
  }

  /// One tick under the force f.
  [[gnu::noinline]] BodyState<N> advance(Force<N> force) noexcept {
    const Vector f = port_vector<N>(force.vec());
    if constexpr (N == 6)
      s_.slope.p += f - s_.held;
    else
      s_.slope.p += (f - s_.held) / body_.mass();
    s_.held = f;
    // Steps short against the fastest motion: local error below (0.1)^5/120.
    double rate = rate_;
    if (friction_ > 0.0) {
      const double pressed = std::max(translation(f).norm(), translation(s_.slope.environment).norm());
      rate = std::max(rate, 0.3 * friction_ * pressed * mobility_ / kStictionSpeed);
    }
    if constexpr (N == 6) rate = std::max(rate, s_.slope.v.angular.norm());
    const double wanted = dt_ * rate / 0.1;
    const int pieces = wanted < kPieces ? std::max(1, static_cast<int>(std::ceil(wanted))) : kPieces;
    for (int i = 0; i < pieces; ++i) {
      double left = dt_ / pieces;
      for (int cuts = 0; left > 0.0; ++cuts) left -= step(left, cuts < kCuts);
    }
    return body();
  }
  [[nodiscard]] BodyState<N> body() const noexcept { return {s_.motion.at.x, Velocity<N>{s_.slope.v}}; }
  [[nodiscard]] Force<N> environment_force() const noexcept { return Force<N>{s_.slope.environment}; }

  [[nodiscard]] const State& state() const noexcept { return s_; }
  /// Continues from `state`, of a plant of the same scene.
  void set_state(const State& state) noexcept { s_ = state; }
  /// Adds dv to the velocity.
  void kick(const Velocity<N>& dv) noexcept {
    const BodyState<N> now = body();
    s_.motion = body_.motion({now.x, now.v + dv});
    s_.slope = body_.slope(s_.motion, s_.held, s_.touched);
  }

 private:
  static constexpr int kPieces = 256;  // of a tick, at most
  static constexpr int kCuts = 4;      // contacts that begin or end within one piece, each met on its own

  /// One step of at most h; ends early, if it may, just past the moment at which a contact begins, ends or changes to
  /// another feature. Returns its length.
  double step(double h, bool may_cut) noexcept {
    const Contacts& among = may_cut ? s_.touched : any_;
    typename Body<N>::Motion next = body_.runge_kutta(s_.motion, s_.slope, s_.held, among, h);
    typename Body<N>::Slope there = body_.slope(next, s_.held, after_);
    if (may_cut && after_ != s_.touched) {
      double lo = 0.0, hi = h;
      while (hi - lo > 1e-7 * h) {
        const double mid = 0.5 * (lo + hi);
        const auto trial = body_.runge_kutta(s_.motion, s_.slope, s_.held, among, mid);
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
  double dt_, mobility_, rate_ = 0.0, friction_ = 0.0;
  Contacts any_;            ///< every contact, by its nearest feature
  Contacts after_, trial_;  ///< of a step; no state
  State s_;
};

}  // namespace twoport::sim
