#pragma once

#include <algorithm>
#include <cmath>

#include "common/scene/scene.h"

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

// Textbook integrators, for the chart of error against cost. None of them detects a contact within its
// step.

/// One step of h from t of q̈ = a(t, q, q̇).
///
///     symplectic Euler   v += h a,   q += h v                                        first order
///     velocity Verlet    q += h v + h²/2 a,   v += h/2 (a + a(t + h, q, v + h a))     second
///     Runge-Kutta 4      the classical one                                            fourth
template <class Vector, class Acceleration>
void step_by(Integrator method, double h, double t, Vector& q, Vector& v, const Acceleration& a) noexcept {
  const Vector a0 = a(t, q, v);
  if (method == Integrator::symplectic_euler) {
    v += h * a0;
    q += h * v;
  } else if (method == Integrator::velocity_verlet) {
    q += h * v + (0.5 * h * h) * a0;
    const Vector end = v + h * a0;
    v += 0.5 * h * (a0 + a(t + h, q, end));
  } else {
    const Vector vb = v + 0.5 * h * a0, ab = a(t + 0.5 * h, Vector{q + 0.5 * h * v}, vb);
    const Vector vc = v + 0.5 * h * ab, ac = a(t + 0.5 * h, Vector{q + 0.5 * h * vb}, vc);
    const Vector vd = v + h * ac, ad = a(t + h, Vector{q + h * vc}, vd);
    q += h / 6.0 * (v + 2.0 * (vb + vc) + vd);
    v += h / 6.0 * (a0 + 2.0 * (ab + ac) + ad);
  }
}

/// The trapezoidal rule for an oscillator, implicit, solved: as Response, second order and stable for any h.
///
///     d = h/2 (v0 + v1),   m (v1 - v0) = h (u0 + u1 h/2 - c (v0 + v1)/2 - k d/2)
inline Response trapezoidal(const Oscillator& o, double h) {
  const double a = 0.5 * h * o.damping_n_s_per_m / o.mass_kg, b = 0.25 * h * h * o.stiffness_n_per_m / o.mass_kg;
  Response r;
  r.vv = (1.0 - a - b) / (1.0 + a + b);
  r.vu = h / o.mass_kg / (1.0 + a + b);
  r.vw = 0.5 * h * r.vu;
  r.xv = 0.5 * h * (1.0 + r.vv);
  r.xu = 0.5 * h * r.vu;
  r.xw = 0.5 * h * r.vw;
  return r;
}

}  // namespace twoport::sim
