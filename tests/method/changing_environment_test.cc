// The environment's stiffness is changed while the robot presses it: what the hand gets back.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "common/scene/load.h"
#include "tests/support/two_sides.h"

namespace twoport::changing_environment_test {
namespace {

constexpr double kRateHz = 1000.0, kInitialEnergy = 0.01;  // [Hz], [J]

/// A hand presses a wall of 500 N/m over `delay_ms` each way.
Scene pressing(const std::string& method, double delay_ms) {
  return parse_scene(
      "dof: 1 duration_s: 100 rate_hz: 1000 seed: 3 "
      "operator { hand { mass_kg: 0.2 stiffness_n_per_m: 400 damping_n_s_per_m: 8 } "
      "path { move_to { position_m: [0.04] duration_s: 0.5 } } path { hold { duration_s: 100 } } } "
      "device { mass_kg: 0.1 damping_n_s_per_m: 0.2 max_force_n: 8 } "
      "control { architecture: POSITION_FORCE virtual_coupling { stiffness_n_per_m: 1000 damping_n_s_per_m: 20 } "
      "passivity { method: " +
          method + " initial_energy_j: " + std::to_string(kInitialEnergy) +
          " } } robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { } } "
          "environment { wall { normal: [-1] offset_m: -0.01 stiffness_n_per_m: 500 } } "
          "to_slave { delay_ms: " +
          std::to_string(delay_ms) + " } to_master { delay_ms: " + std::to_string(delay_ms) + " }",
      "pressing");
}

struct Seen {
  double least_j = 0.0;                          ///< of the hand's port
  double least_with_work_j = 0.0;                ///< of the hand's port and the work of the changes together
  double work_j = 0.0;                           ///< of all changes
  double put_in_j = 0.0;                         ///< of those that put energy in
  double felt_soft_n = 0.0, felt_stiff_n = 0.0;  ///< before the first change, and a second after
};

/// Twenty times 500 to 5000 N/m and back, each within 0.1 s, as the page's sliders do.
Seen change_stiffness(const std::string& method, double delay_ms) {
  const Scene scene = pressing(method, delay_ms);
  test::TwoSides<1> sides{scene};
  Seen seen;
  for (int k = 0; k < 22'000; ++k) {
    const int within = k % 1000;
    const bool stiffens = k / 1000 % 2 == 0;
    if (k >= 2000 && within < 100) {
      const double share = (within + 1) / 100.0;
      const double work =
          sides.robot.set_surface(0, stiffens ? 500.0 + share * 4500.0 : 5000.0 - share * 4500.0, 0.0).si();
      seen.work_j += work;
      seen.put_in_j += std::max(0.0, work);
    }
    const Duration now = tick_time(k, kRateHz);
    sides.slave_tick(now);
    const auto out = sides.master_tick(now);
    const double hand = sides.device.port_energy().si();
    seen.least_j = std::min(seen.least_j, hand);
    seen.least_with_work_j = std::min(seen.least_with_work_j, hand + seen.work_j);
    if (k == 1999) seen.felt_soft_n = std::abs(out.command[0]);
    if (k == 2999) seen.felt_stiff_n = std::abs(out.command[0]);
  }
  return seen;
}

// What leaves at the hand is what the hand has put in, E(0), and what the changes have put in, which any passive link may pass on: robot and
// environment give no more than that. 1 mJ: what FORCE_PROJECTED repays later.
TEST(ChangingEnvironment, TheHandGetsNoMoreThanItAndTheChangesHavePutIn) {
  for (const char* method : {"INTERNAL_MODEL", "FORCE_PROJECTED", "ENERGY_TANK"})
    for (const double delay_ms : {2.0, 25.0}) {
      SCOPED_TRACE(std::string{method} + ", " + std::to_string(delay_ms) + " ms");
      const Seen seen = change_stiffness(method, delay_ms);
      EXPECT_GT(seen.put_in_j, 0.05) << "the changes are large";
      EXPECT_GE(seen.least_with_work_j, -kInitialEnergy - 1e-3);
      std::printf("[          ] %s %.0f ms: least %.3f mJ, with the work %.3f mJ, put in %.1f mJ, net %.1f mJ\n",
                  method, delay_ms, 1e3 * seen.least_j, 1e3 * seen.least_with_work_j, 1e3 * seen.put_in_j,
                  1e3 * seen.work_j);
    }
}

// INTERNAL_MODEL bounds the hand's energy by itself: it passes on nothing of the work. 1 nJ: rounding.
TEST(ChangingEnvironment, InternalModelKeepsTheWorkFromTheHand) {
  for (const double delay_ms : {2.0, 25.0})
    EXPECT_GE(change_stiffness("INTERNAL_MODEL", delay_ms).least_j, -kInitialEnergy - 1e-9) << delay_ms << " ms";
}

// In a rest the hand feels the springs of hand, coupling and wall in series: 30 mm into the wall; the stiff wall is felt as more by 15 % at least.
TEST(ChangingEnvironment, IsFelt) {
  const Seen seen = change_stiffness("INTERNAL_MODEL", 2.0);
  const auto series = [](double wall) { return 0.03 / (1.0 / 400.0 + 1.0 / wall); };
  EXPECT_GT(seen.felt_soft_n, 2.0);
  EXPECT_GT(seen.felt_stiff_n, 1.15 * seen.felt_soft_n);
  EXPECT_LT(seen.felt_stiff_n, 1.15 * series(5000.0));
}

}  // namespace
}  // namespace twoport::changing_environment_test
