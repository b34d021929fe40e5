#include "tests/theory/oracle.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <deque>
#include <numbers>
#include <random>
#include <vector>

// The tables of section B of the theory, row by row. Printed numbers carry six digits: half a unit in the last is 5e-6.
namespace twoport::lab::oracle_test {
namespace {

using std::numbers::pi;

constexpr double kPrinted = 6e-6;
void expect_printed(double value, double printed) {
  EXPECT_NEAR(value, printed, kPrinted * std::abs(printed)) << value - printed;
}

// ---- 1. Colgate

struct ColgateRow {
  double k, b, t;
  int d;
  double least, without_delay, without_damping;
};

TEST(ColgateDamping, IsTheTableAndTheSweep) {
  constexpr ColgateRow kTable[] = {
      {5000, 0, 0.0005, 0, 1.25, 1.25, 1.25},  {5000, 0, 0.001, 0, 2.5, 2.5, 2.5},
      {1000, 0, 0.001, 0, 0.5, 0.5, 0.5},      {1000, 2, 0.001, 0, 2.5, 2.5, 0.5},
      {1000, -2, 0.001, 0, 2.5, 2.5, 0.5},     {5000, 1, 0.0005, 0, 2.25, 2.25, 1.25},
      {1000, 0, 0.001, 1, 1.5, 0.5, 1.5},      {1000, 0, 0.001, 5, 5.5, 0.5, 5.5},
      {1000, 2, 0.001, 1, 2.5625, 2.5, 1.5},   {1000, 2, 0.001, 2, 2.70342, 2.5, 2.5},
      {1000, 5, 0.001, 1, 5.525, 5.5, 1.5},    {5000, 1, 0.0005, 2, 5.25, 2.25, 6.25},
      {500, 0.5, 0.001, 10, 4.75, 0.75, 5.25}, {2000, 10, 0.00025, 0, 10.25, 10.25, 0.25},
  };
  for (const auto& [k, b, t, d, least, without_delay, without_damping] : kTable) {
    SCOPED_TRACE(testing::Message() << "K " << k << " B " << b << " T " << t << " d " << d);
    const double formula = colgate_damping(k, b, t, d);
    expect_printed(formula, least);
    const Discrete wall = [&, k = k, b = b, t = t, d = d](std::complex<double> z) {
      return std::pow(z, -d) * (k + b * (z - 1.0) / (t * z));
    };
    EXPECT_NEAR(colgate_damping(wall, t), formula, 1e-6 * formula);
    expect_printed(k * t / 2 + std::abs(b), without_delay);
    expect_printed(k * (t / 2 + d * t), without_damping);
    if (d == 0) {
      EXPECT_NEAR(formula, without_delay, 1e-12);
    }
    if (b == 0.0) {
      EXPECT_NEAR(formula, without_damping, 1e-9);
    }
  }
}

// ---- 2. a sampled wall

struct WallRow {
  double m, b, wall_b, t;
  int d;
  double k_max, rule, passive, radius, growing, falling;
};

TEST(SampledWall, LosesStabilityWhereTheTableSays) {
  constexpr WallRow kTable[] = {
      {0.075, 0, 10, 0.0005, 0, 37419.4, 40000, 0, 1.00034, 1.00034, 0.99966},
      {0.075, 0.05, 0, 0.0005, 0, 200.011, 200, 200, 1, 1, 0.999998},
      {0.075, 0.5, 0, 0.0005, 0, 2001.11, 2000, 2000, 1.00002, 1.00002, 0.999984},
      {0.075, 1.25, 0, 0.0005, 0, 5006.95, 5000, 5000, 1.00004, 1.00004, 0.999959},
      {0.075, 0.05, 2, 0.0005, 0, 8091.86, 8200, 0, 1.00007, 1.00007, 0.999932},
      {0.075, 0.05, 20, 0.0005, 0, 70180.5, 80200, 0, 1.0007, 1.0007, 0.999301},
      {0.075, 0.05, 2, 0.0005, 1, 2693.06, 2733.33, 0, 1.00007, 1.00007, 0.999932},
      {0.075, 0.05, 2, 0.0005, 2, 1609.48, 1640, 0, 1.00007, 1.00007, 0.999931},
      {0.075, 0.05, 10, 0.0005, 2, 7271.13, 8040, 0, 1.00036, 1.00036, 0.999636},
      {0.1, 0.1, 0, 0.001, 0, 200.033, 200, 200, 1, 1.00001, 0.999995},
      {0.1, 0.1, 1, 0.001, 0, 2178.48, 2200, 0, 1.00006, 1.00006, 0.999944},
      {0.1, 0.1, 5, 0.001, 0, 9704.3, 10200, 0, 1.00026, 1.00026, 0.999735},
      {0.1, 0.1, 5, 0.001, 1, 3211.43, 3400, 0, 1.00027, 1.00027, 0.999732},
      {0.1, 0.1, 5, 0.001, 5, 811.998, 927.273, 0, 1.00028, 1.00028, 0.99972},
      {1, 1, 10, 0.001, 10, 1006.55, 1047.62, 0, 1.00006, 1.00005, 0.999945},
      {2, 5, 0, 0.001, 3, 1430.69, 1428.57, 1428.57, 1.00001, 1.00001, 0.999987},
  };
  for (const WallRow& row : kTable) {
    SCOPED_TRACE(testing::Message() << "m " << row.m << " b " << row.b << " B " << row.wall_b << " d " << row.d);
    SampledWall wall{.mass_kg = row.m,
                     .damping_n_s_per_m = row.b,
                     .wall_damping_n_s_per_m = row.wall_b,
                     .period_s = row.t,
                     .delay_ticks = row.d};
    const double k_max = critical_stiffness(wall);
    expect_printed(k_max, row.k_max);
    expect_printed(linear_rule_stiffness(row.b, row.wall_b, row.t, row.d), row.rule);
    // Passive up to where all of b is needed; with B > b there is no such stiffness.
    if (row.passive > 0.0) {
      EXPECT_NEAR(colgate_damping(row.passive, row.wall_b, row.t, row.d), row.b, 1e-5 * row.b);
    }
    if (row.passive == 0.0) {
      EXPECT_GT(colgate_damping(1e-9, row.wall_b, row.t, row.d), row.b);
    }
    wall.stiffness_n_per_m = 1.01 * k_max;
    EXPECT_NEAR(spectral_radius(wall), row.radius, 6e-6);
    EXPECT_NEAR(spectral_radius(wall), row.growing, 1.5e-5);  // was simulated there
    wall.stiffness_n_per_m = 0.99 * k_max;
    EXPECT_NEAR(spectral_radius(wall), row.falling, 1.5e-5);
  }
}

TEST(SampledWall, WithoutDeviceDampingHasAClosedForm) {
  constexpr double kTable[][3] = {{1, 0, 3973.42},  {10, 0, 37419.4}, {50, 0, 142857},  {124.264, 0, 205887},
                                  {200, 0, 160000}, {10, 1, 12340.5}, {40, 1, 37174.9}, {10, 2, 7233.55},
                                  {25, 2, 15000.6}, {10, 5, 3014.31}, {2, 10, 359.892}, {5, 10, 813.746}};
  constexpr double kMass = 0.075, kPeriod = 0.0005;
  for (const auto& [b, delay, k] : kTable) {
    SCOPED_TRACE(testing::Message() << "B " << b << " d " << delay);
    const int d = static_cast<int>(delay);
    const double closed = critical_stiffness_undamped(kMass, b, kPeriod, d);
    expect_printed(closed, k);
    const SampledWall wall{
        .mass_kg = kMass, .damping_n_s_per_m = 0.0, .wall_damping_n_s_per_m = b, .period_s = kPeriod, .delay_ticks = d};
    EXPECT_NEAR(critical_stiffness(wall), closed, 1e-8 * closed);
  }
  EXPECT_EQ(critical_stiffness_undamped(kMass, 2.1 * kMass / kPeriod, kPeriod, 0), 0.0);  // β > 2
}

TEST(SampledWall, IsStiffestWhereTheTableSays) {
  constexpr double kTable[][3] = {{0, 0.686292, 0.828427},  {1, 0.144469, 0.424694},  {2, 0.0624305, 0.291392},
                                  {3, 0.0347817, 0.222384}, {5, 0.0153540, 0.151154}, {10, 0.00455086, 0.0840513}};
  for (const auto& [d, alpha, beta] : kTable) {
    const Peak peak = stiffest_undamped(static_cast<int>(d));
    expect_printed(peak.alpha, alpha);
    expect_printed(peak.beta, beta);
  }
  EXPECT_NEAR(stiffest_undamped(0).beta, 2.0 * (std::sqrt(2.0) - 1.0), 1e-6);
}

TEST(SampledWall, ShowsWhatIntegratorHandAndDelayDo) {
  struct Row {
    double b;
    int euler;
    bool true_velocity;
    double hand, g;
    int d;
    double k_max;
  };
  constexpr Row kTable[] = {
      {0, 0, false, 0, 0, 0, 2001.11},    {5, 0, false, 0, 0, 0, 21291.7},    {0, 1, false, 0, 0, 0, 1.198e6},
      {5, 1, false, 0, 0, 0, 1.178e6},    {0, 2, false, 0, 0, 0, 4003.34},    {5, 2, false, 0, 0, 0, 42605.8},
      {0, 10, false, 0, 0, 0, 2223.58},   {5, 10, false, 0, 0, 0, 23659.9},   {0, 100, false, 0, 0, 0, 2021.34},
      {5, 100, false, 0, 0, 0, 21507},    {0, 0, true, 0, 0, 0, 2001.11},     {5, 0, true, 0, 0, 0, 22012.2},
      {0, 0, false, 500, 0, 0, 2001.39},  {5, 0, false, 500, 0, 0, 21275.7},  {0, 0, false, 5000, 0, 0, 2003.89},
      {5, 0, false, 5000, 0, 0, 21131.9}, {0, 0, false, 0, 0.25, 0, 1334.07}, {5, 0, false, 0, 0.25, 0, 14197.7},
      {0, 0, false, 0, 0.5, 0, 1000.69},  {5, 0, false, 0, 0.5, 0, 10643},    {0, 0, false, 0, 0.9, 0, 714.919},
      {5, 0, false, 0, 0.9, 0, 7580.68},  {0, 0, false, 0, 0, 1, 667.283},    {5, 0, false, 0, 0, 1, 7068.36},
  };
  for (const Row& row : kTable) {
    SCOPED_TRACE(row.k_max);
    expect_printed(critical_stiffness({.mass_kg = 0.075,
                                       .damping_n_s_per_m = 0.5,
                                       .hand_stiffness_n_per_m = row.hand,
                                       .wall_damping_n_s_per_m = row.b,
                                       .period_s = 0.0005,
                                       .delay_ticks = row.d,
                                       .delay_fraction = row.g,
                                       .true_velocity = row.true_velocity,
                                       .euler_substeps = row.euler}),
                   row.k_max);
  }
}

// ---- 3. bilateral loops

using Change = void (*)(BilateralLoop&);
constexpr Change kAsItIs = [](BilateralLoop&) {};

struct LoopRow {
  Change change;
  int most_delay;
  double critical_at_0, critical_at_10;
};

void expect_table(Architecture architecture, double (*critical)(BilateralLoop), std::span<const LoopRow> table) {
  for (std::size_t i = 0; i < table.size(); ++i) {
    SCOPED_TRACE(testing::Message() << "row " << i);
    BilateralLoop loop{.architecture = architecture};
    table[i].change(loop);
    if (table[i].most_delay < 60) {
      EXPECT_EQ(critical_delay_ticks(loop, 60), table[i].most_delay);
    } else {
      for (const int d : {0, 20, 40, 60}) {
        loop.to_slave_ticks = loop.to_master_ticks = d;
        EXPECT_LE(spectral_radius(loop), 1.0 + 1e-12) << "d1 = d2 = " << d;
      }
    }
    for (const auto& [d, printed] : {std::pair{0, table[i].critical_at_0}, std::pair{10, table[i].critical_at_10}}) {
      loop.to_slave_ticks = loop.to_master_ticks = d;
      expect_printed(critical(loop), printed);
    }
  }
}

TEST(BilateralLoop, OfMeasuredForceIsTheTable) {
  constexpr LoopRow kTable[] = {
      {kAsItIs, -1, 0.948426, 0.260456},
      {[](BilateralLoop& l) { l.environment_stiffness_n_per_m = 100; }, 6, 2.08941, 0.755453},
      {[](BilateralLoop& l) { l.environment_stiffness_n_per_m = 2000; }, -1, 0.957545, 0.25179},
      {[](BilateralLoop& l) { l.master_damping_n_s_per_m = 10; }, 9, 2.03306, 0.987323},
      {[](BilateralLoop& l) { l.hand_stiffness_n_per_m = 0.01; }, 1, 1.22647, 0.354303},
      {[](BilateralLoop& l) { l.force_scale = 0.5; }, 4, 0.948426, 0.260456},
  };
  expect_table(Architecture::position_measured_force, critical_force_scale, kTable);
}

TEST(BilateralLoop, OfComputedForceIsTheTable) {
  constexpr LoopRow kTable[] = {
      {kAsItIs, 13, 32.3318, 1.52283},
      {[](BilateralLoop& l) { l.master_damping_n_s_per_m = 10; }, 37, 32.3314, 1.6419},
  };
  expect_table(Architecture::position_force, critical_force_scale, kTable);
}

TEST(BilateralLoop, OfTwoPositionsIsTheTable) {
  constexpr LoopRow kTable[] = {
      {kAsItIs, 34, 62038, 4595.25},
      {[](BilateralLoop& l) { l.environment_stiffness_n_per_m = 0; }, 35, 62040.4, 4617.68},
      {[](BilateralLoop& l) { l.coupling_damping_n_s_per_m = 10; }, 18, 22013.6, 1880.12},
      {[](BilateralLoop& l) { l.master_damping_n_s_per_m = l.robot_damping_n_s_per_m = 10; }, 60, 70231.2, 5589.08},
      {[](BilateralLoop& l) { l.environment_stiffness_n_per_m = 5000; }, 60, 62016.5, 4631.53},
      {[](BilateralLoop& l) {
         l.coupling_damping_n_s_per_m = 5;
         l.hand_stiffness_n_per_m = 0.01;
         l.environment_stiffness_n_per_m = 0;
       },
       10, 12008, 1066.42},
      {[](BilateralLoop& l) { l.period_s = 0.0005; }, 60, 124040, 10174.6},
      {[](BilateralLoop& l) {
         l.master_mass_kg = 0.075;
         l.master_damping_n_s_per_m = 0.5;
         l.robot_mass_kg = 2.0;
         l.robot_damping_n_s_per_m = 10.0;
         l.hand_stiffness_n_per_m = 300;
       },
       60, 61003.4, 27182.4},
  };
  expect_table(Architecture::position_position, critical_coupling_stiffness, kTable);
}

/// The loop in time, by Runge-Kutta steps and with a queue for each direction: growth per tick of the velocities.
double simulated_growth(const BilateralLoop& l, int ticks) {
  struct Motion {
    double x, v;
  };
  const auto advance = [&](Motion s, double m, double b, double k, double f) {
    const auto slope = [&](Motion at) { return Motion{at.v, (f - b * at.v - k * at.x) / m}; };
    constexpr int kPieces = 4;
    const double h = l.period_s / kPieces;
    for (int i = 0; i < kPieces; ++i) {
      const Motion k1 = slope(s), k2 = slope({s.x + 0.5 * h * k1.x, s.v + 0.5 * h * k1.v}),
                   k3 = slope({s.x + 0.5 * h * k2.x, s.v + 0.5 * h * k2.v}),
                   k4 = slope({s.x + h * k3.x, s.v + h * k3.v});
      s = {s.x + h / 6.0 * (k1.x + 2.0 * k2.x + 2.0 * k3.x + k4.x),
           s.v + h / 6.0 * (k1.v + 2.0 * k2.v + 2.0 * k3.v + k4.v)};
    }
    return s;
  };
  std::deque<Motion> there(static_cast<std::size_t>(l.to_slave_ticks), Motion{0, 0});
  std::deque<Motion> back(static_cast<std::size_t>(l.to_master_ticks), Motion{0, 0});
  std::deque<double> force(static_cast<std::size_t>(l.to_master_ticks), 0.0);
  Motion m{0.0, 1.0}, s{0.0, 0.0};
  const double k = l.coupling_stiffness_n_per_m, b = l.coupling_damping_n_s_per_m;
  double first = 0.0, second = 0.0;
  for (int i = 0; i < ticks; ++i) {
    there.push_back(m);
    const Motion heard = there.front();
    there.pop_front();
    const double f_s = k * (heard.x - s.x) + b * (heard.v - s.v);
    const double f_e = l.environment_stiffness_n_per_m * s.x + l.environment_damping_n_s_per_m * s.v;
    force.push_back(l.force_scale * (l.architecture == Architecture::position_force ? f_s : f_e));
    back.push_back(s);
    const double f_m = l.architecture == Architecture::position_position
                           ? k * (m.x - back.front().x) + b * (m.v - back.front().v)
                           : force.front();
    force.pop_front();
    back.pop_front();
    m = advance(m, l.master_mass_kg, l.master_damping_n_s_per_m, l.hand_stiffness_n_per_m, -f_m);
    s = advance(s, l.robot_mass_kg, l.robot_damping_n_s_per_m + l.environment_damping_n_s_per_m,
                l.environment_stiffness_n_per_m, f_s);
    // Mean squares of the last two quarters, each under a smooth weight.
    const int quarter = ticks / 4, into = (i - 2 * quarter) % quarter;
    const double p = static_cast<double>(into) / quarter, weight = std::pow(p * (1.0 - p), 2);
    if (i >= 2 * quarter) (i < 3 * quarter ? first : second) += weight * (m.v * m.v + s.v * s.v);
  }
  return std::exp(0.5 * std::log(second / first) / (ticks / 4));
}

TEST(BilateralLoop, GrowsAsAnIndependentSimulationDoes) {
  for (const Architecture architecture :
       {Architecture::position_force, Architecture::position_measured_force, Architecture::position_position})
    for (const auto& [d1, d2] : {std::pair{0, 0}, std::pair{10, 10}, std::pair{2, 11}})
      for (const double part : {0.98, 1.02}) {
        BilateralLoop loop{.architecture = architecture, .to_slave_ticks = d1, .to_master_ticks = d2};
        SCOPED_TRACE(testing::Message() << "architecture " << static_cast<int>(architecture) << " d " << d1 << ", "
                                        << d2 << " at " << part << " of critical");
        if (architecture == Architecture::position_position) {
          loop.coupling_stiffness_n_per_m = part * critical_coupling_stiffness(loop);
        } else {
          loop.force_scale = part * critical_force_scale(loop);
        }
        const double radius = spectral_radius(loop);
        EXPECT_EQ(radius > 1.0, part > 1.0);
        const double overflow = 300.0 / std::abs(std::log(radius));
        EXPECT_NEAR(simulated_growth(loop, static_cast<int>(std::min(overflow, 2e4))), radius, 2e-5);
      }
}

TEST(BilateralLoop, TakesAtLeastOneTickBetweenOurNodes) {
  EXPECT_EQ(ticks_of_delay(0.0, 1e-3), 1);
  EXPECT_EQ(ticks_of_delay(1e-3, 1e-3), 1);
  EXPECT_EQ(ticks_of_delay(1.1e-3, 1e-3), 2);
  EXPECT_EQ(ticks_of_delay(0.05, 5e-4), 100);
}

TEST(WaveLine, KeepsAnOffsetAndDampsTheRest) {
  struct Row {
    double impedance, environment, next;
  };
  constexpr Row kTable[] = {{30, 500, 0.9997325}, {5, 500, 0.9996161}, {30, 5000, 0.9997020}};
  for (const auto& [impedance, environment, next] : kTable) {
    SCOPED_TRACE(testing::Message() << "b " << impedance << " k_e " << environment);
    for (const int d : {1, 10, 200}) {
      const WaveModes modes = wave_modes(
          {.environment_stiffness_n_per_m = environment, .to_slave_ticks = d, .to_master_ticks = d}, impedance);
      EXPECT_NEAR(modes.drift, 1.0, 1e-9);
      EXPECT_LT(modes.next, 1.0);
      if (d == 200) {  // the table's is that of the longest delay
        EXPECT_NEAR(modes.next, next, 6e-8);
      }
    }
  }
}

// ---- 4. absolute stability

TEST(Llewellyn, BoundsExchangedStiffness) {
  constexpr double kTable[][7] = {
      {1, 1, 0.01, 0.01, 100, 0.0198994, -0.0201006},   {2, 2, 0.01, 0.01, 200, 0.0198994, -0.0201006},
      {2, 8, 0.01, 0.01, 400, 0.0198994, -0.0201006},   {5, 5, 0.05, 0.05, 100, 0.0199, -0.0201},
      {5, 5, 0.02, 0.08, 100, 0.0199, -0.0201},         {10, 10, 0.1, 0.1, 100, 0.0199, -0.0201},
      {1, 4, 0.005, 0.015, 200, 0.0198994, -0.0201006}, {20, 20, 0.25, 0.25, 80, 0.0199, -0.0201},
      {3, 3, 0.001, 0.001, 3000, 0.0198568, -0.020128}, {0.5, 0.5, 0.03, 0.01, 25, 0.0198998, -0.0201001}};
  for (const auto& [bm, bs, t1, t2, k_max, above, below] : kTable) {
    SCOPED_TRACE(testing::Message() << "b " << bm << ", " << bs << " T " << t1 << ", " << t2);
    EXPECT_NEAR(llewellyn_stiffness(bm, bs, t1, t2), k_max, 1e-12 * k_max);
    const auto least = [&, bm = bm, bs = bs, late = t1 + t2](double k) {
      return least_llewellyn_margin([&](double w) { return exchanged_stiffness(k, bm, bs, late, w); }, 1e-3 / late,
                                    1e2 / late, 2.0 * bm * bs)
          .value;
    };
    // The margin is 1 - (K/K_max)² at ω -> 0; the table's first digits differ by the sweep it was found with.
    EXPECT_NEAR(least(0.99 * k_max), above, 1e-4);
    EXPECT_NEAR(least(1.01 * k_max), below, 1e-4);
    EXPECT_NEAR(least(0.99 * k_max), 0.0199, 1e-5);
    EXPECT_NEAR(least(1.01 * k_max), -0.0201, 1e-5);
  }
}

TEST(Llewellyn, JudgesArchitectures) {
  struct Row {
    double delay, pf, pp, pp_at, wave;
  };
  constexpr Row kTable[] = {
      {0, -0.99608, 2.48e-8, 0.01, 2.48001e-8},       {0.001, -1.99879, 3.66e-8, 0.01, 2.48542e-8},
      {0.01, -1.99911, 1.248e-7, 0.01, 2.54222e-8},   {0.03, -1.99913, 2.048e-7, 0.01, 2.72e-8},
      {0.1, -1.99913, -1.37513, 19.5704, 3.90222e-8}, {0.4, -1.99912, -1.96396, 4.21318, 1.88354e-7}};
  const BilateralLoop loop;
  const auto least = [](const std::function<Immittance(double)>& port) {
    return least_llewellyn_margin(port, 0.01, 1e4);
  };
  for (const auto& [delay, pf, pp, pp_at, wave] : kTable) {
    SCOPED_TRACE(testing::Message() << "delay " << delay);
    // The table's sweep is coarser where the margin ripples.
    EXPECT_NEAR(least([&, t = delay](double w) { return position_measured_force(loop, t, w); }).value, pf, 5e-5);
    const LeastMargin pp_least = least([&, t = delay](double w) { return position_position(loop, t, w); });
    EXPECT_NEAR(pp_least.value, pp, 2e-5 * std::abs(pp));
    EXPECT_NEAR(pp_least.at_rad_per_s, pp_at, 1e-3 * pp_at);
    EXPECT_NEAR(least([&, t = delay](double w) { return wave_line(loop, 30.0, t, w); }).value, wave, 1e-4 * wave);
  }
}

TEST(Llewellyn, MeasuredForceWithoutDelayIsWorstAtTheEndOfTheSweep) {
  const LeastMargin least =
      least_llewellyn_margin([](double w) { return position_measured_force({}, 0.0, w); }, 0.01, 1e4);
  EXPECT_NEAR(least.at_rad_per_s, 1e4, 1.0);
}

// ---- 5. waves

/// A wave line with random terminations: what has gone in less what has come out, and what the identity says.
struct Line {
  double worst = 0.0, least = 0.0, most = 0.0;

