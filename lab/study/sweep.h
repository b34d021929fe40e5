#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "lab/study/table.h"

namespace twoport::lab {

/// Part I of N, I from 1: the cells I-1, I-1+N, I-1+2N, …
struct Shard {
  std::size_t index = 1, count = 1;
};
Shard parse_shard(const std::string& text);

struct HostedRobot;

struct SweepOptions {
  std::string scene;  ///< its file
  std::optional<std::string>
      text{};  ///< in place of what the file holds; `scene` then names it in errors, and its folder counts
  std::vector<std::string> set;  ///< overrides, applied before those that vary
  std::vector<Axis> axes;        ///< the last varies fastest
  std::size_t seeds = 0;  ///< runs a cell: the scene's seed, seed + 1, …; 0: one, without columns of the spread
  int jobs = 1;
  int lanes = 0;  ///< as ManyRuns::lanes
  VerdictFrom verdict = VerdictFrom::tail;
  const HostedRobot* robot = nullptr;  ///< as RunOptions::robot
  Shard shard;
  std::string out;                          ///< folder for table.csv and cells.jsonl; empty: nothing is kept
  const std::atomic<bool>* stop = nullptr;  ///< as RunOptions::stop; finished cells are kept
  /// Figures and texts of the returned table, after the varied paths; none: all. OUT/table.csv has all of them: memory then
  /// holds of a cell only what is named here.
  std::optional<std::vector<std::string>> returned{};
  /// Hears of what is known, as of a sweep that was stopped; not of shards, nor of more than kMostShown cells. With it a sweep that is
  /// stopped returns the table of the finished cells, without it it throws Stopped.
  std::function<void(const Table&)> coarse{};
};
inline constexpr std::size_t kMostShown = 20'000;

/// The figures of a summary that a table holds: its numbers but step_ns, which is the processor time of a tick.
std::vector<std::string> figures();

/// Runs a scene over the product of its axes. The table is the same to the bit for any number of jobs and lanes.
///
/// Each finished cell is appended at once to OUT/cells.jsonl, below a line that defines the sweep;
/// a sweep that was killed resumes from there, an incomplete last line is dropped. Cells of another scene, other
/// overrides, axes, seeds, verdict or version of this program are refused. Expectations of the scene are ignored.
/// Throws ConfigError with the cell when a scene is invalid; finished cells are kept. Cells run from coarse to fine (Refinement), those
/// first where the verdict changes.
Table sweep(const SweepOptions& options, const Heard& heard = {});

/// The table of a sweep that was stopped, to draw it: along one axis only the values that have run, else all cells, each that has not run
/// with the row of the one that stands for it (Refinement). None where one has none.
std::optional<Table> filled(const Table& some);

/// Combines the parts of one sweep and writes them to `out`, as a single sweep would. Throws
/// ConfigError naming the cells that are missing, or in two parts, and the folder that belongs to another sweep.
/// `returned` as in SweepOptions.
Table merge(const std::vector<std::string>& folders, const std::string& out,
            const std::optional<std::vector<std::string>>& returned = {});

}  // namespace twoport::lab
