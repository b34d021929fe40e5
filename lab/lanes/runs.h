#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "common/base/thread.h"
#include "common/scene/scene.h"
#include "lab/engine/tail_judge.h"
#include "lab/lanes/arrays.h"
#include "lab/lanes/taken.h"
#include "lab/run.h"

namespace twoport::lab::lanes {

/// Scenes of one shape, by delay: lanes with the same delays read their packets from the same slot. Threads take the next one.
class Queue {
 public:
  explicit Queue(std::span<const Scene* const> scenes) : scenes_{scenes} {
    std::vector<std::pair<std::int64_t, std::int64_t>> lags;
    for (const Scene* scene : scenes) {
      lags.emplace_back(lag_of(scene->to_slave, period_of(*scene)), lag_of(scene->to_master, period_of(*scene)));
      oldest_ = std::max(oldest_, oldest_of(*scene));
      window_ = std::max(window_, window_of(*scene));
      order_.push_back(order_.size());
    }
    std::stable_sort(order_.begin(), order_.end(), [&](std::size_t a, std::size_t b) { return lags[a] < lags[b]; });
  }
  /// The number of a scene that nobody has taken.
  std::optional<std::size_t> take() {
    const std::size_t i = next_.fetch_add(1);
    return i < order_.size() ? std::optional{order_[i]} : std::nullopt;
  }
  [[nodiscard]] const Scene& scene(std::size_t number) const { return *scenes_[number]; }
  [[nodiscard]] std::int64_t oldest() const { return oldest_; }
  [[nodiscard]] std::size_t window() const { return window_; }

 private:
  std::span<const Scene* const> scenes_;
  std::vector<std::size_t> order_;
  std::int64_t oldest_ = 0;
  std::size_t window_ = 0;
  std::atomic<std::size_t> next_{0};
};

/// Runs cells, a lane each.
template <int N>
class Runs {
 public:
  using Of = std::unique_ptr<Cell<N>>;

  Runs(const Unit& unit, const Queue& queue, VerdictFrom verdict)
      : unit_{unit}, lanes_{unit,           queue.scene(0), queue.oldest(),
                            queue.window(), false,          verdict == VerdictFrom::plain} {}

  [[nodiscard]] bool empty() const { return cells_ == 0; }
  [[nodiscard]] bool has_room() const { return cells_ < lanes_.width(); }
  void add(Of cell) {
    int lane = 0;
    while (cell_[lane] != nullptr) ++lane;
    ++cells_;
    lanes_.cell_of[lane] = cell.get();
    k_[lane] = 0;
    if (!cell->at_stop(0, [] {})) cell->fail();
    lanes_.set_parameters(lane, *cell);
    lanes_.set_state(lane, cell->now.state);
    lanes_.set_sums(lane, *cell);
    lanes_.b.path[lane] = cell->path();
    lanes_.b.plant[lane] = &cell->plant();
    lanes_.nodes[lane] = cell->nodes();
    idle_[lane] = false;
    cell_[lane] = std::move(cell);
  }
  /// Ticks until something happens in a lane. Calls ended(cell) for each cell that has ended.
  template <class Ended>
  void step(Ended ended) {
    const auto start = ThreadClock::now();
    Batch& b = lanes_.b;
    int active = -1;
    std::int64_t n = std::numeric_limits<std::int64_t>::max();
    bool recorded[kMostLanes]{};
    b.records = false;
    for (int lane = 0; lane < lanes_.width(); ++lane) {
      if (cell_[lane] == nullptr) continue;
      active = lane, n = std::min(n, cell_[lane]->next_stop() - k_[lane]);
      recorded[lane] = cell_[lane]->is_recorded(k_[lane]);
      b.records |= recorded[lane];
    }
    if (b.records) n = std::min(n, kRecordRows);
    b.record_row = 0;
    for (int lane = 0; lane < lanes_.width(); ++lane)
      if (cell_[lane] == nullptr) lanes_.copy_lane(lane, active, !std::exchange(idle_[lane], true));
    lanes_.lanes_changed();
    const std::int64_t done = unit_.run[N == 1 ? 0 : 1](b, n);
    spent_ += ThreadClock::now() - start;
    ticks_ += done * cells_;
    for (int lane = 0; lane < lanes_.width(); ++lane) {
      Cell<N>* const cell = cell_[lane].get();
      if (cell == nullptr) continue;
      k_[lane] += done;
      if (recorded[lane]) add_recorded(*cell, lane, done);
      const bool diverged = (b.diverged >> lane & 1U) != 0;
      if (!diverged && k_[lane] < cell->next_stop()) continue;
      lanes_.get_state(lane, cell->now.state);
      lanes_.get_sums(lane, *cell);
      const auto packets = [&] {
        if (cell->nodes() != nullptr) return cell->keep_nodes();
        lanes_.get_packets(lane, cell->now, std::min(cell->oldest(), k_[lane]));
      };
      const bool goes_on = !diverged && cell->at_stop(k_[lane], packets);
      if (goes_on) {
        lanes_.set_parameters(lane, *cell);
        lanes_.set_sums(lane, *cell);
        continue;
      }
      if (!cell->is_plain()) packets();
      std::optional<double> ratio;
      if (cell->t.held_ticks >= static_cast<double>(cell->window()))
        ratio = lanes_.ratio(lane, cell->window(), static_cast<std::size_t>(cell->t.held_next));
      cell->end(k_[lane], diverged, ratio);
      lanes_.cell_of[lane] = nullptr;
      --cells_;
      ended(std::move(cell_[lane]));
    }
  }
  /// Processor time of a tick, of one cell.
  [[nodiscard]] double step_ns() const {
    return spent_.count() / static_cast<double>(std::max<std::int64_t>(ticks_, 1));
  }

