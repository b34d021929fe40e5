#include "lab/study/many_runs.h"

#include <algorithm>
#include <iterator>
#include <numeric>
#include <set>
#include <utility>

#include "common/base/check.h"
#include "lab/engine/simulation.h"
#include "lab/lanes/lanes.h"
#include "lab/study/parallel.h"

namespace twoport::lab {

void LaneUse::add(const LaneUse& more) {
  lanes = more.lanes;
  together += more.together;
  for (const auto& [why, count] : more.alone) alone[why] += count;
}

namespace {

/// Runs of one kind: a sample that runs first, and the rest.
struct Part {
  std::string kind;
  std::vector<std::size_t> first, rest;
  bool in_lanes;
};
/// Neighbours are alike: the sample is of all parts of the row.
Part part_of(std::string kind, const std::vector<std::size_t>& numbers, std::size_t sample, bool in_lanes) {
  Part part{std::move(kind), {}, {}, in_lanes};
  const std::size_t every = std::max<std::size_t>(1, numbers.size() / std::max<std::size_t>(sample, 1));
  for (std::size_t i = 0; i < numbers.size(); ++i)
    (i % every == 0 && (every == 1 || part.first.size() < sample) ? part.first : part.rest).push_back(numbers[i]);
  return part;
}
std::size_t sample_of(std::size_t count, int jobs) {
  return std::max(std::min<std::size_t>(count / 8, 64), 2 * static_cast<std::size_t>(std::max(jobs, 1)));
}

}  // namespace

LaneUse run_many(std::span<const Scene* const> scenes, const ManyRuns& o,
                 const std::function<void(std::size_t, const Summary&)>& finished, Tally* tally) {
  LaneUse use{.lanes = checked_lanes(o.lanes)};
  std::map<std::string, std::vector<std::size_t>> shapes;
  std::vector<std::size_t> alone;
  for (std::size_t i = 0; i < scenes.size(); ++i) {
    if (use.lanes == 1) {
      alone.push_back(i);
      continue;
    }
    const std::string why = o.robot != nullptr ? "the robot is that of --robot" : why_not_in_lanes(*scenes[i]);
    if (why.empty()) {
      shapes[shape_of_lanes(*scenes[i])].push_back(i);
    } else {
      ++use.alone[why];
      alone.push_back(i);
    }
  }
  std::vector<Part> parts;
  const auto full = static_cast<std::size_t>(use.lanes * std::max(o.jobs, 1));  // all lanes of all threads
  for (const auto& [shape, numbers] : shapes) {
    if (numbers.size() == 1) {
      ++use.alone["no other run has its shape"];
      alone.push_back(numbers[0]);
      continue;
    }
    use.together += numbers.size();
    parts.push_back(part_of(shape, numbers, tally != nullptr ? full : numbers.size(), true));
  }
  parts.push_back(part_of("alone", alone, tally != nullptr ? sample_of(alone.size(), o.jobs) : alone.size(), false));
  if (tally != nullptr)
    for (Part& part : parts)
      if (!tally->expect(part.kind, part.first.size() + part.rest.size(), part.first.size())) {
        part.first.insert(part.first.end(), part.rest.begin(), part.rest.end());
        part.rest.clear();
      }
  for (const auto which : {&Part::first, &Part::rest})
    for (const Part& part : parts) {
      const std::vector<std::size_t>& numbers = part.*which;
      if (tally != nullptr) tally->begin(part.kind);
      const auto end = [&](std::size_t i, const Summary& summary) {
        if (tally != nullptr) tally->ran();
        finished(numbers[i], summary);
      };
      if (part.in_lanes) {
        std::vector<const Scene*> of_shape;
        for (const std::size_t i : numbers) of_shape.push_back(scenes[i]);
        run_in_lanes(of_shape, {.lanes = use.lanes, .jobs = o.jobs, .verdict = o.verdict, .stop = o.stop}, end);
      } else {
        for_each_parallel(numbers.size(), o.jobs, [&](std::size_t i) {
          end(i, run(*scenes[numbers[i]], {.verdict = o.verdict, .stop = o.stop, .robot = o.robot}));
        });
      }
    }
  return use;
}

void run_each(std::size_t count, int jobs, Tally& tally, const std::function<void(std::size_t)>& work) {
  std::vector<std::size_t> all(count);
  std::iota(all.begin(), all.end(), std::size_t{0});
  const Part part = part_of("run", all, sample_of(count, jobs), false);
  tally.expect(part.kind, count, part.first.size());
  tally.begin(part.kind);
  for (const auto* numbers : {&part.first, &part.rest})
    for_each_parallel(numbers->size(), jobs, [&](std::size_t i) {
      work((*numbers)[i]);
      tally.ran();
      tally.done();
    });
}

Tally::Tally(std::size_t count, Heard heard, std::size_t kept, std::size_t runs)
    : progress_{.done = kept, .kept = kept, .count = count, .spent_s = 0.0},
      forecast_{(count - kept) * runs},
      heard_{std::move(heard)} {
  if (heard_) heard_(progress_);
}
double Tally::now_s() const {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
}
void Tally::done() {
  const std::lock_guard lock{guard_};
  ++progress_.done;
  progress_.spent_s = now_s();
  progress_.left_s = forecast_.left_s();
  if (heard_) heard_(progress_);
}
bool Tally::expect(const std::string& kind, std::size_t runs, std::size_t sample) {
  const std::lock_guard lock{guard_};
  return forecast_.expect(kind, runs, sample);
}
void Tally::read(std::size_t runs, double spent_s) {
  const std::lock_guard lock{guard_};
  forecast_.read(runs, spent_s);
}
void Tally::begin(const std::string& kind) {
  const std::lock_guard lock{guard_};
  forecast_.begin(kind, now_s());
}
void Tally::ran(std::size_t runs) {
  const std::lock_guard lock{guard_};
  for (std::size_t i = 0; i < runs; ++i) forecast_.ran(now_s());
}
void Tally::drop(const std::string& kind, std::size_t runs) {
  const std::lock_guard lock{guard_};
  progress_.count -= runs;
  forecast_.drop(kind, runs);
}

namespace {

constexpr std::size_t kLoaded = 4096;  ///< scenes that are held at once

/// A cell some of whose seeds have run.
struct OpenCell {
  std::vector<Summary> of_seeds;
  std::size_t finished = 0;
};

}  // namespace

std::size_t next_end(const Cells& cells, std::vector<std::size_t>& order, std::size_t from, std::size_t enough,
                     std::size_t least) {
  // As many whole levels of cells in order of level as are so many runs.
  const auto levels_of = [&](const std::vector<std::size_t>& all, std::size_t at, std::size_t runs) {
    for (const std::size_t begin = at; at < all.size() && (at - begin) * cells.seeds < runs;)
      for (const std::size_t level = cells.levels[all[at]]; at < all.size() && cells.levels[all[at]] == level;) ++at;
    return at;
  };
  if (from > 0 && cells.first) {
    const std::vector<bool> is_first = cells.first();
    std::vector<std::size_t> first;
    std::copy_if(order.begin() + static_cast<std::ptrdiff_t>(from), order.end(), std::back_inserter(first),
                 [&](std::size_t cell) { return is_first[cell]; });
    if (first.size() * cells.seeds >= least) {
      first.resize(levels_of(first, 0, least));
      const std::set<std::size_t> now{first.begin(), first.end()};
      std::stable_partition(order.begin() + static_cast<std::ptrdiff_t>(from), order.end(),
                            [&](std::size_t cell) { return now.contains(cell); });
      return from + first.size();
    }
  }
  const std::size_t to = levels_of(order, from, enough);
  return (order.size() - to) * cells.seeds < least ? order.size() : to;
}

LaneUse run_cells(const Cells& cells, const ManyRuns& o, Tally& tally,
                  const std::function<void(std::size_t, std::uint64_t, const std::vector<Summary>&)>& finished) {
  LaneUse use{.lanes = checked_lanes(o.lanes)};
  std::mutex guard;
  std::map<std::size_t, OpenCell> open;
  std::vector<std::size_t> order;
  const auto run_round = [&](std::size_t from, std::size_t to) {  // runs of cells in this order
    const std::size_t first = from / cells.seeds, last = (to - 1) / cells.seeds;
    std::vector<std::optional<Scene>> loaded(to - from);
    const auto begun = std::chrono::steady_clock::now();
    for_each_parallel(last - first + 1, o.jobs, [&](std::size_t i) {
      if (o.stop != nullptr && *o.stop) throw Stopped{};
      try {
        const Scene scene = cells.scene(order[first + i]);
        const std::size_t of_cell = (first + i) * cells.seeds;  // its first run
        for (std::size_t run = std::max(from, of_cell); run < std::min(to, of_cell + cells.seeds); ++run)
          loaded[run - from].emplace(scene).seed += run - of_cell;
      } catch (const ConfigError&) {  // thrown once the others have run
      }
    });
    tally.read(loaded.size(), std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count());
    std::vector<const Scene*> scenes;
    std::vector<std::size_t> numbers;
    for (std::size_t i = 0; i < loaded.size(); ++i)
      if (loaded[i]) scenes.push_back(&*loaded[i]), numbers.push_back(from + i);
    use.add(run_many(
        scenes, o,
        [&](std::size_t number, const Summary& summary) {
          const std::size_t cell = numbers[number] / cells.seeds, seed = numbers[number] % cells.seeds;
          const std::lock_guard lock{guard};
          OpenCell& of_cell = open[cell];
          of_cell.of_seeds.resize(cells.seeds);
          of_cell.of_seeds[seed] = summary;
          if (++of_cell.finished < cells.seeds) return;
          finished(order[cell], scenes[number]->seed - seed, of_cell.of_seeds);
          open.erase(cell);
          tally.done();
        },
        &tally));
    for (std::size_t i = 0; i < loaded.size(); ++i)
      if (!loaded[i]) static_cast<void>(cells.scene(order[(from + i) / cells.seeds]));
  };
  std::vector<std::size_t> by_level(cells.count);
  std::iota(by_level.begin(), by_level.end(), std::size_t{0});
  if (!cells.levels.empty())
    std::stable_sort(by_level.begin(), by_level.end(),
                     [&](std::size_t a, std::size_t b) { return cells.levels[a] < cells.levels[b]; });
  const auto start = std::chrono::steady_clock::now();
  // First a few per lane, then what takes a second: threads idle where the last of a shape end.
  const std::size_t least = 4 * static_cast<std::size_t>(use.lanes * std::max(o.jobs, 1));
  std::size_t enough = least;
  // Values of an axis without order, such as methods, are often of shapes that do not run together.
  const auto apart = static_cast<std::size_t>(std::count(cells.levels.begin(), cells.levels.end(), std::size_t{0}));
  for (std::size_t begin = 0, end; begin < cells.count; begin = end) {
    end = cells.levels.empty() ? cells.count
                               : next_end(cells, by_level, begin, enough, least * std::max<std::size_t>(apart, 1));
    const std::size_t from = begin * cells.seeds, to = end * cells.seeds, rounds = (to - from + kLoaded - 1) / kLoaded;
    // Every round has cells of all parts of the row, so that the first one shows what the others cost.
    for (std::size_t round = 0; round < rounds; ++round)
      for (std::size_t i = begin + round; i < end; i += rounds) order.push_back(by_level[i]);
    for (std::size_t round = from; round < to; round += kLoaded) run_round(round, std::min(to, round + kLoaded));
    const double spent_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    enough = std::max(least, static_cast<std::size_t>(static_cast<double>(to) / std::max(spent_s, 1e-3)));
    if (end < cells.count && cells.level_ended) cells.level_ended();
  }
  return use;
}

}  // namespace twoport::lab
