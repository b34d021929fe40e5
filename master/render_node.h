#pragma once

#include <utility>

#include "common/base/time.h"
#include "common/coupling/options.h"
#include "common/hardware/device.h"
#include "common/method/render/render.h"
#include "common/runtime/cycle.h"

namespace twoport {

/// The master where there is no link: a virtual environment rendered directly on the device, the reference paper's case.
/// For a tick without a reading it lets go.
template <int N>
class RenderNode {
 public:
  struct Output : Rendering<N>::Output {
    NoReport report;
  };

  RenderNode(const ControlOptions& o, Environment<N> environment) : rendering_{o, std::move(environment)} {}

  [[gnu::flatten]] Output step(const Tick<MasterClock>& tick, const DeviceSample<N>& device, const NoReport&) noexcept {
    if (!all_finite(device.x, device.v, device.applied)) [[unlikely]] {
      rendering_.release();
      return {};
    }
    return {rendering_.step({device.x, device.v}, device.applied, tick.dt, tick.ended), {}};
  }

  [[nodiscard]] Energy observed() const noexcept { return rendering_.observed(); }

 private:
  Rendering<N> rendering_;
};

}  // namespace twoport