 private:
  void add_recorded(Cell<N>& cell, int lane, std::int64_t rows) {
    const auto width = static_cast<std::size_t>(lanes_.width());
    for (std::int64_t row = 0; row < rows; ++row)
      cell.add_recorded(lanes_.b.record + static_cast<std::size_t>(row) * words_of_record(N) * width + lane, width);
  }

  const Unit& unit_;
  Lanes<N> lanes_;
  Of cell_[kMostLanes];
  bool idle_[kMostLanes]{};
  std::int64_t k_[kMostLanes]{}, ticks_ = 0;
  int cells_ = 0;
  std::chrono::duration<double, std::nano> spent_{0};
};

/// Judges cells that have ended: a tail in a lane, and its twin in another one.
template <int N>
class Tails {
 public:
  using Of = std::unique_ptr<Cell<N>>;

  Tails(const Unit& unit, const Queue& queue)
      : unit_{unit}, lanes_{unit, queue.scene(0), queue.oldest(), queue.window(), true, true} {
    for (int lane = lanes_.width(); lane-- > 0;) free_.push_back(lane);
  }

  void add(Of cell) { waiting_.push_back(std::move(cell)); }
  [[nodiscard]] bool empty() const { return tails_.empty() && waiting_.empty(); }
  /// Is there so much to do that no lane is idle?
  [[nodiscard]] bool is_full() {
    fill();
    return free_.empty() || !waiting_.empty();
  }
  /// Ticks until something happens in a lane. Calls judged(cell) for each cell that has a verdict, or has failed.
  template <class Judged>
  void step(Judged judged) {
    fill();
    std::int64_t n = kRecordRows;
    for (const Tail& tail : tails_) n = std::min(n, static_cast<std::int64_t>(tail.judge->stage_ends()) - tail.ticks);
    for (const int lane : free_) lanes_.copy_lane(lane, tails_.front().lane, !std::exchange(idle_[lane], true));
    lanes_.lanes_changed();
    lanes_.b.record_row = 0;
    unit_.tail[N == 1 ? 0 : 1](lanes_.b, n);
    std::size_t kept = 0;
    for (Tail& tail : tails_) {
      if (goes_on(tail, n)) {
        if (&tails_[kept] != &tail) tails_[kept] = std::move(tail);
        ++kept;
        continue;
      }
      free_.push_back(tail.lane);
      if (tail.twin >= 0) free_.push_back(tail.twin);
      if (!tail.cell->failed() && tail.again) {
        waiting_.push_front(std::move(tail.cell));
      } else {
        judged(*tail.cell);
      }
    }
    tails_.erase(tails_.begin() + static_cast<std::ptrdiff_t>(kept), tails_.end());
  }

