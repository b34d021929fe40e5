#pragma once

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <limits>

#include "common/base/scalar.h"
#include "common/base/vector.h"
#include "common/passivity/controller_options.h"
#include "common/passivity/observer.h"
#include "common/passivity/velocity_predictor.h"
#include "common/ports/port.h"

namespace twoport {

/// Energy budget of the coming interval [J].
struct Budget {
  Energy available;  ///< E - E_ref: may be returned now; negative is an accumulated deficit
  Energy rise;       ///< increase of E_ref over the coming interval
};

template <class Out>
struct Corrected {
  Out out;
  Energy dissipated;    ///< by the correction, over the coming interval, as predicted by in·out
  Energy undissipated;  ///< remaining deficit, which stays in the account
};

/// Twists and wrenches in the metric of a body's inertia, mass apart: |V|² = |v|² + ρ²|ω|², |F|² = |f|² + |τ|²/ρ², and
/// dual(V) = (v, ρ²ω), dual(F) = (f, τ/ρ²). Independent of the unit of length. N = 1, 3: the Euclidean norm.
template <class Kind, int N>
[[nodiscard]] typename Coords<Kind, N>::Vector dual_in_metric(const Coords<Kind, N>& a, double radius_m) noexcept {
  typename Coords<Kind, N>::Vector d = a.vec();
  if constexpr (N == 6) {
    const double r2 = radius_m * radius_m;
    d.template tail<3>() *= std::same_as<Coords<Kind, N>, Velocity<N>> ? r2 : 1.0 / r2;
  }
  return d;
}
template <class Kind, int N>
[[nodiscard]] double squared_norm_in_metric(const Coords<Kind, N>& a, double radius_m) noexcept {
  if constexpr (N == 6) {
    return a.vec().dot(dual_in_metric(a, radius_m));
  } else {
    return a.squared_norm();
  }
}

/// Damping of a moving mass that takes a given energy within one interval, the mass's response included:
///
///     C = (g/T) M V,   T C·(V - T M⁻¹C/2) = (g - g²/2) Vᵀ M V = D   =>   g = 1 - √(1 - 2D/(VᵀMV)),
///     g = 1 where D >= VᵀMV/2: no more than the kinetic energy. Mass not known: g = D/(VᵀMV) to first order.
///
/// `in2` is |V|² in the metric. Returns g m/T [N s/m], the factor of dual(V).
[[nodiscard]] inline double metric_damping(Energy due, double in2, double mass_kg, Seconds dt) noexcept {
  if (mass_kg <= 0.0) return due.si() / (in2 * dt.si());
  const double share = 2.0 * due.si() / (mass_kg * in2);
  const double g = share < 1.0 ? share / (1.0 + std::sqrt(1.0 - share)) : 1.0;
  return g * mass_kg / dt.si();
}

/// The force F + C, turned out of the direction of F by no more than the angle θ, in the metric of M⁻¹:
///
///     C = a F + C_t,  FᵀM⁻¹C_t = 0;   |C_t| <= (1 + a)|F| tan θ: F + C
///     else  σ(F + |F| tan θ C_t/|C_t|), with the σ in [0, 2] next to 1 that takes in what C does; none does: the best
///
/// of the energy T(σe - F)·V - T²|σe - F|²/(2m) that the interval takes in beyond F's.
template <int N>
[[nodiscard]] Force<N> within_cone(const Force<N>& wanted, const typename Force<N>::Vector& correction,
                                   const Velocity<N>& v, Energy due, const ControllerOptions& o, Seconds dt) noexcept {
  using Vector = typename Force<N>::Vector;
  const double r = o.radius_of_gyration_m, tan_most = std::tan(o.max_turn_rad);
  const auto inner = [&](const Vector& a, const Vector& b) { return a.dot(dual_in_metric(Force<N>{b}, r)); };
  const Vector& f = wanted.vec();
  const double f2 = inner(f, f);
  const double along = inner(f, correction) / f2;
  const Vector across = correction - along * f;
  const double across2 = inner(across, across), most = (1.0 + along) * std::sqrt(f2) * tan_most;
  if (along >= -1.0 && across2 <= most * most) return Force<N>{f + correction};

  Vector edge = f;
  if (across2 > 1e-24 * inner(correction, correction)) edge += std::sqrt(f2 / across2) * tan_most * across;
  const double half = o.mass_kg > 0.0 ? 0.5 * dt.si() / o.mass_kg : 0.0, need = due.si() / dt.si();
  // With x = σe - F: x·V - half |x|² = -q σ² + b σ - c
  const double q = half * inner(edge, edge), b = edge.dot(v.vec()) + 2.0 * half * inner(edge, f);
  const double c = f.dot(v.vec()) + half * f2 + need;
  const double best = q > 0.0 ? b / (2.0 * q) : std::copysign(2.0, b);
  double s = best;
  if (const double d = b * b - 4.0 * q * c; d >= 0.0) {
    // Roots enclose the feasible scales; the one next to 1, or 1.
    const double z = 0.5 * (b + std::copysign(std::sqrt(d), b));
    const double first = z != 0.0 ? c / z : 0.0, second = q > 0.0 ? z / q : best * 1e300;
    s = std::clamp(1.0, std::min(first, second), std::max(first, second));
  }
  return Force<N>{std::clamp(s, 0.0, 2.0) * edge};
}

// clang-format off
/// Time-domain passivity controller of one port, in either causality: (Out, In) = (Force, Velocity) is the impedance
/// form, gain α [N s/m]; (Velocity, Force) the admittance form, gain β [m/(N s)].
///
///     P  = out·in                                           power into the element [W]
///     D  = max(0, rise - max(available, 0) - P T)           new deficit: bounds itself, |out_PC·in| <= |P| + rise/T
///     A  = max(0, -available)                               accumulated deficit: dissipated at no more than max_gain
///
///     classic          out' = out + g·dual(in),    g = D/(T|in|²) + min(A/(T|in|²), max_gain)
///     force projected  out' = out·s,               s = 1 + (min(D, max(T |P|, G)) + min(A, G)) / (T P),   G = max_gain T P²/|out|²,   s >= 0
///     metric damping   f'   = f + C,               C takes D + min(A, max_gain T|v|²): metric_damping()
///     force cone       f'   = f + C, turned by no more than max_turn_rad: within_cone()
///
/// The second is the paper's eq. (8): with v_p = (fᵀv/|f|²) f, f + α v_p = f·(1 - E/(T fᵀv)). It is one scalar, so a
/// wrench needs no metric and no characteristic length, and the direction of out is kept exactly. Where P -> 0 a force
/// along out does no work: D/(T P) has no bound there, so that what is added for D is at most |out| again, or what max_gain
/// adds. The rest of the deficit stays in the account, as arrears, and is reported as undissipated. The last two hold there,
/// and turn the force.
/// Real time: no allocation, no throw.
template <class Out, class In>
  requires PowerDual<Out, In>
Corrected<Out> passivity_controller(Out wanted, In in, Budget budget, const ControllerOptions& options, Seconds dt) noexcept {
  // clang-format on
  constexpr double kVanishing = 1e-24;  // (1e-12 m/s)² or (1e-12 N)²: below it a direction is noise
  constexpr bool kImpedance = std::same_as<Out, Force<Out::kSize>>;
  const Power p = dot(wanted, in);
  const double accumulated_deficit = std::max(0.0, -budget.available.si());
  const double new_deficit =
      options.predict ? std::max(0.0, budget.rise.si() - std::max(budget.available.si(), 0.0) - (p * dt).si()) : 0.0;
  const double due = accumulated_deficit + new_deficit;
  if (options.method == Method::none || due == 0.0) return {wanted, Energy{}, Energy{}};

  const double radius = options.radius_of_gyration_m;
  const double max_gain = kImpedance ? options.max_gain : options.max_mobility_m_per_n_s;
  const double in2 = squared_norm_in_metric(in, radius);
  if (in2 < kVanishing) return {wanted, Energy{}, Energy{due}};

  const bool along_input = options.method != Method::force_projected;
  if (along_input) {
    const double per_gain = in2 * dt.si();
    const double repaid = std::min(accumulated_deficit, max_gain * per_gain);
    const double gain = (new_deficit + repaid) / per_gain;
    const auto direction = dual_in_metric(in, radius);
    if constexpr (kImpedance) {
      if (options.method != Method::classic) {
        const Energy to_take{new_deficit + repaid};
        const typename Out::Vector c = metric_damping(to_take, in2, options.mass_kg, dt) * direction;
        const Out out = options.method == Method::force_cone && wanted.squared_norm() > kVanishing
                            ? within_cone(wanted, c, in, to_take, options, dt)
                            : Out{wanted.vec() + c};
        const Energy taken = dot(Out{out.vec() - wanted.vec()}, in) * dt;
        return {out, taken, positive_part(Energy{due} - positive_part(taken))};
      }
    }
    return {Out{wanted.vec() + gain * direction}, Energy{new_deficit + repaid}, Energy{accumulated_deficit - repaid}};
  }

  const double out2 = squared_norm_in_metric(wanted, radius);
  if (out2 < kVanishing) return {wanted, Energy{}, Energy{due}};
  if (p.si() * p.si() < 1e-20 * in2 * out2) return {wanted, Energy{}, Energy{due}};
  const double most = max_gain * dt.si() * p.si() * p.si() / out2;
  const double taken = std::min(new_deficit, std::max(dt.si() * std::abs(p.si()), most));
  const double repaid = std::min(accumulated_deficit, most);
  double s = 1.0 + (taken + repaid) / (dt.si() * p.si());
  if (options.unilateral) s = std::max(s, 0.0);
  const Energy dissipated{(s - 1.0) * p.si() * dt.si()};
  return {s * wanted, dissipated, positive_part(Energy{due} - dissipated)};
}

/// Largest scale s in [0, 1] of a force within an energy budget, the port's response to the force included: q s² + b s
/// <= a, q >= 0; if a < 0 cannot be reached, the s that minimises q s² + b s. Roots are computed without cancellation.
inline double largest_feasible_scale(double q, double b, double a) noexcept {
  if (q + b <= a) return 1.0;
  const double root = std::sqrt(std::max(0.0, b * b + 4.0 * q * a));
  const double s = b <= 0.0 ? (root - b) / (2.0 * q) : 2.0 * a / (root + b);
  return std::clamp(s, 0.0, 1.0);
}

/// Force-projected controller at an impedance, with the response of the handle to the force within the interval.
///
///     Δx/T = w - s C f                          C = T/(2m) per axis
///     P = f·w - |f| error_bound,  Q = fᵀC f     power in is at least s (P - s Q)
///     s = largest_feasible_scale(Q, -P, (max(available, 0) - R)/T),   R = min(max(-available, 0), max_gain T P²/|f|²) where P > 0
///
/// A large force on a light handle reverses its velocity within one tick; f·v alone does not predict the outflow of that
/// tick, and the controller would switch between full and zero force. In equilibrium with a hand w = C f and s = 1: a held
/// force does no work and is not reduced. An accumulated deficit is dissipated from the inflowing power, no faster
/// than a damping of max_gain. The force never exceeds the wanted force. `turned`: a limit at the device may turn the force, P is the least
/// of any direction.
template <int N>
inline Corrected<Force<N>> predictive_impedance_controller(const Force<N>& wanted, const VelocityPrediction<N>& port,
                                                           Energy available, const ControllerOptions& options,
                                                           Seconds dt, bool turned = false) noexcept {
  const auto& f = wanted.vec();
  const double accumulated_deficit = std::max(0.0, -available.si());
  if (f.squaredNorm() == 0.0) return {wanted, Energy{}, Energy{accumulated_deficit}};
  const double predicted = turned ? port.least_power(wanted) : f.dot(port.w.vec());
  const double p = predicted - port.power_error_bound(wanted);
  const double q = f.dot(typename Force<N>::Vector{port.mobility * f});
  const double repaid =
      accumulated_deficit > 0.0 && p > 0.0
          ? std::min(accumulated_deficit,
                     options.max_gain * dt.si() * p * p / squared_norm_in_metric(wanted, options.radius_of_gyration_m))
          : 0.0;
  const double s = largest_feasible_scale(q, -p, (std::max(available.si(), 0.0) - repaid) / dt.si());
  const auto taken_in = [&](double power, double scale) { return scale * (power - scale * q) * dt.si(); };
  const Energy undissipated{accumulated_deficit - std::clamp(taken_in(p, s), 0.0, accumulated_deficit)};
  const Energy dissipated{std::max(0.0, taken_in(predicted, s) - taken_in(predicted, 1.0))};
  return {s * wanted, dissipated, undissipated};
}

/// Force and motion of a virtual coupling's port that satisfy the coupling's law and the energy budget.
template <int N>
struct PortSolution {
  Force<N> f;     ///< s·f_d
  Velocity<N> v;  ///< v_d - (1 - s) G⁻¹ f_d
  Energy dissipated;
};

/// Admittance passivity controller acting as the virtual coupling: force in, velocity out, where the force responds to the
/// velocity in the same tick, f = f_0 + G v with G = B + K T (spring and damper of one sampling interval).
///
///     v = v_d - β f   and   f = f_0 + G v     =>     f = s f_d,  v = v_d - (1 - s) G⁻¹ f_d,   s = 1/(1 + G β)
///     T f·v <= A      =>     Q s² + (P - Q) s = A/T,   P = f_d·v_d,  Q = f_dᵀ G⁻¹ f_d,   A = max(available, 0)
///
/// f_d is the force for the wanted motion v_d. Solved for both at once, the controller does not chatter against the
/// damper, the force keeps its direction, and G is the metric that makes newtons and newton-metres comparable.
/// Outflow is bounded exactly: f·v T <= A. Without available energy f·v = 0: the coupling slides in the plane normal to
/// the force, or its force is zero.
/// Real time: two dot products, one square root; no allocation, no throw.
template <int N>
inline PortSolution<N> admittance_controller(const Force<N>& f_d, const Velocity<N>& v_d,
                                             const typename Force<N>::Vector& mobility, Energy available,
                                             Seconds dt) noexcept {
  const double a = std::max(available.si(), 0.0) / dt.si();
  const double p = f_d.vec().dot(v_d.vec());
  if (p <= a) return {f_d, v_d, Energy{}};
  const typename Force<N>::Vector give = mobility.cwiseProduct(f_d.vec());
  const double q = f_d.vec().dot(give);
  if (q < 1e-300) return {f_d, v_d, Energy{}};
  const double s = largest_feasible_scale(q, p - q, a);
  Force<N> f = s * f_d;
  Velocity<N> v{v_d.vec() - (1.0 - s) * give};
  return {f, v, Energy{(p - f.vec().dot(v.vec())) * dt.si()}};
}

}  // namespace twoport
