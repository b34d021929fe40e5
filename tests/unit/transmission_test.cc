#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "common/base/random.h"
#include "common/link/clock_offset.h"
#include "common/link/deadband.h"
#include "common/link/delay_line.h"
#include "common/link/playout.h"

namespace twoport::transmission_test {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;
using std::chrono::seconds;

Report<1> sent_at(Duration sent) {
  Report<1> r;
  r.sent_ns = sent.count();
  return r;
}

// 1000 packets a second, 10 to 30 ms on the way; the sender's clock is an hour ahead.
TEST(Playout, TurnsJitterIntoAConstantDelay) {
  const Random random{1};
  const Duration ahead = seconds{3600};
  Playout<1> playout{0.025};
  std::vector<std::pair<Duration, Duration>> on_the_way;  // arrives, sent
  for (int k = 0; k < 4000; ++k)
    on_the_way.emplace_back(milliseconds{k} + to_duration(0.01 + 0.02 * random.uniform(static_cast<std::uint64_t>(k))),
                            milliseconds{k});
  std::sort(on_the_way.begin(), on_the_way.end());
  std::size_t next = 0;
  int used = 0;
  Duration before{-1};
  for (int k = 0; k < 8200; ++k) {
    const Duration now = microseconds{500} * k;
    for (; next < on_the_way.size() && on_the_way[next].first <= now; ++next)
      playout.put(sent_at(on_the_way[next].second + ahead), now);
    while (const Report<1>* r = playout.take(now)) {
      const Duration sent = Duration{r->sent_ns} - ahead;
      ++used;
      if (now < seconds{1}) continue;  // the smallest delay is not known yet
      EXPECT_GT(sent, before) << "out of order";
      before = sent;
      // 10 ms and 25 ms, to a tick of the receiver and what its least delay is off by.
      EXPECT_NEAR(to_seconds(now - sent).si(), 0.035, 1.1e-3);
    }
  }
  EXPECT_EQ(used, 4000);
  EXPECT_EQ(playout.overflowed(), 0U);
}

TEST(Playout, UsesAPacketThatIsLaterThanItsTimeAtOnce) {
  Playout<1> playout{0.01};
  playout.put(sent_at(milliseconds{0}), milliseconds{5});
  EXPECT_EQ(playout.take(milliseconds{14}), nullptr);
  EXPECT_NE(playout.take(milliseconds{15}), nullptr);
  playout.put(sent_at(milliseconds{10}), milliseconds{60});
  EXPECT_NE(playout.take(milliseconds{60}), nullptr);
}

TEST(Playout, FollowsADelayThatHasGrownWithinTwoSeconds) {
  Playout<1> playout{0.01};
  Duration used_at{0};
  for (int k = 0; k < 6000; ++k) {
    const Duration now = milliseconds{k};
    const Duration delay = k < 2000 ? milliseconds{5} : milliseconds{50};
    playout.put(sent_at(now - delay), now);
    while (playout.take(now) != nullptr) used_at = now;
  }
  EXPECT_EQ(used_at, milliseconds{5999});
  playout.put(sent_at(milliseconds{6000} - milliseconds{50}), milliseconds{6000});
  int waits = 0;
  for (; playout.take(milliseconds{6000}) != nullptr;) ++waits;
  EXPECT_LE(waits, 1) << "the packets of the last 10 ms wait";
}

TEST(Playout, ForgetsWhatWaitsWhenASessionEnds) {
  Playout<1> playout{0.01};
  playout.put(sent_at(milliseconds{0}), milliseconds{5});
  playout.clear();
  EXPECT_EQ(playout.take(seconds{1}), nullptr);
}

PortReport<1> with_force(double f) {
  PortReport<1> r;
  r.f = Force<1>{Force<1>::Vector::Constant(f)};
  return r;
}

TEST(Deadband, SendsWhatHasChangedByItsShareAndItsFloor) {
  Deadband<1> band{{.ratio = 0.1, .force_n = 0.05}};
  EXPECT_TRUE(band.tells(with_force(1.0), Duration{0})) << "the first";
  EXPECT_FALSE(band.tells(with_force(1.09), milliseconds{1}));
  EXPECT_TRUE(band.tells(with_force(1.11), milliseconds{2}));
  EXPECT_FALSE(band.tells(with_force(1.01), milliseconds{3})) << "against the last one sent";
  EXPECT_TRUE(band.tells(with_force(0.1), milliseconds{4}));
  EXPECT_FALSE(band.tells(with_force(0.14), milliseconds{5})) << "the floor";
  EXPECT_TRUE(band.tells(with_force(0.16), milliseconds{6}));
}

TEST(Deadband, SendsEnergyASilenceAndAChangeOfModeOrEpoch) {
  Deadband<1> band{{.energy_j = 1e-4, .silence_s = 0.02}};
  PortReport<1> r = with_force(1.0);
  EXPECT_TRUE(band.tells(r, Duration{0}));
  r.energy_in_j = 0.9e-4;
  EXPECT_FALSE(band.tells(r, milliseconds{1}));
  r.energy_in_j = 1.1e-4;
  EXPECT_TRUE(band.tells(r, milliseconds{2}));
  EXPECT_FALSE(band.tells(r, milliseconds{21}));
  EXPECT_TRUE(band.tells(r, milliseconds{22}));
  r.mode = Mode::coupled;
  EXPECT_TRUE(band.tells(r, milliseconds{23}));
  r.epoch = 1;
  EXPECT_TRUE(band.tells(r, milliseconds{24}));
}

TEST(Deadband, SendsEveryReportOfAStop) {
  Deadband<1> band{{}};
  PortReport<1> r = with_force(0.0);
  EXPECT_TRUE(band.tells(r, Duration{0}));
  EXPECT_FALSE(band.tells(r, milliseconds{1}));
  r.mode = Mode::stopped;
  for (int ms = 2; ms < 9; ++ms) EXPECT_TRUE(band.tells(r, milliseconds{ms})) << ms;
}

/// The estimate after `run_s` of packets both ways. The other clock is `offset_s` ahead and gains `drift`.
ClockOffset estimate(double offset_s, double drift, double there_s, double back_s, double jitter_s, double run_s) {
  const Random random{3};
  ClockOffset clock;
  const auto other = [&](double t) { return to_duration(offset_s + (1.0 + drift) * t).count(); };
  for (std::uint64_t k = 0; 1e-3 * static_cast<double>(k) < run_s; ++k) {
    const double sent = 1e-3 * static_cast<double>(k), reached = sent + there_s + jitter_s * random.uniform(k, 0),
                 back = reached + back_s + jitter_s * random.uniform(k, 1);
    PeerState<1> peer;
    peer.is_new = peer.has_report = true;
    peer.newest.sent_ns = other(reached);
    peer.newest.echo_ns = to_duration(sent).count();
    peer.received_at = to_duration(back);
    clock.step(peer);
  }
  return clock;
}

TEST(ClockOffset, IsExactWhereBothWaysTakeEquallyLong) {
  const ClockOffset clock = estimate(3.6, 0.0, 0.02, 0.02, 0.0, 3.0);
  EXPECT_NEAR(clock.offset_s(3.0), 3.6, 2e-9);  // nanoseconds, rounded twice
  EXPECT_NEAR(clock.one_way_s(), 0.02, 2e-9);
  EXPECT_NEAR(clock.bound_s(), 0.02, 1e-9);
}

TEST(ClockOffset, ErrsByHalfTheAsymmetryAndSaysSo) {
  const ClockOffset clock = estimate(0.0, 0.0, 0.005, 0.095, 0.0, 3.0);
  EXPECT_NEAR(clock.offset_s(3.0), -0.045, 1e-8);
  EXPECT_NEAR(clock.one_way_s(), 0.05, 1e-8);
  EXPECT_LE(std::abs(clock.offset_s(3.0)), clock.bound_s());
}

TEST(ClockOffset, SeesADriftOf200PpmThroughJitter) {
  const ClockOffset clock = estimate(10.0, 200e-6, 0.02, 0.02, 0.01, 30.0);
  // The best of a thousand packets errs by some 0.1 ms, and thirty of them lie on a line of 30 s.
  EXPECT_NEAR(clock.drift(), 200e-6, 5e-6);
  EXPECT_NEAR(clock.offset_s(30.0), 10.0 + 200e-6 * 30.0, 0.5e-3);
  EXPECT_LE(clock.bound_s(), 0.021);
}

TEST(DelayLine, StepsItsDelay) {
  ImpairmentOptions options;
  options.delay_s = 0.01;
  options.delay_step = {{0.1, 0.05}, {0.2, 0.002}};
  DelayLine<int> line{options, 1};
  const auto passes_after = [&](Duration at) {
    line.put(1, at);
    for (Duration now = at;; now += milliseconds{1})
      if (line.take(now) != nullptr) return now - at;
  };
  EXPECT_EQ(passes_after(milliseconds{99}), milliseconds{10});
  EXPECT_EQ(passes_after(milliseconds{110}), milliseconds{50});
  EXPECT_EQ(passes_after(milliseconds{200}), milliseconds{2});
}

}  // namespace
}  // namespace twoport::transmission_test
