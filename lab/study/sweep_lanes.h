#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <string>

#include "lab/study/sweep.h"

namespace twoport::lab {

/// Runs that were stepped several at once (lab/lanes/README.md), how many at once, and how often others ran alone for which reason.
struct LaneUse {
  int lanes = 1;
  std::size_t together = 0;
  std::map<std::string, std::size_t> alone{};
};

/// sweep() with so many simulations at once in a thread: 1, 2, 4 or 8; 0: as many as the processor can. sweep() without it uses 0.
Table sweep(const SweepOptions& options, int lanes, LaneUse& use,
            const std::function<void(const Progress&)>& heard = {});

}  // namespace twoport::lab
