#pragma once

#include <algorithm>
#include <cmath>
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

/// How far a tick may move a port: `times` the largest motion of a tick in the last `memory_s` or so.
struct Reach {
  double times = 2.0, memory_s = 0.5;
};

/// Limits the force at an impedance to what a spring could return that holds the energy of the port. Positive power f·v
/// enters the port.
///
///     A  = max(0, E + E(0))                      available energy; E: energy into the port, exact
///     K  = min(K_0, m/(4 T²)),  K_r likewise   no stiffer than the sampled handle, where its mass m (and inertia) is known
///     d  = c T v_p,   v_p = max(|Δx|/T, (1 - T/τ) v_p),   c = 2,  τ = 0.5 s (Reach),  v_p(0) = 1 m/s
///     s1 = min(1, sqrt(2 K A) / |f_d|, A / (d |f_d|))   |f| <= sqrt(2 K A): the force of a spring K that stores A;  |f| d <= A
///     s2 = largest_feasible_scale                predicted outflow <= A, see predictive_impedance_controller; without a known
///                                                mass T s1 f_d·(-v) s2 <= A
///     f  = s1 s2 f_d
///
/// Without a controller law of time: outward motion under |f| = sqrt(2 K A) is exactly that of a spring K. So the force has no
/// switching, no division by the velocity and no gain. One scalar for the whole wrench: the direction is that of f_d.
///
///     E(k) >= -E(0)              where every tick moves the port by no more than d, or as s2 predicts
///     E(k) >= -E(0) - K δ²/2     else; δ: largest motion in one tick
///     K δ²/2 <= m |δ/T|²/8       where the mass is known: a quarter of the kinetic energy of the handle at that speed, at any T
///
/// for any f_d(k), whatever has arrived, been lost or is wrong. N = 6: |f|² = |f_t|² + K/K_r |τ|² and |δ|² = |Δp|² + K_r/K |log ΔR|².
template <int N>
class EnergySpring {
 public:
  /// `stiffness` K_0 [N/m], `rotational_stiffness` K_r [N m/rad] of N = 6; `mass`, `inertia` of the handle, 0: not known.
  EnergySpring(Energy initial, double stiffness, double rotational_stiffness, double mass_kg, double inertia_kg_m2,
               Reach reach = {})
      : reach_{reach},
        initial_{initial},
        stiffness_{stiffness},
        rotational_stiffness_{rotational_stiffness},
        quarter_mass_kg_{0.25 * mass_kg},
        quarter_inertia_kg_m2_{0.25 * inertia_kg_m2},
        predictor_{predictor_of<N>(mass_kg, inertia_kg_m2)} {}

  /// Books the interval that has ended: `net`, the account of the port since the start; `moved` under `applied`.
  void observe(Energy net, const Displacement<N>& moved, const Force<N>& applied, Seconds ended, Seconds dt) noexcept {
    energy_ += net - net_;
    net_ = net;
    const double speed = ended.si() > 0.0 ? motion_norm(moved, dt) / ended.si() : 0.0;
    peak_speed_ = std::max(speed, std::max(0.0, 1.0 - dt.si() / reach_.memory_s) * peak_speed_);
    if (predictor_) predictor_->step(moved, applied, ended, dt);
  }
  /// Drops energy above `most`: energy put in long ago cannot be returned as a kick.
  void drop_above(Energy most) noexcept { energy_ = std::min(energy_, most); }
  /// Passes energy on to another account.
  void take(Energy e) noexcept { energy_ -= e; }
  /// What another force of the port may lose in the coming interval: the spring leaves it alone.
  void reserve(Energy e) noexcept { reserved_ = e; }
  /// Starts anew with a deficit; `net` as in observe.
  void restart(Energy net, Energy deficit) noexcept {
    net_ = net;
    energy_ = -deficit;
  }

