#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "common/base/low_pass.h"
#include "common/base/scalar.h"
#include "common/base/vector.h"
#include "common/passivity/controller.h"
#include "common/passivity/observer.h"
#include "common/passivity/velocity_predictor.h"

namespace twoport {

/// Norm of a wrench in newtons: a torque counts by the ratio of a translational to a rotational stiffness, K/K_r.
///
///     |f|² = |f_t|² + K/K_r |τ|²
template <int N>
[[nodiscard]] double wrench_norm(const Force<N>& f, double stiffness_ratio) noexcept {
  if constexpr (N == 6) {
    return std::sqrt(f.vec().template head<3>().squaredNorm() +
                     stiffness_ratio * f.vec().template tail<3>().squaredNorm());
  } else {
    return f.vec().norm();
  }
}

/// Predictor of a port whose mass is known (N = 6: and its inertia); empty otherwise.
template <int N>
std::optional<PortVelocityPredictor<N>> predictor_of(double mass_kg, double inertia_kg_m2) {
  if (!(mass_kg > 0.0) || (N == 6 && !(inertia_kg_m2 > 0.0))) return {};
  return PortVelocityPredictor<N>{mass_kg, inertia_kg_m2};
}

/// Limits the force at an impedance to what a spring could return that holds the energy of the port. Positive power f·v
/// enters the port.
///
///     A  = max(0, E + E(0)) - R                available energy; E: energy into the port, exact; R: reserved for a damper g beside it
///     K  = min(K_0, m/(4 T²)),  K_r likewise   no stiffer than the sampled handle, where its mass m (and inertia) is known
///     s1 = min(1, sqrt(2 K A) / |f_d|)         |f| <= sqrt(2 K A): the force of a spring K that stores A
///     s2: the largest s with T (s² fᵀCf - s (f·w - |f| ε - 2 fᵀCg)) <= A,   f = s1 f_d;   ε: VelocityPrediction::worst_power_error
///     f  = s1 s2 f_d
///
/// Without a controller law of time: outward motion under |f| = sqrt(2 K A) is exactly that of a spring K. So the force has no
/// switching, no division by the velocity and no gain. One scalar for the whole wrench: the direction is that of f_d.
///
///     E(k) >= -E(0)              for any f_d(k), whatever has arrived, been lost or is wrong, and any hand that changes its own
///                                force by no more than F_h = 20 N within two ticks (kHandForceChange_n)
///     E(k) >= -E(0) - K δ²/2     else; δ: largest motion in one tick
///     K δ²/2 <= m |δ/T|²/8       a quarter of the kinetic energy of the handle at that speed, at any T
///
/// Where the mass is not known there is no prediction. Then |f| d <= A with d = 2 T v_p, v_p = max(|Δx|/T, (1 - T/0.5 s) v_p),
/// v_p(0) = 1 m/s, and E(k) >= -E(0) where no tick moves the port by more than d.
/// N = 6: |f|² = |f_t|² + K/K_r |τ|² and |δ|² = |Δp|² + K_r/K |log ΔR|².
template <int N>
class EnergySpring {
 public:
  /// `stiffness` K_0 [N/m], `rotational_stiffness` K_r [N m/rad] of N = 6; `mass`, `inertia` of the handle, 0: not known.
  EnergySpring(Energy initial, double stiffness, double rotational_stiffness, double mass_kg, double inertia_kg_m2)
      : initial_{initial},
        stiffness_{stiffness},
        rotational_stiffness_{rotational_stiffness},
        quarter_mass_kg_{0.25 * mass_kg},
        quarter_inertia_kg_m2_{0.25 * inertia_kg_m2},
        predictor_{predictor_of<N>(mass_kg, inertia_kg_m2)} {}

