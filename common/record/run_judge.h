#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

#include "common/base/built_for.h"
#include "common/record/row.h"
#include "common/record/sums.h"
#include "common/record/verdict.h"
#include "common/scene/scene.h"

namespace twoport {

/// Judges a run by its own rows, one by one, in constant memory. Live sides use it, and the laboratory with `--verdict plain`.
/// Trends are taken from the end of the operator's path on; before it only a divergence is detected, as the hand moves the loop.
template <int N>
class RunJudge {
 public:
  using Speeds = std::array<double, 2 * N>;  ///< of both sides, the master's first

  /// What is known of the run.
  struct Known {
    double rate_hz;
    double duration_s;                       ///< planned; infinity: until somebody ends it
    double quiet_from_s;                     ///< when the operator's path ends; infinity: never, NaN: not known
    double initial_energy_j = 0.0;           ///< E(0)
    bool controller = false;                 ///< there is a passivity controller
    bool unseen = false;                     ///< one at the other side may act, and the rows do not say so
    bool coarse = false;                     ///< an encoder or Coulomb friction is in the loop
    bool link = false;                       ///< there is another side
    NoiseMotion noise = {};                  ///< that goes on while the hand rests
    bool trends = true;                      ///< verdict() is wanted; false: only divergence and scale are
    bool of_master = true, of_slave = true;  ///< whose motion is known first-hand; what is only reported is not judged
    bool at_robot = false;    ///< only whether the robot's own coupling drives it is judged, and over the whole run
    double motion_scale = 1;  ///< of the robot's motion to the hand's, where `at_robot`
  };
  static constexpr double kDiverged = 1000.0;  // [m/s], [rad/s]

  explicit RunJudge(const Known& known) : known_{known}, early_until_s_{0.05 * known.duration_s} {
    if (known.trends) after_.emplace(2 * N, 4);
  }

  /// Returns false once the run has diverged: a value is not finite, or a speed is beyond 1000 m/s or rad/s and ten times
  /// that of the first row. The run may then end.
  bool add(const Row<N>& row) noexcept;

  [[nodiscard]] bool diverged() const { return diverged_; }
  /// Were the two sides coupled to the end, or let go on purpose? Where less than 5 % of the rest at the end is missing they were.
  [[nodiscard]] bool coupled_at_end() const;
  /// Of the run so far.
  [[nodiscard]] MotionScale scale() const;
  /// Of both sides, the master's first.
  static Speeds velocities(const Row<N>& row) noexcept {
    Speeds v;
    for (int i = 0; i < N; ++i) {
      const auto at = static_cast<std::size_t>(i);
      v[at] = row.master_v.vec()[i], v[N + at] = row.slave_v.vec()[i];
    }
    return v;
  }
  static TrendRecord::Events events(const Row<N>& row) noexcept {
    const double wanted2 = row.master_f_wanted.squared_norm();
    return {.touching = row.env_f.squared_norm() > 0.0,
            .limited = row.dissipated_j == 0.0 && row.master_f.squared_norm() < wanted2 * (1.0 - 1e-9)};
  }

  /// As after `rows` rows with these sums. `early`: largest speeds in the first twentieth of the run, where it has been that long.
  void set(const JudgeSums<double, N>& sums, std::uint64_t rows, const std::optional<Speeds>& early,
           std::optional<double> diverged_at_s) {
    sums_ = sums;
    rows_ = rows;
    early_ = !early;
    early_speed_ = early.value_or(Speeds{});
    diverged_ = diverged_at_s.has_value();
    diverged_at_s_ = diverged_at_s.value_or(0.0);
  }
  /// What was seen since the path's end, for a verdict from the run itself.
  void set_after(TrendRecord&& after, bool acted, double energy_j) {
    after_ = std::move(after);
    acted_after_ = acted;
    energy_j_ = energy_j;
  }

  /// Why no run of this kind can be judged, whatever follows it. Empty: it can.
  [[nodiscard]] std::string not_judged() const;
  [[nodiscard]] Verdict verdict() const;

