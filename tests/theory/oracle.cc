#include "tests/theory/oracle.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "lab/theory/sampled_loop.h"

namespace twoport::lab {
namespace {

using std::numbers::pi;
using Complex = std::complex<double>;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// ---- search

/// Place and value of a maximum of f in [a, b], by golden section.
template <class F>
std::pair<double, double> maximum(F f, double a, double b) {
  const double shrink = 0.5 * (std::sqrt(5.0) - 1.0);
  double x1 = b - shrink * (b - a), x2 = a + shrink * (b - a), f1 = f(x1), f2 = f(x2);
  for (int i = 0; i < 80; ++i) {
    if (f1 < f2) {
      a = std::exchange(x1, x2);
      f1 = f2;
      f2 = f(x2 = a + shrink * (b - a));
    } else {
      b = std::exchange(x2, x1);
      f2 = f1;
      f1 = f(x1 = b - shrink * (b - a));
    }
  }
  return f1 > f2 ? std::pair{x1, f1} : std::pair{x2, f2};
}

/// The same over a grid first; every hill that the grid sees is climbed.
template <class F>
std::pair<double, double> largest(F f, double a, double b, int points) {
  const auto at = [&](int i) { return a + (b - a) * i / (points - 1); };
  std::vector<double> value;
  for (int i = 0; i < points; ++i) value.push_back(f(at(i)));
  const auto top = std::max_element(value.begin(), value.end()) - value.begin();
  std::pair<double, double> best{at(static_cast<int>(top)), value[static_cast<std::size_t>(top)]};
  for (int i = 0; i < points; ++i) {
    const int left = std::max(i - 1, 0), right = std::min(i + 1, points - 1);
    const auto of = [&](int j) { return value[static_cast<std::size_t>(j)]; };
    if (of(i) < of(left) || of(i) < of(right)) continue;
    if (const auto refined = maximum(f, at(left), at(right)); refined.second > best.second) best = refined;
  }
  return best;
}

}  // namespace

// ---- passivity of a sampled wall

double colgate_damping(const Discrete& wall, double period_s) {
  const auto needed = [&](double theta) {
    const Complex z = std::polar(1.0, theta);
    // 1 - cos θ without cancellation.
    const double half = std::sin(0.5 * theta);
    return 0.5 * period_s * ((1.0 - 1.0 / z) * wall(z)).real() / (2.0 * half * half);
  };
  return largest(needed, 1e-5, pi, 4096).second;
}

double colgate_damping(double k, double b, double period_s, int d) {
  const auto needed = [&](double theta) {
    const double half = 0.5 * theta;
    const double dirichlet = half == 0.0 ? 2.0 * d + 1.0 : std::sin((2 * d + 1) * half) / std::sin(half);
    return 0.5 * k * period_s * dirichlet - b * std::cos((d + 1) * theta);
  };
  return largest(needed, 0.0, pi, 64 * (d + 2)).second;
}

// ---- stability of a sampled wall

namespace {
Peak undamped(double theta, int d) {
  const double half = std::sin(0.5 * theta);
  const double gamma = 4.0 * half * half / std::cos(0.5 * theta);
  const double beta = gamma * std::sin((d + 0.5) * theta) / std::sin(theta);
  return {gamma * std::cos((d + 0.5) * theta) - beta * (1.0 - std::cos(theta)), beta};
}
}  // namespace

double critical_stiffness_undamped(double m, double b, double period_s, int d) {
  const double beta = b * period_s / m, scale = m / (period_s * period_s);
  if (d == 0) return std::max(0.0, scale * 2.0 * beta * (2.0 - beta) / (2.0 + beta));
  // β grows with θ up to where α has fallen to 0, before θ = π/(2d+1).
  double lo = 0.0, hi = pi / (2 * d + 1);
  if (undamped(hi, d).beta < beta) return 0.0;
  for (int i = 0; i < 100; ++i) {
    const double mid = 0.5 * (lo + hi);
    (undamped(mid, d).beta < beta ? lo : hi) = mid;
  }
  return std::max(0.0, scale * undamped(lo, d).alpha);
}

Peak stiffest_undamped(int d) {
  const double end = pi / (2 * d + 1);
  const auto alpha = [&](double theta) { return undamped(theta, d).alpha; };
  return undamped(largest(alpha, 1e-6 * end, (1.0 - 1e-6) * end, 400).first, d);
}

// ---- bilateral loops

int ticks_of_delay(double delay_s, double period_s) {
  return std::max(1, static_cast<int>(std::ceil(delay_s / period_s - 1e-6)));
}

double spectral_radius(const BilateralLoop& l) {
  const Held handle{l.master_mass_kg, l.master_damping_n_s_per_m, l.hand_stiffness_n_per_m, l.period_s};
  const Held robot{l.robot_mass_kg, l.robot_damping_n_s_per_m + l.environment_damping_n_s_per_m,
                   l.environment_stiffness_n_per_m, l.period_s};
  const double k = l.coupling_stiffness_n_per_m, b = l.coupling_damping_n_s_per_m, scale = l.motion_scale;
  // Only the round trip counts: the slave's time is shifted by d1. One number goes back, whatever the architecture.
  const Eigen::Index queue = l.to_slave_ticks + l.to_master_ticks;
  // x_m, ẋ_m, x_s, ẋ_s, x_m of the last tick, numbers under way
  const MatrixXd a = matrix_of(5 + queue, [&](VectorXd& s) {
    const double xm = s[0], vm = l.backward_difference ? (s[0] - s[4]) / l.period_s : s[1], xs = s[2], vs = s[3];
    const double from_environment = l.environment_stiffness_n_per_m * xs + l.environment_damping_n_s_per_m * vs;
    const double coupling = l.ideal_robot ? from_environment : k * (scale * xm - xs) + b * (scale * vm - vs);
    double to_master = 0.0;
    switch (l.architecture) {
      case Architecture::position_measured_force:
        to_master = pass(s, 5, l.force_scale * from_environment);
        break;
      case Architecture::position_position:
        to_master = l.force_scale * (scale * (k * xm + b * vm) - pass(s, 5, k * xs + b * vs));
        break;
      default:
        to_master = pass(s, 5, l.force_scale * coupling);
        break;
    }
    s[4] = xm;
    handle.move(s.head<2>(), -to_master);
    if (l.ideal_robot) {
      s[2] = scale * xm;
      s[3] = (s[2] - xs) / l.period_s;
    } else {
      robot.move(s.segment<2>(2), coupling);
    }
  });
  return moduli(a).front();
}

double critical_force_scale(BilateralLoop l) {
  return first_failure(
      [&](double scale) {
        l.force_scale = scale;
        return stable(spectral_radius(l));
      },
      1.0);
}

double critical_coupling_stiffness(BilateralLoop l) {
  const double trip = 1.0 + l.to_slave_ticks + l.to_master_ticks;
  const double scale = (l.coupling_damping_n_s_per_m + l.master_damping_n_s_per_m) / (l.period_s * trip);
  return first_failure(
      [&](double k) {
        l.coupling_stiffness_n_per_m = k;
        return stable(spectral_radius(l));
      },
      scale);
}

int critical_delay_ticks(BilateralLoop l, int most) {
  for (int d = 0; d <= most; ++d) {
    l.to_slave_ticks = l.to_master_ticks = d;
    if (!stable(spectral_radius(l))) return d - 1;
  }
  return most;
}

WaveModes wave_modes(const BilateralLoop& l, double impedance) {
  const Held handle{l.master_mass_kg, l.master_damping_n_s_per_m, l.hand_stiffness_n_per_m, l.period_s};
  const Held robot{l.robot_mass_kg, l.robot_damping_n_s_per_m + l.environment_damping_n_s_per_m,
                   l.environment_stiffness_n_per_m, l.period_s};
  const double k = l.coupling_stiffness_n_per_m, g = l.coupling_damping_n_s_per_m + k * l.period_s;
  const double root = std::sqrt(2.0 * impedance);
  const Eigen::Index trip = l.to_slave_ticks + l.to_master_ticks;
  // x_m, v_m, x_s, v_s, e, waves under way: the slave's time is shifted by d1, so that all travel back.
  const std::vector<double> all = moduli(matrix_of(5 + trip, [&](VectorXd& s) {
    const double w_m = trip > 0 ? s[5] : 0.0;
    const double f_m = impedance * s[1] - root * w_m, u = root * s[1] - w_m;
    const double f_s = (g * (root * u / impedance - s[3]) + k * s[4]) / (1.0 + g / impedance);
    const double v_sd = (root * u - f_s) / impedance;
    s[4] += l.period_s * (v_sd - s[3]);
    pass(s, 5, u - 2.0 / root * f_s);
    handle.move(s.head<2>(), -f_m);
    robot.move(s.segment<2>(2), f_s);
  }));
  return {all[0], all[1]};
}

// ---- absolute stability

double llewellyn_margin(const Immittance& p) {
  const Complex through = p.p12 * p.p21;
  return 2.0 * p.p11.real() * p.p22.real() - std::abs(through) - through.real();
}

LeastMargin least_llewellyn_margin(const std::function<Immittance(double)>& port, double low, double high,
                                   double scale) {
  const auto short_of = [&](double log_omega) {
    const Immittance p = port(std::exp(log_omega));
    return -llewellyn_margin(p) / (scale > 0.0 ? scale : std::abs(p.p12 * p.p21));
  };
  const auto [where, most] = largest(short_of, std::log(low), std::log(high), 60001);
  return {-most, std::exp(where)};
}

double llewellyn_stiffness(double bm, double bs, double to_slave_s, double to_master_s) {
  return 2.0 * std::sqrt(bm * bs) / (to_slave_s + to_master_s);
}

Immittance exchanged_stiffness(double k, double bm, double bs, double delays_s, double omega) {
  const Complex s{0.0, omega}, spring = k / s;
  // Where in the round trip the delay lies does not matter.
  return {bm + spring, -spring * std::exp(-delays_s * s), -spring, bs + spring};
}

namespace {
struct Branches {
  Complex s, handle, robot, coupling;
};
Branches branches(const BilateralLoop& l, double omega) {
  const Complex s{0.0, omega};
  return {s, l.master_mass_kg * s + l.master_damping_n_s_per_m, l.robot_mass_kg * s + l.robot_damping_n_s_per_m,
          l.coupling_damping_n_s_per_m + l.coupling_stiffness_n_per_m / s};
}
}  // namespace

Immittance position_measured_force(const BilateralLoop& l, double delay_s, double omega) {
  const auto [s, handle, robot, coupling] = branches(l, omega);
  const Complex late = std::exp(-delay_s * s);
  return {handle, l.force_scale * late, -coupling / (robot + coupling) * late, 1.0 / (robot + coupling)};
}

Immittance position_position(const BilateralLoop& l, double delay_s, double omega) {
  const auto [s, handle, robot, coupling] = branches(l, omega);
  const Complex late = std::exp(-delay_s * s);
  return {handle + coupling, -coupling * late, -coupling * late, robot + coupling};
}

Immittance wave_line(const BilateralLoop& l, double b, double delay_s, double omega) {
  const auto [s, handle, robot, coupling] = branches(l, omega);
  // A lossless line, f_m = b (coth v_m - csch v_sd), f_s = b (csch v_m - coth v_sd), its far end on the coupling:
  // f_s = C (v_sd - v_s).
  const Complex coth = 1.0 / std::tanh(delay_s * s), csch = 1.0 / std::sinh(delay_s * s);
  if (delay_s == 0.0) return position_position(l, 0.0, omega);
  const Complex end = coupling / (coupling + b * coth);  // v_sd = (b csch v_m + C v_s)/(C + b coth)
  return {handle + b * coth - b * csch * b * csch / (coupling + b * coth), -b * csch * end, -b * csch * end,
          robot + coupling - coupling * end};
}

// ---- energies

double wave_line_energy(std::span<const double> u_m, std::span<const double> w_s, int d1, int d2, double period_s) {
  double sum = 0.0;
  for (const auto& [waves, ticks] : {std::pair{u_m, d1}, std::pair{w_s, d2}})
    for (const double wave : waves.last(std::min(waves.size(), static_cast<std::size_t>(ticks)))) sum += wave * wave;
  return 0.5 * period_s * sum;
}

double spring_leak(double k, std::span<const double> x) {
  double sum = 0.0;
  for (std::size_t i = 1; i < x.size(); ++i) sum += (x[i] - x[i - 1]) * (x[i] - x[i - 1]);
  return 0.5 * k * sum;
}

double press_release_leak(double k, double period_s, double speed, double depth) {
  return k * speed * period_s * depth;
}

double sine_leak(double k, double amplitude, double ticks_per_period, int d) {
  const double theta = 2.0 * pi / ticks_per_period;
  // cos(dθ) - cos((d+1)θ) without cancellation.
  return k * amplitude * amplitude * ticks_per_period * std::sin((d + 0.5) * theta) * std::sin(0.5 * theta);
}

}  // namespace twoport::lab
