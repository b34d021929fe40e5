#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <map>
#include <span>
#include <string>

#include "common/record/summary.h"
#include "common/scene/scene.h"
#include "lab/run.h"

namespace twoport::lab {

/// Runs that were stepped several at once (lab/lanes/README.md), how many at once, and how often others ran alone for which reason.
struct LaneUse {
  int lanes = 1;
  std::size_t together = 0;
  std::map<std::string, std::size_t> alone{};

  void add(const LaneUse& more);
};

struct ManyRuns {
  int lanes = 0;  ///< simulations at once in a thread: 1, 2, 4 or 8; 0: as many as the processor can
  int jobs = 1;   ///< threads
  VerdictFrom verdict = VerdictFrom::tail;
  const std::atomic<bool>* stop = nullptr;  ///< as RunOptions::stop
};

/// Runs scenes, several at once where lanes take them. Calls `finished` for each as soon as it has its verdict, in any order and from
/// any thread, with its number and its summary, which is that of run(), to the bit, `step_ns` excepted. Throws ConfigError for an
/// impossible number of lanes.
LaneUse run_many(std::span<const Scene* const> scenes, const ManyRuns& options,
                 const std::function<void(std::size_t number, const Summary&)>& finished);

}  // namespace twoport::lab
