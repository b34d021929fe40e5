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

/// Limits the force at an impedance to what a spring could return that holds the energy of the port. Positive power f·v
/// enters the port.
///
///     A  = max(0, E + E(0))                      available energy; E: energy into the port, exact
///     s1 = min(1, sqrt(2 K A) / |f_d|)           |f| <= sqrt(2 K A): the force of a spring K that stores A
///     s2 = predictive_impedance_controller       or, without a known mass, T s1 f_d·(-v) s2 <= A
///     f  = s1 s2 f_d
///
/// Without a controller law of time: outward motion under |f| = sqrt(2 K A) is exactly that of a spring K. So the force has no
/// switching, no division by the velocity and no gain. One scalar for the whole wrench: the direction is that of f_d.
///
///     E(k) >= -E(0) - K δ²/2     δ: largest motion in one tick; s2 removes the second term where its prediction holds
///
/// for any f_d(k), whatever has arrived, been lost or is wrong.
template <int N>
class EnergySpring {
 public:
  /// `stiffness` K [N/m], `rotational_stiffness` K_r [N m/rad] of N = 6; `mass`, `inertia` of the handle, 0: not known.
  EnergySpring(Energy initial, double stiffness, double rotational_stiffness, double mass_kg, double inertia_kg_m2)
      : initial_{initial},
        stiffness_{stiffness},
        ratio_{N == 6 && rotational_stiffness > 0.0 ? stiffness / rotational_stiffness : 0.0},
        predictor_{predictor_of<N>(mass_kg, inertia_kg_m2)} {}

  /// Books the interval that has ended: `net`, the account of the port since the start; `moved` under `applied`.
  void observe(Energy net, const Displacement<N>& moved, const Force<N>& applied, Seconds ended, Seconds dt) noexcept {
    energy_ += net - net_;
    net_ = net;
    if (predictor_) predictor_->step(moved, applied, ended, dt);
  }
  /// Drops energy above `most`: energy put in long ago cannot be returned as a kick.
  void drop_above(Energy most) noexcept { energy_ = std::min(energy_, most); }
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
  [[nodiscard]] double norm(const Force<N>& f) const noexcept { return wrench_norm(f, ratio_); }

  /// Scale s = s1 s2 in [0, 1] of f_d for the coming interval; `v`: velocity of the port.
  [[nodiscard]] double scale(const Force<N>& f_d, const Velocity<N>& v, Seconds dt) const noexcept {
    const double a = available().si(), size = norm(f_d);
    if (size == 0.0) return 1.0;
    const double most = std::sqrt(2.0 * stiffness_ * a);
    const double s1 = size <= most ? 1.0 : most / size;
    if (s1 == 0.0) return 0.0;
    if (predictor_) {
      const Force<N> f = s1 * f_d;
      const VelocityPrediction<N>& port = predictor_->prediction();
      const double power = f.vec().dot(port.w.vec()) - port.power_error_bound(f);
      const double response = f.vec().dot(port.mobility.cwiseProduct(f.vec()));
      return s1 * largest_feasible_scale(response, -power, a / dt.si());
    }
    const double out = -s1 * dot(f_d, v).si() * dt.si();
    return out > a ? s1 * a / out : s1;
  }

 private:
  Energy initial_, energy_, net_;
  double stiffness_, ratio_;
  std::optional<PortVelocityPredictor<N>> predictor_;
};

/// Own account of a damper's force g = b v on the port: a held damping force is active where b is large for the mass and the
/// period.
///
///     D += λ g·Δx,   D < -10 µJ:  γ /= 2, D = 0;   γ += 2e-4 in each tick, up to 1;   force γ g
///
/// λ: part of the force that the device has applied.
template <int N>
class DamperAccount {
 public:
  void observe(const Displacement<N>& moved, double applied_part) noexcept {
    account_j_ += applied_part * dot(g_, moved).si();
    gain_ = std::min(1.0, gain_ + kRise);
    if (account_j_ >= -kDeficit_j) return;
    gain_ *= 0.5;
    account_j_ = 0.0;
  }
  /// Force for the coming interval.
  [[nodiscard]] const Force<N>& apply(const Force<N>& wanted) noexcept { return g_ = gain_ * wanted; }
  void rest() noexcept { g_ = Force<N>{}; }

 private:
  static constexpr double kDeficit_j = 1e-5, kRise = 2e-4;
  double account_j_ = 0.0, gain_ = 1.0;
  Force<N> g_;
};

}  // namespace twoport
