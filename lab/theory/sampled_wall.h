#pragma once

namespace twoport::lab {

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
