#include "lab/study/trim.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string_view>
#include <utility>

#include "common/base/check.h"
#include "common/record/summary.h"
#include "common/scene/load.h"
#include "lab/run.h"
#include "lab/study/table.h"

namespace twoport::lab {
namespace {

/// Two sets of eight values of one distribution are separated by chance once in 6435 cases.
constexpr std::size_t kRuns = 8;

Material* material(EnvironmentSpec& spec) {
  auto* surface = std::get_if<Surface>(&spec);
  return surface != nullptr ? &surface->material : nullptr;
}

/// The scene without these, where that is a scene.
std::optional<Scene> rest(const Scene& scene, const std::vector<Block>& left_out) {
  try {
    return without(scene, left_out);
  } catch (const ConfigError&) {
    return {};
  }
}

std::vector<Block> marked(const std::vector<Block>& all, const std::vector<bool>& which) {
  std::vector<Block> some;
  for (std::size_t i = 0; i < all.size(); ++i)
    if (which[i]) some.push_back(all[i]);
  return some;
}
std::string paths(const std::vector<Block>& some) {
  std::vector<std::string> names;
  for (const Block& block : some) names.push_back(block.path);
  return fmt::format("{}", fmt::join(names, ", "));
}

// ---- runs

/// The scene as its run `i` has it. Where a controller switches, rounding grows into numbers even if nothing is drawn:
/// the seed moves on, and stiffnesses change in the twelfth digit. Run 0 is the scene itself.
Scene perturbed(Scene scene, std::size_t i) {
  const double little = 1.0 + 1e-12 * static_cast<double>(i);
  scene.seed += i;
  scene.control.coupling.stiffness_n_per_m *= little;
  if (scene.operator_model && scene.operator_model->hand) scene.operator_model->hand->stiffness_n_per_m *= little;
  for (EnvironmentSpec& each : scene.environment)
    if (Material* surface = material(each))
      surface->stiffness_n_per_m *= little;
    else
      std::get<Spring>(each).stiffness_n_per_m *= little;
  return scene;
}

/// Results of one variant: a summary for each of the kRuns, a cost for each run and repetition.
struct Seen {
  std::vector<Summary> of_run;
  std::vector<double> tick_ns;
};

/// Variants in turn, so that disturbances of the machine affect all alike.
std::vector<Seen> run_in_turn(const std::vector<Scene>& variants, int repetitions, Tally& tally) {
  std::vector<Seen> seen(variants.size());
  for (int r = 0; r < repetitions; ++r)
    for (std::size_t k = 0; k < kRuns; ++k)
      for (std::size_t i = 0; i < variants.size(); ++i) {
        Summary summary = run(perturbed(variants[i], k));
        seen[i].tick_ns.push_back(summary.step_ns());
        if (r == 0) seen[i].of_run.push_back(std::move(summary));
        tally.ran();
        tally.done();
      }
  return seen;
}

double cost_ratio(const Seen& a, const Seen& b) {
  std::vector<double> ratios(a.tick_ns.size());
  std::transform(a.tick_ns.begin(), a.tick_ns.end(), b.tick_ns.begin(), ratios.begin(), std::divides<>{});
  return median(ratios);
}

// ---- comparison of runs

/// One number of the summary over the runs.
struct Row {
  std::string key;
  std::array<double, kRuns> values;
  [[nodiscard]] double low() const { return *std::min_element(values.begin(), values.end()); }
  [[nodiscard]] double high() const { return *std::max_element(values.begin(), values.end()); }
};
std::vector<Row> rows(const Seen& seen) {
  std::vector<Row> all;
  for (std::size_t k = 0; k < kRuns; ++k) {
    std::size_t row = 0;
    for (const auto& [key, value] : numbers(seen.of_run[k])) {
      if (key == "step_ns") continue;
      if (k == 0) all.push_back({key, {}});
      all[row++].values[k] = value;
    }
  }
  return all;
}

Contrast scatter(const Seen& seen) {
  Contrast most;
  for (const Row& row : rows(seen)) {
    const double change = relative_change(row.key, row.low(), row.high());
    if (change > most.change) most = {row.key, row.low(), row.high(), change};
  }
  return most;
}

/// The keys of expectations that one run meets and the other does not, `stable` first.
std::vector<std::string> turned(const ExpectSpec& expect, const Summary& a, const Summary& b) {
  std::vector<std::string> keys;
  if (a.stable() != b.stable()) keys.push_back("stable");
  const auto check = [&](const Bound& bound, std::vector<Bound> ExpectSpec::*side) {
    ExpectSpec one;
    (one.*side).push_back(bound);
    if (bound.key != "step_ns" && violations(one, a).empty() != violations(one, b).empty()) keys.push_back(bound.key);
  };
  for (const Bound& bound : expect.at_least) check(bound, &ExpectSpec::at_least);
  for (const Bound& bound : expect.at_most) check(bound, &ExpectSpec::at_most);
  return keys;
}

Judged judge(const std::string& path, const Seen& with, const Seen& without, const ExpectSpec& expect,
             double tolerance) {
  std::vector<std::string> decisive;
  for (std::size_t k = 0; k < kRuns && decisive.empty(); ++k)
    decisive = turned(expect, with.of_run[k], without.of_run[k]);

  Contrast any, beyond;
  const std::vector<Row> a = rows(with), b = rows(without);
  for (std::size_t i = 0; i < a.size(); ++i) {
    const bool counts = decisive.empty() || a[i].key == decisive.front();
    const bool overlap = a[i].low() <= b[i].high() && b[i].low() <= a[i].high();
    for (std::size_t k = 0; k < kRuns && counts; ++k) {
      const Contrast d{a[i].key, a[i].values[k], b[i].values[k],
                       relative_change(a[i].key, a[i].values[k], b[i].values[k])};
      if (d.change > any.change) any = d;
      if (d.change > beyond.change && !overlap) beyond = d;
    }
  }
  const double saved = 1.0 - cost_ratio(without, with);
  if (!decisive.empty()) return {path, Need::needed, any, saved};
  if (any.change < tolerance) return {path, Need::spare, any, saved};
  if (beyond.change < tolerance) return {path, Need::in_scatter, any, saved};
  return {path, Need::needed, beyond, saved};
}

const char* words(Need need) {
  constexpr const char* kWords[] = {"needed", "within the scatter", "could be left out",
                                    "needed once the others are left out"};
  return kWords[static_cast<std::size_t>(need)];
}

}  // namespace

double relative_change(const std::string& key, double a, double b) {
  static constexpr std::pair<std::string_view, double> kFloors[] = {
      {"_j", 1e-6}, {"_min_energy_j", 1e-3}, {"_m", 1e-6}, {"_n", 1e-3}, {"_deg", 1e-2}, {"_s", 1e-3}};
  if (a == b || (std::isnan(a) && std::isnan(b))) return 0.0;
  if (!std::isfinite(a) || !std::isfinite(b)) return 1.0;
  double floor = 1.0;
  for (const auto& [ending, value] : kFloors)
    if (key.ends_with(ending)) floor = value;
  return std::abs(a - b) / std::max({std::abs(a), std::abs(b), floor});
}

std::vector<Block> blocks(const Scene& scene) {
  std::vector<Block> all = removable_parts(scene);
  std::erase_if(all, [&](const Block& block) { return !rest(scene, {block}); });
  return all;
}

Trim trim(const Scene& scene, double tolerance, int repetitions, const Heard& heard) {
  if (!(tolerance > 0.0 && tolerance < 1.0))
    throw ConfigError{fmt::format("--tolerance is {}; it must be > 0 and < 1", tolerance)};
  if (scene.control.architecture == Architecture::uncontrolled)
    throw ConfigError{
        "control.architecture is UNCONTROLLED; it must be another value: a summary has no figures of a robot alone"};
  const std::vector<Block> all = blocks(scene);
  std::vector<Scene> variants{scene};
  for (const Block& block : all) variants.push_back(without(scene, {block}));
  // Every block may turn out spare, and is then left out beside others.
  const std::size_t turns = static_cast<std::size_t>(repetitions);
  const std::size_t most = kRuns * (turns * (variants.size() + 3) + all.size());
  Tally tally{most, heard};
  tally.expect("run", most, 4 * variants.size());
  tally.begin("run");
  const std::vector<Seen> seen = run_in_turn(variants, repetitions, tally);

  Trim result;
  result.scatter = scatter(seen[0]);
  for (std::size_t i = 0; i < all.size(); ++i)
    result.blocks.push_back(judge(all[i].path, seen[0], seen[i + 1], scene.expect, tolerance));

  // One after the other, from the one that changes least, as long as all that are gone change less than the tolerance.
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < all.size(); ++i)
    if (result.blocks[i].need == Need::spare) order.push_back(i);
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return result.blocks[a].most.change < result.blocks[b].most.change;
  });
  tally.drop("run", kRuns * (all.size() - order.size()));
  std::vector<bool> gone(all.size(), false);
  for (const std::size_t i : order) {
    gone[i] = true;
    const std::optional<Scene> left = rest(scene, marked(all, gone));
    if (!left) tally.drop("run", kRuns);
    if (left && judge("", seen[0], run_in_turn({*left}, 1, tally)[0], scene.expect, tolerance).need == Need::spare)
      continue;
    gone[i] = false;
    result.blocks[i].need = Need::together;
  }
  std::vector<bool> loose(all.size(), false), both = gone;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (result.blocks[i].need != Need::in_scatter) continue;
    both[i] = true;
    loose[i] = both[i] = rest(scene, marked(all, both)).has_value();
  }

  const std::vector<Seen> last =
      run_in_turn({scene, without(scene, marked(all, gone)), without(scene, marked(all, both))}, repetitions, tally);
  result.spare = judge(paths(marked(all, gone)), last[0], last[1], scene.expect, tolerance);
  result.loose = judge(paths(marked(all, loose)), last[0], last[2], scene.expect, tolerance);
  return result;
}

