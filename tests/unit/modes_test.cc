#include "common/runtime/modes.h"

#include <gtest/gtest.h>

#include <array>

namespace twoport::modes_test {
namespace {

using std::chrono::milliseconds;

constexpr std::array kModes{Mode::idle, Mode::coupled, Mode::holding, Mode::released, Mode::let_go};

/// All that can be known at a tick.
template <class Visit>
void for_every_health(Visit visit) {
  for (unsigned bits = 0; bits < 32; ++bits)
    visit(Health{.heard = (bits & 1) != 0,
                 .with_us = (bits & 2) != 0,
                 .silent = (bits & 4) != 0,
                 .may_begin = (bits & 8) != 0,
                 .let_go = (bits & 16) != 0});
}

TEST(Modes, NothingCouplesWithoutHearingTheOtherSide) {
  for (const Mode mode : kModes)
    for_every_health([&](const Health& h) {
      if (!h.heard) {
        EXPECT_NE(next_mode(mode, h), Mode::coupled);
      }
    });
}

TEST(Modes, WhatHasNoCouplingBeginsOneOnlyWhereTheOtherSideDoesToo) {
  for (const Mode mode : {Mode::idle, Mode::released})
    for_every_health([&](const Health& h) {
      const Mode next = next_mode(mode, h);
      if (h.heard && h.may_begin) {
        EXPECT_EQ(next, h.let_go ? Mode::let_go : Mode::coupled);
      } else {
        EXPECT_TRUE(next == mode || (h.heard && next == Mode::idle));
      }
    });
}

TEST(Modes, ACouplingGoesOnOnlyWhileBothSidesHaveIt) {
  for (const Mode mode : {Mode::coupled, Mode::holding})
    for_every_health([&](const Health& h) {
      const Mode expected = h.heard && h.with_us ? (h.let_go ? Mode::let_go : Mode::coupled)
                            : h.silent           ? Mode::released
                                                 : Mode::holding;
      EXPECT_EQ(next_mode(mode, h), expected);
    });
}

TEST(Modes, WhatWasLetGoCouplesAnewWhenItIsHeldAgain) {
  for_every_health([&](const Health& h) {
    if (!(h.heard && h.with_us)) {
      EXPECT_EQ(next_mode(Mode::let_go, h), Mode::released);
    } else if (!h.let_go) {
      EXPECT_EQ(next_mode(Mode::let_go, h), Mode::coupled);
    }
  });
  EXPECT_TRUE(begins(Mode::let_go, Mode::coupled));
}

TEST(Modes, DoNotFlickerWhileNothingChanges) {
  for (const Mode mode : kModes)
    for_every_health([&](const Health& h) {
      if (h.may_begin && !h.with_us) return;  // a coupling that has just begun has time: ModeMachine
      const Mode once = next_mode(mode, h), twice = next_mode(once, h);
      EXPECT_EQ(next_mode(twice, h), twice);
    });
}

TEST(Modes, OnlyWhatWasCoupledHolds) {
  for (const Mode mode : {Mode::idle, Mode::released, Mode::let_go})
    for_every_health([&](const Health& h) { EXPECT_NE(next_mode(mode, h), Mode::holding); });
}

/// One side, which hears the other one each millisecond. hold_after 100 ms, release_after 1 s, round trip 20 ms.
struct OneSide {
  ModeMachine modes{ControlOptions{}};
  PeerState<1> peer;
  int ms = 500;
  bool held = true;

