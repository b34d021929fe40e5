#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <vector>

#include "common/base/eigenvalues.h"

namespace twoport::lab {

// Sampled loops as matrices from tick to tick, computed without the laboratory's code.

/// Where `holds` first fails, from 0 up: scanned in steps of 10 % around `scale`, then bisected. 0: it never holds.
template <class Holds>
double first_failure(Holds holds, double scale) {
  double lo = 1e-3 * scale, hi = lo;
  if (!holds(lo)) return 0.0;
  while (holds(hi)) {
    lo = hi;
    hi *= 1.1;
    if (hi > 1e6 * scale) return std::numeric_limits<double>::infinity();
  }
  while (hi / lo > 1.0 + 1e-13) {
    const double mid = 0.5 * (lo + hi);
    if (mid <= lo || mid >= hi) break;
    (holds(mid) ? lo : hi) = mid;
  }
  return lo;
}

/// A radius of 1 is not unstable; eigenvalues come out to about 1e-14.
inline bool stable(double radius) {
  return radius <= 1.0 + 1e-12;
}

/// Matrix of a linear map of n numbers, column by column.
template <class Step>
Eigen::MatrixXd matrix_of(Eigen::Index n, Step step) {
  Eigen::MatrixXd a(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    Eigen::VectorXd state = Eigen::VectorXd::Unit(n, i);
    step(state);
    a.col(i) = state;
  }
  return a;
}

/// Moduli of the eigenvalues, largest first.
inline std::vector<double> moduli(const Eigen::MatrixXd& a) {
  const Eigen::VectorXcd values = eigenvalues(a);
  std::vector<double> all;
  for (Eigen::Index i = 0; i < values.size(); ++i) all.push_back(std::abs(values[i]));
  std::sort(all.begin(), all.end(), std::greater<>{});
  return all;
}

/// Position and velocity of m ẍ = f - b ẋ - k x after h seconds of a constant f: exp of the 3x3 generator, by scaling
/// and squaring of its series.
struct Held {
  Eigen::Matrix2d of_state;
  Eigen::Vector2d of_force;

  Held(double m, double b, double k, double h) {
    Eigen::Matrix3d g;
    g << 0, 1, 0, -k / m, -b / m, 1 / m, 0, 0, 0;
    g *= h;
    int halvings = 0;
    for (double size = g.cwiseAbs().rowwise().sum().maxCoeff(); size > 0.25; size *= 0.5) ++halvings;
    g /= std::ldexp(1.0, halvings);
    Eigen::Matrix3d sum = Eigen::Matrix3d::Identity(), term = sum;
    for (int j = 1; j < 20; ++j) sum += term = term * g / j;
    for (int i = 0; i < halvings; ++i) sum = sum * sum;
    of_state = sum.topLeftCorner<2, 2>();
    of_force = sum.topRightCorner<2, 1>();
  }
  Held(const Eigen::Matrix2d& a, const Eigen::Vector2d& f) : of_state{a}, of_force{f} {}

  /// n substeps of semi-implicit Euler: v += h a(x, v), x += h v.
  static Held euler(double m, double b, double k, double h, int n) {
    const double s = h / n;
    Eigen::Matrix2d step;
    Eigen::Vector2d push;
    step << 1 - s * s * k / m, s * (1 - s * b / m), -s * k / m, 1 - s * b / m;
    push << s * s / m, s / m;
    Held all{Eigen::Matrix2d::Identity(), Eigen::Vector2d::Zero()};
    for (int i = 0; i < n; ++i) all = {step * all.of_state, step * all.of_force + push};
    return all;
  }
  void move(Eigen::Ref<Eigen::Vector2d> state, double f) const { state = (of_state * state + of_force * f).eval(); }
};

/// A delay line in the tail of a state: in at the back, out at the front. No tail: out is what goes in.
inline double pass(Eigen::VectorXd& state, Eigen::Index from, double in) {
  const Eigen::Index length = state.size() - from;
  if (length == 0) return in;
  const double out = state[from];
  for (Eigen::Index i = from; i + 1 < state.size(); ++i) state[i] = state[i + 1];
  state[state.size() - 1] = in;
  return out;
}

/// A mass on a bilateral sampled spring-damper; mass and damping include those of the hand.
///
///     m ẍ = -b ẋ - k_h x - f(t),    f(t) = K x(k) + B v(k)   held from (k + d + g) T on, for T
///     v(k) = (x(k) - x(k-1))/T      or ẋ(kT) where true_velocity
struct SampledWall {
  double mass_kg = 0.075, damping_n_s_per_m = 0.5;
  double hand_stiffness_n_per_m = 0.0;
  double stiffness_n_per_m = 0.0, wall_damping_n_s_per_m = 0.0;
  double period_s = 1e-3;
  int delay_ticks = 0;
  double delay_fraction = 0.0;  ///< g, of a tick, in [0, 1)
  bool true_velocity = false;
  /// 0: the exact zero-order-hold map. n: semi-implicit Euler in n substeps, to show its error.
  int euler_substeps = 0;
};

/// Largest |eigenvalue| of the loop from tick to tick: stable below 1, growth per tick above.
double spectral_radius(const SampledWall& wall);

/// Stiffness at which the loop first becomes unstable, from 0 up [N/m]; stiffness_n_per_m is ignored.
/// 0: unstable for any stiffness.
double critical_stiffness(SampledWall wall);

/// Rule of small gains, good for B T/m << 1: K = (b + B)/(T/2 + d T) [N/m].
double linear_rule_stiffness(double damping_n_s_per_m, double wall_damping_n_s_per_m, double period_s,
                             double delay_ticks);

}  // namespace twoport::lab