std::string to_text(const Trim& trim, double tolerance) {
  std::size_t wide = 5;
  for (const Judged& block : trim.blocks) wide = std::max(wide, block.path.size());
  std::string text =
      fmt::format("{:<{}} {:<30} {:>9} {:>7}\n", "block", wide, "number that changes most", "change", "saved");
  const auto line = [&](const Judged& j) {
    return fmt::format("{:<30} {:>9.2g} {:>5.0f} %  {}\n", j.most.key, j.most.change, std::round(100.0 * j.saved) + 0.0,
                       words(j.need));
  };
  for (const Judged& block : trim.blocks) text += fmt::format("{:<{}} {}", block.path, wide, line(block));
  text += fmt::format("scatter over {} runs: {} {:.2g}\n", kRuns, trim.scatter.key, trim.scatter.change);
  if (trim.spare.path.empty()) {
    text += fmt::format("nothing could be left out at a tolerance of {}\n", tolerance);
  } else {
    text += fmt::format("could be left out together: {}\n  all at once: {}", trim.spare.path, line(trim.spare));
  }
  if (!trim.loose.path.empty())
    text += fmt::format("within the scatter: {}\n  without these too: {}", trim.loose.path, line(trim.loose));
  return text;
}

std::string to_csv(const Trim& trim) {
  std::string text = "block,verdict,key,with,without,change,saved\n";
  for (const Judged& j : trim.blocks)
    text += fmt::format("{},{},{},{},{},{},{}\n", j.path, words(j.need), j.most.key, j.most.with, j.most.without,
                        j.most.change, j.saved);
  return text;
}

