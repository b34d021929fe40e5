#include "lab/study/many_runs.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "lab/lanes/lanes.h"
#include "lab/study/parallel.h"

namespace twoport::lab {

void LaneUse::add(const LaneUse& more) {
  lanes = more.lanes;
  together += more.together;
  for (const auto& [why, count] : more.alone) alone[why] += count;
}

LaneUse run_many(std::span<const Scene* const> scenes, const ManyRuns& o,
                 const std::function<void(std::size_t, const Summary&)>& finished) {
  LaneUse use{.lanes = checked_lanes(o.lanes)};
  std::map<std::string, std::vector<std::size_t>> shapes;
  std::vector<std::size_t> alone;
  for (std::size_t i = 0; i < scenes.size(); ++i) {
    if (use.lanes == 1) {
      alone.push_back(i);
      continue;
    }
    const std::string why = why_not_in_lanes(*scenes[i]);
    if (why.empty()) {
      shapes[shape_of_lanes(*scenes[i])].push_back(i);
    } else {
      ++use.alone[why];
      alone.push_back(i);
    }
  }
  for (const auto& [shape, numbers] : shapes) {
    if (numbers.size() == 1) {
      ++use.alone["no other run has its shape"];
      alone.push_back(numbers[0]);
      continue;
    }
    use.together += numbers.size();
    std::vector<const Scene*> of_shape;
    for (const std::size_t i : numbers) of_shape.push_back(scenes[i]);
    run_in_lanes(of_shape, {.lanes = use.lanes, .jobs = o.jobs, .verdict = o.verdict, .stop = o.stop},
                 [&, &all = numbers](std::size_t i, const Summary& summary) { finished(all[i], summary); });
  }
  for_each_parallel(alone.size(), o.jobs, [&](std::size_t i) {
    finished(alone[i], run(*scenes[alone[i]], {.verdict = o.verdict, .stop = o.stop}));
  });
  return use;
}

Tally::Tally(std::size_t count, Heard heard, std::size_t kept)
    : progress_{.done = kept, .kept = kept, .count = count, .spent_s = 0.0}, heard_{std::move(heard)} {
  if (heard_) heard_(progress_);
}

void Tally::done() {
  const std::lock_guard lock{guard_};
  ++progress_.done;
  progress_.spent_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  if (heard_) heard_(progress_);
}

namespace {

constexpr std::size_t kLoaded = 4096;  ///< scenes that are held at once

/// A cell some of whose seeds have run.
struct OpenCell {
  std::vector<Summary> of_seeds;
  std::size_t finished = 0;
};

}  // namespace

LaneUse run_cells(const Cells& cells, const ManyRuns& o, Tally& tally,
                  const std::function<void(std::size_t, std::uint64_t, const std::vector<Summary>&)>& finished) {
  LaneUse use{.lanes = checked_lanes(o.lanes)};
  std::mutex guard;
  std::map<std::size_t, OpenCell> open;
  const std::size_t runs = cells.count * cells.seeds;
  for (std::size_t from = 0; from < runs; from += kLoaded) {
    const std::size_t to = std::min(runs, from + kLoaded), first = from / cells.seeds, last = (to - 1) / cells.seeds;
    std::vector<std::optional<Scene>> loaded(to - from);
    for_each_parallel(last - first + 1, o.jobs, [&](std::size_t i) {
      try {
        const Scene scene = cells.scene(first + i);
        const std::size_t of_cell = (first + i) * cells.seeds;  // its first run
        for (std::size_t run = std::max(from, of_cell); run < std::min(to, of_cell + cells.seeds); ++run)
          loaded[run - from].emplace(scene).seed += run - of_cell;
      } catch (const ConfigError&) {  // thrown once the others have run
      }
    });
    std::vector<const Scene*> scenes;
    std::vector<std::size_t> numbers;
    for (std::size_t i = 0; i < loaded.size(); ++i)
      if (loaded[i]) scenes.push_back(&*loaded[i]), numbers.push_back(from + i);
    use.add(run_many(scenes, o, [&](std::size_t number, const Summary& summary) {
      const std::size_t cell = numbers[number] / cells.seeds, seed = numbers[number] % cells.seeds;
      const std::lock_guard lock{guard};
      OpenCell& of_cell = open[cell];
      of_cell.of_seeds.resize(cells.seeds);
      of_cell.of_seeds[seed] = summary;
      if (++of_cell.finished < cells.seeds) return;
      finished(cell, scenes[number]->seed - seed, of_cell.of_seeds);
      open.erase(cell);
      tally.done();
    }));
    for (std::size_t i = 0; i < loaded.size(); ++i)
      if (!loaded[i]) static_cast<void>(cells.scene((from + i) / cells.seeds));
  }
  return use;
}

}  // namespace twoport::lab
