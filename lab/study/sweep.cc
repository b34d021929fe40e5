#include "lab/study/sweep.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <memory>
#include <numeric>
#include <string_view>
#include <utility>
#include <variant>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/text.h"
#include "common/record/summary.h"
#include "common/scene/load.h"
#include "lab/engine/hosted.h"
#include "lab/engine/simulation.h"
#include "lab/run.h"
#include "lab/study/cells.h"

namespace twoport::lab {
namespace {

constexpr std::size_t kMostRuns = 1'000'000'000;

/// What a table holds of a summary: all figures but the processor time of a tick.
const std::vector<Figure>& table_figures() {
  static const std::vector<Figure> all = [] {
    std::vector<Figure> figures = Figure::all();
    std::erase_if(figures, [](const Figure& figure) { return figure.name() == "step_ns"; });
    return figures;
  }();
  return all;
}

std::vector<std::string> summary_columns(bool with_spread) {
  std::vector<std::string> all;
  for (const Figure& figure : table_figures()) {
    all.push_back(figure.name());
    if (with_spread) all.insert(all.end(), {figure.name() + "_sd", figure.name() + "_worst"});
  }
  for (const auto& [name, text] : texts(Summary{})) all.push_back(name);
  if (with_spread) all.emplace_back("worst_seed");
  return all;
}

/// Appends the values of these columns.
void add_summary(const Summary& summary, Values& row) {
  for (const Figure& figure : table_figures()) row.emplace_back(figure.of(summary));
  for (auto& [name, text] : texts(summary)) row.emplace_back(std::move(text));
}
void add_spread(const std::vector<Summary>& of_seeds, std::uint64_t first_seed, Values& row) {
  for (const Figure& figure : table_figures()) {
    const Spread s = spread(figure, of_seeds);
    row.insert(row.end(), {s.mean, s.sd, s.worst});
  }
  const std::size_t worst = worst_seed(of_seeds);
  for (auto& [name, text] : texts(of_seeds[worst])) row.emplace_back(std::move(text));
  row.emplace_back(fmt::format("{}", first_seed + worst));
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
  Plan plan{.digest = {}, .grid = {o.axes}, .seeds = o.seeds, .columns = {}};
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
  const std::vector<std::string> of_summary = summary_columns(o.seeds > 0);
  plan.columns.insert(plan.columns.end(), of_summary.begin(), of_summary.end());

  refuse_lost(o, base);
  // Each value by itself, before anything runs.
  const Scene scene = base.with(plan.grid.overrides(0));
  std::size_t step = plan.grid.cells();
  for (const Axis& axis : o.axes) {
    step /= axis.values.size();
    for (std::size_t i = 1; i < axis.values.size(); ++i) static_cast<void>(base.with(plan.grid.overrides(i * step)));
  }

  // Cells are of one sweep when scene text, recorded delays, overrides, axes, seeds, verdict and version are the same.
  Digest digest;
  digest.add(TWOPORT_VERSION);
  digest.add(o.text ? *o.text : read_text(o.scene));
  for (const std::string& assignment : o.set) digest.add(assignment);
  for (const Axis& axis : o.axes) {
    digest.add(axis.name());
    for (const std::string& value : axis.values) digest.add(value);
  }
  if (o.seeds > 0) digest.add(fmt::format("seeds {}", o.seeds));
  if (o.verdict == VerdictFrom::lean) digest.add("verdict lean");
  if (o.verdict == VerdictFrom::plain) digest.add("verdict plain");
  if (o.robot != nullptr)
    digest.add(std::visit([](const auto& robot) { return robot->fingerprint(); }, o.robot->robot));
  for (const auto* direction : {&scene.to_slave, &scene.to_master})
    for (const double delay : direction->recorded_delay_s) digest.add(delay);
  plan.digest = digest.text();
  return plan;
}

using Names = std::optional<std::vector<std::string>>;

/// A table that takes rows of a plan in order: its file has all columns, what is returned those of `names`.
class TableWriter {
 public:
  /// `path`: of the file; empty: none.
  TableWriter(const Plan& plan, const Names& names, const std::string& path)
      : table_{.grid = plan.grid, .seeds = plan.seeds, .columns = {}, .rows = {}} {
    const std::size_t varied = plan.varied_columns(0).size();
    for (std::size_t i = 0; i < plan.columns.size(); ++i)
      if (i < varied || !names || std::find(names->begin(), names->end(), plan.columns[i]) != names->end())
        returned_.push_back(i);
    table_.columns = chosen(plan.columns);
    if (path.empty()) return;
    file_.emplace(path);
    file_->write(csv_line({plan.columns.begin(), plan.columns.end()}));
  }