std::vector<BlockCost> block_costs(const Scene& scene, int repetitions, const Heard& heard) {
  const std::vector<Block> all = blocks(scene);
  std::vector<std::string> labels;
  std::vector<Scene> variants;
  std::string label = "bare scene";
  for (std::size_t i = 0; i <= all.size(); ++i) {
    if (i > 0) label += (label.empty() ? "+ " : ", ") + all[i - 1].path;
    const std::optional<Scene> variant = rest(scene, {all.begin() + static_cast<std::ptrdiff_t>(i), all.end()});
    if (!variant) continue;  // a hand waits for its mass
    labels.push_back(std::exchange(label, ""));
    variants.push_back(*variant);
  }
  const std::size_t runs = kRuns * static_cast<std::size_t>(repetitions) * variants.size();
  Tally tally{runs, heard};
  tally.expect("run", runs, 4 * variants.size());
  tally.begin("run");
  const std::vector<Seen> seen = run_in_turn(variants, repetitions, tally);
  std::vector<BlockCost> costs;
  for (std::size_t i = 0; i < seen.size(); ++i)
    costs.push_back({labels[i], median(seen[i].tick_ns), cost_ratio(seen[i], seen[0]),
                     std::all_of(seen[i].of_run.begin(), seen[i].of_run.end(), [](auto& s) { return s.stable(); })});
  return costs;
}

std::string to_text(const std::vector<BlockCost>& costs) {
  std::size_t wide = 0;
  for (const BlockCost& cost : costs) wide = std::max(wide, cost.path.size());
  std::string text = fmt::format("{:<{}} {:>11} {:>7}\n", "model", wide, "ns per tick", "ratio");
  for (const BlockCost& cost : costs)
    text += fmt::format("{:<{}} {:>11.1f} {:>7.2f}{}\n", cost.path, wide, cost.tick_ns, cost.ratio,
                        cost.stable ? "" : "  unstable");
  return text;
}

std::string to_csv(const std::vector<BlockCost>& costs) {
  std::string csv = "model,tick_ns,ratio,stable\n";
  for (const BlockCost& cost : costs)
    csv += fmt::format("\"{}\",{},{},{}\n", cost.path, cost.tick_ns, cost.ratio, cost.stable ? 1 : 0);
  return csv;
}

}  // namespace twoport::lab