  OneSide() {
    peer.has_report = true;
    peer.known_round_trip = milliseconds{20};
    peer.newest.mode = Mode::idle;
  }
  /// A tick in which a young report says `other`; it echoes the stamp of 20 ms ago.
  Mode hears(Mode other) {
    peer.newest.mode = peer.heard.mode = other;
    peer.newest.echo_ns = Duration{milliseconds{ms - 20}}.count();
    peer.proven_at = milliseconds{ms};
    peer.heard.is_new = true;
    return tick();
  }
  /// A tick without one.
  Mode tick() {
    const Duration now = milliseconds{ms++};
    if (!modes.is_stopped(HardwareStatus::ok, peer))
      begun += modes.step(now, peer, modes.has_let_go(now, held)) ? 1 : 0;
    peer.heard.is_new = false;
    return modes.mode();
  }
  /// Ticks of the same kind until the mode is `wanted`; -1: not within 5 s.
  int until(Mode wanted, auto one_tick) {
    for (int n = 1; n <= 5000; ++n)
      if (one_tick() == wanted) return n;
    return -1;
  }
  int begun = 0;
};

TEST(ModeMachine, TheFirstCouplingOfASessionBeginsWithTheFirstYoungReport) {
  OneSide side;
  EXPECT_EQ(side.tick(), Mode::idle) << "what is known is as old as the start";
  EXPECT_EQ(side.hears(Mode::idle), Mode::coupled);
  EXPECT_EQ(side.begun, 1);
}

TEST(ModeMachine, AnUnconfirmedCouplingHoldsAfterARoundTripAndHoldAfterAndIsReleased) {
  OneSide side;
  side.hears(Mode::idle);
  EXPECT_NEAR(side.until(Mode::holding, [&] { return side.hears(Mode::idle); }), 120, 1);
  EXPECT_NEAR(side.until(Mode::released, [&] { return side.hears(Mode::idle); }), 900, 1);
}

TEST(ModeMachine, AConfirmedCouplingHoldsAtOnceWhenTheOtherSideReleases) {
  OneSide side;
  side.hears(Mode::idle);
  EXPECT_EQ(side.hears(Mode::coupled), Mode::coupled);
  EXPECT_EQ(side.hears(Mode::released), Mode::holding);
  EXPECT_EQ(side.hears(Mode::coupled), Mode::coupled) << "a fault of one tick";
  EXPECT_EQ(side.begun, 1);
  EXPECT_NEAR(side.until(Mode::released, [&] { return side.hears(Mode::released); }), 1000, 2);
}

TEST(ModeMachine, ASilenceHoldsAfterHoldAfterAndReleasesAfterReleaseAfter) {
  OneSide side;
  side.hears(Mode::idle), side.hears(Mode::coupled);
  EXPECT_NEAR(side.until(Mode::holding, [&] { return side.tick(); }), 100, 1);
  EXPECT_NEAR(side.until(Mode::released, [&] { return side.tick(); }), 900, 1);
}

TEST(ModeMachine, AfterASilenceBothSidesAreReadyBeforeACouplingBegins) {
  OneSide side;
  side.hears(Mode::idle), side.hears(Mode::coupled);
  side.until(Mode::released, [&] { return side.tick(); });
  // The other side has not noticed: its reports are of the old coupling, then it holds.
  EXPECT_EQ(side.hears(Mode::released), Mode::idle);
  EXPECT_EQ(side.hears(Mode::coupled), Mode::idle) << "it cannot have heard that this side is ready";
  for (int i = 0; i < 200; ++i) EXPECT_EQ(side.hears(Mode::holding), Mode::idle);
  for (int i = 0; i < 200; ++i) EXPECT_EQ(side.hears(Mode::released), Mode::idle);
  EXPECT_EQ(side.hears(Mode::idle), Mode::coupled);
  EXPECT_EQ(side.begun, 2);
}

TEST(ModeMachine, AfterAnOwnFaultTheCouplingBeginsAnewAtOnce) {
  OneSide side;
  side.hears(Mode::idle), side.hears(Mode::coupled);
  side.modes.release();
  EXPECT_EQ(side.hears(Mode::coupled), Mode::coupled);
  EXPECT_EQ(side.begun, 2);
}

TEST(ModeMachine, AFaultDuringASilenceIsNoShortcut) {
  OneSide side;
  side.hears(Mode::idle), side.hears(Mode::coupled);
  for (int i = 0; i < 300; ++i) side.tick();
  side.modes.release();
  side.tick();
  EXPECT_EQ(side.hears(Mode::coupled), Mode::idle);
}

// A hand that is off the handle for less than release_after changes nothing.
TEST(ModeMachine, OnlyAHandleThatNobodyHoldsForReleaseAfterIsLetGo) {
  OneSide side;
  side.hears(Mode::idle);
  const auto mode_at = [&](int ms, bool held) {
    side.ms = ms, side.held = held;
    return side.hears(Mode::coupled);
  };
  for (int ms = 1; ms < 3000; ++ms) ASSERT_EQ(mode_at(ms, ms % 1000 == 0), Mode::coupled) << ms;  // held at 2000
  EXPECT_EQ(mode_at(3000, false), Mode::let_go);
  EXPECT_EQ(mode_at(9000, false), Mode::let_go);
  EXPECT_EQ(mode_at(9001, true), Mode::coupled);
  EXPECT_EQ(side.begun, 2);
}

TEST(ModeMachine, WhatBeginsLetGoHasTimeToBeConfirmed) {
  OneSide side;
  side.held = false, side.ms = 3000;
  EXPECT_EQ(side.hears(Mode::idle), Mode::let_go);
  for (int i = 0; i < 50; ++i) EXPECT_EQ(side.hears(Mode::idle), Mode::let_go);
  EXPECT_EQ(side.hears(Mode::let_go), Mode::let_go);
}

TEST(ModeMachine, AStopOfTheOwnHardwareLasts) {
  ModeMachine modes{ControlOptions{}};
  EXPECT_FALSE(modes.is_stopped(HardwareStatus::fault, PeerState<1>{}));
  EXPECT_TRUE(modes.is_stopped(HardwareStatus::stopped, PeerState<1>{}));
  modes.release();
  modes.reset();
  EXPECT_TRUE(modes.is_stopped(HardwareStatus::ok, PeerState<1>{}));
  EXPECT_EQ(modes.mode(), Mode::stopped);
}

// A bit of a report may be flipped on its way. The age of such a report does not matter.
TEST(ModeMachine, AStopOfTheOtherSideIsBelievedAfterThreeReportsInARowAndLasts) {
  ModeMachine modes{ControlOptions{}};
  const auto hears = [&](Mode mode, bool is_new = true) {
    PeerState<1> peer;
    peer.heard.mode = mode;
    peer.heard.is_new = is_new;
    return modes.is_stopped(HardwareStatus::ok, peer);
  };
  const Mode stopped = Mode::stopped, coupled = Mode::coupled;
  for (const Mode mode : {stopped, stopped, coupled, stopped, coupled, stopped, stopped}) EXPECT_FALSE(hears(mode));
  for (int i = 0; i < 10; ++i) EXPECT_FALSE(hears(stopped, false)) << "no new report";
  EXPECT_TRUE(hears(stopped));
  EXPECT_TRUE(hears(coupled)) << "it has been started again, this side has not";
}

TEST(ModeMachine, AGoodbyeReleasesAtOnceUntilAnotherSession) {
  OneSide side;
  side.hears(Mode::idle), side.hears(Mode::coupled);
  EXPECT_EQ(side.hears(Mode::ended), Mode::holding) << "one may be damaged";
  side.hears(Mode::ended);
  EXPECT_EQ(side.hears(Mode::ended), Mode::released);
  for (int i = 0; i < 2000; ++i) EXPECT_EQ(side.tick(), Mode::released);
  side.modes.reset();
  EXPECT_EQ(side.hears(Mode::idle), Mode::coupled);
}

}  // namespace
}  // namespace twoport::modes_test
