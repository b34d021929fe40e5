#pragma once

#include "common/method/layers.h"

namespace twoport {

/// Books at the robot's port in place of the link's, exactly: what is commanded is held for a tick, and what it has done is known with the
/// next reading.
///
///     into the link   -f·Δx_r of every tick;  as `grounded` of the set point's: f·v_d T less what was expected, f·v_r T, corrected a tick later
template <int N>
class RobotPortAccount {
 public:
  void start(const RobotSample<N>& robot) noexcept {
    x_ = robot.x;
    release();
  }
  /// Energy out of the port since the last tick, and the robot's motion.
  struct Moved {
    Energy out;
    Displacement<N> by;
  };
  Moved observe(const RobotSample<N>& robot) noexcept {
    const Displacement<N> by = robot.x - x_;
    const Energy out = dot(f_, by);
    x_ = robot.x;
    correction_ = expected_ - out;
    expected_ = Energy{};
    return {out, by};
  }
  void book(SlaveOutput<N>& out, const RobotSample<N>& robot, Seconds dt) noexcept {
    f_ = out.command.f;
    expected_ = dot(f_, robot.v * dt);
    out.grounded = dot(f_, out.command.v_d * dt) - expected_ + correction_;
  }
  void release() noexcept {
    f_ = Force<N>{};
    expected_ = correction_ = Energy{};
  }

 private:
  Position<N> x_;                 ///< of the robot
  Force<N> f_;                    ///< on the robot in the last tick
  Energy expected_, correction_;  ///< of the tick that has begun; of the one before
};

}  // namespace twoport
