#include "lab/study/sweep.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string_view>
#include <tuple>
#include <utility>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/print_error.h"
#include "common/record/summary.h"
#include "common/scene/scene_text.h"
#include "common/scene/text.h"
#include "lab/both_couplings.h"
#include "lab/lanes/lanes.h"
#include "lab/study/cells.h"
#include "lab/study/digest.h"
#include "lab/study/many_runs.h"
#include "lab/study/parallel.h"
#include "lab/study/seeds.h"
#include "lab/study/sweep_lanes.h"

namespace twoport::lab {
namespace {

constexpr std::size_t kMostRuns = 1'000'000'000;

template <class Number>
bool reads(std::string_view text, Number& number) {
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc{} && stop == text.data() + text.size();
}

std::vector<std::string_view> parts(std::string_view text, char separator) {
  std::vector<std::string_view> all;
  int depth = 0;
  std::size_t from = 0;
  for (std::size_t i = 0; i <= text.size(); ++i) {
    if (i < text.size() && (text[i] == '[' || text[i] == '{')) ++depth;
    if (i < text.size() && (text[i] == ']' || text[i] == '}')) --depth;
    if (i < text.size() && (text[i] != separator || depth > 0)) continue;
    all.push_back(text.substr(from, i - from));
    from = i + 1;
  }
  return all;
}

std::vector<std::string> overrides(const SweepOptions& o, const std::vector<std::string>& values) {
  std::vector<std::string> all;
  for (std::size_t i = 0; i < values.size(); ++i) o.axes[i].append_overrides(all, values[i]);
  return all;
}

using Columns = std::vector<std::pair<std::string, std::string>>;

/// The figures of a summary, as (name, value).
std::vector<std::pair<std::string, double>> figures_of(const Summary& summary) {
  std::vector<std::pair<std::string, double>> all = numbers(summary);
  std::erase_if(all, [](const auto& figure) { return figure.first == "step_ns"; });
  return all;
}

/// What a table holds of one run, as (column, text).
Columns columns_of(const Summary& summary) {
  Columns all;
  for (const auto& [name, value] : figures_of(summary)) all.emplace_back(name, fmt::format("{}", value));
  for (auto& word : texts(summary)) all.push_back(std::move(word));
  return all;
}

/// What a table holds of a cell that was run with several seeds, from `first_seed` on.
Columns columns_of(const std::vector<Summary>& of_seeds, std::uint64_t first_seed) {
  std::vector<std::vector<std::pair<std::string, double>>> figures;
  for (const Summary& summary : of_seeds) figures.push_back(figures_of(summary));
  Columns all;
  std::vector<double> values(of_seeds.size());
  for (std::size_t i = 0; i < figures.front().size(); ++i) {
    for (std::size_t k = 0; k < values.size(); ++k) values[k] = figures[k][i].second;
    const std::string& name = figures.front()[i].first;
    const Spread s = spread(name, values);
    all.emplace_back(name, fmt::format("{}", s.mean));
    all.emplace_back(name + "_sd", fmt::format("{}", s.sd));
    all.emplace_back(name + "_worst", fmt::format("{}", s.worst));
  }
  const std::size_t worst = worst_seed(of_seeds);
  for (auto& word : texts(of_seeds[worst])) all.push_back(std::move(word));
  all.emplace_back("worst_seed", fmt::format("{}", first_seed + worst));
  return all;
}

/// Throws ConfigError where an axis sets anew what an earlier one has set, however it is spelled: environment[0].wall and
/// environment[0].spring exclude each other.
void refuse_lost(const SweepOptions& o, const SceneText& base) {
  const auto end = [](const Axis& axis, bool last) { return last ? axis.values.back() : axis.values.front(); };
  for (std::size_t later = 1; later < o.axes.size(); ++later)
    for (std::size_t i = 0; i < later; ++i)
      for (const auto& [last_of_i, last] : {std::pair{false, false}, {true, false}, {true, true}}) {
        std::vector<std::string> of_i, of_later;
        for (std::size_t k = 0; k <= later; ++k)
          o.axes[k].append_overrides(k <= i ? of_i : of_later, end(o.axes[k], k == i ? last_of_i : last));
        if (!base.keeps(of_i, of_later))
          throw ConfigError{fmt::format("--vary {}: what it sets, --vary {} sets anew; vary one of them",
                                        o.axes[i].name(), o.axes[later].name())};
      }
}

/// Makes the plan of a sweep, and checks each single value before a cell is run. `base`: the scene, with what is set in every cell.
Plan plan_of(const SweepOptions& o, const SceneText& base) {
  if (o.axes.empty()) throw ConfigError{"--vary is missing; it must read PATH=SPEC"};
  Plan plan{.digest = {}, .axes = o.axes, .seeds = o.seeds, .columns = {}};
  double cells = 1.0;
  for (const Axis& axis : o.axes) {
    cells *= static_cast<double>(axis.values.size());
    refuse_overlap(axis, plan.columns);
    for (const std::string& path : axis.paths) {
      if (path == "seed" && o.seeds > 0)
        throw ConfigError{fmt::format("--seeds {}: --vary {} gives the seed of each cell", o.seeds, axis.name())};
      plan.columns.push_back(path);
    }
  }
  if (cells > static_cast<double>(kMostCells))
    throw ConfigError{fmt::format("--vary: {:.0f} cells; there must be at most {}", cells, kMostCells)};
  if (cells * static_cast<double>(o.seeds) > static_cast<double>(kMostRuns))
    throw ConfigError{fmt::format("--seeds {}: {:.0f} cells make {:.0f} runs; there must be at most {}", o.seeds, cells,
                                  cells * static_cast<double>(o.seeds), kMostRuns)};
  for (const auto& [name, text] : o.seeds > 0 ? columns_of({Summary{}}, 0) : columns_of(Summary{}))
    plan.columns.push_back(name);

  refuse_lost(o, base);
  const std::vector<std::string> first = plan.values(0);
  const Scene scene = base.with(overrides(o, first));
  for (std::size_t i = 0; i < o.axes.size(); ++i) {
    std::vector<std::string> values = first;
    for (const std::string& value : o.axes[i].values) {
      values[i] = value;
      static_cast<void>(base.with(overrides(o, values)));
    }
  }

  // Cells are of one sweep when scene text, recorded delays, overrides, axes, seeds, verdict and version are the same.
  Digest digest;
  digest.add(TWOPORT_VERSION);
  digest.add(o.text ? *o.text : read_whole(o.scene));
  for (const std::string& assignment : o.set) digest.add(assignment);
  for (const Axis& axis : o.axes) {
    digest.add(axis.name());
    for (const std::string& value : axis.values) digest.add(value);
  }
  if (o.seeds > 0) digest.add(fmt::format("seeds {}", o.seeds));
  if (o.verdict == VerdictFrom::lean) digest.add("verdict lean");
  if (o.verdict == VerdictFrom::plain) digest.add("verdict plain");
  for (const auto* direction : {&scene.to_slave, &scene.to_master})
    for (const double delay : direction->recorded_delay_s) digest.add(delay);
  plan.digest = digest.text();
  return plan;
}

/// A cell some of whose seeds have run.
struct OpenCell {
  std::vector<Summary> of_seeds;
  std::size_t finished = 0;
};

/// One run of a sweep: the k-th seed of a cell.
struct Run {
  std::size_t cell, k;
};

/// The scene of a run, and the seed that the cell's scene has.
std::pair<Scene, std::uint64_t> scene_of_run(const SweepOptions& o, const SceneText& base, const Plan& plan,
                                             const Run& run) {
  try {
    Scene scene = base.with(overrides(o, plan.values(run.cell)));
    const std::uint64_t first_seed = scene.seed;
    scene.seed += run.k;
    return {std::move(scene), first_seed};
  } catch (const ConfigError& e) {
    throw ConfigError{fmt::format("cell {} ({}): {}", run.cell, plan.name(run.cell), e.what())};
  }
}

/// Runs each cell with each seed, several at once where lanes take them, the rest alone. `finished` is called from any thread, with each
/// run, its summary and the seed of its cell's scene.
template <class Finished>
LaneUse run_all(const SweepOptions& o, int lanes, const SceneText& base, const Plan& plan,
                const std::vector<std::size_t>& cells, std::size_t seeds, Finished finished) {
  constexpr std::size_t kLoaded = 4096;
  LaneUse use{.lanes = checked_lanes(lanes)};
  for (std::size_t from = 0; from < cells.size() * seeds; from += kLoaded) {
    const std::size_t count = std::min(kLoaded, cells.size() * seeds - from);
    const auto nth = [&](std::size_t i) { return Run{cells[(from + i) / seeds], (from + i) % seeds}; };
    std::vector<std::optional<Scene>> loaded(count);
    std::vector<std::uint64_t> first_seeds(count);
    for_each_parallel(count, o.jobs, [&](std::size_t i) {
      try {
        std::tie(loaded[i], first_seeds[i]) = scene_of_run(o, base, plan, nth(i));
      } catch (const ConfigError&) {  // thrown once the others have run
      }
    });
    std::vector<const Scene*> scenes;
    std::vector<std::size_t> numbers;
    for (std::size_t i = 0; i < count; ++i)
      if (loaded[i]) scenes.push_back(&*loaded[i]), numbers.push_back(i);
    use.add(run_many(scenes, {.lanes = lanes, .jobs = o.jobs, .verdict = o.verdict, .stop = o.stop},
                     [&](std::size_t number, const Summary& summary) {
                       const std::size_t i = numbers[number];
                       finished(nth(i), with_verdict_of_both(summary), first_seeds[i]);
                     }));
    for (std::size_t i = 0; i < count; ++i)
      if (!loaded[i]) scene_of_run(o, base, plan, nth(i));
  }
  return use;
}

/// Is `path` within the block or list `whole`?
bool is_part(std::string_view path, std::string_view whole) {
  return path.starts_with(whole) && path.size() > whole.size() &&
         (path[whole.size()] == '.' || path[whole.size()] == '[');
}

/// One line of a table, the newline included.
std::string csv_line(const std::vector<std::string>& row) {
  std::string csv;
  for (std::size_t i = 0; i < row.size(); ++i) {
    if (i > 0) csv += ',';
    if (row[i].find_first_of(",\"\n") == std::string::npos) {
      csv += row[i];
      continue;
    }
    csv += '"';
    for (const char c : row[i]) csv += c == '"' ? "\"\"" : std::string(1, c);
    csv += '"';
  }
  return csv + '\n';
}

using Names = std::optional<std::vector<std::string>>;

/// A table that takes rows of a plan in order: its file has all columns, what is returned those of `names`.
class TableWriter {
 public:
  /// `path`: of the file; empty: none.
  TableWriter(const Plan& plan, const Names& names, const std::string& path)
      : table_{.axes = plan.axes, .seeds = plan.seeds, .columns = {}, .rows = {}} {
    const std::size_t varied = plan.varied_columns(0).size();
    for (std::size_t i = 0; i < plan.columns.size(); ++i)
      if (i < varied || !names || std::find(names->begin(), names->end(), plan.columns[i]) != names->end())
        returned_.push_back(i);
    table_.columns = chosen(plan.columns);
    if (path.empty()) return;
    file_.emplace(path);
    file_->write(csv_line(plan.columns));
  }