  void add(std::size_t cell, const Values& row) {
    if (file_) file_->write(csv_line(row));
    add_chosen(cell, chosen(row));
  }
  void add_chosen(std::size_t cell, Values some) {
    table_.cells.push_back(cell);
    table_.rows.push_back(std::move(some));
  }
  Table finish() {
    if (file_) file_->commit();
    return std::move(table_);
  }
  /// Of a row what is returned.
  template <class Row>
  [[nodiscard]] Row chosen(const Row& row) const {
    Row some;
    for (const std::size_t i : returned_) some.push_back(row[i]);
    return some;
  }

 private:
  Table table_;
  std::vector<std::size_t> returned_;
  std::optional<WholeFile> file_;
};

/// Which shards are not whole, in words. `holders`: the part that has each cell; null: none. The number of shards is what divides every
/// distance between two cells of a part.
std::string lost_shards(const std::vector<CellFile*>& holders) {
  std::map<const CellFile*, std::size_t> last;
  std::size_t shards = 0;
  for (std::size_t cell = 0; cell < holders.size(); ++cell) {
    if (holders[cell] == nullptr) continue;
    if (const auto [at, first] = last.try_emplace(holders[cell], cell); !first)
      shards = std::gcd(shards, cell - at->second);
    last[holders[cell]] = cell;
  }
  shards = std::max<std::size_t>(shards, 1);
  std::vector<std::string> lost;
  for (std::size_t shard = 0; shard < std::min(shards, holders.size()); ++shard) {
    std::size_t cells = 0, held = 0;
    const CellFile* part = nullptr;
    for (std::size_t cell = shard; cell < holders.size(); cell += shards) {
      ++cells;
      if (holders[cell] == nullptr) continue;
      part = holders[cell];
      ++held;
    }
    if (part == nullptr) lost.push_back(fmt::format("--shard {}/{} is not there", shard + 1, shards));
    if (part != nullptr && held < cells)
      lost.push_back(
          fmt::format("{} has {} of the {} cells of --shard {}/{}", part->path(), held, cells, shard + 1, shards));
  }
  constexpr std::size_t kNamed = 20;
  const std::size_t more = lost.size() - std::min(lost.size(), kNamed);
  lost.resize(lost.size() - more);
  return fmt::format("{}{}; run these again, each to its end", fmt::join(lost, "; "),
                     more > 0 ? fmt::format("; and {} more", more) : "");
}

}  // namespace

Shard parse_shard(const std::string& text) {
  const std::vector<std::string_view> two = parts_of(text, '/');
  const auto index = number_from<std::size_t>(two.front()), count = number_from<std::size_t>(two.back());
  if (two.size() != 2 || !index || !count || *index < 1 || *index > *count)
    throw ConfigError{fmt::format("--shard {}: it must read I/N with I from 1 to N", text)};
  return {*index, *count};
}

std::vector<std::string> figures() {
  std::vector<std::string> names;
  for (const Figure& figure : table_figures()) names.push_back(figure.name());
  return names;
}

Table sweep(const SweepOptions& o, const Heard& heard) {
  const SceneText base{o.text ? *o.text : read_text(o.scene), o.scene, o.set};
  const Plan plan = plan_of(o, base);
  std::optional<CellFile> file;
  if (!o.out.empty()) file.emplace(o.out, plan);

  std::vector<std::size_t> of_shard, todo;
  for (std::size_t cell = o.shard.index - 1; cell < plan.grid.cells(); cell += o.shard.count) {
    of_shard.push_back(cell);
    if (!file || !file->holds(cell)) todo.push_back(cell);
  }
  const bool tells = o.coarse && o.shard.count == 1 && plan.grid.cells() <= kMostShown;
  std::map<std::size_t, Values> rows;  // what is returned of them, where there is no file or it tells
  const TableWriter chooser{plan, o.returned, ""};
  const Refinement refinement{plan.grid};
  std::vector<signed char> stable(plan.grid.cells(), -1);
  const auto scene_of = [&](std::size_t i) {
    try {
      return base.with(plan.grid.overrides(todo[i]));
    } catch (const ConfigError& e) {
      throw ConfigError{fmt::format("cell {} ({}): {}", todo[i], plan.grid.name(todo[i]), e.what())};
    }
  };
  const auto keep = [&](std::size_t i, std::uint64_t first_seed, const std::vector<Summary>& of_seeds) {
    std::vector<Summary> both;
    for (const Summary& summary : of_seeds) both.push_back(with_verdict_of_both(summary));
    const std::vector<std::string> varied = plan.varied_columns(todo[i]);
    Values row{varied.begin(), varied.end()};
    if (o.seeds > 0) {
      add_spread(both, first_seed, row);
    } else {
      add_summary(both.front(), row);
    }
    stable[todo[i]] =
        std::all_of(both.begin(), both.end(), [](const Summary& summary) { return summary.stable(); }) ? 1 : 0;
    if (file) file->append(todo[i], row);
    if (!file || tells) rows.emplace(todo[i], chooser.chosen(row));
  };
  const auto tell = [&] {
    if (!tells) return;
    for (std::size_t cell = 0; file && cell < plan.grid.cells(); ++cell)
      if (file->holds(cell) && !rows.contains(cell)) rows.emplace(cell, chooser.chosen(file->row(cell)));
    TableWriter known{plan, o.returned, ""};
    for (const auto& [cell, row] : rows) known.add_chosen(cell, row);
    o.coarse(known.finish());
  };
  Cells cells{todo.size(), std::max<std::size_t>(o.seeds, 1), scene_of, {}, tell, [&] {
                const std::vector<bool> edge = refinement.edges(stable);
                std::vector<bool> first;
                for (const std::size_t cell : todo) first.push_back(edge[cell]);
                return first;
              }};
  for (const std::size_t cell : todo) cells.levels.push_back(refinement.level(cell));
  Tally tally{of_shard.size(), heard, of_shard.size() - todo.size(), std::max<std::size_t>(o.seeds, 1)};
  LaneUse use;
  bool stopped = false;
  try {
    use = run_cells(cells, {.lanes = o.lanes, .jobs = o.jobs, .verdict = o.verdict, .stop = o.stop, .robot = o.robot},
                    tally, keep);
  } catch (const Stopped&) {
    if (!o.coarse) throw;
    stopped = true;
  }

  TableWriter writer{plan, o.returned, file ? o.out + "/table.csv" : ""};
  if (!file)
    for (auto& [cell, row] : rows) writer.add_chosen(cell, std::move(row));
  for (const std::size_t cell : of_shard)
    if (file && file->holds(cell)) writer.add(cell, file->row(cell));
  Table table = writer.finish();
  table.use = use;
  table.stopped = stopped;
  return table;
}

std::optional<Table> filled(const Table& some) {
  Table all{.grid = some.grid, .seeds = some.seeds, .columns = some.columns, .stopped = true};
  if (all.grid.axes.size() == 1) {  // a curve has its own values only
    std::vector<std::string>& values = all.grid.axes[0].values;
    values.clear();
    for (const std::size_t cell : some.cells) values.push_back(some.grid.axes[0].values[cell]);
    all.rows = some.rows;
    return some.rows.empty() ? std::nullopt : std::optional{all};
  }
  std::vector<std::size_t> row_of(some.grid.cells(), Refinement::kNone);
  std::vector<bool> known(row_of.size());
  for (std::size_t i = 0; i < some.cells.size(); ++i) row_of[some.cells[i]] = i, known[some.cells[i]] = true;
  for (const std::size_t cell : Refinement{some.grid}.stand_ins(known)) {
    if (cell == Refinement::kNone) return std::nullopt;
    all.rows.push_back(some.rows[row_of[cell]]);
  }
  return all;
}

Table merge(const std::vector<std::string>& folders, const std::string& out, const Names& returned) {
  if (folders.empty()) throw ConfigError{"merge: there must be at least one folder"};
  std::vector<std::unique_ptr<CellFile>> parts;
  for (const std::string& folder : folders) parts.push_back(std::make_unique<CellFile>(folder));
  const Plan& plan = parts.front()->plan();
  for (const auto& part : parts)
    if (part->plan().line() != plan.line())
      throw ConfigError{fmt::format("{}: is of another sweep than {}", part->path(), parts.front()->path())};

  std::vector<CellFile*> holders(plan.grid.cells(), nullptr);
  std::size_t missing = 0;
  for (std::size_t cell = 0; cell < plan.grid.cells(); ++cell) {
    for (const auto& part : parts) {
      if (!part->holds(cell)) continue;
      if (holders[cell] != nullptr)
        throw ConfigError{fmt::format("cell {} ({}) is in two parts: {} and {}", cell, plan.grid.name(cell),
                                      holders[cell]->path(), part->path())};
      holders[cell] = part.get();
    }
    missing += holders[cell] == nullptr ? 1 : 0;
  }
  if (missing > 0)
    throw ConfigError{fmt::format("{} of {} cells are missing: {}", missing, plan.grid.cells(), lost_shards(holders))};

  make_folder(out);
  WholeFile cells{cells_in(out)};
  TableWriter table{plan, returned, out + "/table.csv"};
  cells.write(plan.line());
  for (std::size_t cell = 0; cell < plan.grid.cells(); ++cell) {
    cells.write(holders[cell]->line(cell));
    table.add(cell, holders[cell]->row(cell));
  }
  cells.commit();
  return table.finish();
}

}  // namespace twoport::lab
