#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "sim/plant/integrators.h"

namespace twoport::sim {

/// Coulomb friction of a plane wall on a mass on springs, under a held force u:
///
///     across   m n̈ = u_n - c ṅ - k n + f_n,   f_n = K (o - n) - B ṅ
///     along    m ẍ = u - c ẋ - k x - μ f_n ẋ/|ẋ|,   or rests while |u - k x| <= μ f_n
///
/// The motion across is known. Along a line of direction d, d·x + μ n moves as if there was no wall, under d·u + μ u_n: a closed form.
/// Where the velocity turns, it is integrated by Runge-Kutta 4. Stops and releases are located in time.
template <int D>
class WallFriction {
 public:
  using Vector = Eigen::Matrix<double, D, 1>;

  /// The mass without the wall, on its springs; the same across while the wall presses; of the wall.
  Oscillator free{}, across{};
  double coefficient = 0.0, stiffness = 0.0, damping = 0.0, offset = 0.0;

  /// Moves x, v, both along the wall, for h under u, while n and ṅ move from `n` under u_n.
  void advance(Vector& x, Vector& v, const Vector& u, double un, AxisState n, double h) const noexcept {
    double done = 0.0;
    for (int part = 0; done < h; ++part) {
      const double left = h - done;
      const Vector load = u - free.stiffness_n_per_m * x;
      Vector direction = v;
      double moves = 0.0, waits = 0.0;
      if (rests(v)) {
        v.setZero();
        waits = part < kParts ? release(load.norm(), un, n, left) : left;
        if (!(waits < left)) return;
        n = moved_across(n, un, waits);
        direction = load;
      }
      direction.normalize();
      if (part < kParts && turns(load, direction, limit(n)))
        moves = slide_turning(u, un, n, left - waits, x, v);
      else
        moves = slide_straight(direction, u, un, n, left - waits, x, v);
      done += waits + moves;
      if (done < h) n = moved_across(n, un, moves);
    }
  }

  /// Of the wall on a mass that moves with v under the load u - k x along it [N].
  [[nodiscard]] Vector force(const Vector& load, const Vector& v, const AxisState& n) const noexcept {
    const double most = limit(n), pull = load.norm();
    if (!rests(v)) return -most * v.normalized();
    return pull > most ? Vector{-most / pull * load} : Vector{-load};
  }

 private:
  static constexpr int kParts = 256;       ///< of a step, between stops and releases
  static constexpr double kRest = 1e-12;   ///< slower is at rest [m/s]
  static constexpr double kTurn = 0.02;    ///< [rad]: a step of Runge-Kutta 4 errs by kTurn^5/120 of what it moves
  static constexpr double kClose = 1e-15;  ///< so close to a stop the direction does not matter [m]

  static bool rests(const Vector& v) noexcept { return v.squaredNorm() < kRest * kRest; }
  [[nodiscard]] AxisState moved_across(const AxisState& n, double un, double t) const noexcept {
    return t > 0.0 ? propagate(across, n, un + stiffness * offset, 0.0, t) : n;
  }
  /// μ f_n
  [[nodiscard]] double limit(const AxisState& n) const noexcept {
    return coefficient * std::max(0.0, stiffness * (offset - n.x) - damping * n.v);
  }
  [[nodiscard]] static bool turns(const Vector& load, const Vector& direction, double most) noexcept {
    return (load - direction.dot(load) * direction).norm() > 1e-13 * (load.norm() + most);
  }
  /// Until when, between 0 and h, `holds` does.
  template <class Holds>
  static double last(const Holds& holds, double h) noexcept {
    double lo = 0.0, hi = h;
    for (int i = 0; i < 60; ++i) {
      const double t = 0.5 * (lo + hi);
      (holds(t) ? lo : hi) = t;
    }
    return hi;
  }