  [[nodiscard]] Energy energy() const noexcept { return energy_; }
  [[nodiscard]] Energy available() const noexcept { return positive_part(energy_ + initial_); }
  /// Energy returned beyond what has been put in.
  [[nodiscard]] Energy deficit() const noexcept { return positive_part(-energy_); }
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
  /// d [m]: no motion of one tick is expected to be larger.
  [[nodiscard]] double reach(Seconds dt) const noexcept { return reach_.times * dt.si() * peak_speed_; }
  /// Scale s = s1 s2 in [0, 1] of f_d for the coming interval; `v`: velocity of the port; `beside`: what is displayed besides s f_d
  /// and has an account of its own.
  [[nodiscard]] double scale(const Force<N>& f_d, const Velocity<N>& v, Seconds dt,
                             const Force<N>& beside = {}) const noexcept {
    const double a = positive_part(available() - reserved_).si(), size = norm(f_d, dt);
    if (size == 0.0) return 1.0;
    const double most = std::min(std::sqrt(2.0 * stiffness(dt) * a), a / std::max(reach(dt), kLeastReach_m));
    const double s1 = size <= most ? 1.0 : most / size;
    if (s1 == 0.0) return 0.0;
    return s1 * feasible_part(s1 * f_d, v, Energy{a}, dt, beside);
  }
  /// Largest part in [0, 1] of `f` that returns no more than `budget` in the coming interval, as predicted; `v` serves where there
  /// is no predictor.
  [[nodiscard]] double feasible_part(const Force<N>& f, const Velocity<N>& v, Energy budget, Seconds dt,
                                     const Force<N>& beside = {}) const noexcept {
    const double a = budget.si();
    if (predictor_) {
      const VelocityPrediction<N>& port = predictor_->prediction();
      const auto response = port.mobility.cwiseProduct(f.vec());
      const double power = f.vec().dot(port.w.vec()) - port.power_error_bound(f) - 2.0 * beside.vec().dot(response);
      return largest_feasible_scale(f.vec().dot(response), -power, a / dt.si());
    }
    const double out = -dot(f, v).si() * dt.si();
    return out > a ? a / out : 1.0;
  }

 private:
  [[nodiscard]] double sampled(double stiffness, double quarter, Seconds dt) const noexcept {
    return predictor_ ? std::min(stiffness, quarter / (dt.si() * dt.si())) : stiffness;
  }

  static constexpr double kFirstSpeed_m_per_s = 1.0, kLeastReach_m = 1e-12;

  Reach reach_;
  Energy initial_, energy_, net_, reserved_;
  double stiffness_, rotational_stiffness_, quarter_mass_kg_, quarter_inertia_kg_m2_;
  double peak_speed_ = kFirstSpeed_m_per_s;  ///< v_p
  std::optional<PortVelocityPredictor<N>> predictor_;
};

/// Own account of a damper's force g = b v on the port: a held damping force is active where b is large for the mass and the
/// period, or where the hand turns back within a tick.
///
///     L += λ γ g·Δx + r T,   L <= D_0 = 10 µJ,   r = 1 µW
///     γ  = min(1, 2 L/D_0), at least 0, γ |g| d <= D_1 = 1 mJ, and predicted outflow of γ g <= L;   force γ g
///
/// λ: part of the force that the device has applied; d: EnergySpring's. L >= -D_1 while no tick moves the port by more than d, else
/// L >= -b δ²/T: with L <= 0 the force is zero. What the damper gives back beyond what it has taken is at most D_0 - L + r t, t the
/// time since L was last D_0.
template <int N>
class DamperAccount {
 public:
  void observe(const Displacement<N>& moved, double applied_part, Seconds dt) noexcept {
    level_j_ = std::min(kMost_j, level_j_ + applied_part * dot(g_, moved).si() + kRefill_w * dt.si());
  }
  /// Force for the coming interval at `port`; `most`: what it may lose in a tick, at most D_1.
  [[nodiscard]] const Force<N>& apply(const Force<N>& wanted, const Velocity<N>& v, const EnergySpring<N>& port,
                                      Seconds dt, Energy most = Energy{kMostOfATick_j}) noexcept {
    const double part = std::clamp(2.0 * level_j_ / kMost_j, 0.0, 1.0);
    if (part == 0.0) return g_ = Force<N>{};
    const double reach_j = part * port.norm(wanted, dt) * port.reach(dt);
    const double most_j = std::min(kMostOfATick_j, most.si());
    const Force<N> g = (reach_j > most_j ? part * most_j / reach_j : part) * wanted;
    return g_ = port.feasible_part(g, v, Energy{level_j_}, dt) * g;
  }
  void rest() noexcept { g_ = Force<N>{}; }

 private:
  static constexpr double kMost_j = 1e-5, kRefill_w = 1e-6, kMostOfATick_j = 1e-3;
  double level_j_ = kMost_j;  ///< L
  Force<N> g_;
};

}  // namespace twoport
