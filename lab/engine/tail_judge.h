#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <span>
#include <utility>

#include "common/coupling/registration.h"
#include "common/record/run_judge.h"
#include "common/record/verdict.h"
#include "common/scene/held_coupling.h"
#include "common/scene/scene.h"

namespace twoport::lab {

/// Largest speed of the run, as this signal's kind has it: motion of the other kind counts by the reach, v = ω reach. What was at
/// rest in the run may begin to move in the tail without being unstable.
inline double largest_speed(const MotionScale& run, std::size_t signal) {
  const double same = run.largest_of_kind(signal), other = run.largest(!run.rotates(signal));
  if (!run.rotates(signal)) return std::max(same, other * run.reach_m);
  return run.reach_m > 0.0 ? std::max(same, other / run.reach_m) : same;
}

/// What judge_tail() (lab/engine/quiet_tail.h) makes of the ticks of a tail and of its twin, whoever simulates them.
///
/// In stages: add() ticks until stage_ends(), then decide(); until that is true.
template <int N>
class TailJudge {
 public:
  static constexpr std::size_t kSides = 2 * N, kSignals = 2 * kSides;
  using Speeds = std::array<double, kSides>;  ///< of both sides, the master's first
  /// A tick of the tail.
  struct Tick {
    Speeds v;
    std::array<double, 4> energies;  ///< as Tail::record
    TrendRecord::Events events;
    bool acted = false, driven = false;  ///< as Tail
  };

  /// `granted`: Simulation::granted_energy(). `scene` and `run` must outlive this.
  TailJudge(const Scene& scene, const MotionScale& run, Energy granted, bool twin)
      : scale_{run},
        registration_{scene.control},
        alone_{scene.control.architecture == Architecture::uncontrolled},
        may_drive_{coupling_may_drive_robot(scene)},
        first_ticks_{std::max(kFewest, static_cast<std::size_t>(std::ceil(kFirst * run.rate_hz * scene.duration_s)))} {
    // The first judgement finds more than half of the blocks that a record holds, or as few ticks as show a trend.
    const std::size_t block = std::max<std::size_t>(1, first_ticks_ / (TrendRecord::kBlocks / 2));
    tail_ = std::make_unique<Tail>(Tail{.record = {twin ? kSignals : kSides, 4, block},
                                        .has_twin = twin,
                                        .has_controller = has_controller(scene),
                                        .coarse = is_coarse(scene),
                                        .initial_energy_j = granted.si()});
    for (std::size_t i = 0; i < kSides; ++i)
      most_[i] = kDiverged * std::max(largest_speed(run, i), 1e6 * run.rounding(i));
  }

  [[nodiscard]] bool has_twin() const { return tail_->has_twin; }
  /// The twin has been given up: its ticks are no longer wanted.
  [[nodiscard]] bool twin_parted() const { return tail_->twin_parted; }
  [[nodiscard]] bool diverged() const { return tail_->diverged; }
  [[nodiscard]] bool controller_acted() const { return tail_->controller_acted; }
  /// What the twin's velocities differ by at the beginning.
  [[nodiscard]] std::pair<Velocity<N>, Velocity<N>> kick() const {
    std::array<typename Velocity<N>::Vector, 2> dv;
    for (std::size_t i = 0; i < kSides; ++i) {
      const double speed = scale_.speed[i], rounding = scale_.rounding(i);
      double size = 0.0;
      if (speed > rounding) size = std::min(1e-3 * speed, std::max(1e-6 * speed, 1e6 * rounding));
      dv[i / N][static_cast<Eigen::Index>(i % N)] = i % 2 == 0 ? size : -size;
    }
    return {Velocity<N>{dv[0]}, Velocity<N>{dv[1]}};
  }
  /// Tick::energies over a link, of a row's.
  [[nodiscard]] std::array<double, 4> energies(double master_j, double slave_j, double coupling_j) const {
    return {master_j, master_j - registration_.to_master(Energy{slave_j}).si(), coupling_j, slave_j - coupling_j};
  }

  /// A tick of the tail, before add(). False: the tail has diverged, and the tick is not added.
  bool see(const Tick& tick) noexcept {
    tail_->controller_acted = tail_->controller_acted || tick.acted;
    tail_->driven = tail_->driven || tick.driven;
    for (std::size_t i = 0; i < kSides; ++i)
      if (!(std::abs(tick.v[i]) <= most_[i])) tail_->diverged = true;
    return !tail_->diverged;
  }
  void add(const Tick& tick) noexcept {
    std::array<double, kSignals> signals{};
    std::copy(tick.v.begin(), tick.v.end(), signals.begin());
    tail_->record.add(std::span{signals}.first(tail_->record.signals()), judged(tick.energies), tick.events);
  }
  /// The same, with the twin's velocities.
  void add(const Tick& tick, const Speeds& of_twin) noexcept {
    std::array<double, kSignals> signals;
    for (std::size_t i = 0; i < kSides; ++i) {
      signals[i] = tick.v[i];
      signals[kSides + i] = of_twin[i] - tick.v[i];
    }
    tail_->record.add(signals, judged(tick.energies), tick.events);
  }

  /// Number of the tick at whose beginning the tail is judged next.
  [[nodiscard]] std::size_t stage_ends() const { return static_cast<std::size_t>(lengths_ / kFirst) * first_ticks_; }
  /// Judges. False: another stage begins.
  bool decide() {
    tail_->run_lengths = lengths_;
    tail_->last = lengths_ >= kLongest;
    verdict_ = alone_ ? judge_body(*tail_) : judge(*tail_, scale_);
    if (verdict_.kind != VerdictKind::undecided || tail_->last) return true;
    if (tail_->has_twin && !tail_->twin_parted && lengths_ >= 1.0 && twin_has_parted(*tail_, scale_))
      tail_->twin_parted = true;
    lengths_ *= 2.0;
    return false;
  }
  [[nodiscard]] const Verdict& verdict() const { return verdict_; }

 private:
  /// What controllers change in the set point counts as the coupling's energy too: it is no cause where the coupling holds the robot amply.
  [[nodiscard]] std::array<double, 4> judged(const std::array<double, 4>& energies) const {
    return may_drive_ ? energies : std::array{energies[0], energies[1], 0.0, 0.0};
  }
  static constexpr double kFirst = 0.25, kLongest = 32.0;  ///< lengths of the scene
  static constexpr std::size_t kFewest = 128;              ///< ticks of the shortest tail
  static constexpr double kDiverged = 1e3;                 ///< of the run's largest speed

  const MotionScale& scale_;
  Registration<N> registration_;
  bool alone_, may_drive_;
  std::size_t first_ticks_;
  double lengths_ = kFirst;
  std::unique_ptr<Tail> tail_;
  std::array<double, kSides> most_{};  ///< speeds beyond which the tail has diverged
  Verdict verdict_;
};

}  // namespace twoport::lab
