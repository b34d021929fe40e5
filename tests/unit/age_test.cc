#include "common/link/age.h"

#include <gtest/gtest.h>

#include <random>

namespace twoport::age_test {
namespace {

using std::chrono::milliseconds;

constexpr double kMs = 1e6;  // [ns]
Duration ms(double t) {
  return Duration{static_cast<std::int64_t>(t * kMs)};
}

/// Reports of a partner, each a millisecond after the last one. Returns how many of `n` are young, from `from` on.
template <class AgeAt>
int young(ReportAge& age, double from_ms, int n, AgeAt age_at) {
  int all = 0;
  for (int i = 0; i < n; ++i) {
    const double now = from_ms + i;
    all += age.admits(ms(now - age_at(i)), ms(now)) ? 1 : 0;
  }
  return all;
}

TEST(ReportAge, AReportOfAKnownLinkIsYoungFromTheFirstOn) {
  ReportAge age{{.round_trip = ms(100)}};
  EXPECT_TRUE(age.admits_first(ms(0), ms(200)));
  EXPECT_FALSE(age.admits_first(ms(0), ms(200.1)));
  EXPECT_EQ(young(age, 200, 1000, [](int) { return 105.0; }), 1000);
}

TEST(ReportAge, ALinkThatIsNotKnownIsLearnedWithinThreeWindows) {
  ReportAge age;
  EXPECT_GE(young(age, 5000, 1000, [](int) { return 600.0; }), 1000 - 151);
  EXPECT_NEAR(to_seconds(age.round_trip()).si(), 0.6, 1e-9);
}

TEST(ReportAge, HoldAfterBeyondTheRoundTripIsTooOld) {
  ReportAge age;
  ASSERT_EQ(young(age, 1000, 100, [](int) { return 20.0; }), 100);
  EXPECT_TRUE(age.admits(ms(1100 - 119), ms(1100)));
  EXPECT_FALSE(age.admits(ms(1101 - 122), ms(1101)));
}

// A partner that hears nothing sends back the same stamp for ever.
TEST(ReportAge, OfADeadDirectionGrowsAndIsNeverLearned) {
  ReportAge age{{.round_trip = ms(20)}};
  ASSERT_EQ(young(age, 1000, 1000, [](int) { return 20.0; }), 1000);
  EXPECT_NEAR(young(age, 2000, 20000, [](int i) { return 20.0 + i; }), 101, 1);
  EXPECT_FALSE(age.is_answered());
}

// A report each 80 ms, of those said each millisecond.
TEST(ReportAge, OfASlowReplayIsNeverLearned) {
  ReportAge age{{.round_trip = ms(20)}};
  ASSERT_EQ(young(age, 1000, 1000, [](int) { return 20.0; }), 1000);
  int all = 0;
  for (int i = 1; i < 200; ++i) all += age.admits(ms(1980 + i), ms(2000 + 80 * i)) ? 1 : 0;
  EXPECT_LE(all, 1);
}

// Each stamp comes back, half as fast as the clock goes.
TEST(ReportAge, OfAReplayAtHalfSpeedIsNeverLearned) {
  ReportAge age{{.round_trip = ms(20)}};
  ASSERT_EQ(young(age, 1000, 1000, [](int) { return 20.0; }), 1000);
  EXPECT_LE(young(age, 2000, 5000, [](int i) { return 20.0 + 0.5 * i; }), 340);
}

// A stall of 3 s; then what has waited comes, 20 reports in a millisecond.
TEST(ReportAge, OfADrainedQueueIsYoungOnlyAtItsEnd) {
  ReportAge age{{.round_trip = ms(20)}};
  ASSERT_EQ(young(age, 1000, 1000, [](int) { return 20.0; }), 1000);
  double least = 1e9;
  for (int i = 0; i < 3000; ++i) {
    const double now = 5000 + i / 20.0, made = 2000 + i;
    if (age.admits(ms(made - 20), ms(now))) least = std::min(least, made);
  }
  EXPECT_GE(least, 5000 - 100 - 1);
}

TEST(ReportAge, OfAStepOfTheDelayIsLearnedWithinThreeWindows) {
  ReportAge age{{.round_trip = ms(20)}};
  ASSERT_EQ(young(age, 1000, 1000, [](int) { return 20.0; }), 1000);
  EXPECT_GE(young(age, 2500, 1000, [](int) { return 500.0; }), 1000 - 151);
  EXPECT_EQ(young(age, 3500, 1000, [](int) { return 30.0; }), 1000) << "and back at once";
}

TEST(ReportAge, JitterIsNotTakenForAge) {
  std::mt19937 rng{1};
  std::exponential_distribution<double> late{1.0 / 30.0};
  ReportAge age{{.round_trip = ms(200)}};
  double newest = 0.0;
  int all = 0, all_young = 0;
  for (int i = 0; i < 20000; ++i) {
    const double now = 1000 + i, echo = now - 200 - late(rng);
    if (echo < newest) continue;  // the network reorders: an older report
    newest = echo;
    ++all;
    all_young += age.admits(ms(echo), ms(now)) ? 1 : 0;
  }
  EXPECT_GT(all, 4000);
  EXPECT_GE(all_young, 0.999 * all);
}

TEST(ReportAge, AStampOfTheFutureIsNobodys) {
  ReportAge age{{.round_trip = ms(20)}};
  EXPECT_FALSE(age.admits(ms(1001), ms(1000)));
  EXPECT_EQ(young(age, 1001, 100, [](int) { return 20.0; }), 100) << "and changes nothing";
}

TEST(ReportAge, NoQueueMakesALinkLongerThanFiveSeconds) {
  ReportAge age{{.round_trip = ms(20)}};
  young(age, 1000, 60000, [](int i) { return 20.0 + 0.18 * i; });
  EXPECT_LE(to_seconds(age.round_trip()).si(), 5.0);
  EXPECT_EQ(young(age, 61000, 1000, [](int i) { return 20.0 + 0.18 * (60000 + i); }), 0);
}

TEST(ReportAge, TheRoundTripRisesSlowly) {
  ReportAge age{{.round_trip = ms(20)}};
  young(age, 1000, 1000, [](int) { return 20.0; });
  EXPECT_GT(young(age, 2000, 5000, [](int i) { return 20.0 + 0.09 * i; }), 4999) << "with a queue that fills slowly";
}

}  // namespace
}  // namespace twoport::age_test
