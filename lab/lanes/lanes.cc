#include "lab/lanes/lanes.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "common/base/check.h"
#include "common/base/time.h"
#include "lab/engine/simulation.h"
#include "lab/lanes/batch.h"
#include "lab/lanes/cell.h"
#include "lab/lanes/runs.h"
#include "lab/study/parallel.h"
#include "sim/sim_device.h"

namespace twoport {

namespace lab {
namespace {

using namespace lanes;

/// A thread's work: cells of the queue until there are none.
template <int N>
void run_queue(Queue& queue, const Unit& unit, const LaneOptions& o, const FinishedInLanes& finished) {
  Runs<N> runs{unit, queue, o.verdict};
  Tails<N> tails{unit, queue};
  std::map<std::string, std::weak_ptr<const Intended>> paths;
  std::shared_ptr<const Intended> path;  // of the newest cell: the next one's is often the same
  const auto finish = [&](const Cell<N>& cell) { finished(cell.number, cell.summary(runs.step_ns())); };
  const auto check = [&] {
    if (o.stop != nullptr && *o.stop) throw Stopped{};
  };
  for (;;) {
    check();
    while (runs.has_room()) {
      const std::optional<std::size_t> number = queue.take();
      if (!number) break;
      const Scene& scene = queue.scene(*number);
      const sim::SimDevice<N> device{scene, Seconds{1.0 / scene.master_rate_hz}};
      std::weak_ptr<const Intended>& known = paths[path_key(scene)];
      path = known.lock();
      if (!path)
        known = path = intended_of<N>(device, scene, tick_from(to_duration(scene.duration_s), period_of(scene)));
      runs.add(std::make_unique<Cell<N>>(*number, scene, o.verdict, device, path));
    }
    if (runs.empty() && tails.empty()) return;
    if (!runs.empty())
      runs.step([&](std::unique_ptr<Cell<N>> cell) {
        if (cell->needs_tails()) {
          tails.add(std::move(cell));
        } else {
          finish(*cell);
        }
      });
    while (tails.is_full() || (runs.empty() && !tails.empty())) {
      check();
      tails.step(finish);
    }
  }
}

const Unit* unit_of(int lanes) {
#if defined(__x86_64__)
  if (lanes == 8 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
      __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw"))
    return &kAvx512;
  if (lanes == 4 && __builtin_cpu_supports("avx2")) return &kAvx2;
#endif
  return lanes == 2 ? &kBase : nullptr;
}

}  // namespace

int widest_lanes() {
  for (const int lanes : {8, 4})
    if (unit_of(lanes) != nullptr) return lanes;
  return 2;
}
std::string name_of_lanes(int lanes) {
  return unit_of(lanes)->name;
}
int checked_lanes(int lanes) {
  if (lanes == 0) return widest_lanes();
  if (lanes == 1 || unit_of(lanes) != nullptr) return lanes;
  throw ConfigError{
      fmt::format("--lanes {}: it must be 0 (as many as there are), 1, 2, 4 or 8, and at most {} on this processor",
                  lanes, widest_lanes())};
}

void run_in_lanes(std::span<const Scene* const> scenes, const LaneOptions& o, const FinishedInLanes& finished) {
  if (scenes.empty()) return;
  const Unit& unit = *unit_of(o.lanes);
  Queue queue{scenes};
  // A thread for fewer cells than it has lanes would step empty ones.
  const auto lanes = static_cast<std::size_t>(o.lanes), threads = static_cast<std::size_t>(std::max(o.jobs, 1));
  for_each_parallel(std::min(threads, (scenes.size() + lanes - 1) / lanes), o.jobs, [&](std::size_t) {
    if (scenes.front()->dof == 1) {
      run_queue<1>(queue, unit, o, finished);
    } else {
      run_queue<3>(queue, unit, o, finished);
    }
  });
}

}  // namespace lab
}  // namespace twoport
