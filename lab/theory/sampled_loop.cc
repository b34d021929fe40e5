#include "lab/theory/sampled_loop.h"

namespace twoport::lab {

double spectral_radius(const SampledWall& w) {
  const auto plant = [&](double h) {
    return w.euler_substeps > 0
               ? Held::euler(w.mass_kg, w.damping_n_s_per_m, w.hand_stiffness_n_per_m, h, w.euler_substeps)
               : Held{w.mass_kg, w.damping_n_s_per_m, w.hand_stiffness_n_per_m, h};
  };
  const double g = w.delay_fraction;
  const Held early = plant(g * w.period_s), late = plant((1.0 - g) * w.period_s);
  const Eigen::Index queue = w.delay_ticks + (g > 0.0 ? 1 : 0);
  // x, ẋ, x of the last tick, forces under way
  const Eigen::MatrixXd a = matrix_of(3 + queue, [&](Eigen::VectorXd& s) {
    const double v = w.true_velocity ? s[1] : (s[0] - s[2]) / w.period_s;
    const double force = w.stiffness_n_per_m * s[0] + w.wall_damping_n_s_per_m * v;
    s[2] = s[0];
    const double first = pass(s, 3, force);
    const double then = g > 0.0 ? (w.delay_ticks > 0 ? s[3] : force) : first;
    if (g > 0.0) early.move(s.head<2>(), -first);
    late.move(s.head<2>(), -then);
  });
  return moduli(a).front();
}

double critical_stiffness(SampledWall w) {
  const double late = w.delay_ticks + w.delay_fraction;
  const double rule =
      linear_rule_stiffness(w.damping_n_s_per_m, w.wall_damping_n_s_per_m, w.period_s, 0) / (1.0 + 2.0 * late);
  if (!(rule > 0.0)) return 0.0;
  return first_failure(
      [&](double k) {
        w.stiffness_n_per_m = k;
        return stable(spectral_radius(w));
      },
      rule);
}

double linear_rule_stiffness(double b, double wall_b, double period_s, double d) {
  return (b + wall_b) / (period_s * (0.5 + d));
}

}  // namespace twoport::lab
