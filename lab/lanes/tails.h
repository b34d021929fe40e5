#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <memory>
#include <utility>
#include <vector>

#include "lab/engine/tail_judge.h"
#include "lab/lanes/arrays.h"
#include "lab/lanes/queue.h"

namespace twoport::lab::lanes {

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