  Line(int ticks, int d1, int d2, double b, std::uint64_t seed) {
    std::mt19937_64 rng{seed};
    std::normal_distribution<double> normal;
    constexpr double kPeriod = 1e-3;
    const double root = std::sqrt(2.0 * b);
    std::vector<double> u_m, w_s;
    double in = 0.0, through = 0.0;
    for (int k = 0; k < ticks; ++k) {
      // Any v_m, and any force at the slave; with no delay at all the far end answers first.
      const double v_m = normal(rng), f_s = 10.0 * normal(rng);
      const auto late = [](const std::vector<double>& waves, int d) {
        const auto n = static_cast<std::ptrdiff_t>(waves.size()) - d;
        return n >= 0 && n < static_cast<std::ptrdiff_t>(waves.size()) ? waves[static_cast<std::size_t>(n)] : 0.0;
      };
      double w_m = 0.0, u_s = 0.0;
      if (d1 == 0 && d2 == 0) {
        // u = √(2b) v - w and w = u - √(2/b) f_s
        w_m = 0.5 * (root * v_m - 2.0 / root * f_s);
      } else if (d2 > 0) {
        w_m = late(w_s, d2);
      } else {
        w_m = late(u_m, d1) - 2.0 / root * f_s;
      }
      const double u = root * v_m - w_m;
      u_s = d1 > 0 ? late(u_m, d1) : u;
      const double w = u_s - 2.0 / root * f_s;
      u_m.push_back(u);
      w_s.push_back(w);
      const double f_m = b * v_m - root * w_m, v_sd = (root * u_s - f_s) / b;
      in += kPeriod * (f_m * v_m - f_s * v_sd);
      through += kPeriod * (std::abs(f_m * v_m) + std::abs(f_s * v_sd));
      const double held = wave_line_energy(u_m, w_s, d1, d2, kPeriod);
      worst = std::max(worst, std::abs(in - held) / through);
      least = std::min(least, held);
      most = std::max(most, held);
    }
  }
};

TEST(WaveLine, HoldsExactlyWhatIsInFlight) {
  constexpr double kTable[][4] = {{2000, 1, 1, 1},       {2000, 5, 9, 10}, {5000, 100, 50, 30}, {3000, 0, 0, 2},
                                  {3000, 3, 0, 2},       {4000, 1, 0, 5},  {4000, 0, 7, 5},     {4000, 13, 13, 100},
                                  {3000, 250, 400, 0.3}, {1000, 999, 1, 1}};
  std::uint64_t seed = 5000;
  for (const auto& [ticks, d1, d2, b] : kTable) {
    SCOPED_TRACE(testing::Message() << "d " << d1 << ", " << d2 << " b " << b << " seed " << seed);
    const Line line{static_cast<int>(ticks), static_cast<int>(d1), static_cast<int>(d2), b, seed++};
    EXPECT_LT(line.worst, 1e-12);
    EXPECT_GE(line.least, 0.0);
    if (d1 + d2 > 0) {
      EXPECT_GT(line.most, 0.0);
    }
    if (d1 + d2 == 0) {
      EXPECT_EQ(line.most, 0.0);
    }
  }
}

/// A smooth wave through a link that loses and delays packets, played by four receivers: energy out over energy in, and
/// the most that out has been ahead of in. From a blackout on nothing is sent.
struct Played {
  double ratio = 0.0, ahead = 0.0;
};
struct Receivers {
  Played hold, zero, queue, scaled;

