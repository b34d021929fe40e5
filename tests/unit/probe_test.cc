#include "tools/device/probe.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "common/scene/load.h"
#include "drivers/drivers.h"
#include "tests/support/folder.h"

namespace twoport::probe_test {
namespace {

/// The simulated device in virtual time.
struct Simulated {
  explicit Simulated(const std::string& device, double rate_hz = 2000.0)
      : scene{parse_scene("name: \"probe\" dof: 1 rate_hz: " + std::to_string(rate_hz) + " device { " + device +
                              " } control { architecture: RENDER passivity { method: NONE } }",
                          "probe", {}, SceneFor::live)},
        period{1.0 / rate_hz},
        hardware{all_drivers().devices.open<1>("sim", scene, Seconds{period})} {
    hardware->sense({Instant<MasterClock>{Duration{0}}, Seconds{period}});
    hardware->start();
  }
  ProbeRunner runner() {
    return [this](const ProbePhase& step) {
      for (;;) {
        const Duration now = tick_time(++k, 1.0 / period);
        const DeviceSample<1> s = hardware->sense({Instant<MasterClock>{now}, Seconds{period}});
        const auto push = step({to_seconds(now).si(), s.x.translation()[0], s.v[0], -s.applied[0], s.status});
        hardware->actuate(Force<1>{Force<1>::Vector{push ? -*push : 0.0}});
        if (!push) return;
      }
    };
  }
  Scene scene;
  double period;
  std::unique_ptr<Device<1>> hardware;
  long k = 0;
};

TEST(Probe, FindsMassDampingAndFriction) {
  for (const double friction : {0.0, 0.15}) {
    Simulated sim{"mass_kg: 0.075 damping_n_s_per_m: 0.5 coulomb_friction_n: " + std::to_string(friction)};
    Probe probe{sim.runner(), {.period_s = sim.period, .most_speed_m_per_s = 10.0, .most_way_m = 1.0}};
    probe.push();
    const ProbeFigures& f = probe.figures();
    EXPECT_EQ(f.broken_off, "");
    // Central differences over 10 ms are wrong by (5 ms b/m)²/6 = 2e-4 of v.
    EXPECT_NEAR(f.mass_kg, 0.075, 2e-4 * 0.075);
    EXPECT_NEAR(f.damping_n_s_per_m, 0.5, 2e-3 * 0.5);
    EXPECT_NEAR(f.coulomb_friction_n, friction, 1e-3);
    EXPECT_GT(f.fit, 0.999999);
    EXPECT_DOUBLE_EQ(f.latency_s, sim.period);  // the first reading after the push has moved
    EXPECT_EQ(f.resolution_m, 0.0);
  }
}

TEST(Probe, SeesTheStepsOfAnEncoder) {
  Simulated sim{"mass_kg: 0.075 damping_n_s_per_m: 0.5 position_resolution_m: 2e-5 velocity_estimate: FILTERED"};
  Probe probe{sim.runner(), {.period_s = sim.period, .most_speed_m_per_s = 10.0, .most_way_m = 1.0}};
  probe.push();
  EXPECT_NEAR(probe.figures().resolution_m, 2e-5, 1e-12);
  // A step of 20 um is 2 mm/s over 10 ms, 0.3 % of the largest velocity: some percent of the friction's small impulses.
  EXPECT_NEAR(probe.figures().mass_kg, 0.075, 0.02 * 0.075);
  EXPECT_NEAR(probe.figures().damping_n_s_per_m, 0.5, 0.1 * 0.5);
}

TEST(Probe, FindsNoNegativeFrictionNorDamping) {
  // Coarse encoders and little friction: noise decides the sign of what is not there.
  for (const char* resolution : {"1e-5", "2e-5", "3e-5", "5e-5", "1e-4"})
    for (const char* damping : {"0", "0.05", "0.5"}) {
      Simulated sim{std::string{"mass_kg: 0.075 velocity_estimate: FILTERED position_resolution_m: "} + resolution +
                    " damping_n_s_per_m: " + damping};
      Probe probe{sim.runner(), {.period_s = sim.period, .most_speed_m_per_s = 10.0, .most_way_m = 1.0}};
      probe.push();
      EXPECT_GE(probe.figures().coulomb_friction_n, 0.0) << resolution << " " << damping;
      EXPECT_GE(probe.figures().damping_n_s_per_m, 0.0) << resolution << " " << damping;
      // 5 % at 20 um, and so on with the step.
      EXPECT_NEAR(probe.figures().mass_kg, 0.075, 2500.0 * std::stod(resolution) * 0.075)
          << resolution << " " << damping;
    }
}

TEST(Probe, CountsReadingsInTimeAndNotInTicks) {
  // A loop at 1 kHz that comes round every third millisecond, and a device with something new every second time.
  const ProbeRunner slow = [](const ProbePhase& step) {
    for (int k = 0;; ++k)
      if (!step({3e-3 * k, 0.0, 0.0, 0.0, k % 2 == 0 ? HardwareStatus::ok : HardwareStatus::stale})) return;
  };
  Probe probe{slow, {.period_s = 1e-3}};
  probe.listen();
  EXPECT_NEAR(probe.figures().rate_hz, 1000.0 / 6.0, 1e-6);
  const ProbeRunner silent = [](const ProbePhase& step) {
    for (int k = 0; step({1e-3 * k, 0.0, 0.0, 0.0, HardwareStatus::stale}); ++k) {
    }
  };
  Probe none{silent, {.period_s = 1e-3}};
  none.listen();
  EXPECT_EQ(none.figures().rate_hz, 0.0);
}

/// Stiffest sampled spring without damping on a mass m with damping b: poles of
///
///     z² - (1 + a - K p/…) …  of the exact map of m x'' = -b x' - K x(k), force held over T
///
/// x(k+1) = x + (1-a)/c v - K h x/m, v(k+1) = a v - K (1-a)/b x; c = b/m, a = e^-cT, h = (T - (1-a)/c)/c. Largest K whose poles are
/// inside the unit circle: product of the poles a (1 - K h/m) + K (1-a)²/(b c) < 1.
double boundary(double m, double b, double T) {
  const double c = b / m, a = std::exp(-c * T), h = (T - (1.0 - a) / c) / c;
  return (1.0 - a) / ((1.0 - a) * (1.0 - a) / (b * c) - a * h / m);
}

TEST(Probe, FindsTheStiffestWallThatTheoryHas) {
  // c T << 1: 2 b/T, the limit of Colgate and Brown without a hand.
  EXPECT_NEAR(boundary(0.075, 0.5, 0.5e-3), 2000.0, 4.0);
  struct Case {
    double mass, damping, rate_hz;
  };
  for (const Case& c :
       {Case{0.075, 0.5, 2000.0}, Case{0.075, 0.5, 1000.0}, Case{0.2, 1.5, 1000.0}, Case{0.05, 0.2, 1000.0}}) {
    Simulated sim{
        "mass_kg: " + std::to_string(c.mass) + " damping_n_s_per_m: " + std::to_string(c.damping) + " max_force_n: 8",
        c.rate_hz};
    Probe probe{sim.runner(),
                {.period_s = sim.period,
                 .trial_s = 4.0,
                 .most_speed_m_per_s = 10.0,
                 .most_way_m = 1.0,
                 .wall_tolerance = 0.01}};
    probe.push();
    probe.wall();
    const double theory = boundary(c.mass, c.damping, sim.period);
    // Bisected to 1 % from below; a trial tells walls apart that differ by a fraction of that.
    EXPECT_NEAR(probe.figures().wall_n_per_m, theory, 0.015 * theory);
    EXPECT_FALSE(probe.figures().wall_is_bound);
  }
}

TEST(Probe, BreaksOffWhatGoesTooFar) {
  Simulated sim{"mass_kg: 0.075 damping_n_s_per_m: 0.5"};
  Probe probe{sim.runner(), {.period_s = sim.period, .push_n = 400.0}};
  probe.push();  // with 400 N, 100 N and 25 N: all too much
  EXPECT_EQ(probe.figures().broken_off, "it was faster than allowed");
  probe.wall();
  EXPECT_TRUE(std::isnan(probe.figures().wall_n_per_m));
  Probe careful{sim.runner(), {.period_s = sim.period, .push_n = 20.0}};
  careful.push();  // with 20 N, 5 N, and 1.25 N, which does
  EXPECT_EQ(careful.figures().broken_off, "");
  EXPECT_NEAR(careful.figures().mass_kg, 0.075, 2e-4 * 0.075);
}

}  // namespace
}  // namespace twoport::probe_test
