#pragma once

#include "common/base/vector.h"
#include "common/coupling/options.h"
#include "common/coupling/setpoint_tracker.h"
#include "common/coupling/spring_damper.h"
#include "common/coupling/virtual_coupling.h"
#include "common/hardware/device.h"
#include "common/link/mailbox.h"
#include "common/method/coupled_by_position.h"

namespace twoport {

/// The master's own spring-damper of the position-position architecture: it pulls the handle towards the robot.
///
///     f_m = s (K (x_m - x_d) + B (v_m - v_rx))    x_d: tracked position of the robot in the master's world; s: impedance_scale
template <int N>
class PositionErrorForce {
 public:
  explicit PositionErrorForce(const ControlOptions& o)
      : spring_{o.coupling}, tracker_{o.coupling}, scale_{impedance_scale<N>(o)} {}

  void start(const Position<N>& device) noexcept { x_d_ = device; }

  // By value: the caller keeps what it sensed in registers.
  Force<N> step(DeviceSample<N> device, const PeerState<N>& slave, Seconds dt) noexcept {
    RobotInMasterWorld<N> robot;
    if (!read(slave.words, robot)) return {};
    const Velocity<N> v_rx = slave.newest.v;
    const Velocity<N> v_d = tracker_.step(x_d_, robot.x.value, v_rx, slave.is_new, dt);
    x_d_ = x_d_ + v_d * dt;
    return Force<N>{scale_.cwiseProduct(spring_.force(device.x - x_d_, device.v - v_rx).vec())};
  }

 private:
  SpringDamper<N> spring_;
  SetpointTracker<N> tracker_;
  typename Force<N>::Vector scale_;
  Position<N> x_d_;
};

}  // namespace twoport
