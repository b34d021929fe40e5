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
///     f_m = s (K (x_m - x_d) + B (v_m - v))    x_d, v: tracked motion of the robot in the master's world; s: impedance_scale
template <int N>
class PositionErrorForce {
 public:
  explicit PositionErrorForce(const ControlOptions& o)
      : spring_{o.coupling}, tracker_{o.coupling}, scale_{impedance_scale<N>(o)} {}

  void start(const Position<N>& device) noexcept { x_d_ = device; }

  Force<N> step(DeviceSample<N> device, const PeerState<N>& slave, Seconds dt) noexcept {
    RobotInMasterWorld<N> robot;
    if (!read(slave.words, robot)) return {};
    x_d_ = x_d_ + tracker_.step(x_d_, robot.x.value, slave.newest.v, slave.is_new, dt) * dt;
    return Force<N>{scale_.cwiseProduct(spring_.force(device.x - x_d_, device.v - tracker_.velocity()).vec())};
  }

 private:
  SpringDamper<N> spring_;
  SetpointTracker<N> tracker_;
  typename Force<N>::Vector scale_;
  Position<N> x_d_;
};

}  // namespace twoport
