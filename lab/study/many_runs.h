#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/record/summary.h"
#include "common/scene/scene.h"
#include "lab/run.h"

namespace twoport::lab {

/// How long the runs of a study take yet. They are of kinds that cost differently, and no cost is known before: a first part of each kind
/// shows it. With n runs of a kind to come, each of which takes the mean c of those that have run, the time left is Σ n c, and for
/// runs whose kind is not known yet the mean over all kinds. Times are of the caller's clock [s].
class Forecast {
 public:
  /// `runs`: of the study; more than are expected of kinds where those of later ones are not known yet.
  explicit Forecast(std::size_t runs) : runs_{runs} {}

  /// So many runs of a kind will follow, of which the first `sample` show its cost.
  /// True where none of this kind were expected before.
  bool expect(const std::string& kind, std::size_t runs, std::size_t sample) {
    Kind& k = kinds_[kind];
    const bool first = k.expected == 0;
    if (first) k.sample = sample;
    k.expected += runs;
    return first;
  }
  /// The scenes of so many runs were read, which took that long.
  void read(std::size_t runs, double spent_s) {
    read_ += runs;
    reading_s_ += spent_s;
  }
  /// From now on, runs are of this kind.
  void begin(const std::string& kind, double now_s) {
    present_ = &kinds_[kind];
    since_s_ = now_s;
  }
  void ran(double now_s) {
    ++present_->ran;
    present_->spent_s += now_s - since_s_;
    since_s_ = now_s;
  }
  /// Runs of a kind that are not needed after all.
  void drop(const std::string& kind, std::size_t runs) {
    kinds_[kind].expected -= runs;
    runs_ -= runs;
  }
  /// Nothing while the cost of a kind is not known.
  [[nodiscard]] std::optional<double> left_s() const {
    double left_s = 0.0, whole_s = 0.0, known = 0.0;
    for (const auto& [name, k] : kinds_) {
      if (k.expected == 0) continue;
      if (k.ran == 0 || k.ran < k.sample) return {};
      const double cost_s = k.spent_s / static_cast<double>(k.ran);
      left_s += cost_s * static_cast<double>(k.expected - k.ran);
      whole_s += cost_s * static_cast<double>(k.expected);
      known += static_cast<double>(k.expected);
    }
    if (known == 0.0) return {};
    if (read_ > 0) left_s += static_cast<double>(runs_ - read_) * reading_s_ / static_cast<double>(read_);
    return left_s + (static_cast<double>(runs_) - known) * whole_s / known;
  }

 private:
  struct Kind {
    std::size_t expected = 0, sample = 0, ran = 0;
    double spent_s = 0.0;
  };
  std::size_t runs_, read_ = 0;
  std::map<std::string, Kind> kinds_;
  Kind* present_ = nullptr;
  double since_s_ = 0.0, reading_s_ = 0.0;
};

/// Runs that were stepped several at once (lab/lanes/README.md), how many at once, and how often others ran alone for which reason.
struct LaneUse {
  int lanes = 1;
  std::size_t together = 0;
  std::map<std::string, std::size_t> alone{};

  void add(const LaneUse& more);
};

struct ManyRuns {
  int lanes = 0;  ///< simulations at once in a thread: 1, 2, 4 or 8; 0: as many as the processor can
  int jobs = 1;   ///< threads
  VerdictFrom verdict = VerdictFrom::tail;
  const std::atomic<bool>* stop = nullptr;  ///< as RunOptions::stop
  const HostedRobot* robot = nullptr;       ///< as RunOptions::robot
};

struct Progress {
  std::size_t done, kept, count;  ///< cells; `kept` of `done` were there before
  double spent_s;
  std::optional<double> left_s{};  ///< forecast; none while it would be a guess
};
using Heard = std::function<void(const Progress&)>;

/// Counts the cells of a study as they are done, forecasts how long it takes yet, and tells. From any thread.
class Tally {
 public:
  /// `count` cells, `kept` of which are there already, the others of `runs` runs each.
  Tally(std::size_t count, Heard heard, std::size_t kept = 0, std::size_t runs = 1);
  /// One more cell.
  void done();
  /// As those of Forecast. expect: were none of this kind expected before?
  bool expect(const std::string& kind, std::size_t runs, std::size_t sample);
  void read(std::size_t runs, double spent_s);
  void begin(const std::string& kind);
  void ran(std::size_t runs = 1);
  /// Cells of one run each that are not needed after all.
  void drop(const std::string& kind, std::size_t runs);

 private:
  [[nodiscard]] double now_s() const;
  Progress progress_;
  Forecast forecast_;
  Heard heard_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::mutex guard_;
};

/// Runs scenes, several at once where lanes take them. Calls `finished` for each as soon as it has its verdict, in any order and from
/// any thread, with its number and its summary, which is that of run(), to the bit, `step_ns` excepted. Throws ConfigError for an
/// impossible number of lanes. `tally`: hears of the runs by kind; some of each kind run first.
LaneUse run_many(std::span<const Scene* const> scenes, const ManyRuns& options,
                 const std::function<void(std::size_t number, const Summary&)>& finished, Tally* tally = nullptr);

/// Calls work(0) … work(count - 1), each once, from up to `jobs` threads. Each is a cell of one run, and some of all parts of the row are
/// first, from which the tally forecasts.
void run_each(std::size_t count, int jobs, Tally& tally, const std::function<void(std::size_t)>& work);

/// The cells of a study: each is a scene, run with its seed, seed + 1, …
struct Cells {
  std::size_t count = 0, seeds = 1;
  std::function<Scene(std::size_t cell)> scene;  ///< called from any thread
  /// Of each cell its level (Refinement): lower ones run first. Empty: all run together.
  std::vector<std::size_t> levels{};
  std::function<void()> level_ended{};         ///< called when cells of some levels have ended and others are left
  std::function<std::vector<bool>()> first{};  ///< asked then: which cells run before all others?
};

/// The end of the cells of `order`, which is by level, from `from` on that run next: of cells.first() whole levels that are at least `least`
/// runs, which it puts in front, and where there are not so many, of all at least `enough`.
std::size_t next_end(const Cells& cells, std::vector<std::size_t>& order, std::size_t from, std::size_t enough,
                     std::size_t least);

/// Runs every cell with every seed. Calls `finished` for each as soon as its last seed has its verdict, in any order, never two at once,
/// with its number, its first seed and a summary for each seed. So many levels run at once as take a second. A cell whose scene is refused throws its ConfigError, after those read
/// with it have run.
LaneUse run_cells(
    const Cells& cells, const ManyRuns& options, Tally& tally,
    const std::function<void(std::size_t cell, std::uint64_t first_seed, const std::vector<Summary>&)>& finished);

}  // namespace twoport::lab