  void add(const std::vector<std::string>& row) {
    if (file_) file_->write(csv_line(row));
    table_.rows.push_back(chosen(row));
  }
  Table finish() {
    if (file_) file_->commit();
    return std::move(table_);
  }

 private:
  [[nodiscard]] std::vector<std::string> chosen(const std::vector<std::string>& row) const {
    std::vector<std::string> some;
    for (const std::size_t i : returned_) some.push_back(row[i]);
    return some;
  }

  Table table_;
  std::vector<std::size_t> returned_;
  std::optional<WholeFile> file_;
};

}  // namespace

std::string Axis::name() const {
  return fmt::format("{}", fmt::join(paths, ","));
}

void Axis::append_overrides(std::vector<std::string>& overrides, const std::string& value) const {
  for (const std::string& path : paths) overrides.push_back(path + "=" + value);
}

std::vector<std::string> parse_paths(const std::string& text, const std::string& what) {
  std::vector<std::string> paths;
  for (const std::string_view path : parts(text, ',')) {
    if (path.empty()) throw ConfigError{fmt::format("{}: a path is empty; linked paths read A,B", what)};
    if (std::find(paths.begin(), paths.end(), path) != paths.end())
      throw ConfigError{fmt::format("{}: {} is named twice", what, path)};
    paths.emplace_back(path);
  }
  return paths;
}

Axis parse_axis(const std::string& text, const std::string& option) {
  const std::string what = fmt::format("{} {}", option, text);
  const auto wrong = [&](const std::string& words) { return ConfigError{fmt::format("{}: {}", what, words)}; };
  const char* const allowed = "it must read PATH=a,b,c or PATH=start:stop:count or PATH=start:stop:count:log";
  const std::size_t equals = text.find('=');
  if (equals == text.npos || equals == 0 || equals + 1 == text.size()) throw wrong(allowed);
  Axis axis{.paths = parse_paths(text.substr(0, equals), what), .values = {}, .logarithmic = false};
  const std::string_view spec = std::string_view{text}.substr(equals + 1);

  const std::vector<std::string_view> range = parts(spec, ':');
  if (range.size() == 1) {
    for (const std::string_view value : parts(spec, ',')) {
      if (value.empty()) throw wrong("a value is empty; " + std::string{allowed});
      axis.values.emplace_back(value);
    }
    return axis;
  }
  double start = 0.0, stop = 0.0;
  int count = 0;
  axis.logarithmic = range.size() == 4 && range[3] == "log";
  if (range.size() != (axis.logarithmic ? 4 : 3) || !reads(range[0], start) || !reads(range[1], stop) ||
      !reads(range[2], count) || !std::isfinite(start) || !std::isfinite(stop))
    throw wrong(allowed);
  if (count < 2 || count > static_cast<int>(kMostCells))
    throw wrong(fmt::format("count is {}; it must be 2 to {}", count, kMostCells));
  if (axis.logarithmic && !(start * stop > 0.0))
    throw wrong(fmt::format("start is {}, stop is {}; with :log both must be > 0, or both < 0", start, stop));
  for (int i = 0; i < count; ++i) {
    const double part = static_cast<double>(i) / (count - 1);
    const double value = axis.logarithmic ? start * std::pow(stop / start, part) : start + part * (stop - start);
    // 15 digits: 0.3 and not 0.30000000000000004.
    axis.values.push_back(fmt::format("{:.15g}", i == 0 ? start : i + 1 == count ? stop : value));
  }
  return axis;
}

void refuse_overlap(const Axis& axis, const std::vector<std::string>& varied, const char* option) {
  for (const std::string& path : axis.paths)
    for (const std::string& other : varied) {
      if (path == other) throw ConfigError{fmt::format("{} {}: {} is varied twice", option, axis.name(), path)};
      if (is_part(path, other) || is_part(other, path))
        throw ConfigError{fmt::format("{} {}: {} is a part of {}, which is varied too; vary one of them", option,
                                      axis.name(), std::max(path, other), std::min(path, other))};
    }
}

void warn_if_lost(const std::vector<std::string>& set, const std::vector<std::string>& varied) {
  for (const std::string& assignment : set)
    for (const std::string& path : varied) {
      const std::string_view name = trimmed(std::string_view{assignment}.substr(0, assignment.find('=')));
      if (name == path || is_part(name, path))
        print_error("warning: --set {} has no effect: {} is varied\n", assignment, path);
    }
}

Shard parse_shard(const std::string& text) {
  Shard shard;
  const std::vector<std::string_view> two = parts(text, '/');
  if (two.size() != 2 || !reads(two[0], shard.index) || !reads(two[1], shard.count) || shard.index < 1 ||
      shard.index > shard.count)
    throw ConfigError{fmt::format("--shard {}: it must read I/N with I from 1 to N", text)};
  return shard;
}

std::vector<std::string> figures() {
  std::vector<std::string> names;
  for (const auto& [name, value] : figures_of(Summary{})) names.push_back(name);
  return names;
}

std::size_t Table::column_of(std::size_t axis) const {
  std::size_t column = 0;
  for (std::size_t i = 0; i < axis; ++i) column += axes[i].paths.size();
  return column;
}

std::string to_csv(const Table& table) {
  std::string csv = csv_line(table.columns);
  for (const auto& row : table.rows) csv += csv_line(row);
  return csv;
}

Table sweep(const SweepOptions& o, const std::function<void(const Progress&)>& heard) {
  LaneUse use;
  return sweep(o, 0, use, heard);
}

Table sweep(const SweepOptions& o, int lanes, LaneUse& use, const std::function<void(const Progress&)>& heard) {
  const SceneText base{o.text ? *o.text : read_whole(o.scene), o.scene, o.set};
  const Plan plan = plan_of(o, base);
  std::optional<CellFile> file;
  if (!o.out.empty()) file.emplace(o.out, plan);

  std::vector<std::size_t> of_shard, todo;
  for (std::size_t cell = o.shard.index - 1; cell < plan.cells(); cell += o.shard.count) {
    of_shard.push_back(cell);
    if (!file || !file->holds(cell)) todo.push_back(cell);
  }
  std::map<std::size_t, std::vector<std::string>> rows;  // where there is no file

  const std::size_t kept = of_shard.size() - todo.size();
  Progress progress{.done = kept, .kept = kept, .count = of_shard.size(), .spent_s = 0.0};
  if (heard) heard(progress);
  std::mutex guard;
  std::map<std::size_t, OpenCell> open;
  const std::size_t seeds = std::max<std::size_t>(o.seeds, 1);
  const auto start = std::chrono::steady_clock::now();
  use =
      run_all(o, lanes, base, plan, todo, seeds, [&](const Run& run, const Summary& summary, std::uint64_t first_seed) {
        const std::lock_guard lock{guard};
        OpenCell& of_cell = open[run.cell];
        of_cell.of_seeds.resize(seeds);
        of_cell.of_seeds[run.k] = summary;
        if (++of_cell.finished < seeds) return;
        std::vector<std::string> row = plan.varied_columns(run.cell);
        for (auto& [name, text] : o.seeds > 0 ? columns_of(of_cell.of_seeds, first_seed) : columns_of(summary))
          row.push_back(std::move(text));
        open.erase(run.cell);
        if (file) {
          file->append(run.cell, row);
        } else {
          rows.emplace(run.cell, std::move(row));
        }
        ++progress.done;
        progress.spent_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        if (heard) heard(progress);
      });

  TableWriter table{plan, o.returned, file ? o.out + "/table.csv" : ""};
  for (const auto& [cell, row] : rows) table.add(row);
  if (file)
    for (const std::size_t cell : of_shard) table.add(file->row(cell));
  return table.finish();
}

Table merge(const std::vector<std::string>& folders, const std::string& out, const Names& returned) {
  if (folders.empty()) throw ConfigError{"merge: there must be at least one folder"};
  std::vector<std::unique_ptr<CellFile>> parts;
  for (const std::string& folder : folders) parts.push_back(std::make_unique<CellFile>(folder));
  const Plan& plan = parts.front()->plan();
  for (const auto& part : parts)
    if (part->plan().line() != plan.line())
      throw ConfigError{fmt::format("{}: is of another sweep than {}", part->path(), parts.front()->path())};

  std::vector<CellFile*> holders(plan.cells(), nullptr);
  std::size_t missing = 0, first_missing = 0;
  for (std::size_t cell = 0; cell < plan.cells(); ++cell) {
    for (const auto& part : parts) {
      if (!part->holds(cell)) continue;
      if (holders[cell] != nullptr)
        throw ConfigError{fmt::format("cell {} ({}) is in two parts: {} and {}", cell, plan.name(cell),
                                      holders[cell]->path(), part->path())};
      holders[cell] = part.get();
    }
    if (holders[cell] == nullptr && missing++ == 0) first_missing = cell;
  }
  if (missing > 0)
    throw ConfigError{
        fmt::format("{} of {} cells are missing, the first is cell {} ({}); every part of --shard I/N must "
                    "be there and have run to its end",
                    missing, plan.cells(), first_missing, plan.name(first_missing))};

  make_folder(out);
  WholeFile cells{cells_in(out)};
  TableWriter table{plan, returned, out + "/table.csv"};
  cells.write(plan.line());
  for (std::size_t cell = 0; cell < plan.cells(); ++cell) {
    cells.write(holders[cell]->line(cell));
    table.add(holders[cell]->row(cell));
  }
  cells.commit();
  return table.finish();
}

}  // namespace twoport::lab