  /// When within h the wall no longer holds a load of this size; h where it does.
  [[nodiscard]] double release(double load, double un, const AxisState& n, double h) const noexcept {
    const auto holds = [&](double t) { return load <= limit(moved_across(n, un, t)); };
    if (load > limit(n)) return 0.0;
    double until = h;
    if (holds(h)) {
      // The limit may have been least within the step, where it is convex: above its tangent.
      const auto falls = [&](double t) { return rate(moved_across(n, un, t), un) < 0.0; };
      if (!falls(0.0) || load <= limit(n) + coefficient * rate(n, un) * h || falls(h)) return h;
      until = last(falls, h);
      if (holds(until)) return h;
    }
    return last(holds, until);
  }
  /// Of f_n [N/s].
  [[nodiscard]] double rate(const AxisState& n, double un) const noexcept {
    const double acceleration =
        (un + stiffness * offset - across.damping_n_s_per_m * n.v - across.stiffness_n_per_m * n.x) / across.mass_kg;
    return -stiffness * n.v - damping * acceleration;
  }

  /// Slides along a line for h or until it stops. Returns how long.
  double slide_straight(const Vector& direction, const Vector& u, double un, const AxisState& n, double h, Vector& x,
                        Vector& v) const noexcept {
    const double s0 = direction.dot(x), speed = direction.dot(v);
    // Of d·x + μ n, from where it is.
    const double load = direction.dot(u) + coefficient * un - free.stiffness_n_per_m * (s0 + coefficient * n.x);
    const auto along = [&](double t) -> AxisState {
      const AxisState sum = propagate(free, {0.0, speed + coefficient * n.v}, load, 0.0, t),
                      other = moved_across(n, un, t);
      return {sum.x - coefficient * (other.x - n.x), sum.v - coefficient * other.v};
    };
    const auto slows = [&](const AxisState& s, double t) {
      return direction.dot(u) - free.stiffness_n_per_m * (s0 + s.x) - free.damping_n_s_per_m * s.v <
             limit(moved_across(n, un, t));
    };
    AxisState end = along(h);
    double until = h;
    bool stops = end.v < 0.0;
    if (!stops && slows({0.0, speed}, 0.0) && !slows(end, h)) {
      const double slowest = last([&](double t) { return slows(along(t), t); }, h);
      stops = along(slowest).v < 0.0;
      if (stops) until = slowest;
    }
    if (stops) {
      until = last([&](double t) { return along(t).v > 0.0; }, until);
      end = {along(until).x, 0.0};
    }
    x += end.x * direction;
    v = end.v * direction;
    return until;
  }

  /// Slides for h, or until it stops or no longer turns. Returns how long.
  double slide_turning(const Vector& u, double un, const AxisState& n, double h, Vector& x, Vector& v) const noexcept {
    constexpr int kSteps = 20'000;
    const double mass = free.mass_kg;
    const double own_rate = std::max(std::sqrt(across.stiffness_n_per_m / mass), across.damping_n_s_per_m / mass);
    const auto acceleration = [&](const Vector& at, const Vector& speed, double most) -> Vector {
      return (u - free.damping_n_s_per_m * speed - free.stiffness_n_per_m * at -
              most / std::max(speed.norm(), kRest) * speed) /
             mass;
    };
    double t = 0.0;
    AxisState at = n;
    for (int steps = 0; steps < kSteps && t < h; ++steps) {
      const double size = v.norm(), most = limit(at);
      const Vector load = u - free.stiffness_n_per_m * x, direction = v / size, a = acceleration(x, v, most);
      const double slows = -direction.dot(a);
      if (size * size < 2.0 * slows * kClose) {
        const double rest = std::min(size / slows, h - t);
        x += 0.5 * rest * v;
        v.setZero();
        return t + rest;
      }
      if (steps > 0 && !turns(load, direction, most)) return t;
      const double d = std::min(h - t, kTurn / std::max((most + load.norm()) / (mass * size), own_rate));
      const AxisState mid = moved_across(at, un, 0.5 * d);
      at = moved_across(at, un, d);
      const double most_mid = limit(mid), most_end = limit(at);
      step_by(Integrator::rk4, d, 0.0, x, v, [&](double into, const Vector& q, const Vector& speed) -> Vector {
        return into <= 0.0 ? a : acceleration(q, speed, into < d ? most_mid : most_end);
      });
      t = d == h - t ? h : t + d;
    }
    return h;
  }
};

}  // namespace twoport::sim
