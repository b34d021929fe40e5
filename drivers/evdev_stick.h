#pragma once

#include <libevdev/libevdev.h>
#include <linux/input.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace twoport {

/// State of a joystick or gamepad.
struct StickState {
  /// In [-1, 1]: right, forward, up; then turns about these axes. 0 for an axis that it lacks.
  std::array<double, 6> axis{};
  std::uint32_t buttons = 0;  ///< bit i: the i-th button that it has
};

/// Codes that are buttons of sticks and gamepads.
inline constexpr unsigned kFirstStickButton = BTN_JOYSTICK, kLastStickButton = BTN_THUMBR;

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

/// What a force is displayed by: FF_CONSTANT, else FF_RUMBLE; 0: it has neither.
inline unsigned stick_effect(const libevdev* d) {
  if (libevdev_has_event_code(d, EV_FF, FF_CONSTANT) != 0) return FF_CONSTANT;
  return libevdev_has_event_code(d, EV_FF, FF_RUMBLE) != 0 ? FF_RUMBLE : 0;
}

inline int stick_buttons(const libevdev* d) {
  int count = 0;
  for (unsigned code = kFirstStickButton; code <= kLastStickButton; ++code)
    count += libevdev_has_event_code(d, EV_KEY, code) != 0 ? 1 : 0;
  return std::min(count, 32);
}

/// Does it have two axes and at least one button of a stick?
inline bool is_stick(const libevdev* d) {
  return libevdev_has_event_code(d, EV_ABS, ABS_X) != 0 && libevdev_has_event_code(d, EV_ABS, ABS_Y) != 0 &&
         stick_buttons(d) > 0;
}

/// What opens and closes a gripper.
struct StickGripper {
  unsigned trigger = 0;          ///< axis: open at its minimum, closed at its maximum; 0: none
  unsigned close = 0, open = 0;  ///< buttons, where there is no such axis; 0: none
  explicit operator bool() const { return trigger != 0 || (close != 0 && open != 0); }
};

/// The gas pedal (ABS_GAS), else the left trigger of a gamepad (ABS_Z where the second stick has axes of its own); else the shoulder
/// buttons, the left one closes; else the first two buttons of a joystick, the first one closes. A throttle in ABS_Z is none.
inline StickGripper stick_gripper(const libevdev* d) {
  const auto has = [&](unsigned type, unsigned code) { return libevdev_has_event_code(d, type, code) != 0; };
  if (has(EV_ABS, ABS_GAS)) return {.trigger = ABS_GAS};
  if (has(EV_ABS, ABS_Z) && has(EV_ABS, ABS_RX) && has(EV_ABS, ABS_RY)) return {.trigger = ABS_Z};
  if (has(EV_KEY, BTN_TL) && has(EV_KEY, BTN_TR)) return {.close = BTN_TL, .open = BTN_TR};
  if (has(EV_KEY, BTN_TRIGGER) && has(EV_KEY, BTN_THUMB)) return {.close = BTN_TRIGGER, .open = BTN_THUMB};
  return {};
}

/// Where the fingers shall be after `dt_s`, from 0 (closed) to 1 (open), from `open` before. Buttons take `travel_s` from one end to the
/// other; both together, or none, leave it.
inline double stick_opening(const libevdev* d, const StickGripper& g, double open, double dt_s, double travel_s) {
  if (g.trigger != 0) {
    const input_absinfo* a = libevdev_get_abs_info(d, g.trigger);
    if (a == nullptr || a->maximum <= a->minimum) return open;
    const double least = a->minimum + std::max(a->flat, 0);
    return 1.0 - std::clamp((a->value - least) / std::max(a->maximum - least, 1.0), 0.0, 1.0);
  }
  const auto pressed = [&](unsigned code) { return libevdev_get_event_value(d, EV_KEY, code) != 0 ? 1.0 : 0.0; };
  return std::clamp(open + (pressed(g.open) - pressed(g.close)) * dt_s / travel_s, 0.0, 1.0);
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
