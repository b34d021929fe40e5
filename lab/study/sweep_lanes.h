#pragma once

#include <functional>

#include "lab/study/many_runs.h"
#include "lab/study/sweep.h"

namespace twoport::lab {

/// sweep() with so many simulations at once in a thread: 1, 2, 4 or 8; 0: as many as the processor can. sweep() without it uses 0.
Table sweep(const SweepOptions& options, int lanes, LaneUse& use,
            const std::function<void(const Progress&)>& heard = {});

}  // namespace twoport::lab
