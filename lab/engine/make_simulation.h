#pragma once

#include "common/method/passivity/time_domain/time_domain.h"
#include "lab/engine/loops.h"
#include "lab/engine/simulation.h"

namespace twoport::lab {

template <int N>
std::unique_ptr<Simulation<N>> make_simulation(const Scene& scene, Taps<N>* taps) {
  switch (scene.control.architecture) {
    case Architecture::render:
      return std::make_unique<RenderLoop<N>>(scene, taps);
    case Architecture::uncontrolled:
      return std::make_unique<BodyLoop<N>>(scene);
    default:
      // One loop for each size does for every method; the controllers that sweeps run most have one of their own, 10 %
      // faster.
      if (scene.control.transparency == kPlainTransparency &&
          scene.control.controller.method != ::twoport::Method::none && scene.schedule.empty())
        return std::make_unique<LinkLoop<N, TimeDomainPassivity>>(scene, taps);
      return std::make_unique<LinkLoop<N>>(scene, taps);
  }
}

}  // namespace twoport::lab
