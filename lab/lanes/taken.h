#pragma once

#include <cstddef>
#include <cstdint>

#include "common/scene/scene.h"
#include "lab/lanes/batch.h"

// What lanes take of a scene, and how.

namespace twoport::lab::lanes {

inline constexpr std::int64_t kMostLag = 1 << 16;
inline constexpr double kMostTicks = 4e6;  // of a run: its path is kept

/// Of a tick [ns].
std::int64_t period_of(const Scene& scene);
/// Delay of a direction in ticks, as DueQueue makes it where ticks are a whole number of nanoseconds apart.
std::int64_t lag_of(const ImpairmentOptions& way, std::int64_t period_ns);
/// The packet that comes before the first one of the slave's is as old as the network's delay, and a tick.
std::int64_t first_force_lag_of(const Scene& scene);
/// Age of the oldest packet or force that a tick may read [ticks].
std::int64_t oldest_of(const Scene& scene);
/// Length of HeldForce's window [ticks].
std::size_t window_of(const Scene& scene);
/// Are the method's halves, the modes and the network stepped in lanes too, or by the laboratory's nodes lane by lane?
LaneMethod method_of(const Scene& scene);

}  // namespace twoport::lab::lanes
