#pragma once

#include "common/base/time.h"

namespace twoport {

/// A robot that obeys positions only: it takes the newest set point once per period, `delay` later, with a first-order lag. It yields to
/// no force.
struct Servo {
  Seconds period{}, delay{}, lag{};

  /// From a set point to the robot, on average.
  [[nodiscard]] Seconds behind() const noexcept { return lag + delay + 0.5 * period; }
  friend bool operator==(const Servo&, const Servo&) = default;
};

}  // namespace twoport
