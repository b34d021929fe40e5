#include "drivers/force_feedback.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include "drivers/effect_thread.h"
#include "drivers/rumble.h"

// What a joystick with a constant-force effect, and a gamepad that rumbles, are sent: a stand-in for the kernel takes it.
namespace twoport::force_feedback_test {
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
  [[nodiscard]] int strong() const { return uploaded.back().u.rumble.strong_magnitude; }
  [[nodiscard]] int weak() const { return uploaded.back().u.rumble.weak_magnitude; }

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

TEST_F(ForceFeedbackTest, WithoutAPushFor100MillisecondsItLetsGo) {
  force.start();
  force.push(1.0, 0.0);
  rounds(10);
  EXPECT_EQ(stick.level(), 0x2000);
  rounds(5);
  EXPECT_EQ(stick.level(), 0);
}

struct RumbleTest : testing::Test {
  Stick pad;
  Rumble rumble{pad, kFull};
  Duration now{std::chrono::seconds{1}};
  void rounds(int count, double force_n) {
    for (int i = 0; i < count; ++i) {
      rumble.push(force_n);
      rumble.round(now += ForceFeedback::kPeriod);
    }
  }
};

TEST_F(RumbleTest, StartsWithoutRumble) {
  EXPECT_TRUE(rumble.start());
  ASSERT_EQ(pad.uploaded.size(), 1u);
  EXPECT_EQ(pad.uploaded[0].type, FF_RUMBLE);
  EXPECT_EQ(pad.uploaded[0].replay.length, 100);
  EXPECT_EQ(pad.strong(), 0);
  rounds(20, 0.0);
  EXPECT_EQ(pad.uploaded.size(), 1u) << "nothing is sent where nothing is felt";
  Stick without;
  without.refuses = true;
  Rumble none{without, kFull};
  EXPECT_FALSE(none.start());
  none.end();
  EXPECT_TRUE(without.written.empty());
}

TEST_F(RumbleTest, TheStrongMotorShowsTheForceAndTheWeakOneItsOnset) {
  rumble.start();
  rounds(1, 0.0);
  rounds(1, 1.0);
  EXPECT_EQ(pad.strong(), 0x4000);  // a quarter of 0xffff, rounded
  EXPECT_NEAR(pad.weak(), 0.9 * 0x4000, 1.0);
  EXPECT_EQ(pad.written.back(), std::pair(3u, 1));
  rounds(10, 1.0);
  EXPECT_NEAR(pad.weak(), std::pow(0.9, 11) * 0x4000, 1.0);
  rounds(200, 1.0);
  EXPECT_EQ(pad.strong(), 0x4000);
  EXPECT_EQ(pad.weak(), 0);
  rounds(1, 0.5);
  EXPECT_EQ(pad.strong(), 0x2000);
  EXPECT_EQ(pad.weak(), 0) << "the end of a contact is none";
  rounds(1, 30.0);
  EXPECT_EQ(pad.strong(), 0xffff);
  EXPECT_EQ(pad.weak(), 0xffff);
  rounds(1, NAN);
  EXPECT_EQ(pad.strong(), 0);
  EXPECT_EQ(pad.uploaded.back().id, 3) << "one effect";
}

TEST_F(RumbleTest, ASteadyForceIsRenewedBeforeItsEffectEnds) {
  rumble.start();
  rounds(300, 1.0);
  const std::size_t sent = pad.uploaded.size();
  rounds(100, 1.0);  // a second
  EXPECT_EQ(pad.uploaded.size(), sent + 20);
}

TEST_F(RumbleTest, StopsWhereItIsLetGoAndWithoutAPushFor100Milliseconds) {
  rumble.start();
  rounds(5, 1.0);
  rumble.let_go();
  rumble.round(now += ForceFeedback::kPeriod);
  EXPECT_EQ(pad.strong(), 0);
  EXPECT_EQ(pad.weak(), 0);
  rounds(5, 1.0);
  for (int k = 0; k < 9; ++k) rumble.round(now += ForceFeedback::kPeriod);
  EXPECT_EQ(pad.strong(), 0x4000);
  rumble.round(now += ForceFeedback::kPeriod);
  EXPECT_EQ(pad.strong(), 0);
  rumble.end();
  EXPECT_EQ(pad.written.back(), std::pair(3u, 0));
  EXPECT_EQ(pad.erased, std::vector{3});
}

TEST_F(RumbleTest, WhatTheDeviceDidNotTakeIsSentAgain) {
  rumble.start();
  rounds(5, 1.0);
  pad.refuses = true;
  rounds(5, 0.0);
  EXPECT_EQ(pad.strong(), 0x4000);
  pad.refuses = false;
  rounds(1, 0.0);
  EXPECT_EQ(pad.strong(), 0);
}

/// The same, for two threads.
struct SharedPad final : EffectPort {
  bool upload(ff_effect& effect) noexcept override {
    const std::lock_guard lock{mutex};
    return pad.upload(effect);
  }
  void erase(int id) noexcept override {
    const std::lock_guard lock{mutex};
    pad.erase(id);
  }
  bool write(unsigned code, int value) noexcept override {
    const std::lock_guard lock{mutex};
    return pad.write(code, value);
  }
  [[nodiscard]] int strong() {
    const std::lock_guard lock{mutex};
    return pad.strong();
  }
  std::mutex mutex;
  Stick pad;
};

TEST(EffectThread, RumblesWhileItIsPushedAndStopsTheMotorsAtItsEnd) {
  using std::chrono::milliseconds;
  SharedPad shared;
  const auto begun = std::chrono::steady_clock::now();
  {
    EffectThread<Rumble> thread{shared, kFull};
    ASSERT_TRUE(thread.works());
    for (int k = 0; k < 2000 && shared.strong() == 0; ++k) {
      thread.effect().push(kFull);
      std::this_thread::sleep_for(milliseconds{1});
    }
    EXPECT_EQ(shared.strong(), 0xffff);
  }
  const auto spent = std::chrono::steady_clock::now() - begun;
  EXPECT_EQ(shared.pad.written.back(), std::pair(3u, 0));
  EXPECT_EQ(shared.pad.erased, std::vector{3});
  EXPECT_LE(shared.pad.uploaded.size(), 3 + static_cast<std::size_t>(spent / ForceFeedback::kPeriod));
  shared.pad.refuses = true;  // unplugged
  EXPECT_FALSE((EffectThread<Rumble>{shared, kFull}.works()));
}

TEST(EffectThread, ASlowDeviceIsLeftAloneForHalfOfTheTime) {
  using std::chrono::milliseconds;
  using Thread = EffectThread<ForceFeedback>;
  EXPECT_EQ(Thread::pause(milliseconds{1}), milliseconds{9});
  EXPECT_EQ(Thread::pause(milliseconds{8}), milliseconds{8});
  EXPECT_EQ(Thread::pause(milliseconds{40}), milliseconds{40});
}

}  // namespace
}  // namespace twoport::force_feedback_test
