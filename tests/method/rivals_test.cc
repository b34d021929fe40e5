// What each method claims, against a closed form or a bound.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "common/method/any.h"
#include "common/method/catalogue.h"
#include "common/scene/load.h"
#include "lab/engine/loops.h"
#include "lab/run.h"
#include "tests/support/two_sides.h"

namespace twoport {
namespace {

using test::DelayLines;
using test::TwoSides;

template <int N>
class Loop : DelayLines<N>, public TwoSides<N> {
 public:
  explicit Loop(const Scene& scene)
      : DelayLines<N>{scene}, TwoSides<N>{scene, this->master_end(), this->slave_end()}, rate_hz_{scene.rate_hz} {}
  typename MasterNode<N>::Output tick() noexcept {
    const Duration now = tick_time(k_++, rate_hz_);
    slave_out = this->slave_tick(now);
    return this->master_tick(now);
  }
  typename SlaveNode<N>::Output slave_out;

 private:
  double rate_hz_;
  std::int64_t k_ = 0;
};

// ---- fixed damping

/// Growth of the swing of two free masses against each other, in 20 s [1/s].
double growth(double damping_n_s_per_m) {
  Scene scene = parse_scene(
      "dof: 1 duration_s: 100 rate_hz: 1000 device { mass_kg: 20 velocity_m_per_s: 0.1 } robot { mass_kg: 20 "
      "velocity_m_per_s: "
      "-0.1 } to_slave { delay_ms: 10 } to_master { delay_ms: 10 } control { passivity { method: FIXED_DAMPING "
      "fixed_damping { "
      "stiffness_n_per_m: 400 damping_n_s_per_m: " +
          std::to_string(damping_n_s_per_m) + " } } }",
      "two masses");
  Loop<1> loop{scene};
  const auto swing = [&](int ticks) {
    double largest = 0.0;
    for (int k = 0; k < ticks; ++k) {
      loop.tick();
      largest = std::max(largest, std::abs(loop.device.v()[0] - loop.robot.state().v[0]));
    }
    return largest;
  };
  swing(10000);
  const double before = swing(2000);
  swing(18000);
  return std::log(swing(2000) / before) / 20.0;
}

// Antisymmetric motion of two masses m: m x'' + B x' + K (x(t - T/2) + x(t - D - T/2)) = 0, T = 1 ms, D = 10 ms. At the
// boundary B = K (sin(w T/2) + sin(w (D + T/2)))/w, w² = 2K/m to 0.1 %; sin x = x to 0.2 %: K R/2 with R = 2D + 2T.
TEST(FixedDamping, BoundaryIsHalfStiffnessTimesRoundTrip) {
  const double rule = 0.5 * 400.0 * 0.022;
  const double slope = -0.5 / 20.0;  // of the growth over B: -1/(2m)
  const double below = growth(0.95 * rule), above = growth(1.05 * rule);
  EXPECT_GT(below, 0.0);
  EXPECT_LT(above, 0.0);
  EXPECT_NEAR(below - above, -slope * 0.1 * rule, 0.05 * std::abs(slope) * 0.1 * rule);
  // Zero between them: at the rule within 1 %, for the approximations above and the held damper, B T/(2m).
  const double zero = 0.95 * rule + 0.1 * rule * below / (below - above);
  EXPECT_NEAR(zero / rule, 1.0, 0.01);
}

TEST(FixedDamping, RuleKeepsTheBound) {
  for (const double delay_s : {0.0, 0.01, 0.1, 1.0}) {
    ControlOptions o;
    o.known.round_trip = Seconds{delay_s};
    o.known.master_tick = o.known.slave_tick = Seconds{1e-3};
    const double r = delay_s + 2e-3;
    const auto holds = [&] {
      const FixedDampingGains g = fixed_damping_gains(o);
      return g.damping_n_s_per_m >= 0.5 * g.stiffness_n_per_m * r * (1.0 - 1e-12) &&
             g.rotational_damping_n_m_s_per_rad >= 0.5 * g.rotational_stiffness_n_m_per_rad * r * (1.0 - 1e-12);
    };
    EXPECT_TRUE(holds());
    o.fixed_damping.damping_n_s_per_m = 3.0;
    EXPECT_TRUE(holds());
    o.fixed_damping = {};
    o.fixed_damping.stiffness_n_per_m = 5000.0;
    o.fixed_damping.rotational_stiffness_n_m_per_rad = 50.0;
    EXPECT_TRUE(holds());
  }
}

}  // namespace
}  // namespace twoport
