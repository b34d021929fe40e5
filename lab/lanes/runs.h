#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include "common/base/thread.h"
#include "lab/lanes/arrays.h"
#include "lab/lanes/queue.h"
#include "lab/run.h"

namespace twoport::lab::lanes {

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

}  // namespace twoport::lab::lanes
