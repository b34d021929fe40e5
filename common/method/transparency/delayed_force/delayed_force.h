#pragma once

#include "common/method/layers.h"
#include "common/method/transparency/displayed_force.h"

namespace twoport {

/// The force of the architecture as it arrives, f_d = ρ DisplayedForce.
template <int N>
class DelayedForceMaster final : public Copyable<DelayedForceMaster<N>, MasterTransparency<N>> {
 public:
  explicit DelayedForceMaster(const ControlOptions& o) : displayed_{o} {}
  void start(const DeviceSample<N>& device) noexcept override { displayed_.start(device.x); }
  Wish<N> wish(const MasterInput<N>& in) noexcept override {
    if (!in.active) return {};
    return {.idle = false, .f = in.ramp * displayed_.step(in.device, in.slave, in.dt)};
  }

 private:
  DisplayedForce<N> displayed_;
};

/// The virtual coupling. Under POSITION_MEASURED_FORCE the sensor's force is returned.
template <int N>
class DelayedForceSlave final : public Copyable<DelayedForceSlave<N>, SlaveTransparency<N>> {
 public:
  explicit DelayedForceSlave(const ControlOptions& o)
      : Copyable<DelayedForceSlave<N>, SlaveTransparency<N>>{o}, measured_{returns_measured_force(o)} {}
  RobotWish<N> wish(const SlaveInput<N>& in) noexcept override {
    auto wanted = this->want(in);
    RobotWish<N> out{.f = wanted.f, .v = wanted.v};
    if (measured_) out.f_back = in.robot.f_environment;
    return out;
  }

 private:
  bool measured_;
};

}  // namespace twoport
