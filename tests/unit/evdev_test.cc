#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "drivers/evdev_stick.h"

namespace twoport::evdev_test {
namespace {

/// A stick that no kernel knows: libevdev keeps its state.
struct Stick {
  Stick() {
    axis(ABS_X, 0, 1023, 15);
    axis(ABS_Y, -100, 100, 0);
    key(BTN_TRIGGER);
    key(BTN_TOP);
  }
  void axis(unsigned code, int least, int most, int flat) {
    input_absinfo a{};
    a.minimum = least;
    a.maximum = most;
    a.flat = flat;
    a.value = (least + most) / 2;
    libevdev_enable_event_code(d.get(), EV_ABS, code, &a);
  }
  void key(unsigned code) { libevdev_enable_event_code(d.get(), EV_KEY, code, nullptr); }
  void set(unsigned type, unsigned code, int value) { libevdev_set_event_value(d.get(), type, code, value); }
  StickState state() const { return stick_state(d.get()); }

  std::unique_ptr<libevdev, void (*)(libevdev*)> d{libevdev_new(), libevdev_free};
};

TEST(Evdev, ReadsAxesInTheirOwnRangesWithADeadZone) {
  Stick stick;
  stick.set(EV_ABS, ABS_X, 1023);
  stick.set(EV_ABS, ABS_Y, -100);  // pushed away
  EXPECT_DOUBLE_EQ(stick.state().axis[0], 1.0);
  EXPECT_DOUBLE_EQ(stick.state().axis[1], 1.0);
  stick.set(EV_ABS, ABS_X, 0);
  EXPECT_DOUBLE_EQ(stick.state().axis[0], -1.0);
  for (const int value : {497, 511, 512, 526}) {
    stick.set(EV_ABS, ABS_X, value);
    EXPECT_EQ(stick.state().axis[0], 0.0) << value;
  }
  stick.set(EV_ABS, ABS_X, 530);  // 3.5 of 496.5 counts beyond the dead zone
  EXPECT_NEAR(stick.state().axis[0], 3.5 / 496.5, 1e-12);
  for (const std::size_t lacking : {2u, 3u, 4u, 5u}) EXPECT_EQ(stick.state().axis[lacking], 0.0);
}

TEST(Evdev, CountsTheButtonsThatItHas) {
  Stick stick;
  EXPECT_EQ(stick_buttons(stick.d.get()), 2);
  EXPECT_EQ(stick.state().buttons, 0u);
  stick.set(EV_KEY, BTN_TOP, 1);
  EXPECT_EQ(stick.state().buttons, 0b10u);
  EXPECT_TRUE(is_stick(stick.d.get()));
  libevdev_disable_event_code(stick.d.get(), EV_ABS, ABS_Y);
  EXPECT_FALSE(is_stick(stick.d.get()));
  Stick mouse;
  mouse.key(BTN_LEFT);
  libevdev_disable_event_code(mouse.d.get(), EV_KEY, BTN_TRIGGER);
  libevdev_disable_event_code(mouse.d.get(), EV_KEY, BTN_TOP);
  EXPECT_FALSE(is_stick(mouse.d.get()));
}

TEST(Evdev, PushesInTheDirectionsThatTheKernelNames) {
  // linux/input.h: 0 is down, towards the user; 0x4000 left, 0x8000 up, 0xC000 right.
  EXPECT_EQ(constant_force({0.0, -1.0}, 2.0, 3, 100).direction, 0x0000);
  EXPECT_EQ(constant_force({-1.0, 0.0}, 2.0, 3, 100).direction, 0x4000);
  EXPECT_EQ(constant_force({0.0, 1.0}, 2.0, 3, 100).direction, 0x8000);
  EXPECT_EQ(constant_force({1.0, 0.0}, 2.0, 3, 100).direction, 0xC000);
  EXPECT_EQ(constant_force({1.0, 0.0}, 2.0, 3, 100).u.constant.level, 0x4000);
  EXPECT_EQ(constant_force({9.0, 9.0}, 2.0, 3, 100).u.constant.level, 0x7fff);
  EXPECT_EQ(constant_force({0.0, 0.0}, 2.0, 3, 100).u.constant.level, 0);
  EXPECT_EQ(constant_force({0.0, 0.0}, 2.0, 3, 100).replay.length, 100);
}

TEST(Evdev, DisplaysByAConstantForceElseByRumble) {
  Stick stick;
  EXPECT_EQ(stick_effect(stick.d.get()), 0u);
  libevdev_enable_event_code(stick.d.get(), EV_FF, FF_SINE, nullptr);
  libevdev_enable_event_code(stick.d.get(), EV_FF, FF_RUMBLE, nullptr);
  EXPECT_EQ(stick_effect(stick.d.get()), static_cast<unsigned>(FF_RUMBLE));
  libevdev_enable_event_code(stick.d.get(), EV_FF, FF_CONSTANT, nullptr);
  EXPECT_EQ(stick_effect(stick.d.get()), static_cast<unsigned>(FF_CONSTANT));
}

TEST(Evdev, ClosesAGripperByATriggerFromEndToEnd) {
  Stick pad;
  for (const unsigned code : {unsigned{ABS_RX}, unsigned{ABS_RY}}) pad.axis(code, -100, 100, 0);
  pad.axis(ABS_Z, 0, 255, 5);
  const StickGripper g = stick_gripper(pad.d.get());
  ASSERT_EQ(g.trigger, static_cast<unsigned>(ABS_Z));
  const auto opening = [&](int value) {
    pad.set(EV_ABS, ABS_Z, value);
    return stick_opening(pad.d.get(), g, 0.3, 0.01, 1.0);
  };
  EXPECT_EQ(opening(0), 1.0);
  EXPECT_EQ(opening(5), 1.0);
  EXPECT_EQ(opening(255), 0.0);
  EXPECT_DOUBLE_EQ(opening(130), 0.5);
}

TEST(Evdev, ClosesAGripperByTwoButtonsAtASpeed) {
  Stick stick;
  EXPECT_FALSE(stick_gripper(stick.d.get()));  // a trigger alone
  stick.key(BTN_THUMB);
  stick.axis(ABS_Z, 0, 255, 0);  // a throttle
  const StickGripper g = stick_gripper(stick.d.get());
  ASSERT_TRUE(g && g.trigger == 0);
  double open = 1.0;
  const auto hold = [&](unsigned code, double seconds) {
    if (code != 0) stick.set(EV_KEY, code, 1);
    for (int k = 0; k < std::lround(seconds * 1000); ++k) open = stick_opening(stick.d.get(), g, open, 1e-3, 2.0);
    if (code != 0) stick.set(EV_KEY, code, 0);
    return open;
  };
  EXPECT_NEAR(hold(BTN_TRIGGER, 0.5), 0.75, 1e-12);
  EXPECT_NEAR(hold(0, 0.5), 0.75, 1e-12);
  EXPECT_NEAR(hold(BTN_THUMB, 0.2), 0.85, 1e-12);
  EXPECT_EQ(hold(BTN_THUMB, 1.0), 1.0);
  EXPECT_EQ(hold(BTN_TRIGGER, 3.0), 0.0);
}

}  // namespace
}  // namespace twoport::evdev_test
