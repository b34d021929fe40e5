#include "common/runtime/modes.h"

#include <gtest/gtest.h>

#include <array>

namespace twoport {
namespace {

constexpr std::array kModes{Mode::idle, Mode::coupled, Mode::holding, Mode::released};

/// The four things that can be known at a tick.
template <class Visit>
void for_every_health(Visit visit) {
  for (bool heard : {false, true})
    for (bool silent : {false, true}) visit(Health{.heard = heard, .silent = silent});
}

TEST(Modes, HearingTheOtherSideCouples) {
  for (Mode mode : kModes)
    for_every_health([&](const Health& h) {
      if (h.heard) {
        EXPECT_EQ(next_mode(mode, h), Mode::coupled);
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
  for (bool silent : {false, true}) EXPECT_EQ(next_mode(Mode::idle, {.heard = false, .silent = silent}), Mode::idle);
}

TEST(Modes, AShortSilenceHolds) {
  for (Mode mode : {Mode::coupled, Mode::holding})
    EXPECT_EQ(next_mode(mode, {.heard = false, .silent = false}), Mode::holding);
}

TEST(Modes, ALongSilenceReleases) {
  for (Mode mode : {Mode::coupled, Mode::holding})
    EXPECT_EQ(next_mode(mode, {.heard = false, .silent = true}), Mode::released);
}

TEST(Modes, ReleasedStaysReleasedUntilHeardAgain) {
  for (bool silent : {false, true})
    EXPECT_EQ(next_mode(Mode::released, {.heard = false, .silent = silent}), Mode::released);
}

TEST(Modes, DoNotFlickerWhileNothingChanges) {
  for (Mode mode : kModes)
    for_every_health([&](const Health& h) {
      const Mode once = next_mode(mode, h);
      EXPECT_EQ(next_mode(once, h), once);
    });
}

TEST(Modes, OnlyWhatWasCoupledHolds) {
  for (Mode mode : {Mode::idle, Mode::released})
    for_every_health([&](const Health& h) { EXPECT_NE(next_mode(mode, h), Mode::holding); });
}

}  // namespace
}  // namespace twoport
