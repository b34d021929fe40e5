#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <span>
#include <string>

#include "common/record/summary.h"
#include "common/scene/scene.h"
#include "lab/run.h"

namespace twoport::lab {

/// Most simulations that this processor steps at once: 8 with AVX-512, 4 with AVX2, else 2.
int widest_lanes();
/// The instruction set of so many lanes: 2, 4 or 8.
std::string name_of_lanes(int lanes);
/// Throws ConfigError unless `lanes` is 0 (the widest), 1, or 2, 4 or 8 as far as this processor has them. Returns the number.
int checked_lanes(int lanes);

/// Why this scene has to run alone; empty: lanes take it.
std::string why_not_in_lanes(const Scene& scene);
/// Scenes of equal shape share a batch.
std::string shape_of_lanes(const Scene& scene);

struct LaneOptions {
  int lanes = 2;  ///< 2, 4 or 8
  int jobs = 1;   ///< threads
  VerdictFrom verdict = VerdictFrom::tail;
  const std::atomic<bool>* stop = nullptr;  ///< throws Stopped soon after it has become true
};
using FinishedInLanes = std::function<void(std::size_t number, const Summary&)>;

/// Runs scenes that lanes take, all of one shape. Calls `finished` for each as soon as it has its verdict, from any thread, with its
/// number and the summary that run(scene) makes, to the bit, `step_ns` excepted: here the processor time of a tick of all of a thread's
/// cells over their number.
void run_in_lanes(std::span<const Scene* const> scenes, const LaneOptions& options, const FinishedInLanes& finished);

}  // namespace twoport::lab
