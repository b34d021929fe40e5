#pragma once

#include <utility>

#include "common/base/time.h"
#include "common/coupling/motor_mask.h"
#include "common/coupling/options.h"
#include "common/hardware/device.h"
#include "common/method/render/render.h"
#include "common/runtime/cycle.h"
#include "common/safety/safety_stage.h"

namespace twoport {

/// The master where there is no link: a virtual environment rendered directly on the device, the reference paper's case. It keeps
/// the limits at the device as MasterNode does. For a tick without a reading or with a force that no double holds, and after
/// a stop, it lets go.
template <int N>
class RenderNode {
 public:
  struct Output : Rendering<N>::Output {
    NoReport report;
  };

  RenderNode(const ControlOptions& o, Environment<N> environment)
      : rendering_{o, std::move(environment)}, motors_{o}, safety_{limits_at_device(o), -1.0} {}

  Output step(const Tick<MasterClock>& tick, const DeviceSample<N>& device, const NoReport&) noexcept {
    if (device.status == HardwareStatus::stopped || !all_finite(device.x, device.v, device.applied)) [[unlikely]]
      return fail_safe();
    Output out{rendering_.step({device.x, device.v}, device.applied, tick.dt, tick.ended), {}};
    if (!all_finite(out.command)) [[unlikely]]
      return fail_safe();
    out.command = safety_(out.command, device.x, device.v, tick.dt);
    if (!motors_.all()) [[unlikely]]
      out.command = motors_(out.command);
    return out;
  }

  [[nodiscard]] const LimitCounts& limit_counts() const noexcept { return safety_.counts(); }
  [[nodiscard]] Energy observed() const noexcept { return rendering_.observed(); }

 private:
  Output fail_safe() noexcept {
    rendering_.release();
    safety_.release();
    return {};
  }

  Rendering<N> rendering_;
  MotorMask<N> motors_;
  SafetyStage<N> safety_;
};

}  // namespace twoport
