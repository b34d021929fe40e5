#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <ostream>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/base/time.h"
#include "common/link/delay_line.h"
#include "common/link/impairment.h"
#include "common/link/mailbox.h"
#include "common/link/report.h"

namespace twoport::link_test {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr double kRate = 2000.0;
constexpr std::uint64_t kSeed = 20240611;

Duration at(std::int64_t tick) {
  return tick_time(tick, kRate);
}

// --- a stream through one direction --------------------------------------------------------------

struct Named {
  std::string name;
  ImpairmentOptions options;
};
void PrintTo(const Named& n, std::ostream* out) {
  *out << n.name;
}

std::vector<Named> every_impairment() {
  std::vector<Named> all;
  const auto add = [&](const std::string& name, auto set) {
    ImpairmentOptions o;
    set(o);
    all.push_back({name, o});
  };
  add("Nothing", [](auto&) {});
  add("Delay", [](auto& o) { o.delay_s = 0.05; });
  add("Loss", [](auto& o) { o.delay_s = 0.01, o.loss = 0.4; });
  add("NormalJitter", [](auto& o) { o.delay_s = 0.05, o.jitter_s = 0.02; });
  add("NormalJitterAsLargeAsTheDelay", [](auto& o) { o.delay_s = 0.01, o.jitter_s = 0.1; });
  add("UniformJitter",
      [](auto& o) { o.delay_s = 0.05, o.jitter_s = 0.02, o.jitter_distribution = JitterDistribution::uniform; });
  add("ParetoJitter",
      [](auto& o) { o.delay_s = 0.05, o.jitter_s = 0.02, o.jitter_distribution = JitterDistribution::pareto; });
  add("Reorder", [](auto& o) { o.delay_s = 0.002, o.reorder = 0.2; });
  add("Duplication", [](auto& o) { o.delay_s = 0.02, o.jitter_s = 0.005, o.duplicate = 0.3; });
  add("Blackout", [](auto& o) { o.delay_s = 0.01, o.blackout = {{0.0, 0.1}, {1.0, 0.3}, {2.4, 0.1}}; });
  add("Bursts", [](auto& o) { o.delay_s = 0.01, o.burst = GilbertElliottOptions{.p = 0.02, .r = 0.2}; });
  add("Recording", [](auto& o) { o.recorded_delay_s = {0.03, 0.001, 0.0, 0.2, 0.0005, -0.01}; });
  add("Everything", [](auto& o) {
    o.delay_s = 0.05, o.jitter_s = 0.02, o.loss = 0.1, o.reorder = 0.05, o.duplicate = 0.1;
    o.jitter_distribution = JitterDistribution::pareto;
    o.burst = GilbertElliottOptions{.p = 0.01, .r = 0.1, .loss_good = 0.02, .loss_bad = 0.9};
    o.blackout = {{0.0, 0.05}, {1.0, 0.2}};
  });
  return all;
}

/// One end of two lines, that notes every sequence it hands over.
struct End {
  DelayLine<Report<1>>* out;
  DelayLine<Report<1>>* in;
  std::vector<std::uint64_t>* heard;

  template <class Offer>
  void poll(Duration now, Offer offer) noexcept {
    while (const Report<1>* r = in->take(now)) {
      heard->push_back(r->sequence);
      offer(*r);
    }
  }
  void send(const Report<1>& r, Duration now) noexcept { out->put(r, now); }
};

constexpr AgeOptions kAnyAge{.hold_after = std::chrono::hours{24}};  // nothing is sent back

/// A side that tells its growing energy each tick, and a side that listens.
struct Stream {
  DelayLine<Report<1>> there, back;
  std::vector<std::uint64_t> heard, unused;
  Mailbox<1, End> sender, receiver;
  std::mt19937_64 rng{kSeed};
  std::vector<double> total{0.0};  ///< total[s]: what report s says

  explicit Stream(const ImpairmentOptions& options)
      : there{options, kSeed, 1 << 14},
        back{ImpairmentOptions{}, kSeed + 1},
        sender{End{&there, &back, &unused}},
        receiver{End{&back, &there, &heard}, kAnyAge} {}
  Stream(const Stream&) = delete;

