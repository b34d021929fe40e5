#pragma once

#include <libevdev/libevdev.h>
#include <linux/input.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <span>

namespace twoport {

/// State of a joystick or gamepad.
struct StickState {
  /// In [-1, 1]: right, forward, up; then turns about these axes. 0 for an axis that it lacks.
  std::array<double, 6> axis{};
  std::uint32_t buttons = 0;  ///< bit i: the i-th button that it has
};

/// Codes that are buttons of sticks and gamepads.
inline constexpr unsigned kFirstStickButton = BTN_JOYSTICK, kLastStickButton = BTN_THUMBR;

/// Does it have two axes and at least one button of a stick?
inline bool is_stick(const libevdev* d) {
  if (libevdev_has_event_code(d, EV_ABS, ABS_X) == 0 || libevdev_has_event_code(d, EV_ABS, ABS_Y) == 0) return false;
  for (unsigned code = kFirstStickButton; code <= kLastStickButton; ++code)
    if (libevdev_has_event_code(d, EV_KEY, code) != 0) return true;
  return false;
}

/// Value of an axis in [-1, 1] from its own range; 0 within `flat` of the middle.
inline double axis_share(const libevdev* d, unsigned code) {
  const input_absinfo* a = libevdev_get_abs_info(d, code);
  if (a == nullptr || a->maximum <= a->minimum) return 0.0;
  const double middle = 0.5 * (static_cast<double>(a->minimum) + a->maximum);
  const double half = 0.5 * (static_cast<double>(a->maximum) - a->minimum),
               flat = std::min<double>(a->flat, 0.9 * half);
  const double from = a->value - middle, beyond = std::abs(from) - flat;
  return beyond <= 0.0 ? 0.0 : std::copysign(std::min(beyond / (half - flat), 1.0), from);
}

/// The state that libevdev holds: no access to the device. A stick pulled back and a hat pressed down have positive values.
inline StickState stick_state(const libevdev* d) {
  StickState s;
  s.axis[0] = axis_share(d, ABS_X);
  s.axis[1] = -axis_share(d, ABS_Y);
  // Up: the second stick of a gamepad, else the throttle of a joystick, which is 0 where it is pulled.
  s.axis[2] = libevdev_has_event_code(d, EV_ABS, ABS_RY) != 0 ? -axis_share(d, ABS_RY) : -axis_share(d, ABS_THROTTLE);
  s.axis[3] = axis_share(d, ABS_HAT0Y);
  s.axis[4] = axis_share(d, ABS_HAT0X);
  s.axis[5] = -axis_share(d, ABS_RZ);
  unsigned bit = 0;
  for (unsigned code = kFirstStickButton; code <= kLastStickButton && bit < 32; ++code)
    if (libevdev_has_event_code(d, EV_KEY, code) != 0)
      s.buttons |= libevdev_get_event_value(d, EV_KEY, code) != 0 ? 1u << bit++ : 0u << bit++;
  return s;
}

inline int stick_buttons(const libevdev* d) {
  int count = 0;
  for (unsigned code = kFirstStickButton; code <= kLastStickButton; ++code)
    count += libevdev_has_event_code(d, EV_KEY, code) != 0 ? 1 : 0;
  return std::min(count, 32);
}

/// The constant effect that pushes the hand with (right, forward) times `full_n`. The kernel counts the direction from towards the
/// user (0), left 0x4000, away 0x8000, right 0xC000 (linux/input.h), and plays it for `length_ms` at most.
inline ff_effect constant_force(std::array<double, 2> push_n, double full_n, int id, std::uint16_t length_ms) {
  ff_effect effect{};
  effect.type = FF_CONSTANT;
  effect.id = static_cast<std::int16_t>(id);
  effect.replay.length = length_ms;
  const double norm = std::hypot(push_n[0], push_n[1]);
  effect.u.constant.level = static_cast<std::int16_t>(std::lround(0x7fff * std::min(norm / full_n, 1.0)));
  const double turns = norm > 0.0 ? std::atan2(-push_n[0], -push_n[1]) / (2.0 * std::numbers::pi) : 0.0;
  effect.direction = static_cast<std::uint16_t>(std::lround(65536.0 * (turns < 0.0 ? turns + 1.0 : turns)) & 0xffff);
  return effect;
}

}  // namespace twoport
