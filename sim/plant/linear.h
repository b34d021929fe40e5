#pragma once

#include <algorithm>
#include <cmath>

namespace twoport::sim {

/// One axis of a mass with a spring and a damper under a force that is linear in time:
///
///     m ẍ = u0 + u1 s - c ẋ - k x
struct Oscillator {
  double mass_kg, damping_n_s_per_m, stiffness_n_per_m;
};
struct AxisState {
  double x, v;
};

/// State after h seconds: the Taylor series of the exact solution, in pieces short enough that it converges to
/// rounding (relative error below 1e-15 for any damping and stiffness).
inline AxisState propagate(const Oscillator& o, AxisState s, double u0, double u1, double h) {
  const double rate = std::max(o.damping_n_s_per_m / o.mass_kg, std::sqrt(std::abs(o.stiffness_n_per_m) / o.mass_kg));
  const int pieces = std::max(1, static_cast<int>(std::ceil(rate * std::abs(h))));
  const double d = h / pieces;
  for (int i = 0; i < pieces; ++i) {
    // a_j = x^(j) d^j / j!, from the equation of motion differentiated j times.
    double a0 = s.x, a1 = s.v * d;
    double force = u0, slope = u1;
    double x = a0 + a1, v = a1;
    for (int j = 2; j < 40; ++j) {
      const double c = o.damping_n_s_per_m * a1 * d / (o.mass_kg * j);
      const double k = o.stiffness_n_per_m * a0 * d * d / (o.mass_kg * j * (j - 1));
      const double u = force * d * d / (o.mass_kg * j * (j - 1));
      const double a2 = u - c - k;
      force = j == 2 ? slope * d : 0.0;
      slope = 0.0;
      x += a2;
      v += j * a2;
      a0 = a1;
      a1 = a2;
      if (j > 4 && std::abs(a2) + std::abs(a0) < 1e-19 * (std::abs(x) + std::abs(v))) break;
    }
    s = {x, v / d};
    u0 += u1 * d;
  }
  return s;
}

/// The same map for one fixed h, as six numbers: exact, and one multiply-add each.
///
///     x(h) - x0 = xv v0 + xu u0 + xw u1      v(h) = vv v0 + vu u0 + vw u1      with -k x0 in u0
struct Response {
  double xv, xu, xw;  ///< displacement per v0, u0, u1
  double vv, vu, vw;  ///< velocity per v0, u0, u1

  Response() = default;
  Response(const Oscillator& o, double h) {
    const AxisState v = propagate(o, {0, 1}, 0, 0, h), u = propagate(o, {0, 0}, 1, 0, h),
                    w = propagate(o, {0, 0}, 0, 1, h);
    xv = v.x, vv = v.v, xu = u.x, vu = u.v, xw = w.x, vw = w.v;
  }
};

}  // namespace twoport::sim