  /// As PortVelocityPredictor's, before observe().
  void take_inertia(const PortInertia<N>& inertia) noexcept {
    if (predictor_) predictor_->take_inertia(inertia);
  }
  /// Books the interval that has ended: `net`, the account of the port since the start; `moved` under `applied`.
  void observe(Energy net, const Displacement<N>& moved, const Force<N>& applied, Seconds ended, Seconds dt) noexcept {
    energy_ += net - net_;
    net_ = net;
    if (predictor_) return predictor_->step(moved, applied, ended, dt);
    const double speed = ended.si() > 0.0 ? motion_norm(moved, dt) / ended.si() : 0.0;
    peak_speed_ = std::max(speed, std::max(0.0, 1.0 - dt.si() / kMemory_s) * peak_speed_);
  }
  /// As PortVelocityPredictor's.
  void take_ratio(const typename Velocity<N>::Vector& r, const Velocity<N>& v, Seconds dt) noexcept {
    if (predictor_) predictor_->take_ratio(r, v, dt);
  }
  /// The port has been another method's until now; `r`: as PortVelocityPredictor::restart.
  void take_port(const typename Velocity<N>::Vector& r) noexcept {
    peak_speed_ = kFirstSpeed_m_per_s;
    if (predictor_) predictor_->restart(r);
  }
  /// Says whether a limit at the device may turn the coming force, not only shorten it: its worst direction is expected then.
  void expect_turned(bool turned) noexcept { turned_ = turned; }
  /// Drops energy above `most`: energy put in long ago cannot be returned as a kick.
  void drop_above(Energy most) noexcept { energy_ = std::min(energy_, most); }
  /// From now on no more is available than a second account has.
  void cap(Energy available) noexcept { cap_ = available; }
  /// Starts anew with that energy; `net` as in observe.
  void restart(Energy net, Energy energy) noexcept {
    net_ = net;
    energy_ = energy;
  }

  [[nodiscard]] Energy energy() const noexcept { return energy_; }
  [[nodiscard]] Energy available() const noexcept { return positive_part(std::min(energy_ + initial_, cap_)); }
  /// Energy returned beyond E(0) too.
  [[nodiscard]] Energy undissipated() const noexcept { return positive_part(-(energy_ + initial_)); }

  /// K [N/m] and K_r [N m/rad] at the period `dt`.
  [[nodiscard]] double stiffness(Seconds dt) const noexcept { return sampled(stiffness_, quarter_mass_kg_, dt); }
  [[nodiscard]] double rotational_stiffness(Seconds dt) const noexcept {
    return sampled(rotational_stiffness_, quarter_inertia_kg_m2_, dt);
  }
  /// Energy of a spring K with the force f.
  [[nodiscard]] Energy stored(const Force<N>& f, Seconds dt) const noexcept {
    const double size = norm(f, dt), k = stiffness(dt);
    return Energy{k > 0.0 ? 0.5 * size * size / k : 0.0};
  }
  /// |f| [N]: a torque counts by K/K_r.
  [[nodiscard]] double norm(const Force<N>& f, Seconds dt) const noexcept {
    const double k_r = N == 6 ? rotational_stiffness(dt) : 0.0;
    return wrench_norm(f, k_r > 0.0 ? stiffness(dt) / k_r : 0.0);
  }
  /// |Δx| [m]: a rotation counts by K_r/K.
  [[nodiscard]] double motion_norm(const Displacement<N>& moved, Seconds dt) const noexcept {
    if constexpr (N == 6) {
      const double ratio = rotational_stiffness(dt) / stiffness(dt);
      return std::sqrt(moved.vec().template head<3>().squaredNorm() +
                       ratio * moved.vec().template tail<3>().squaredNorm());
    } else {
      return moved.vec().norm();
    }
  }
  /// d [m] of a port without a known mass: no motion of one tick is expected to be larger.
  [[nodiscard]] double reach(Seconds dt) const noexcept { return kReach * dt.si() * peak_speed_; }
  /// Scale s = s1 s2 in [0, 1] of f_d for the coming interval; `beside`: the damper's force, displayed besides s f_d.
  [[nodiscard]] double scale(const Force<N>& f_d, Seconds dt, const Force<N>& beside = {}) const noexcept {
    const double a = positive_part(available() - worst_outflow(beside, dt)).si(), size = norm(f_d, dt);
    if (size == 0.0) return 1.0;
    const double most = std::sqrt(2.0 * stiffness(dt) * a), s1 = size <= most ? 1.0 : most / size;
    if (s1 == 0.0) return 0.0;
    return s1 * feasible_part(s1 * f_d, Energy{a}, dt, beside);
  }
  /// Largest part in [0, 1] of `f` that returns no more than `budget` in the coming interval, whatever the hand does within
  /// kHandForceChange_n.
  [[nodiscard]] double feasible_part(const Force<N>& f, Energy budget, Seconds dt,
                                     const Force<N>& beside = {}) const noexcept {
    if (predictor_) return part_within(f, budget, dt, predictor_->prediction().worst_power_error(f), beside);
    const double out = norm(f, dt) * std::max(reach(dt), kLeastReach_m);
    return out > budget.si() ? budget.si() / out : 1.0;
  }
  /// The same as it is expected: with the error that the prediction has had lately; `v` serves where there is no predictor.
  [[nodiscard]] double expected_part(const Force<N>& f, const Velocity<N>& v, Energy budget,
                                     Seconds dt) const noexcept {
    if (predictor_) return part_within(f, budget, dt, predictor_->prediction().power_error_bound(f), {});
    const double out = -dot(f, v).si() * dt.si();
    return out > budget.si() ? budget.si() / out : 1.0;
  }

