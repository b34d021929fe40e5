#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "common/method/catalogue.h"
#include "common/scene/load.h"
#include "tests/support/rows.h"

// A network that stalls and flows again, and one whose ways die one by one, in virtual time: a robot that nobody moves rests, and both
// sides are coupled or neither is (docs/reference/safety.md, "Old reports").
namespace twoport::test::silence_test {
namespace {

struct Drawn {
  Scene scene;
  std::string text;
  double from_s, to_s, delay_s;  ///< of the stall or the death; one way
};

/// The hand moves by up to 80 mm while the network stalls, and rests from 2.6 s on. `stall`: the text of a way whose packets of
/// from_s to to_s come late or never.
Drawn draw(unsigned seed, const std::string& method, auto way) {
  std::mt19937 rng{seed};
  const auto uniform = [&](double a, double b) { return std::uniform_real_distribution<double>{a, b}(rng); };
  Drawn d;
  d.delay_s = 1e-3 * std::exp(uniform(0.0, std::log(200.0)));
  d.from_s = uniform(1.0, 1.6), d.to_s = uniform(4.2, 5.0);
  const double rate_hz = seed % 3 == 0 ? 250.0 : 1000.0;
  const std::string clock = seed % 2 == 0 ? std::string{}
                                          : fmt::format("slave_clock {{ offset_ms: {} drift_ppm: {} }}",
                                                        uniform(0.0, 5000.0), uniform(-200.0, 200.0));
  d.text = fmt::format(
      R"(dof: 1 rate_hz: {} duration_s: 8 seed: {} {}
operator {{
  hand {{ mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 }}
  path {{ hold {{ duration_s: 1.7 }} }} path {{ move_to {{ position_m: [{}] duration_s: 0.9 }} }} path {{ hold {{ duration_s: 10 }} }}
}}
device {{ mass_kg: 0.075 damping_n_s_per_m: 0.05 max_force_n: 8 }}
control {{ virtual_coupling {{ stiffness_n_per_m: 1000 damping_n_s_per_m: 20 }} passivity {{ method: {} }} }}
to_slave {{ {} }} to_master {{ {} }}
robot {{ mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor {{ }} }}
environment {{ wall {{ normal: [-1] offset_m: {} stiffness_n_per_m: 5000 }} }})",
      rate_hz, seed, clock, uniform(0.03, 0.08), method, way(d, true), way(d, false), seed % 4 == 0 ? -0.01 : -1.0);
  d.scene = parse_scene(d.text, "stall");
  return d;
}

/// In all rows of [from, to): the largest force of the coupling on the robot, and how far that and the hand go.
struct Rest {
  double force_n = 0.0, moved_m = 0.0, hand_m = 0.0;
  int coupled = 0, rows = 0;
  /// Does the robot move or press without the hand? Under a method without a claim the hand may be shaken.
  [[nodiscard]] bool at_rest() const { return moved_m < 1e-3 + hand_m && (force_n < 0.5 || hand_m > 1e-3); }
};
Rest rest(const Rows<1>& rows, double from_s, double to_s) {
  Rest all;
  double x = 0.0, hand = 0.0;
  for (const Row<1>& row : rows) {
    if (row.t_s < from_s || row.t_s >= to_s) continue;
    if (all.rows++ == 0) x = row.slave_x.translation()[0], hand = row.master_x.translation()[0];
    all.hand_m = std::max(all.hand_m, std::abs(row.master_x.translation()[0] - hand));
    all.force_n = std::max(all.force_n, std::abs(row.slave_f[0]));
    all.moved_m = std::max(all.moved_m, std::abs(row.slave_x.translation()[0] - x));
    all.coupled += row.mode == Mode::coupled || row.following ? 1 : 0;
  }
  return all;
}

std::vector<std::string> methods() {
  std::vector<std::string> all;
  for (const MethodName& method : kMethods) all.emplace_back(method.name);
  return all;
}

TEST(Silence, WhatWaitedInTheNetworkMovesNoRobotWhenItFlowsAgain) {
  int coupled_again = 0, runs = 0;
  for (unsigned seed = 1; seed <= 24; ++seed) {
    const std::string method = methods()[seed % methods().size()];
    const bool both = seed % 2 == 0;
    const Drawn d = draw(seed, method, [&](const Drawn& at, bool to_slave) {
      const double delay_ms = 1e3 * at.delay_s;
      if (!to_slave && !both) return fmt::format("delay_ms: {}", delay_ms);
      // Steps of 10 ms: a packet of the time t comes when the stall ends.
      std::string steps;
      for (double t = at.from_s; t < at.to_s; t += 0.01)
        steps += fmt::format(" delay_step {{ at_s: {} delay_ms: {} }}", t, delay_ms + 1e3 * (at.to_s - t));
      return fmt::format("delay_ms: {}{} delay_step {{ at_s: {} delay_ms: {} }}", delay_ms, steps, at.to_s, delay_ms);
    });
    const Rows<1> all = rows<1>(d.scene);
    const Rest after = rest(all, d.from_s + 2.0 * d.delay_s + 1.3, 8.0);
    EXPECT_TRUE(after.at_rest()) << method << " seed " << seed << ": " << after.moved_m << " m, " << after.force_n
                                 << " N; hand " << after.hand_m << " m\n"
                                 << d.text;
    coupled_again += all.back().coupled ? 1 : 0;
    ++runs;
  }
  EXPECT_EQ(coupled_again, runs);
}

TEST(Silence, OfOneWayEndsTheCouplingAtBothSides) {
  for (unsigned seed = 1; seed <= 24; ++seed) {
    const std::string method = methods()[seed % methods().size()];
    const bool dead_to_slave = seed % 2 == 0;
    const Drawn d = draw(seed, method, [&](const Drawn& at, bool to_slave) {
      std::string way = fmt::format("delay_ms: {}", 1e3 * at.delay_s);
      if (to_slave == dead_to_slave)
        way += fmt::format(" blackout {{ start_s: {} duration_s: {} }}", at.from_s, at.to_s - at.from_s);
      return way;
    });
    const Rows<1> all = rows<1>(d.scene);
    ASSERT_GT(rest(all, 0.0, d.from_s).coupled, 0) << method;
    // A stamp that waits counts as waiting for hold_after/2.
    const double release_s = d.from_s + 1.0 + 2.0 * d.delay_s + 0.06;
    const Rest dead = rest(all, release_s, d.to_s);
    EXPECT_EQ(dead.coupled, 0) << method << " seed " << seed;
    EXPECT_EQ(dead.force_n, 0.0) << method << " seed " << seed;
    for (const Row<1>& row : all)
      if (row.t_s >= release_s + 0.2 && row.t_s < d.to_s) {
        EXPECT_EQ(row.master_f[0], 0.0) << method << " seed " << seed;
      }
    EXPECT_TRUE(all.back().coupled) << method << " seed " << seed;
    const Rest after = rest(all, d.to_s, 8.0);
    EXPECT_TRUE(after.at_rest()) << method << " seed " << seed << ": " << after.moved_m << " m; hand " << after.hand_m;
  }
}

// Networks with jitter, bursts, steps of the delay and up to 2 s of round trip are links all the same.
TEST(Silence, IsNotWhatAJitteryNetworkDoes) {
  std::mt19937 rng{11};
  const auto uniform = [&](double a, double b) { return std::uniform_real_distribution<double>{a, b}(rng); };
  for (int i = 0; i < 18; ++i) {
    const double round_trip_ms = 20.0 * std::pow(100.0, uniform(0.0, 1.0)), share = uniform(0.2, 0.8);
    std::string ways[2];
    for (int way = 0; way < 2; ++way) {
      const double delay_ms = round_trip_ms * (way == 0 ? share : 1.0 - share);
      ways[way] =
          fmt::format("delay_ms: {} jitter_ms: {} loss: {}", delay_ms, uniform(0.0, 0.1) * delay_ms, uniform(0.0, 0.3));
      if (i % 3 == 0) ways[way] += fmt::format(" burst {{ p: {} r: 0.1 }}", uniform(0.001, 0.02));
      if (i % 3 == 1)
        ways[way] +=
            fmt::format(" delay_step {{ at_s: {} delay_ms: {} }}", uniform(1.0, 3.0), delay_ms + uniform(0.0, 90.0));
    }
    const Scene scene = parse_scene(fmt::format(R"(dof: 1 rate_hz: 1000 duration_s: 8 seed: {}
operator {{
  hand {{ mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 }}
  path {{ hold {{ duration_s: 0.3 }} }} path {{ move_to {{ position_m: [0.04] duration_s: 1 }} }} path {{ hold {{ duration_s: 10 }} }}
}}
device {{ mass_kg: 0.075 damping_n_s_per_m: 0.05 max_force_n: 8 }}
control {{ virtual_coupling {{ stiffness_n_per_m: 1000 damping_n_s_per_m: 20 }} }}
to_slave {{ {} }} to_master {{ {} }}
robot {{ mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor {{ }} }}
environment {{ wall {{ normal: [-1] offset_m: -0.02 stiffness_n_per_m: 5000 }} }})",
                                                i, ways[0], ways[1]),
                                    "network");
    const Rows<1> all = rows<1>(scene);
    const Rest late = rest(all, 6.0, 8.0);
    EXPECT_GT(late.coupled, 0.9 * late.rows) << round_trip_ms << " ms\n" << ways[0] << '\n' << ways[1];
    EXPECT_GT(late.force_n, 1.0) << "presses; " << round_trip_ms << " ms\n" << ways[0] << '\n' << ways[1];
  }
}

}  // namespace
}  // namespace twoport::test::silence_test
