#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/base/vector.h"
#include "common/hardware/servo.h"

namespace twoport::sim {

/// The position of a robot that obeys positions only (Servo), exact between its set points.
template <int N>
class PositionServo {
 public:
  PositionServo(const Servo& servo, const Position<N>& x)
      : s_{servo}, waiting_(static_cast<std::size_t>(std::ceil(servo.delay / servo.period)) + 2), x_{x}, target_{x} {}

  /// One tick with that newest set point.
  void advance(const Position<N>& set_point, double dt) noexcept {
    const double end = t_ + dt;
    const Position<N> before = x_;
    const double almost = end - 1e-9 * s_.period.si();
    for (double at; (at = static_cast<double>(taken_) * s_.period.si()) < almost; ++taken_)
      waiting_[index(last_++)] = {at + s_.delay.si(), set_point};
    for (; first_ != last_ && waiting_[index(first_)].at_s <= end; ++first_) {
      follow(waiting_[index(first_)].at_s);
      target_ = waiting_[index(first_)].x;
    }
    follow(end);
    v_ = s_.lag > Seconds{} ? (target_ - x_) / s_.lag : (x_ - before) / Seconds{dt};
  }
  [[nodiscard]] const Position<N>& x() const noexcept { return x_; }
  [[nodiscard]] const Velocity<N>& v() const noexcept { return v_; }

 private:
  struct SetPoint {
    double at_s = 0.0;
    Position<N> x;
  };
  [[nodiscard]] std::size_t index(std::uint64_t number) const noexcept { return number % waiting_.size(); }
  void follow(double until) noexcept {
    if (s_.lag > Seconds{}) {
      x_ = x_ + (1.0 - std::exp(-(until - t_) / s_.lag.si())) * (target_ - x_);
    } else {
      x_ = target_;
    }
    t_ = until;
  }

  Servo s_;
  std::vector<SetPoint> waiting_;  ///< a ring: on their way
  std::uint64_t first_ = 0, last_ = 0, taken_ = 0;
  double t_ = 0.0;
  Position<N> x_, target_;
  Velocity<N> v_;
};

}  // namespace twoport::sim