  Receivers(double loss, int jitter_ticks, int blackout_from) {
    constexpr int kTicks = 20000;
    std::mt19937_64 rng{777};
    std::uniform_real_distribution<double> draw;
    std::normal_distribution<double> late{0.0, static_cast<double>(jitter_ticks)};
    std::vector<double> sent(kTicks);
    std::vector<std::vector<int>> arriving(kTicks);
    for (int k = 0; k < (blackout_from > 0 ? blackout_from : kTicks); ++k) {
      sent[at(k)] = std::sin(0.021 * k + 0.3) + 0.5 * std::sin(0.0073 * k);
      const bool lost = draw(rng) < loss;
      const int due =
          k + (jitter_ticks > 0 ? std::max(0, static_cast<int>(std::lround(2.0 * jitter_ticks + late(rng)))) : 0);
      if (!lost && due < kTicks) arriving[at(due)].push_back(k);
    }
    int newest = -1;
    double last = 0.0, in = 0.0, received = 0.0, spent = 0.0;
    std::deque<double> waiting;
    for (int k = 0; k < kTicks; ++k) {
      in += sent[at(k)] * sent[at(k)];
      bool fresh = false;
      for (const int packet : arriving[at(k)]) {
        received += sent[at(packet)] * sent[at(packet)];
        waiting.push_back(sent[at(packet)]);
        if (packet <= newest) continue;
        newest = packet;
        last = sent[at(packet)];
        fresh = true;
      }
      const double from_queue = waiting.empty() ? 0.0 : waiting.front();
      if (!waiting.empty()) waiting.pop_front();
      const double budget = std::sqrt(std::max(0.0, received - spent));
      const double limited = std::clamp(last, -budget, budget);
      spent += limited * limited;
      play(hold, last, in);
      play(zero, fresh ? last : 0.0, in);
      play(queue, from_queue, in);
      play(scaled, limited, in);
    }
    for (Played* p : {&hold, &zero, &queue, &scaled}) p->ratio /= in;
  }