 private:
  [[nodiscard]] std::string why_not_coupled() const;
  [[nodiscard]] Verdict at_robot() const;
  void end_early() noexcept {
    early_ = false;
    std::copy_n(sums_.speed, 2 * N, early_speed_.begin());
  }
  void note_apart(const Row<N>& row) noexcept {
    const Mode was = std::exchange(mode_, row.mode);
    if (row.coupled || row.mode == Mode::let_go || row.mode == Mode::stopped) [[likely]] {
      if (sums_.apart_at_end > 0.0) [[unlikely]]
        sums_.apart_at_end = 0.0, failed_at_s_.reset();
      return;
    }
    ++sums_.apart_at_end;
    // A link that falls silent is held first, and a side that hears that the other one has left does not follow it.
    if (was == Mode::coupled && row.mode == Mode::released && row.following) failed_at_s_ = row.t_s;
  }
  void see(const Row<N>& row) noexcept {
    energy_j_ = row.master_energy_j;
    if (!(row.t_s >= known_.quiet_from_s)) return;
    Speeds v = velocities(row);
    auto what = events(row);
    if (!known_.of_master && !known_.at_robot) std::fill_n(v.begin(), N, 0.0);
    if (!known_.of_slave) {
      std::fill_n(v.begin() + N, N, 0.0);
      what.touching = row.master_f_wanted.squared_norm() > 0.0;
    }
    const std::array energies{row.master_energy_j, row.master_energy_j, row.coupling_energy_j,
                              row.slave_energy_j - row.coupling_energy_j};
    after_->add(v, energies, what);
    acted_after_ = acted_after_ || row.dissipated_j > 0.0;
  }

  Known known_;
  double early_until_s_;
  std::optional<TrendRecord> after_;  ///< what came after the path's end
  std::uint64_t rows_ = 0;
  double most_speed2_ = 0.0, diverged_at_s_ = 0.0, energy_j_ = 0.0;
  JudgeSums<double, N> sums_{};
  Speeds early_speed_{};  ///< largest within the first twentieth of the run
  bool early_ = true, diverged_ = false, acted_after_ = false;
  Mode mode_ = Mode::idle;
  std::optional<double> failed_at_s_;  ///< this side has released by itself, and not coupled again
};

template <int N>
bool RunJudge<N>::add(const Row<N>& row) noexcept {
  const double speed2 =
      (known_.of_master ? row.master_v.squared_norm() : 0.0) + (known_.of_slave ? row.slave_v.squared_norm() : 0.0);
  if (rows_++ == 0) most_speed2_ = std::max(kDiverged * kDiverged, 100.0 * speed2);
  const double reach2 = std::max(known_.of_master ? row.master_x.translation().squaredNorm() : 0.0,
                                 known_.of_slave ? row.slave_x.translation().squaredNorm() : 0.0);
  if (!(speed2 <= most_speed2_) || !std::isfinite(reach2 + row.master_energy_j)) [[unlikely]] {
    diverged_ = true;
    diverged_at_s_ = row.t_s;
    return false;
  }
  if (early_ && row.t_s >= early_until_s_) [[unlikely]]
    end_early();
  // Extremes change in few ticks: a branch costs less than a store.
  if (reach2 > sums_.reach2) sums_.reach2 = reach2;
  for (int i = 0; i < N; ++i) {
    const double of_master = std::abs(row.master_v.vec()[i]), of_slave = std::abs(row.slave_v.vec()[i]);
    if (of_master > sums_.speed[i] && known_.of_master) sums_.speed[i] = of_master;
    if (of_slave > sums_.speed[N + i] && known_.of_slave) sums_.speed[N + i] = of_slave;
  }
  if (row.mode == Mode::coupled) sums_.was_coupled = 1.0;
  note_apart(row);
  if (known_.trends) see(row);
  return true;
}

/// Is something in the scene that makes a loop nonlinear however small its motion: an encoder, Coulomb friction?
bool is_coarse(const Scene& scene);
/// The noise of the scene's force sensor, whose force the hand feels: a white force of rms σ, held for T, on mass m with damping b:
///
///     v = σ √(T/(2 b m))
NoiseMotion noise_motion(const Scene& scene);
/// May a passivity controller act?
bool has_controller(const Scene& scene);

TWOPORT_DECLARE(RunJudge);

}  // namespace twoport
