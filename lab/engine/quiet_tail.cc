#include "lab/engine/quiet_tail.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <span>
#include <vector>

#include "common/coupling/registration.h"
#include "common/record/run_judge.h"

namespace twoport::lab {
namespace {

constexpr double kFirst = 0.25, kLongest = 32.0;  // lengths of the scene
constexpr std::size_t kFewest = 128;              // ticks of the shortest tail
constexpr std::size_t kChunk = 512;               // ticks that the run is ahead of its twin, at most
constexpr double kDiverged = 1e3;                 // of the run's largest speed

/// Largest speed of the run, as this signal's kind has it: motion of the other kind counts by the reach, v = ω reach. What was at
/// rest in the run may begin to move in the tail without being unstable.
double largest_speed(const MotionScale& run, std::size_t signal) {
  const double same = run.largest_of_kind(signal), other = run.largest(!run.rotates(signal));
  if (!run.rotates(signal)) return std::max(same, other * run.reach_m);
  return run.reach_m > 0.0 ? std::max(same, other / run.reach_m) : same;
}

template <int N>
class TailRun {
 public:
  TailRun(const Simulation<N>& at, const Scene& scene, const MotionScale& run, bool twin)
      : scene_{scene},
        scale_{run},
        registration_{scene.control},
        self_{at.copy()},
        rate_hz_{run.rate_hz},
        alone_{scene.control.architecture == Architecture::uncontrolled} {
    self_->be_quiet();
    twin_ = twin && !alone_ ? self_->copy() : nullptr;
    if (twin_) kick();
    // The first judgement finds more than half of the blocks that a record holds, or as few ticks as show a trend.
    const double quarter = std::ceil(kFirst * rate_hz_ * scene.duration_s);
    first_ticks_ = std::max(kFewest, static_cast<std::size_t>(quarter));
    const std::size_t block = std::max<std::size_t>(1, first_ticks_ / (TrendRecord::kBlocks / 2));
    tail_ = std::make_unique<Tail>(Tail{.record = {twin_ ? kSignals : kSides, 2, block},
                                        .has_twin = twin_ != nullptr,
                                        .has_controller = has_controller(scene),
                                        .coarse = is_coarse(scene),
                                        .initial_energy_j = at.granted_energy().si()});
    for (std::size_t i = 0; i < kSides; ++i)
      most_[i] = kDiverged * std::max(largest_speed(run, i), 1e6 * run.rounding(i));
    chunk_.reserve(kChunk);
  }

  /// Without a twin it ends where a controller acts: the verdict is then UNDECIDED, and has no text.
  TailVerdict judged() {
    std::size_t ticks = 0;
    std::uint64_t simulated = 0;
    Verdict verdict;
    for (double lengths = kFirst;; lengths *= 2.0) {
      const auto until = static_cast<std::size_t>(lengths / kFirst) * first_ticks_;
      while (ticks < until && !tail_->diverged) {
        const std::size_t more = std::min(kChunk, until - ticks);
        advance(more);
        ticks += more;
        simulated += twin_ ? 2 * more : more;
      }
      if (!tail_->has_twin && !alone_ && tail_->controller_acted) return {{}, simulated};
      tail_->run_lengths = lengths;
      tail_->last = lengths >= kLongest;
      verdict = alone_ ? judge_body(*tail_) : judge(*tail_, scale_);
      if (verdict.kind != VerdictKind::undecided || tail_->last) break;
      if (twin_ && lengths >= 1.0 && twin_has_parted(*tail_, scale_)) {
        tail_->twin_parted = true;
        twin_ = nullptr;
      }
    }
    return {verdict, simulated};
  }

 private:
  static constexpr std::size_t kSides = 2 * N, kSignals = 2 * kSides;
  struct Tick {
    std::array<double, kSides> v;
    std::array<double, 2> energies;
    TrendRecord::Events events;
  };

  void kick() {
    std::array<typename Velocity<N>::Vector, 2> dv;
    for (std::size_t i = 0; i < kSides; ++i) {
      const double speed = scale_.speed[i], rounding = scale_.rounding(i);
      double size = 0.0;
      if (speed > rounding) size = std::min(1e-3 * speed, std::max(1e-6 * speed, 1e6 * rounding));
      dv[i / N][static_cast<Eigen::Index>(i % N)] = i % 2 == 0 ? size : -size;
    }
    twin_->kick(Velocity<N>{dv[0]}, Velocity<N>{dv[1]});
  }

  void advance(std::size_t ticks) {
    chunk_.clear();
    const Duration until = tick_time(self_->ticks() + static_cast<std::int64_t>(ticks), rate_hz_);
    self_->run_until(until, [&](const Row<N>& row) { return see(row); });
    std::array<double, kSignals> signals{};
    if (!twin_) {
      for (const Tick& tick : chunk_) {
        std::copy(tick.v.begin(), tick.v.end(), signals.begin());
        tail_->record.add(std::span{signals}.first(tail_->record.signals()), tick.energies, tick.events);
      }
      return;
    }
    std::size_t k = 0;
    twin_->run_until(until, [&](const Row<N>& row) {
      if (k == chunk_.size()) return false;
      const Tick& tick = chunk_[k++];
      const auto of_twin = RunJudge<N>::velocities(row);
      for (std::size_t i = 0; i < kSides; ++i) {
        signals[i] = tick.v[i];
        signals[kSides + i] = of_twin[i] - tick.v[i];
      }
      tail_->record.add(signals, tick.energies, tick.events);
      return true;
    });
  }

  bool see(const Row<N>& row) {
    Tick tick{.v = RunJudge<N>::velocities(row), .energies = {}, .events = RunJudge<N>::events(row)};
    if (alone_) {
      const double held = self_->mechanical_energy()->si();
      tick.energies = {held, held};
    } else {
      const double out = registration_.to_master(Energy{row.slave_energy_j}).si();
      tick.energies = {row.master_energy_j, row.master_energy_j - out};
    }
    tail_->controller_acted = tail_->controller_acted || row.dissipated_j > 0.0;
    tail_->driven = tail_->driven || row.master_f.squared_norm() > 0.0 || row.slave_f.squared_norm() > 0.0;
    for (std::size_t i = 0; i < kSides; ++i)
      if (!(std::abs(tick.v[i]) <= most_[i])) tail_->diverged = true;
    if (tail_->diverged) return false;
    chunk_.push_back(tick);
    return true;
  }

  const Scene& scene_;
  const MotionScale& scale_;
  Registration<N> registration_;
  std::unique_ptr<Simulation<N>> self_, twin_;
  double rate_hz_;
  bool alone_;
  std::size_t first_ticks_ = 0;
  std::unique_ptr<Tail> tail_;
  std::vector<Tick> chunk_;
  std::array<double, kSides> most_{};  ///< speeds beyond which the tail has diverged
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

}  // namespace twoport::lab
