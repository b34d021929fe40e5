#include "drivers/force_feedback.h"

#include <gtest/gtest.h>

#include <utility>
#include <vector>

// What a joystick with a constant-force effect is sent: a stand-in for the kernel takes it.
namespace twoport {
namespace {

struct Stick final : EffectPort {
  bool upload(ff_effect& effect) noexcept override {
    if (refuses) return false;
    if (effect.id == -1) effect.id = 3;
    uploaded.push_back(effect);
    return true;
  }
  void erase(int id) noexcept override { erased.push_back(id); }
  bool write(unsigned code, int value) noexcept override {
    written.emplace_back(code, value);
    return true;
  }
  [[nodiscard]] int level() const { return uploaded.back().u.constant.level; }

  bool refuses = false;
  std::vector<ff_effect> uploaded;
  std::vector<std::pair<unsigned, int>> written;
  std::vector<int> erased;
};

constexpr double kFull = 4.0;  // [N]

struct ForceFeedbackTest : testing::Test {
  Stick stick;
  ForceFeedback force{stick, kFull};
  Duration now{0};
  void rounds(int count) {
    for (int i = 0; i < count; ++i) force.round(now += ForceFeedback::kPeriod);
  }
};

TEST_F(ForceFeedbackTest, StartsWithoutForceAtFullGainAndWithoutACentringSpring) {
  EXPECT_TRUE(force.start());
  EXPECT_EQ(stick.level(), 0);
  EXPECT_EQ(stick.uploaded.front().type, FF_CONSTANT);
  const std::vector<std::pair<unsigned, int>> settings{{FF_AUTOCENTER, 0}, {FF_GAIN, 0xffff}};
  EXPECT_EQ(stick.written, settings);
}

TEST_F(ForceFeedbackTest, ADeviceThatTakesNoEffectDisplaysNoForce) {
  stick.refuses = true;
  EXPECT_FALSE(force.start());
  force.end();
  EXPECT_TRUE(stick.written.empty());
  EXPECT_TRUE(stick.erased.empty());
}

TEST_F(ForceFeedbackTest, UpdatesOneEffectWithLevelAndDirection) {
  force.start();
  force.push(1.0, 0.0);
  EXPECT_EQ(force.played()[0], 0.0) << "before the device has taken it";
  rounds(1);
  EXPECT_EQ(stick.uploaded.back().id, 3);
  EXPECT_EQ(stick.uploaded.back().direction, 0xC000);
  EXPECT_EQ(stick.level(), 0x2000);  // a quarter of 0x7fff, rounded
  EXPECT_EQ(stick.uploaded.back().replay.length, 100);
  EXPECT_EQ(stick.written.back(), std::pair(3u, 1));
  EXPECT_EQ(force.played()[0], 1.0);
  force.push(0.0, -2.0);
  rounds(1);
  EXPECT_EQ(stick.uploaded.back().direction, 0x0000);
  EXPECT_EQ(stick.level(), 0x4000);
}

TEST_F(ForceFeedbackTest, StrongerThanTheDeviceIsItsLargestInTheSameDirectionAndBookedAsThat) {
  force.start();
  force.push(30.0, 40.0);
  rounds(1);
  EXPECT_EQ(stick.level(), 0x7fff);
  EXPECT_NEAR(force.played()[0], 0.6 * kFull, 1e-12);
  EXPECT_NEAR(force.played()[1], 0.8 * kFull, 1e-12);
  force.push(NAN, 1.0);
  rounds(1);
  EXPECT_EQ(stick.level(), 0);
}

TEST_F(ForceFeedbackTest, LetGoRampsToZeroWithin50Milliseconds) {
  force.start();
  force.push(kFull, 0.0);
  rounds(1);
  force.let_go();
  for (const int level : {26214, 19660, 13107, 6553, 0}) {  // 4/5, 3/5, ... of 0x7fff
    rounds(1);
    EXPECT_NEAR(stick.level(), level, 1);
    if (level > 0) {
      EXPECT_EQ(stick.uploaded.back().direction, 0xC000);
    }
  }
  rounds(3);
  EXPECT_EQ(stick.level(), 0);
  force.push(1.0, 0.0);
  rounds(1);
  EXPECT_EQ(stick.level(), 0x2000) << "the next push is displayed again";
}

TEST_F(ForceFeedbackTest, WhatTheDeviceNoLongerTakesIsBookedUntilItsEffectHasEnded) {
  force.start();
  force.push(1.0, 0.0);
  rounds(1);
  stick.refuses = true;
  force.push(2.0, 0.0);
  rounds(9);
  EXPECT_EQ(force.played()[0], 1.0);
  rounds(1);
  EXPECT_EQ(force.played()[0], 0.0);
}

TEST_F(ForceFeedbackTest, EndStopsAndRemovesTheEffect) {
  force.start();
  force.push(1.0, 0.0);
  rounds(1);
  force.end();
  EXPECT_EQ(stick.written.back(), std::pair(3u, 0));
  EXPECT_EQ(stick.erased, std::vector{3});
  EXPECT_EQ(force.played()[0], 0.0);
}

TEST(ForceFeedback, ASlowDeviceIsLeftAloneForHalfOfTheTime) {
  using std::chrono::milliseconds;
  EXPECT_EQ(ForceFeedback::pause(milliseconds{1}), milliseconds{9});
  EXPECT_EQ(ForceFeedback::pause(milliseconds{8}), milliseconds{8});
  EXPECT_EQ(ForceFeedback::pause(milliseconds{40}), milliseconds{40});
}

}  // namespace
}  // namespace twoport
