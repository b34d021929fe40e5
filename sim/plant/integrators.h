#pragma once

#include "common/scene/scene.h"
#include "sim/plant/linear.h"

namespace twoport::sim {

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