  void post(std::int64_t tick) {
    const double more = std::uniform_real_distribution<double>{0.0, 1e-3}(rng);
    total.push_back(total.back() + more);
    Report<1> r;
    r.energy_in_j = total.back();
    sender.post(r, at(tick));
  }
  [[nodiscard]] std::uint64_t posted() const { return sender.counts().sent; }
};

class Impaired : public ::testing::TestWithParam<Named> {};
INSTANTIATE_TEST_SUITE_P(By, Impaired, ::testing::ValuesIn(every_impairment()),
                         [](const auto& instance) { return instance.param.name; });

constexpr std::int64_t kTicks = 5000, kDrain = 1 << 20;  // 2.5 s, and longer than any delay drawn here

TEST_P(Impaired, NeverKnowsMoreThanWasSentAndNeverForgets) {
  Stream s{GetParam().options};
  double known = 0.0;
  std::uint64_t newest = 0;
  for (std::int64_t k = 0; k < kTicks; ++k) {
    const std::uint64_t before = s.posted();  // strictly before this tick
    s.post(k);
    const PeerState<1>& now = s.receiver.collect(at(k));
    ASSERT_GE(now.energy_in_j, known);
    ASSERT_GE(now.newest.sequence, newest);
    ASSERT_LE(now.newest.sequence, before) << "tick " << k;
    ASSERT_LE(now.energy_in_j, s.total[before]) << "tick " << k;
    known = now.energy_in_j;
    newest = now.newest.sequence;
    // The totals grow with the sequence, so the most that was heard is what the newest says; to the bit.
    ASSERT_EQ(known, s.total[newest]) << "tick " << k;
  }
  EXPECT_GT(known, 0.0);
}

TEST_P(Impaired, CountsAddUp) {
  Stream s{GetParam().options};
  for (std::int64_t k = 0; k < kTicks; ++k) {
    s.post(k);
    s.receiver.collect(at(k));
  }
  s.receiver.collect(at(kTicks + kDrain));

  const PacketCounts& c = s.receiver.counts();
  ASSERT_FALSE(s.heard.empty());
  const std::set<std::uint64_t> different(s.heard.begin(), s.heard.end());
  const std::uint64_t first = *different.begin(), newest = *different.rbegin();
  EXPECT_EQ(c.received, s.heard.size());
  EXPECT_EQ(c.received - c.duplicated, different.size());
  EXPECT_EQ(newest - first + 1, c.received - c.duplicated + c.lost);

  // Every packet sent: heard, lost between the first and the newest heard, or lost before or after them.
  const std::uint64_t sent = s.posted(), lost_before = first - 1, lost_after = sent - newest;
  EXPECT_EQ(sent, (c.received - c.duplicated) + c.lost + lost_before + lost_after);
  EXPECT_EQ(s.there.lost(), c.lost + lost_before + lost_after);
  EXPECT_EQ(s.there.overflowed(), 0U);

  // Late: heard for the first time after a newer one.
  std::set<std::uint64_t> seen;
  std::uint64_t late = 0;
  for (std::uint64_t q : s.heard) late += seen.insert(q).second && q < *seen.rbegin();
  EXPECT_EQ(c.late, late);
}

TEST_P(Impaired, DoesNotCareWhichSideIsSteppedFirst) {
  Stream sends_first{GetParam().options}, listens_first{GetParam().options};
  for (std::int64_t k = 0; k < kTicks; ++k) {
    sends_first.post(k);
    const PeerState<1>& a = sends_first.receiver.collect(at(k));
    const PeerState<1>& b = listens_first.receiver.collect(at(k));
    listens_first.post(k);
    ASSERT_EQ(a.newest.sequence, b.newest.sequence) << "tick " << k;
    ASSERT_EQ(a.energy_in_j, b.energy_in_j) << "tick " << k;
    ASSERT_EQ(a.is_new, b.is_new) << "tick " << k;
  }
}

TEST_P(Impaired, FatesAreTheSameFromTheSameSeedAndOthersFromAnother) {
  const ImpairmentOptions& o = GetParam().options;
  Impairment one{o, 1}, same{o, 1}, other{o, 2};
  bool differs = false;
  for (std::int64_t k = 0; k < 10'000; ++k) {
    const auto a = one.draw(at(k)), b = same.draw(at(k)), c = other.draw(at(k));
    ASSERT_EQ(a.copies, b.copies);
    ASSERT_EQ(a.delay[0], b.delay[0]);
    ASSERT_EQ(a.delay[1], b.delay[1]);
    ASSERT_GE(a.delay[0], Duration{0});
    ASSERT_GE(a.delay[1], Duration{0});
    differs = differs || a.copies != c.copies || a.delay[0] != c.delay[0];
  }
  const bool random = o.jitter_s > 0.0 || o.loss > 0.0 || o.burst || o.reorder > 0.0 || o.duplicate > 0.0;
  EXPECT_EQ(differs, random);
}

// --- the delay line ------------------------------------------------------------------------------

TEST(AnyDelayLine, OfAWholeNumberOfTicksDelaysByExactlyThatMany) {
  // Also where a tick is no whole number of nanoseconds.
  for (double rate : {500.0, 1000.0, 2000.0, 3000.0, 4096.0, 7000.0, 10'000.0}) {
    for (std::int64_t d : {1, 2, 3, 7, 50}) {
      ImpairmentOptions o;
      o.delay_s = static_cast<double>(d) / rate;
      DelayLine<std::int64_t> line{o, kSeed};
      for (std::int64_t k = 0; k < 5000; ++k) {
        line.put(k, tick_time(k, rate));
        const std::int64_t* out = line.take(tick_time(k, rate));
        if (k < d) {
          ASSERT_EQ(out, nullptr) << rate << " Hz, " << d << " ticks, tick " << k;
        } else {
          ASSERT_NE(out, nullptr) << rate << " Hz, " << d << " ticks, tick " << k;
          ASSERT_EQ(*out, k - d) << rate << " Hz, " << d << " ticks";
        }
        ASSERT_EQ(line.take(tick_time(k, rate)), nullptr);
      }
    }
  }
}

TEST(AnyDelayLine, KeepsWhatIsPutInAtAMomentUntilALaterOne) {
  DelayLine<int> line{ImpairmentOptions{}, kSeed};
  line.put(7, Duration{1000});
  EXPECT_EQ(line.take(Duration{1000}), nullptr);
  ASSERT_NE(line.take(Duration{1001}), nullptr);
  EXPECT_EQ(line.take(Duration{5000}), nullptr);
}

TEST(AnyDelayLine, HandsOverInOrderOfDueTimeAndFirstInFirstOutWhereEqual) {
  ImpairmentOptions o;
  o.recorded_delay_s = {0.005, 0.001, 0.003, 0.003, 0.001};
  DelayLine<int> line{o, kSeed};
  for (int i = 0; i < 5; ++i) line.put(i, Duration{0});
  for (int expected : {1, 4, 2, 3, 0}) {
    const int* out = line.take(milliseconds{10});
    ASSERT_NE(out, nullptr);
    EXPECT_EQ(*out, expected);
  }
  EXPECT_EQ(line.take(milliseconds{10}), nullptr);
}

TEST(AnyDelayLine, DropsAndCountsWhatFindsItFull) {
  ImpairmentOptions o;
  o.delay_s = 1.0;
  DelayLine<int> line{o, kSeed, 4};
  for (int i = 0; i < 6; ++i) line.put(i, Duration{i});
  EXPECT_EQ(line.overflowed(), 2U);
  EXPECT_EQ(line.lost(), 0U);
  for (int i = 0; i < 4; ++i) {
    const int* out = line.take(std::chrono::seconds{2});
    ASSERT_NE(out, nullptr);
    EXPECT_EQ(*out, i);
  }
  EXPECT_EQ(line.take(std::chrono::seconds{2}), nullptr);
  line.put(9, std::chrono::seconds{2});
  EXPECT_NE(line.take(std::chrono::seconds{3}), nullptr);
}

TEST(AnyDelayLine, AgreesWithAListSortedByDueTimeOverManyTurnsOfTheRing) {
  // Reference: every copy with its due time, sorted stably.
  ImpairmentOptions o;
  o.delay_s = 0.01, o.jitter_s = 0.004, o.loss = 0.1, o.duplicate = 0.2, o.reorder = 0.1;
  DelayLine<int> line{o, 5, 128};
  Impairment fates{o, 5};
  struct Copy {
    Duration put, due;
    int packet;
  };
  std::vector<Copy> waiting;
  for (int k = 0; k < 20'000; ++k) {
    const Impairment::Fate fate = fates.draw(at(k));
    for (int c = 0; c < fate.copies; ++c) waiting.push_back({at(k), at(k) + fate.delay[c], k});
    line.put(k, at(k));
    std::stable_sort(waiting.begin(), waiting.end(), [](const Copy& a, const Copy& b) { return a.due < b.due; });
    while (const int* out = line.take(at(k))) {
      ASSERT_FALSE(waiting.empty());
      ASSERT_EQ(*out, waiting.front().packet) << "tick " << k;
      ASSERT_LE(waiting.front().due, at(k) + nanoseconds{1});
      waiting.erase(waiting.begin());
    }
    ASSERT_TRUE(waiting.empty() || waiting.front().due > at(k) || waiting.front().put >= at(k)) << "tick " << k;
  }
  EXPECT_EQ(line.overflowed(), 0U);
}

// --- impairments against their closed forms ------------------------------------------------------

constexpr int kDraws = 200'000;

/// `count` of n independent draws of probability p, within 4 standard deviations (6e-5 of seeds would fail).
void expect_rate(std::int64_t count, std::int64_t n, double p, double variance_factor = 1.0) {
  const double mean = static_cast<double>(count) / static_cast<double>(n);
  EXPECT_NEAR(mean, p, 4.0 * std::sqrt(p * (1.0 - p) * variance_factor / static_cast<double>(n)));
}

TEST(Loss, HasTheRateAskedFor) {
  for (double p : {0.01, 0.3, 0.9}) {
    ImpairmentOptions o;
    o.loss = p;
    Impairment impairment{o, kSeed};
    std::int64_t lost = 0;
    for (int i = 0; i < kDraws; ++i) lost += impairment.draw(Duration{i}).copies == 0;
    expect_rate(lost, kDraws, p);
  }
}

TEST(Loss, OfOneIsCertainAndOfZeroNever) {
  ImpairmentOptions all, none;
  all.loss = 1.0;
  none.jitter_s = 0.001;
  Impairment always{all, kSeed}, never{none, kSeed};
  for (int i = 0; i < 1000; ++i) {
    ASSERT_EQ(always.draw(Duration{i}).copies, 0);
    ASSERT_EQ(never.draw(Duration{i}).copies, 1);
  }
}

TEST(Duplication, HasTheRateAskedForAmongWhatIsNotLost) {
  ImpairmentOptions o;
  o.duplicate = 0.3, o.loss = 0.2;
  Impairment impairment{o, kSeed};
  std::int64_t arrived = 0, twice = 0;
  for (int i = 0; i < kDraws; ++i) {
    const int copies = impairment.draw(Duration{i}).copies;
    arrived += copies > 0;
    twice += copies == 2;
  }
  expect_rate(twice, arrived, 0.3);
  expect_rate(arrived, kDraws, 0.8);
}

TEST(Reordering, HoldsTheAskedShareBackByTheAskedTime) {
  ImpairmentOptions o;
  o.delay_s = 0.01, o.reorder = 0.1, o.reorder_s = 0.005;
  Impairment impairment{o, kSeed};
  std::int64_t held_back = 0;
  for (int i = 0; i < kDraws; ++i) {
    const Duration delay = impairment.draw(Duration{i}).delay[0];
    ASSERT_TRUE(delay == milliseconds{10} || delay == milliseconds{15});
    held_back += delay == milliseconds{15};
  }
  expect_rate(held_back, kDraws, 0.1);
}

TEST(Bursts, LoseWhatTheStationaryChainLoses) {
  // Bad with probability p/(p+r). Losses of neighbours correlate by 1-p-r per packet, which widens the deviation of the
  // mean by at most (1+c)/(1-c), c = 1-p-r.
  for (const GilbertElliottOptions& b : {GilbertElliottOptions{.p = 0.01, .r = 0.1},
                                         GilbertElliottOptions{.p = 0.02, .r = 0.3, .loss_good = 0.01, .loss_bad = 0.7},
                                         GilbertElliottOptions{.p = 0.6, .r = 0.5}}) {
    ImpairmentOptions o;
    o.burst = b;
    Impairment impairment{o, kSeed};
    std::int64_t lost = 0;
    for (int i = 0; i < kDraws; ++i) lost += impairment.draw(Duration{i}).copies == 0;
    const double bad = b.p / (b.p + b.r), c = 1.0 - b.p - b.r;
    expect_rate(lost, kDraws, bad * b.loss_bad + (1.0 - bad) * b.loss_good, std::max(1.0, (1.0 + c) / (1.0 - c)));
  }
}

TEST(Bursts, LastOneOverR) {
  // Lengths are geometric: mean 1/r, standard deviation sqrt(1-r)/r.
  constexpr double kR = 0.1;
  ImpairmentOptions o;
  o.burst = GilbertElliottOptions{.p = 0.02, .r = kR};
  Impairment impairment{o, kSeed};
  std::int64_t bursts = 0, lost = 0;
  bool before = false;
  for (int i = 0; i < kDraws; ++i) {
    const bool gone = impairment.draw(Duration{i}).copies == 0;
    bursts += gone && !before;
    lost += gone;
    before = gone;
  }
  EXPECT_NEAR(static_cast<double>(lost) / static_cast<double>(bursts), 1.0 / kR,
              4.0 * std::sqrt(1.0 - kR) / kR / std::sqrt(static_cast<double>(bursts)));
}

TEST(Blackout, LosesEverythingInItsWindowAndNothingElseAndDrawsNoNumbers) {
  ImpairmentOptions plain, dark;
  plain.delay_s = dark.delay_s = 0.01;
  plain.jitter_s = dark.jitter_s = 0.002;
  dark.blackout = {{0.1, 0.05}, {0.3, 0.1}};
  Impairment a{plain, kSeed}, b{dark, kSeed};
  for (std::int64_t k = 0; k < 1000; ++k) {  // 0.5 ms apart
    const auto lit = a.draw(at(k)), fate = b.draw(at(k));
    const bool inside = (k >= 200 && k < 300) || (k >= 600 && k < 800);
    ASSERT_EQ(fate.copies, inside ? 0 : 1) << "tick " << k;
    ASSERT_EQ(fate.delay[0], lit.delay[0]) << "tick " << k;
  }
}

/// Delays less their mean, in units of the jitter.
std::vector<double> units(JitterDistribution distribution, double delay_s, double jitter_s) {
  ImpairmentOptions o;
  o.delay_s = delay_s, o.jitter_s = jitter_s, o.jitter_distribution = distribution;
  Impairment impairment{o, kSeed};
  std::vector<double> u;
  for (int i = 0; i < kDraws; ++i)
    u.push_back((to_seconds(impairment.draw(Duration{i}).delay[0]).si() - delay_s) / jitter_s);
  return u;
}
struct Moments {
  double mean = 0.0, second = 0.0, deviation_of_second = 0.0;
  explicit Moments(const std::vector<double>& u, double below = std::numeric_limits<double>::infinity()) {
    const double n = static_cast<double>(u.size());
    double fourth = 0.0;
    for (double x : u) {
      mean += x / n;
      if (x >= below) continue;
      second += x * x / n;
      fourth += x * x * x * x / n;
    }
    deviation_of_second = std::sqrt((fourth - second * second) / n);
  }
};
const double kMeanTolerance = 4.0 / std::sqrt(static_cast<double>(kDraws));  // 4 sigma of a mean of unit variance

TEST(Jitter, NormalHasTheAskedDeviation) {
  const Moments m{units(JitterDistribution::normal, 0.1, 0.01)};  // 10 deviations above 0: never cut off
  EXPECT_NEAR(m.mean, 0.0, kMeanTolerance);
  EXPECT_NEAR(m.second, 1.0, 4.0 * std::sqrt(2.0 / kDraws));  // variance of x²: 2
}

TEST(Jitter, NormalFallsWhereANormalFalls) {
  const auto u = units(JitterDistribution::normal, 0.1, 0.01);
  for (double x : {-2.0, -1.0, 0.0, 0.5, 1.5, 3.0})
    expect_rate(std::count_if(u.begin(), u.end(), [x](double y) { return y < x; }), kDraws,
                0.5 * std::erfc(-x / std::sqrt(2.0)));
}

TEST(Jitter, UniformHasTheAskedDeviationAndIsFlatAndBounded) {
  const auto u = units(JitterDistribution::uniform, 0.1, 0.01);
  const Moments m{u};
  EXPECT_NEAR(m.mean, 0.0, kMeanTolerance);
  EXPECT_NEAR(m.second, 1.0, 4.0 * std::sqrt(0.8 / kDraws));  // variance of x²: 9/5 - 1
  const double half = std::sqrt(3.0);
  EXPECT_GE(*std::min_element(u.begin(), u.end()), -half - 1e-6);  // a nanosecond is 1e-7
  EXPECT_LE(*std::max_element(u.begin(), u.end()), half + 1e-6);
  for (double x : {-1.5, -0.5, 0.0, 1.0})
    expect_rate(std::count_if(u.begin(), u.end(), [x](double y) { return y < x; }), kDraws, (x + half) / (2.0 * half));
}

TEST(Jitter, ParetoHasTheAskedDeviationAndTheTailOfIndexThree) {
  // x = (y - 3/2)/sqrt(3/4) with P(y > c) = c^-3. Its fourth moment does not exist, so the second is compared up to c:
  // 3 (1/4 - 1/c + 3/(2c²) - 3/(4c³)) / (3/4), which goes to 1.
  const auto u = units(JitterDistribution::pareto, 0.1, 0.01);
  const auto unit = [](double c) { return (c - 1.5) / std::sqrt(0.75); };
  EXPECT_NEAR(Moments{u}.mean, 0.0, kMeanTolerance);
  for (double c : {2.0, 5.0, 20.0}) {
    const Moments below{u, unit(c)};
    const double closed = 4.0 * (0.25 - 1.0 / c + 1.5 / (c * c) - 0.75 / (c * c * c));
    EXPECT_NEAR(below.second, closed, 4.0 * below.deviation_of_second) << c;
    expect_rate(std::count_if(u.begin(), u.end(), [&](double y) { return y > unit(c); }), kDraws, std::pow(c, -3.0));
  }
  EXPECT_GE(*std::min_element(u.begin(), u.end()), unit(1.0) - 1e-6);
}

TEST(Jitter, NeverMakesADelayNegative) {
  // At half a deviation above 0 the normal is cut off with probability Phi(-1/2).
  ImpairmentOptions o;
  o.delay_s = 0.005, o.jitter_s = 0.01;
  Impairment impairment{o, kSeed};
  std::int64_t cut = 0;
  for (int i = 0; i < kDraws; ++i) {
    const Duration delay = impairment.draw(Duration{i}).delay[0];
    ASSERT_GE(delay, Duration{0});
    cut += delay == Duration{0};
  }
  expect_rate(cut, kDraws, 0.5 * std::erfc(0.5 / std::sqrt(2.0)));
}

TEST(Recording, IsReplayedInALoopInPlaceOfDelayAndJitter) {
  ImpairmentOptions o;
  o.delay_s = 1.0, o.jitter_s = 1.0;
  o.recorded_delay_s = {0.003, 0.001, -0.5};  // a clock that was off: not before it was sent
  Impairment impairment{o, kSeed};
  for (int turn = 0; turn < 5; ++turn)
    for (int ms : {3, 1, 0}) EXPECT_EQ(impairment.draw(Duration{0}).delay[0], milliseconds{ms});
}

// --- the mailbox ---------------------------------------------------------------------------------

/// Hands over what the test has put there.
struct Script {
  std::vector<Report<1>>* arriving;
  std::vector<Report<1>>* sent;
  template <class Offer>
  void poll(Duration, Offer offer) noexcept {
    for (const Report<1>& r : *arriving) offer(r);
    arriving->clear();
  }
  void send(const Report<1>& r, Duration) noexcept { sent->push_back(r); }
};
class MailboxOf : public ::testing::Test {
 protected:
  static Report<1> report(std::uint64_t sequence, double energy = 0.0) {
    Report<1> r;
    r.sequence = sequence;
    r.energy_in_j = energy;
    return r;
  }
  const PacketCounts& after(const std::vector<std::uint64_t>& sequences) {
    for (std::uint64_t q : sequences) {
      arriving.push_back(report(q));
      box.collect(Duration{0});
    }
    return box.counts();
  }
  std::vector<Report<1>> arriving, sent;
  Mailbox<1, Script> box{Script{&arriving, &sent}, kAnyAge};
};

TEST_F(MailboxOf, AGapThatIsFilledWasLateAndNotLost) {
  EXPECT_EQ(after({1, 4}).lost, 2U);
  EXPECT_EQ(after({3}).lost, 1U);
  EXPECT_EQ(box.counts().late, 1U);
  EXPECT_EQ(after({3, 4, 1}).duplicated, 3U);
  EXPECT_EQ(box.counts().lost, 1U);
  EXPECT_EQ(box.counts().received, 6U);
}

TEST_F(MailboxOf, AReportOlderThanTheFirstHeardFillsNoGapOfAnother) {
  // 3 is lost. That 1 comes late does not bring it back.
  EXPECT_EQ(after({2, 4, 1}).lost, 1U);
  EXPECT_EQ(box.counts().late, 1U);
  EXPECT_EQ(box.counts().duplicated, 0U);
}

TEST_F(MailboxOf, AReportOlderThanTheFirstHeardOpensTheGapBehindIt) {
  EXPECT_EQ(after({5}).lost, 0U);  // where a session begins is not known
  EXPECT_EQ(after({2}).lost, 2U);
  EXPECT_EQ(after({3, 4}).lost, 0U);
  EXPECT_EQ(after({3}).duplicated, 1U);
  EXPECT_EQ(box.counts().late, 3U);
}

TEST_F(MailboxOf, ARepeatIsToldFromALateReportOverSecondsOfJitter) {
  // All even ones, then all odd ones: up to 4000 sequences, 2 s at 2 kHz, late.
  std::vector<std::uint64_t> order;
  for (std::uint64_t q = 2; q <= 4000; q += 2) order.push_back(q);
  for (std::uint64_t q = 1; q <= 4000; q += 2) order.push_back(q);
  EXPECT_EQ(after(order).lost, 0U);
  EXPECT_EQ(box.counts().late, 2000U);
  EXPECT_EQ(box.counts().duplicated, 0U);
  EXPECT_EQ(after(order).duplicated, 4000U);
}

TEST_F(MailboxOf, WhatIsOlderThanTheMemoryCountsAsRepeatedAndTheSumStillHolds) {
  const PacketCounts& c = after({1, 4'000, 8'000, 2, 7'999, 12'000, 7'999});
  EXPECT_EQ(c.duplicated, 2U);
  EXPECT_EQ(c.late, 1U);
  EXPECT_EQ(12'000 - 1 + 1, c.received - c.duplicated + c.lost);
}

TEST_F(MailboxOf, AJumpOfTheSequenceIsRejectedAndChangesNothing) {
  after({1, 2});
  for (const std::uint64_t jump : {std::uint64_t{1} << 63, std::uint64_t{10'000}, ~std::uint64_t{0}}) {
    arriving = {report(jump, 1e9)};
    EXPECT_FALSE(box.collect(Duration{0}).is_new);
  }
  EXPECT_EQ(box.counts().rejected, 3U);
  EXPECT_EQ(box.counts().received, 2U);
  EXPECT_EQ(box.known().energy_in_j, 0.0);
  arriving = {report(3)};
  EXPECT_TRUE(box.collect(Duration{0}).is_new);
  EXPECT_EQ(box.counts().lost, 0U);
}

TEST_F(MailboxOf, AJumpThatGoesOnIsBelieved) {
  EXPECT_EQ(after({1, 2, 1'000'000, 1'000'001, 1'000'002}).rejected, 1U);
  EXPECT_EQ(box.known().newest.sequence, 1'000'002U);
  EXPECT_EQ(box.counts().lost, 0U);
}

TEST_F(MailboxOf, AfterASilenceAsManyAreMissingAsTheSenderCanHaveSent) {
  after({1});
  arriving = {report(7'200'001)};  // an hour at 2 kHz
  EXPECT_TRUE(box.collect(std::chrono::hours{1}).is_new);
  EXPECT_EQ(box.counts().lost, 7'199'999U);
  EXPECT_EQ(box.counts().rejected, 0U);
}

TEST_F(MailboxOf, AWrongSequenceThatWasBelievedDeafensForASecond) {
  for (const std::uint64_t wrong : {std::uint64_t{1} << 63, std::uint64_t{4'000}}) {
    box.reset(Duration{0});
    std::uint64_t next = 10;
    if (wrong == 4'000) {  // far ahead, but not too far
      arriving = {report(next++)};
      box.collect(at(0));
    }
    arriving = {report(wrong)};
    EXPECT_TRUE(box.collect(at(0)).is_new);
    std::int64_t tick = 1;
    do {
      arriving = {report(next++)};
    } while (!box.collect(at(tick++)).is_new && tick < 10'000);
    EXPECT_LE(at(tick - 1), milliseconds{1002});
    arriving = {report(next)};
    EXPECT_TRUE(box.collect(at(tick)).is_new);
    EXPECT_LT(box.counts().lost, 5'000U);
  }
}

TEST_F(MailboxOf, TheLargestEnergyWinsWhateverTheOrder) {
  arriving = {report(3, 0.5), report(1, 0.9), report(4, 0.2)};
  const PeerState<1>& known = box.collect(Duration{0});
  EXPECT_EQ(known.energy_in_j, 0.9);
  EXPECT_EQ(known.newest.sequence, 4U);
}

TEST_F(MailboxOf, IsFreshOnlyInTheTickThatBringsANewerReport) {
  EXPECT_FALSE(box.collect(Duration{1}).has_report);
  arriving = {report(2)};
  EXPECT_TRUE(box.collect(Duration{2}).is_new);
  EXPECT_FALSE(box.collect(Duration{3}).is_new);
  arriving = {report(1), report(2)};
  EXPECT_FALSE(box.collect(Duration{4}).is_new);
  EXPECT_TRUE(box.collect(Duration{4}).has_report);
  EXPECT_EQ(box.collect(Duration{5}).received_at, Duration{2});
}

TEST_F(MailboxOf, ANewSessionStartsFromNothingKnown) {
  arriving = {report(100, 5.0)};
  box.collect(Duration{1});
  box.reset(Duration{1});
  arriving = {report(1, 0.1)};
  const PeerState<1>& known = box.collect(Duration{2});
  EXPECT_EQ(known.newest.sequence, 1U);
  EXPECT_EQ(known.energy_in_j, 0.1);
  EXPECT_EQ(box.counts().lost, 0U);
  EXPECT_EQ(after({3, 2}).lost, 0U);
  EXPECT_EQ(box.counts().late, 1U);
}

TEST_F(MailboxOf, NumbersAndStampsWhatItPosts) {
  box.post(Report<1>{}, Duration{10});
  box.post(Report<1>{}, Duration{20});
  ASSERT_EQ(sent.size(), 2U);
  EXPECT_EQ(sent[0].sequence, 1U);
  EXPECT_EQ(sent[1].sequence, 2U);
  EXPECT_EQ(sent[1].sent_ns, 20);
  EXPECT_EQ(sent[1].echo_ns, -1);  // nothing heard yet
  EXPECT_EQ(box.counts().sent, 2U);
}

/// An end that tells time by another clock.
struct Abroad {
  End end;
  Duration offset;
  template <class Offer>
  void poll(Duration now, Offer offer) noexcept {
    end.poll(now - offset, offer);
  }
  void send(const Report<1>& r, Duration now) noexcept { end.send(r, now - offset); }
};

TEST(RoundTrip, IsTheSumOfBothDelaysWhateverTheOtherSidesClockAndPatience) {
  // The other side's clock is an hour off, and it answers at its own ticks, 2.5 times slower: the report waits there.
  ImpairmentOptions to, fro;
  to.delay_s = 0.02;
  fro.delay_s = 0.03;
  DelayLine<Report<1>> there{to, kSeed}, back{fro, kSeed};
  std::vector<std::uint64_t> unused;
  Mailbox<1, End> master{End{&there, &back, &unused}};

  const Duration offset = std::chrono::hours{1};
  Mailbox<1, Abroad> slave{Abroad{End{&back, &there, &unused}, offset}};

  int measured = 0;
  Duration slave_tick = nanoseconds{1'250'000};
  for (std::int64_t k = 0; k < 1000; ++k) {
    const PeerState<1>& known = master.collect(at(k));
    if (known.is_new && known.round_trip() >= Duration{0}) {
      ++measured;
      // Posts of the slave fall on its own ticks of 2.5 of ours: rounded up to ours at arrival.
      ASSERT_GE(known.round_trip(), milliseconds{50});
      ASSERT_LE(known.round_trip(), milliseconds{50} + nanoseconds{500'000});
    }
    master.post(Report<1>{}, at(k));
    for (; slave_tick <= at(k + 1); slave_tick += nanoseconds{1'250'000}) {
      slave.collect(slave_tick + offset);
      slave.post(Report<1>{}, slave_tick + offset);
    }
  }
  EXPECT_GT(measured, 300);
}

}  // namespace
}  // namespace twoport::link_test
