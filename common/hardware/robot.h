#pragma once

#include "common/base/vector.h"

namespace twoport {

/// What a robot says at the start of a tick.
template <int N>
struct RobotState {
  Position<N> x;           ///< tool [m], attitude
  Velocity<N> v;           ///< [m/s], [rad/s]
  Force<N> f_environment;  ///< the force sensor: force of the robot on the environment [N], [N m]
  bool ideal = false;      ///< follows the motion it is told exactly; its sensor then is the coupling force
};

/// What the slave asks of its robot for the coming period.
template <int N>
struct RobotCommand {
  Force<N> f;       ///< coupling force on the robot [N], [N m]
  Position<N> x_d;  ///< where the coupling's other end is: what an ideal robot follows
  Velocity<N> v_d;
};

/// A robot with a force sensor: the seam for hardware at the slave. Calls as for Device.
template <int N>
class Robot {
 public:
  virtual ~Robot() = default;
  virtual RobotState<N> sense() noexcept = 0;
  virtual void actuate(const RobotCommand<N>& command) noexcept = 0;
  /// Let go: no force, now.
  virtual void release() noexcept = 0;
};

}  // namespace twoport