 private:
  [[nodiscard]] double part_within(const Force<N>& f, Energy budget, Seconds dt, double error_w,
                                   const Force<N>& beside) const noexcept {
    const VelocityPrediction<N>& port = predictor_->prediction();
    const typename Force<N>::Vector response = port.mobility * f.vec();
    const double power = power_without_response(f) - error_w - 2.0 * beside.vec().dot(response);
    return largest_feasible_scale(f.vec().dot(response), -power, budget.si() / dt.si());
  }
  [[nodiscard]] double power_without_response(const Force<N>& f) const noexcept {
    const VelocityPrediction<N>& port = predictor_->prediction();
    return turned_ ? port.least_power(f) : f.vec().dot(port.w.vec());
  }
  /// R: what `f` returns at most in the coming interval.
  [[nodiscard]] Energy worst_outflow(const Force<N>& f, Seconds dt) const noexcept {
    if (!predictor_) return Energy{norm(f, dt) * reach(dt)};
    const VelocityPrediction<N>& port = predictor_->prediction();
    const double out_w = f.vec().dot(typename Force<N>::Vector{port.mobility * f.vec()}) - power_without_response(f) +
                         port.worst_power_error(f);
    return positive_part(Energy{out_w * dt.si()});
  }
  [[nodiscard]] double sampled(double stiffness, double quarter, Seconds dt) const noexcept {
    return predictor_ ? std::min(stiffness, quarter / (dt.si() * dt.si())) : stiffness;
  }

  static constexpr double kReach = 2.0, kMemory_s = 0.5, kFirstSpeed_m_per_s = 1.0, kLeastReach_m = 1e-12;

  Energy initial_, energy_, net_, cap_{std::numeric_limits<double>::infinity()};
  double stiffness_, rotational_stiffness_, quarter_mass_kg_, quarter_inertia_kg_m2_;
  double peak_speed_ = kFirstSpeed_m_per_s;  ///< v_p
  bool turned_ = false;
  std::optional<PortVelocityPredictor<N>> predictor_;
};

/// Own account of a damper's force g = b v on the port: a held damping force is active where b is large for the mass and the
/// period, or where the hand turns back within a tick.
///
///     L += λ γ g·Δx + r T,   L <= D_0 = 10 µJ,   r = 1 µW
///     γ  = min(1, 2 L/D_0), at least 0;  expected outflow of γ g <= L,  worst outflow <= min(A, D_1 = 1 mJ);   force γ g
///
/// λ: part of the force that the device has applied; A: EnergySpring's, from which a tick's loss is paid. With L <= 0 the force is
/// zero. What the damper gives back beyond what it has taken is at most D_0 - L + r t, t the time since L was last D_0, and a tick
/// that was not expected.
template <int N>
class DamperAccount {
 public:
  void observe(const Displacement<N>& moved, double applied_part, Seconds dt) noexcept {
    level_j_ = std::min(kMost_j, level_j_ + applied_part * dot(g_, moved).si() + kRefill_w * dt.si());
  }
  /// Force for the coming interval at `port`.
  [[nodiscard]] const Force<N>& apply(const Force<N>& wanted, const Velocity<N>& v, const EnergySpring<N>& port,
                                      Seconds dt) noexcept {
    const double part = std::clamp(2.0 * level_j_ / kMost_j, 0.0, 1.0);
    if (part == 0.0) return g_ = Force<N>{};
    const Force<N> g = part * wanted, expected = port.expected_part(g, v, Energy{level_j_}, dt) * g;
    const Energy most = std::min(port.available(), Energy{kMostOfATick_j});
    return g_ = port.feasible_part(expected, most, dt) * expected;
  }
  void rest() noexcept { g_ = Force<N>{}; }

 private:
  static constexpr double kMost_j = 1e-5, kRefill_w = 1e-6, kMostOfATick_j = 1e-3;
  double level_j_ = kMost_j;  ///< L
  Force<N> g_;
};

}  // namespace twoport
