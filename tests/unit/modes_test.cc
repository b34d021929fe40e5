#include "common/runtime/modes.h"

#include <gtest/gtest.h>

#include <array>

namespace twoport {
namespace {

constexpr std::array kModes{Mode::idle, Mode::coupled, Mode::holding, Mode::released, Mode::let_go};

/// All that can be known at a tick.
template <class Visit>
void for_every_health(Visit visit) {
  for (bool heard : {false, true})
    for (bool silent : {false, true})
      for (bool let_go : {false, true}) visit(Health{.heard = heard, .silent = silent, .let_go = let_go});
}

TEST(Modes, HearingTheOtherSideCouplesWhereTheHandleIsHeld) {
  for (Mode mode : kModes)
    for_every_health([&](const Health& h) {
      if (h.heard) {
        EXPECT_EQ(next_mode(mode, h), h.let_go ? Mode::let_go : Mode::coupled);
      }
    });
}

TEST(Modes, NothingCouplesWithoutHearingTheOtherSide) {
  for (Mode mode : kModes)
    for_every_health([&](const Health& h) {
      if (!h.heard) {
        EXPECT_NE(next_mode(mode, h), Mode::coupled);
      }
    });
}

TEST(Modes, IdleWaitsForTheFirstReport) {
  for (bool silent : {false, true})
    EXPECT_EQ(next_mode(Mode::idle, {.heard = false, .silent = silent, .let_go = false}), Mode::idle);
}

TEST(Modes, AShortSilenceHolds) {
  for (Mode mode : {Mode::coupled, Mode::holding})
    EXPECT_EQ(next_mode(mode, {.heard = false, .silent = false, .let_go = false}), Mode::holding);
}

TEST(Modes, ALongSilenceReleases) {
  for (Mode mode : {Mode::coupled, Mode::holding})
    EXPECT_EQ(next_mode(mode, {.heard = false, .silent = true, .let_go = false}), Mode::released);
}

TEST(Modes, ReleasedStaysReleasedUntilHeardAgain) {
  for (bool silent : {false, true})
    EXPECT_EQ(next_mode(Mode::released, {.heard = false, .silent = silent, .let_go = false}), Mode::released);
}

TEST(Modes, WhatWasLetGoCouplesAnewWhenItIsHeldAgain) {
  EXPECT_EQ(next_mode(Mode::let_go, {.heard = true, .silent = false, .let_go = false}), Mode::coupled);
  EXPECT_TRUE(begins(Mode::let_go, Mode::coupled));
  for (bool silent : {false, true})
    EXPECT_EQ(next_mode(Mode::let_go, {.heard = false, .silent = silent, .let_go = false}), Mode::released);
}

// Held and let go at 1 kHz: a hand that is off the handle for less than release_after changes nothing.
TEST(Modes, OnlyAHandleThatNobodyHoldsForReleaseAfterIsLetGo) {
  ControlOptions o;
  ModeMachine modes{o};
  PeerState<1> peer;
  peer.has_report = true;
  const auto mode_at = [&](int ms, bool held) {
    const Duration now = std::chrono::milliseconds{ms};
    peer.received_at = now;
    modes.step(now, peer, modes.has_let_go(now, held));
    return modes.mode();
  };
  for (int ms = 0; ms < 3000; ++ms) ASSERT_EQ(mode_at(ms, ms % 1000 == 0), Mode::coupled) << ms;  // held at 2000
  EXPECT_EQ(mode_at(2999, false), Mode::coupled);
  EXPECT_EQ(mode_at(3000, false), Mode::let_go);
  EXPECT_EQ(mode_at(9000, false), Mode::let_go);
  EXPECT_EQ(mode_at(9001, true), Mode::coupled);
}

TEST(Modes, AStopOfTheOwnHardwareLasts) {
  ModeMachine modes{ControlOptions{}};
  EXPECT_FALSE(modes.is_stopped(HardwareStatus::fault, PeerState<1>{}));
  EXPECT_TRUE(modes.is_stopped(HardwareStatus::stopped, PeerState<1>{}));
  modes.release();
  modes.reset();
  EXPECT_TRUE(modes.is_stopped(HardwareStatus::ok, PeerState<1>{}));
  EXPECT_EQ(modes.mode(), Mode::stopped);
}

// A bit of a report may be flipped on its way.
TEST(Modes, AStopOfTheOtherSideIsBelievedAfterThreeReportsInARowAndLasts) {
  ModeMachine modes{ControlOptions{}};
  const auto hears = [&](Mode mode, bool is_new = true) {
    PeerState<1> peer;
    peer.newest.mode = mode;
    peer.is_new = is_new;
    return modes.is_stopped(HardwareStatus::ok, peer);
  };
  const Mode stopped = Mode::stopped, coupled = Mode::coupled;
  for (const Mode mode : {stopped, stopped, coupled, stopped, coupled, stopped, stopped}) EXPECT_FALSE(hears(mode));
  for (int i = 0; i < 10; ++i) EXPECT_FALSE(hears(stopped, false)) << "no new report";
  EXPECT_TRUE(hears(stopped));
  EXPECT_TRUE(hears(coupled)) << "it has been started again, this side has not";
}

TEST(Modes, DoNotFlickerWhileNothingChanges) {
  for (Mode mode : kModes)
    for_every_health([&](const Health& h) {
      const Mode once = next_mode(mode, h);
      EXPECT_EQ(next_mode(once, h), once);
    });
}

TEST(Modes, OnlyWhatWasCoupledHolds) {
  for (Mode mode : {Mode::idle, Mode::released, Mode::let_go})
    for_every_health([&](const Health& h) { EXPECT_NE(next_mode(mode, h), Mode::holding); });
}

}  // namespace
}  // namespace twoport