 private:
  static std::size_t at(int k) { return static_cast<std::size_t>(k); }
  static void play(Played& p, double out, double in) {
    p.ratio += out * out;
    p.ahead = std::max(p.ahead, p.ratio - in);
  }
};

// The table's own signal and seed are not known: its claims are what is tested.
TEST(WaveReceivers, OnlyTheHoldCreatesEnergy) {
  for (const double loss : {0.0, 0.01, 0.05, 0.1, 0.3, 0.9}) {
    SCOPED_TRACE(loss);
    const Receivers r{loss, 0, 0};
    EXPECT_NEAR(r.zero.ratio, 1.0 - loss, 0.02);
    EXPECT_NEAR(r.queue.ratio, r.zero.ratio, 1e-12);
    EXPECT_NEAR(r.scaled.ratio, r.zero.ratio, 0.01);
    EXPECT_NEAR(r.hold.ratio, 1.0, 0.03);
    EXPECT_EQ(r.hold.ahead > 1e-9, loss > 0.0);
    for (const Played& p : {r.zero, r.queue, r.scaled}) EXPECT_LE(p.ahead, 1e-9);
  }
  for (const auto& [jitter, zero_below] : {std::pair{10, 0.5}, std::pair{100, 0.25}}) {
    SCOPED_TRACE(jitter);
    const Receivers r{0.0, jitter, 0};
    EXPECT_GT(r.hold.ahead, 1e-9);
    EXPECT_LT(r.zero.ratio, zero_below);  // only the newest counts: most of the energy is thrown away
    EXPECT_GT(r.queue.ratio, 0.98);
    EXPECT_GT(r.scaled.ratio, 0.95);
    for (const Played& p : {r.zero, r.queue, r.scaled}) EXPECT_LE(p.ahead, 1e-9);
  }
}

TEST(WaveReceivers, AHoldPlaysABlackoutForEver) {
  const Receivers r{0.0, 0, 200};
  EXPECT_GT(r.hold.ahead, 1000.0);
  for (const Played& p : {r.zero, r.queue, r.scaled}) EXPECT_LE(p.ahead, 1e-9);
}

// ---- 6. what a sampled spring gives away

/// Positions at the ticks: straight in to the depth and straight back.
std::vector<double> press_and_release(double period, double speed, double depth) {
  const int ticks = static_cast<int>(std::lround(depth / (speed * period)));
  std::vector<double> x;
  for (int k = 0; k <= ticks; ++k) x.push_back(depth * k / ticks);
  for (int k = ticks - 1; k >= 0; --k) x.push_back(depth * k / ticks);
  return x;
}

TEST(SpringOracle, GivesAwayKvTDWhenPressedAndReleased) {
  constexpr double kTable[][5] = {{5000, 0.0005, 0.1, 0.001, 0.00025},  {5000, 0.0005, 0.2, 0.002, 0.001},
                                  {1000, 0.001, 0.1, 0.005, 0.0005},    {1000, 0.001, 0.5, 0.01, 0.005},
                                  {200, 0.01, 0.1, 0.01, 0.002},        {10000, 0.0001, 0.05, 0.001, 5e-5},
                                  {5000, 0.0005, 0.02, 0.0005, 2.5e-5}, {300, 0.002, 0.3, 0.06, 0.0108},
                                  {2000, 0.0005, 1, 0.01, 0.01},        {5000, 0.001, 0.1, 0.001, 0.0005}};
  for (const auto& [k, t, v, depth, generated] : kTable) {
    SCOPED_TRACE(testing::Message() << "K " << k << " v " << v << " D " << depth);
    EXPECT_NEAR(press_release_leak(k, t, v, depth), generated, 1e-12 * generated);
    const std::vector<double> x = press_and_release(t, v, depth);
    EXPECT_NEAR(spring_leak(k, x), generated, 1e-12 * generated);
    // The port itself, and what the backward difference with the current force would have believed: the other sign.
    double port = 0.0, believed = 0.0;
    for (std::size_t i = 1; i < x.size(); ++i) {
      port += k * x[i - 1] * (x[i] - x[i - 1]);
      believed += k * x[i] * (x[i] - x[i - 1]);
    }
    EXPECT_NEAR(-port, generated, 1e-12 * generated);
    EXPECT_NEAR(-believed, -generated, 1e-12 * generated);
  }
}

TEST(SpringOracle, GivesAwayInASineWhatTheClosedFormSays) {
  constexpr double kTable[][7] = {{5000, 0.001, 50, 0.0005, 0, 0.000985662, 0.00098696},
                                  {5000, 0.001, 200, 0.0005, 0, 0.00024672, 0.00024674},
                                  {1000, 0.005, 100, 0.001, 0, 0.00246659, 0.0024674},
                                  {1000, 0.005, 100, 0.001, 1, 0.00739003, 0.0074022},
                                  {1000, 0.005, 100, 0.001, 5, 0.0266, 0.0271414},
                                  {1000, 0.005, 100, 0.001, 20, 0.0754089, 0.101163},
                                  {2000, 0.002, 12, 0.001, 0, 0.00643078, 0.00657974},
                                  {2000, 0.002, 12, 0.001, 2, 0.024, 0.0328987},
                                  {5000, 0.0005, 20, 0.0005, 1, 0.00177549, 0.00185055},
                                  {300, 0.02, 1000, 0.001, 3, 0.00828979, 0.00828979 * 0.00829047 / 0.00828979}};
  for (const auto& [k, a, n, t, d, closed, continuous] : kTable) {
    SCOPED_TRACE(testing::Message() << "K " << k << " N " << n << " d " << d);
    const int ticks = static_cast<int>(n), late = static_cast<int>(d);
    const double leak = sine_leak(k, a, n, late);
    expect_printed(leak, closed);
    double port = 0.0;
    const auto x = [&, a = a, n = n](int i) { return a * std::sin(2.0 * pi * i / n); };
    for (int i = 0; i < ticks; ++i) port += k * x(i - late) * (x(i + 1) - x(i));
    EXPECT_NEAR(-port, leak, 1e-12 * leak * std::max(1.0, n / 100));
    const double omega = 2.0 * pi / (n * t);
    expect_printed(pi * k * a * a * omega * (t / 2 + d * t), continuous);
    expect_printed(pi * a * a * omega * colgate_damping(k, 0.0, t, late), continuous);
  }
}

}  // namespace
}  // namespace twoport::lab::oracle_test
