#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "common/base/built_for.h"
#include "common/record/angle.h"
#include "common/record/contact_figures.h"
#include "common/record/high_pass.h"
#include "common/record/row.h"
#include "common/record/run_judge.h"
#include "common/record/summary.h"
#include "common/record/sums.h"
#include "common/record/tool_view.h"

namespace twoport {

/// Which parts of the system the recording side observes. Figures of the others are left out of the summary.
struct KnownParts {
  bool stability = true;
  bool hand = true;                                       ///< the master port: felt force, port energy
  bool link = true;                                       ///< another side, and the position error
  bool robot = true;                                      ///< its motion, and the force on it
  bool account = true;                                    ///< a controller at the master that tells its deficit
  bool robot_energy = true;                               ///< the energies through both ports of its coupling
  std::optional<std::vector<Rest>> rests = std::nullopt;  ///< of the intended motion; nothing: not known
};

/// Computes the summary from rows, one at a time, in constant memory.
template <int N>
class Metrics {
 public:
  static constexpr double kFelt = 0.05;  ///< forces below this do not count in the direction figures [N]

  /// `run.initial_energy_j`: E(0) of the master port. `energy_scale`: E_master / E_slave, as Registration::to_master(Energy).
  explicit Metrics(const typename RunJudge<N>::Known& run, double energy_scale = 1.0, KnownParts known = {},
                   ToolView<N> tool = {});

  /// Returns false once the run has diverged.
  bool add(const Row<N>& ports) noexcept;
  [[nodiscard]] const RunJudge<N>& judge() const { return judge_; }

  /// As after `rows` rows with these sums, the last one at `last_s`. Sets those of the two parts beside.
  void set(const MetricsSums<double, N>& sums, std::uint64_t rows, double last_s) {
    sums_ = sums;
    rows_ = rows;
    last_s_ = last_s;
  }
  [[nodiscard]] RunJudge<N>& judge() { return judge_; }
  [[nodiscard]] ContactFigures<ToolView<N>::kSize>& contact() { return contact_; }

  /// Sets all fields that follow from rows. The caller sets those of the scene, the packets and the computing time.
  void fill(Summary& s) const;