 private:
  struct Tail {
    Of cell;
    std::unique_ptr<TailJudge<N>> judge;
    int lane = -1, twin = -1;  ///< twin: -1 if there is none, or none is wanted any longer
    std::int64_t from = 0, ticks = 0;
    bool again = false;  ///< the cell has another tail
  };

  void fill() {
    while (!waiting_.empty() && free_.size() >= (waiting_.front()->wants_twin() ? 2U : 1U)) {
      Tail tail;
      tail.cell = std::move(waiting_.front());
      waiting_.pop_front();
      tail.judge = tail.cell->begin_tail();
      const Snapshot<N>& from = tail.cell->tail_from();
      tail.from = static_cast<std::int64_t>(from.state.k);
      tail.lane = take_lane(*tail.cell, from, from.state);
      if (tail.judge->has_twin())
        tail.twin = take_lane(*tail.cell, from, tail.cell->kicked(from.state, tail.judge->kick()));
      tails_.push_back(std::move(tail));
    }
  }
  int take_lane(Cell<N>& cell, const Snapshot<N>& from, const State<double, N>& state) {
    const int lane = free_.back();
    free_.pop_back();
    idle_[lane] = false;
    lanes_.set_parameters(lane, cell);
    lanes_.set_state(lane, state);
    lanes_.set_packets(lane, from);
    lanes_.b.path[lane] = cell.path();
    lanes_.b.plant[lane] = &cell.plant();
    if (from.nodes != nullptr) {
      nodes_[lane] = std::make_unique<Nodes<N>>(*from.nodes);
      nodes_[lane]->be_quiet();
      lanes_.nodes[lane] = nodes_[lane].get();
    }
    return lane;
  }
  /// After n ticks more. False: the tail has ended.
  bool goes_on(Tail& tail, std::int64_t n) {
    TailJudge<N>& judge = *tail.judge;
    const auto w = static_cast<std::size_t>(lanes_.width());
    bool holds = true;  // see Cell::holds()
    for (std::int64_t row = 0; row < n && !judge.diverged(); ++row) {
      const double* const rows = lanes_.b.record + static_cast<std::size_t>(row) * words_of_record(N) * w;
      const double* const at = rows + tail.lane;
      typename TailJudge<N>::Tick tick;
      typename TailJudge<N>::Speeds of_twin{};
      double sum = 0.0;
      for (std::size_t j = 0; j < 2 * N; ++j) {
        tick.v[j] = at[j * w];
        if (tail.twin >= 0) of_twin[j] = rows[j * w + static_cast<std::size_t>(tail.twin)];
        sum += tick.v[j] + of_twin[j];
      }
      for (std::size_t e = 0; e < tick.energies.size(); ++e) tick.energies[e] = at[(2 * N + e) * w];
      const auto events = static_cast<unsigned>(at[(2 * N + 4) * w]);
      tick.events = {.touching = (events & kTouching) != 0, .limited = (events & kLimited) != 0};
      tick.acted = (events & kActed) != 0, tick.driven = (events & kDriven) != 0;
      holds = holds && sum - sum == 0.0 && (events & kSilent) == 0;
      if (!judge.see(tick)) break;
      if (tail.twin >= 0) {
        judge.add(tick, of_twin);
      } else {
        judge.add(tick);
      }
    }
    tail.ticks += n;
    if (!holds) {
      tail.cell->fail();
      return false;
    }
    if (!judge.has_twin() && judge.controller_acted()) {
      tail.cell->want_twin();
      tail.again = true;
      return false;
    }
    if (judge.diverged() || tail.ticks >= static_cast<std::int64_t>(judge.stage_ends())) {
      if (judge.decide()) {
        tail.again = tail.cell->end_tail(judge.verdict());
        return false;
      }
      if (judge.twin_parted() && tail.twin >= 0) free_.push_back(std::exchange(tail.twin, -1));
    }
    return true;
  }

  const Unit& unit_;
  Lanes<N> lanes_;
  std::vector<Tail> tails_;
  std::deque<Of> waiting_;
  std::vector<int> free_;
  std::unique_ptr<Nodes<N>> nodes_[kMostLanes];  ///< of the lane's tail or twin
  bool idle_[kMostLanes]{};
};

}  // namespace twoport::lab::lanes
