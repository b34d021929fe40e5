#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "lab/run.h"

namespace twoport::lab {

/// A path into the scene that a sweep varies, or several that take the same value in each cell (linked), and the values,
/// as an override would write them.
struct Axis {
  std::vector<std::string> paths;
  std::vector<std::string> values;
  bool logarithmic = false;

  /// "A", or "A,B" where paths are linked.
  [[nodiscard]] std::string name() const;
  /// Appends PATH=VALUE for each path.
  void append_overrides(std::vector<std::string>& overrides, const std::string& value) const;
};
/// PATH=SPEC or PATH,PATH=SPEC, split at the first '='. SPEC is a,b,c or start:stop:count, both ends included, evenly in
/// value or, with :log, in the logarithm; nothing is split within brackets or braces. Throws ConfigError with the option,
/// the text and what is allowed.
Axis parse_axis(const std::string& text, const std::string& option = "--vary");

/// Throws ConfigError, which begins with `option`, when a path of `axis` is one of `varied`, or one is a part of the other: both would
/// set it, and their order decide.
void refuse_overlap(const Axis& axis, const std::vector<std::string>& varied, const char* option = "--vary");

/// Warns on stderr of an assignment of --set that has no effect: its path is one of `varied`, or within one.
void warn_if_lost(const std::vector<std::string>& set, const std::vector<std::string>& varied);

/// The paths of "A,B". Throws ConfigError, whose sentence begins with `what`, when one is empty or named twice.
std::vector<std::string> parse_paths(const std::string& text, const std::string& what);

/// Part I of N, I from 1: the cells I-1, I-1+N, I-1+2N, …
struct Shard {
  std::size_t index = 1, count = 1;
};
Shard parse_shard(const std::string& text);

struct SweepOptions {
  std::string scene;  ///< its file
  std::optional<std::string>
      text{};  ///< in place of what the file holds; `scene` then names it in errors, and its folder counts
  std::vector<std::string> set;  ///< overrides, applied before those that vary
  std::vector<Axis> axes;        ///< the last varies fastest
  std::size_t seeds = 0;  ///< runs a cell: the scene's seed, seed + 1, …; 0: one, without columns of the spread
  int jobs = 1;
  VerdictFrom verdict = VerdictFrom::tail;
  Shard shard;
  std::string out;                          ///< folder for table.csv and cells.jsonl; empty: nothing is kept
  const std::atomic<bool>* stop = nullptr;  ///< as RunOptions::stop; finished cells are kept
  /// Figures and texts of the returned table, after the varied paths; none: all. OUT/table.csv has all of them: memory then
  /// holds of a cell only what is named here.
  std::optional<std::vector<std::string>> returned{};
};

/// One row for each cell, in the order of cells: the varied paths first, then every figure of the summary, then
/// its texts. With seeds each figure KEY has three columns: KEY, the mean; KEY_sd; KEY_worst (see
/// lab/study/seeds.h). The texts are then those of the worst seed, which a last column worst_seed gives. Numbers
/// read back to the bit.
struct Table {
  std::vector<Axis> axes;
  std::size_t seeds = 0;
  std::vector<std::string> columns;
  std::vector<std::vector<std::string>> rows;

  /// The first of an axis's columns: it has one for each path, all with the same value.
  [[nodiscard]] std::size_t column_of(std::size_t axis) const;
};
std::string to_csv(const Table& table);

/// The figures of a summary that a table holds: its numbers but step_ns, which is the processor time of a tick.
std::vector<std::string> figures();

struct Progress {
  std::size_t done, kept, count;  ///< cells; `kept` of `done` were there before
  double spent_s;
};

/// Runs a scene over the product of its axes. The table is the same to the bit for any number of jobs.
///
/// Each finished cell is appended at once to OUT/cells.jsonl, below a line that defines the sweep;
/// a sweep that was killed resumes from there, an incomplete last line is dropped. Cells of another scene, other
/// overrides, axes, seeds, verdict or version of this program are refused. Expectations of the scene are ignored.
/// Throws ConfigError with the cell when a scene is invalid; finished cells are kept.
Table sweep(const SweepOptions& options, const std::function<void(const Progress&)>& heard = {});

/// Combines the parts of one sweep and writes them to `out`, as a single sweep would. Throws
/// ConfigError naming the cells that are missing, or in two parts, and the folder that belongs to another sweep.
/// `returned` as in SweepOptions.
Table merge(const std::vector<std::string>& folders, const std::string& out,
            const std::optional<std::vector<std::string>>& returned = {});

}  // namespace twoport::lab