 private:
  // An extreme changes in few ticks, and a branch costs less than a store.
  static void lower(double& least, double value) noexcept {
    if (value < least) least = value;
  }
  static void raise(double& most, double value) noexcept {
    if (value > most) most = value;
  }
  void turn(double squared_angle) noexcept {
    raise(sums_.turn2_max, squared_angle);
    sums_.turn2 += squared_angle;
  }
  double rate_hz_, initial_energy_j_, energy_scale_;
  KnownParts known_;
  [[no_unique_address]] ToolView<N> tool_;
  RunJudge<N> judge_;
  HighPass<kAxes<ToolView<N>::kSize>> high_pass_;
  ContactFigures<ToolView<N>::kSize> contact_;
  std::uint64_t rows_ = 0;
  double last_s_ = 0.0;
  MetricsSums<double, N> sums_{};
};

template <int N>
Metrics<N>::Metrics(const typename RunJudge<N>::Known& run, double energy_scale, KnownParts known, ToolView<N> tool)
    : rate_hz_{run.rate_hz},
      initial_energy_j_{run.initial_energy_j},
      energy_scale_{energy_scale},
      known_{std::move(known)},
      tool_{std::move(tool)},
      judge_{run},
      high_pass_{30.0, run.rate_hz},
      contact_{run.rate_hz, known_.rests} {}

template <int N>
bool Metrics<N>::add(const Row<N>& ports) noexcept {
  ++rows_;
  const Row<ToolView<N>::kSize>& row = tool_(ports);
  last_s_ = row.t_s;
  auto felt = translational(row.master_f.vec()), wanted = translational(row.master_f_wanted.vec());
  auto missed = translational(row.position_error.vec());
  lower(sums_.min_energy, row.master_energy_j);
  lower(sums_.min_observed, row.observed_energy_j);
  lower(sums_.min_two_port, row.master_energy_j - energy_scale_ * row.slave_energy_j);
  lower(sums_.min_robot, row.coupling_energy_j);
  raise(sums_.robot_force2, translational(row.slave_f.vec()).squaredNorm());
  raise(sums_.robot_speed2, translational(row.slave_v.vec()).squaredNorm());
  raise(sums_.owed, row.undissipated_j);
  sums_.dissipated += row.dissipated_j;
  if (row.dissipated_j > 0.0) ++sums_.corrected_ticks;
  sums_.drift2 = missed.squaredNorm();
  sums_.position_error2 += sums_.drift2;  // 0 while the slave does not follow
  if (!row.following) [[unlikely]]
    ++sums_.apart_rows, sums_.last_apart_row = static_cast<double>(rows_);

  const auto correction = (felt - wanted).eval();
  const double correction2 = correction.squaredNorm(), felt2 = felt.squaredNorm(), wanted2 = wanted.squaredNorm();
  sums_.force_error2 += correction2;
  raise(sums_.correction2, correction2);
  raise(sums_.force2, felt2);
  const double fast2 = high_pass_.step(felt).squaredNorm();
  sums_.chatter2 += fast2;
  if (wanted2 > kFelt * kFelt) {
    ++sums_.wanted_rows;
    if (felt2 > kFelt * kFelt) {
      ++sums_.turned_rows;
      if (correction2 != 0.0) turn(squared_angle(felt, wanted, felt2, wanted2));
    }
  }
  contact_.add(row, felt, felt2);
  return judge_.add(ports);
}

template <int N>
void Metrics<N>::fill(Summary& s) const {
  const double rows = static_cast<double>(std::max<std::uint64_t>(rows_, 1));
  s.set_steps(count(rows_));
  s.set_rate_hz(rate_hz_);
  // To the end of the last tick: a live loop may have skipped some.
  s.set_duration_s(rows_ > 0 ? (std::round(last_s_ * rate_hz_) + 1.0) / rate_hz_ : 0.0);
  s.set_dissipated_j(sums_.dissipated);
  s.set_corrected_ticks(count(static_cast<std::uint64_t>(sums_.corrected_ticks)));
  set_verdict(judge_.verdict(), s);
  if (!known_.stability) s.clear_stable();
  if (known_.stability && known_.link) s.set_coupled_at_end(judge_.coupled_at_end());
  if (known_.hand) {
    s.set_initial_energy_j(initial_energy_j_);
    s.set_min_port_energy_j(initial_energy_j_ + sums_.min_energy);
    s.set_min_observed_energy_j(initial_energy_j_ + sums_.min_observed);
    s.set_hand_min_energy_j(sums_.min_energy);
    if (known_.account) s.set_energy_owed_j(sums_.owed);
    s.set_force_error_rms_n(std::sqrt(sums_.force_error2 / rows));
    s.set_correction_max_n(std::sqrt(sums_.correction2));
    s.set_max_force_n(std::sqrt(sums_.force2));
    s.set_chatter_rms_n(std::sqrt(sums_.chatter2 / rows));
    if (sums_.wanted_rows > 0) s.set_force_direction_share(sums_.turned_rows / sums_.wanted_rows);
    if (sums_.turned_rows > 0) {
      constexpr double kDegree = 180.0 / std::numbers::pi;
      s.set_force_direction_error_max_deg(kDegree * std::sqrt(sums_.turn2_max));
      s.set_force_direction_error_rms_deg(kDegree * std::sqrt(sums_.turn2 / sums_.turned_rows));
    }
  }
  if (known_.hand && known_.robot_energy) s.set_two_port_min_energy_j(sums_.min_two_port);
  if (known_.robot_energy) s.set_robot_min_energy_j(sums_.min_robot);
  if (const double together = static_cast<double>(rows_) - sums_.apart_rows; known_.link && together > 0.0) {
    s.set_position_error_rms_m(std::sqrt(sums_.position_error2 / together));
    if (sums_.last_apart_row != static_cast<double>(rows_)) s.set_drift_m(std::sqrt(sums_.drift2));
  }
  if (known_.robot) {
    s.set_robot_max_force_n(std::sqrt(sums_.robot_force2));
    s.set_robot_max_speed_m_per_s(std::sqrt(sums_.robot_speed2));
  }
  contact_.fill(s, known_.hand, known_.link, static_cast<double>(rows_), rate_hz_);
}

TWOPORT_DECLARE(Metrics);

}  // namespace twoport
