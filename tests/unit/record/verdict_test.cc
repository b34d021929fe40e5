#include "common/record/verdict.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

namespace twoport {
namespace {

/// An oscillation of 25 Hz that goes on by itself, as a verdict sees it.
struct Motion {
  double growth_per_tick = 0.0;  ///< ln ρ
  double paid_w = 0.1;           ///< by the network, at the first amplitude; in proportion to its square
  double speed = 0.1;            ///< first amplitude [m/s]
  double settles = 0.0;          ///< by this share of it, in seconds
  double slides_j = 0.0;         ///< lent and taken back by the hand, every five seconds
  double fast_share = 0.0;       ///< of the force, rms, above 30 Hz
  bool corrected = false, limited = false;
  double path_ends_s = 0.0, duration_s = 20.0, initial_energy_j = 1e-3;
};

constexpr double kRate = 2000.0;

Verdict verdict(const Motion& m) {
  Verdict judge{m.path_ends_s, m.duration_s, m.initial_energy_j};
  double energy = 0.0;
  for (int k = 0; k < static_cast<int>(m.duration_s * kRate); ++k) {
    const double a = m.speed * std::exp(m.growth_per_tick * k) * (1.0 + m.settles * std::exp(-k / kRate / 5.0)),
                 v = a * std::cos(157.0 * k / kRate);
    energy -= m.paid_w * (a * a) / (m.speed * m.speed) / kRate;
    if (!judge.add({.t_s = k / kRate,
                    .reach_m = 0.01,
                    .speed2 = v * v,
                    .port_energy_j = energy + m.slides_j * std::sin(2.0 * std::numbers::pi / 5.0 * k / kRate),
                    .force2 = 1.0,
                    .fast_force2 = m.fast_share * m.fast_share,
                    .corrected = m.corrected,
                    .limited = m.limited}))
      break;
  }
  return judge;
}

TEST(Verdict, SeesGrowthOfOneInTenMillionPerTickInAMinute) {
  const Verdict grows = verdict({.growth_per_tick = 1e-7, .duration_s = 60.0});
  const Verdict falls = verdict({.growth_per_tick = -1e-7, .duration_s = 60.0});
  EXPECT_FALSE(grows.stable());
  EXPECT_NE(grows.text().find("growing"), std::string::npos) << grows.text();
  EXPECT_TRUE(falls.stable()) << falls.text();
  EXPECT_EQ(falls.text(), "bounded and decaying");
}

TEST(Verdict, SeesGrowthBeforeTheNetworkHasPaidMuch) {
  // The store is a thousand times what is paid.
  EXPECT_FALSE(verdict({.growth_per_tick = 1e-6, .paid_w = 1e-4, .initial_energy_j = 2.0}).stable());
}

TEST(Verdict, LeavesGrowthToTheHandWhereThePortEnergyRises) {
  const Verdict fed_by_the_hand = verdict({.growth_per_tick = 1e-5, .paid_w = -0.1});
  EXPECT_TRUE(fed_by_the_hand.stable()) << fed_by_the_hand.text();
  EXPECT_FALSE(verdict({.growth_per_tick = 1e-4, .paid_w = -0.1}).stable()) << "tenfold all the same";
}

TEST(Verdict, BelievesAControllerThatHasCreditLeft) {
  const Motion swelling{.growth_per_tick = 1e-5, .paid_w = 0.01, .corrected = true, .initial_energy_j = 1.0};
  EXPECT_TRUE(verdict(swelling).stable()) << verdict(swelling).text();
  Motion tenfold = swelling;
  tenfold.growth_per_tick = 1e-4;
  tenfold.speed = 1e-3;
  tenfold.paid_w = 1e-5;
  EXPECT_TRUE(verdict(tenfold).stable()) << verdict(tenfold).text();
  tenfold.corrected = false;
  EXPECT_FALSE(verdict(tenfold).stable()) << verdict(tenfold).text();
  Motion broke = swelling;
  broke.initial_energy_j = 1e-3;
  EXPECT_FALSE(verdict(broke).stable()) << verdict(broke).text();
  Motion alone = swelling;
  alone.corrected = false;
  EXPECT_FALSE(verdict(alone).stable()) << verdict(alone).text();
}

TEST(Verdict, CallsALimitCycleThatTheNetworkFeedsSustained) {
  const Verdict cycle = verdict({});
  EXPECT_FALSE(cycle.stable());
  EXPECT_NE(cycle.text().find("sustained oscillation"), std::string::npos) << cycle.text();
  EXPECT_FALSE(verdict({.settles = 1e-3}).stable()) << verdict({.settles = 1e-3}).text();
  EXPECT_TRUE(verdict({.growth_per_tick = -1e-7}).stable());
  EXPECT_FALSE(verdict({.growth_per_tick = -1e-7, .limited = true}).stable()) << "no linear loop";
  EXPECT_TRUE(verdict({.growth_per_tick = -1e-5, .limited = true}).stable());
  EXPECT_TRUE(verdict({.paid_w = 0.0}).stable());
  EXPECT_TRUE(verdict({.initial_energy_j = 100.0}).stable()) << "from what the hand had put in";
}

TEST(Verdict, SeesAPaymentThroughWhatTheHandDoesMeanwhile) {
  const Motion sliding{.slides_j = 0.2, .fast_share = 0.6, .path_ends_s = 20.0};  // 0.125 J are paid in a window
  EXPECT_FALSE(verdict(sliding).stable()) << verdict(sliding).text();
  Motion unpaid = sliding;
  unpaid.paid_w = 0.0;
  EXPECT_TRUE(verdict(unpaid).stable()) << verdict(unpaid).text();
}

TEST(Verdict, LeavesToTheHandWhatIsSlowWhileThePathRuns) {
  EXPECT_TRUE(verdict({.fast_share = 0.4, .path_ends_s = 20.0}).stable());
  EXPECT_FALSE(verdict({.fast_share = 0.6, .path_ends_s = 20.0}).stable());
  EXPECT_FALSE(verdict({.fast_share = 0.4, .path_ends_s = 5.0}).stable()) << "the hand rests";
  EXPECT_TRUE(verdict({.growth_per_tick = 1e-6, .fast_share = 0.4, .path_ends_s = 20.0}).stable());
}

TEST(Verdict, NeedsSomethingThatMoves) {
  EXPECT_EQ(verdict({.speed = 1e-10}).text(), "bounded, at rest");
  Verdict silent{0.0, 1.0, 0.0};
  for (int k = 0; k < 2000; ++k) silent.add({k / kRate, 0, 0, 0, 0, 0, false});
  EXPECT_EQ(silent.text(), "bounded, at rest");
  EXPECT_TRUE(silent.stable());
}

TEST(Verdict, JudgesNothingFromLessThanHalfOfWhatWasPlanned) {
  Verdict cut{0.0, 100.0, 0.0};
  for (int k = 0; k < 40 * static_cast<int>(kRate); ++k)
    cut.add({k / kRate, 0.01, std::exp(1e-5 * k), -1.0 * k, 0, 0, false});
  EXPECT_TRUE(cut.stable());
  EXPECT_NE(cut.text().find("too short"), std::string::npos) << cut.text();
}

TEST(Verdict, EndsWhereThereIsNoUseInGoingOn) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN(),
                   kInfinite = std::numeric_limits<double>::infinity();
  for (const Verdict::Sample bad :
       {Verdict::Sample{0.5, 101.0, 0, 0, 0, 0, false}, Verdict::Sample{0.5, kNone, 0, 0, 0, 0, false},
        Verdict::Sample{0.5, 0, kNone, 0, 0, 0, false}, Verdict::Sample{0.5, 0, 0, kInfinite, 0, 0, false}}) {
    Verdict judge{0.0, 1.0, 0.0};
    EXPECT_TRUE(judge.add({0.4, 99.0, 1.0, 0, 0, 0, false}));
    EXPECT_FALSE(judge.add(bad));
    EXPECT_FALSE(judge.stable());
    EXPECT_EQ(judge.text(), "diverged at 0.5 s");
  }
}

}  // namespace
}  // namespace twoport
