#include "lab/engine/quiet_tail.h"

#include <algorithm>
#include <memory>
#include <vector>

#include "common/record/run_judge.h"
#include "lab/engine/tail_judge.h"

namespace twoport::lab {
namespace {

constexpr std::size_t kChunk = 512;  // ticks that the run is ahead of its twin, at most

template <int N>
class TailRun {
 public:
  TailRun(const Simulation<N>& at, const Scene& scene, const MotionScale& run, bool twin)
      : self_{at.copy()},
        rate_hz_{run.rate_hz},
        alone_{scene.control.architecture == Architecture::uncontrolled},
        judge_{scene, run, at.granted_energy(), twin && !alone_} {
    self_->be_quiet();
    twin_ = judge_.has_twin() ? self_->copy() : nullptr;
    if (twin_) {
      const auto [master, slave] = judge_.kick();
      twin_->kick(master, slave);
    }
    chunk_.reserve(kChunk);
  }

  /// Without a twin it ends where a controller acts: the verdict is then UNDECIDED, and has no text.
  TailVerdict judged() {
    std::size_t ticks = 0;
    std::uint64_t simulated = 0;
    for (;;) {
      const std::size_t until = judge_.stage_ends();
      while (ticks < until && !judge_.diverged()) {
        const std::size_t more = std::min(kChunk, until - ticks);
        advance(more);
        ticks += more;
        simulated += twin_ ? 2 * more : more;
      }
      if (!judge_.has_twin() && !alone_ && judge_.controller_acted()) return {{}, simulated};
      if (judge_.decide()) break;
      if (judge_.twin_parted()) twin_ = nullptr;
    }
    return {judge_.verdict(), simulated};
  }

 private:
  void advance(std::size_t ticks) {
    chunk_.clear();
    const Duration until = tick_time(self_->ticks() + static_cast<std::int64_t>(ticks), rate_hz_);
    self_->run_until(until, [&](const Row<N>& row) {
      const typename TailJudge<N>::Tick tick = tick_of(row);
      if (!judge_.see(tick)) return false;
      chunk_.push_back(tick);
      return true;
    });
    if (!twin_) {
      for (const typename TailJudge<N>::Tick& tick : chunk_) judge_.add(tick);
      return;
    }
    std::size_t k = 0;
    twin_->run_until(until, [&](const Row<N>& row) {
      if (k == chunk_.size()) return false;
      judge_.add(chunk_[k++], RunJudge<N>::velocities(row));
      return true;
    });
  }

  typename TailJudge<N>::Tick tick_of(const Row<N>& row) {
    typename TailJudge<N>::Tick tick{
        .v = RunJudge<N>::velocities(row), .energies = {}, .events = RunJudge<N>::events(row)};
    if (alone_) {
      const double held = self_->mechanical_energy()->si();
      tick.energies = {held, held, 0.0, 0.0};
    } else {
      tick.energies = judge_.energies(row.master_energy_j, row.slave_energy_j, row.coupling_energy_j);
    }
    tick.acted = row.dissipated_j > 0.0;
    tick.driven = row.master_f.squared_norm() > 0.0 || row.slave_f.squared_norm() > 0.0;
    return tick;
  }

  std::unique_ptr<Simulation<N>> self_, twin_;
  double rate_hz_;
  bool alone_;
  TailJudge<N> judge_;
  std::vector<typename TailJudge<N>::Tick> chunk_;
};

}  // namespace

template <int N>
TailVerdict judge_tail(const Simulation<N>& at, const Scene& scene, const MotionScale& run, TwinUse twin) {
  std::uint64_t ticks = 0;
  if (twin == TwinUse::under_control) {
    TailVerdict one = TailRun<N>{at, scene, run, false}.judged();
    if (!one.verdict.text.empty()) return one;
    ticks = one.ticks;
  }
  TailVerdict two = TailRun<N>{at, scene, run, true}.judged();
  two.ticks += ticks;
  return two;
}

template TailVerdict judge_tail<1>(const Simulation<1>&, const Scene&, const MotionScale&, TwinUse);
template TailVerdict judge_tail<3>(const Simulation<3>&, const Scene&, const MotionScale&, TwinUse);
template TailVerdict judge_tail<6>(const Simulation<6>&, const Scene&, const MotionScale&, TwinUse);
template TailVerdict judge_tail<kJointPort>(const Simulation<kJointPort>&, const Scene&, const MotionScale&, TwinUse);

}  // namespace twoport::lab
