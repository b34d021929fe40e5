#include "lab/study/many_runs.h"

#include <vector>

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

}  // namespace twoport::lab
