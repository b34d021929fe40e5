#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "common/record/angle.h"
#include "common/record/contact_figures.h"
#include "common/record/high_pass.h"
#include "common/record/row.h"
#include "common/record/run_judge.h"
#include "common/record/summary.h"

namespace twoport {

/// Sets the sums that a batch of simulations has made (lab/lanes/).
struct SumsOfLanes;

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
  explicit Metrics(const typename RunJudge<N>::Known& run, double energy_scale = 1.0, KnownParts known = {})
      : rate_hz_{run.rate_hz},
        initial_energy_j_{run.initial_energy_j},
        energy_scale_{energy_scale},
        known_{std::move(known)},
        judge_{run},
        high_pass_{30.0, run.rate_hz},
        contact_{run.rate_hz, known_.rests} {}

  /// Returns false once the run has diverged.
  bool add(const Row<N>& row) noexcept {
    ++rows_;
    last_s_ = row.t_s;
    const auto felt = translational(row.master_f.vec()), wanted = translational(row.master_f_wanted.vec());
    const auto missed = translational(row.position_error.vec());
    lower(min_energy_j_, row.master_energy_j);
    lower(min_observed_j_, row.observed_energy_j);
    lower(min_two_port_j_, row.master_energy_j - energy_scale_ * row.slave_energy_j);
    lower(min_robot_j_, row.coupling_energy_j);
    raise(robot_force2_max_, translational(row.slave_f.vec()).squaredNorm());
    raise(robot_speed2_max_, translational(row.slave_v.vec()).squaredNorm());
    raise(owed_j_, row.undissipated_j);
    dissipated_j_ += row.dissipated_j;
    if (row.dissipated_j > 0.0) ++corrected_ticks_;
    drift2_ = missed.squaredNorm();
    position_error2_ += drift2_;  // 0 while the slave does not follow
    if (!row.following) [[unlikely]]
      ++apart_rows_, last_apart_row_ = rows_;

    const auto correction = (felt - wanted).eval();
    const double correction2 = correction.squaredNorm(), felt2 = felt.squaredNorm(), wanted2 = wanted.squaredNorm();
    force_error2_ += correction2;
    raise(correction2_max_, correction2);
    raise(force2_max_, felt2);
    const double fast2 = high_pass_.step(felt).squaredNorm();
    chatter2_ += fast2;
    if (wanted2 > kFelt * kFelt) {
      ++wanted_rows_;
      if (felt2 > kFelt * kFelt) {
        ++turned_rows_;
        if (correction2 != 0.0) turn(squared_angle(felt, wanted, felt2, wanted2));
      }
    }
    contact_.add(row, felt, felt2);
    return judge_.add(row);
  }
  [[nodiscard]] const RunJudge<N>& judge() const { return judge_; }

  /// Sets all fields that follow from rows. The caller sets those of the scene, the packets and the computing time.
  void fill(Summary& s) const {
    const double rows = static_cast<double>(std::max<std::uint64_t>(rows_, 1));
    s.set_steps(count(rows_));
    s.set_rate_hz(rate_hz_);
    // To the end of the last tick: a live loop may have skipped some.
    s.set_duration_s(rows_ > 0 ? (std::round(last_s_ * rate_hz_) + 1.0) / rate_hz_ : 0.0);
    s.set_dissipated_j(dissipated_j_);
    s.set_corrected_ticks(count(corrected_ticks_));
    set_verdict(judge_.verdict(), s);
    if (!known_.stability) s.clear_stable();
    if (known_.hand) {
      s.set_initial_energy_j(initial_energy_j_);
      s.set_min_port_energy_j(initial_energy_j_ + min_energy_j_);
      s.set_min_observed_energy_j(initial_energy_j_ + min_observed_j_);
      s.set_hand_min_energy_j(min_energy_j_);
      if (known_.account) s.set_energy_owed_j(owed_j_);
      s.set_force_error_rms_n(std::sqrt(force_error2_ / rows));
      s.set_correction_max_n(std::sqrt(correction2_max_));
      s.set_max_force_n(std::sqrt(force2_max_));
      s.set_chatter_rms_n(std::sqrt(chatter2_ / rows));
      if (wanted_rows_ > 0)
        s.set_force_direction_share(static_cast<double>(turned_rows_) / static_cast<double>(wanted_rows_));
      if (turned_rows_ > 0) {
        constexpr double kDegree = 180.0 / std::numbers::pi;
        s.set_force_direction_error_max_deg(kDegree * std::sqrt(turn2_max_));
        s.set_force_direction_error_rms_deg(kDegree * std::sqrt(turn2_ / static_cast<double>(turned_rows_)));
      }
    }
    if (known_.hand && known_.robot_energy) s.set_two_port_min_energy_j(min_two_port_j_);
    if (known_.robot_energy) s.set_robot_min_energy_j(min_robot_j_);
    if (known_.link && rows_ > apart_rows_) {
      s.set_position_error_rms_m(std::sqrt(position_error2_ / static_cast<double>(rows_ - apart_rows_)));
      if (last_apart_row_ != rows_) s.set_drift_m(std::sqrt(drift2_));
    }
    if (known_.robot) {
      s.set_robot_max_force_n(std::sqrt(robot_force2_max_));
      s.set_robot_max_speed_m_per_s(std::sqrt(robot_speed2_max_));
    }
    contact_.fill(s, known_.hand, known_.link, static_cast<double>(rows_), rate_hz_);
  }

 private:
  friend struct SumsOfLanes;
  // An extreme changes in few ticks, and a branch costs less than a store.
  static void lower(double& least, double value) noexcept {
    if (value < least) least = value;
  }
  static void raise(double& most, double value) noexcept {
    if (value > most) most = value;
  }
  void turn(double squared_angle) noexcept {
    raise(turn2_max_, squared_angle);
    turn2_ += squared_angle;
  }
  double rate_hz_, initial_energy_j_, energy_scale_;
  KnownParts known_;
  RunJudge<N> judge_;
  HighPass<N == 6 ? 3 : N> high_pass_;
  ContactFigures<N> contact_;
  std::uint64_t rows_ = 0, apart_rows_ = 0, last_apart_row_ = 0, wanted_rows_ = 0, turned_rows_ = 0,
                corrected_ticks_ = 0;
  double last_s_ = 0.0, min_energy_j_ = 0.0, min_observed_j_ = 0.0, owed_j_ = 0.0, dissipated_j_ = 0.0;
  double min_two_port_j_ = 0.0, min_robot_j_ = 0.0, robot_force2_max_ = 0.0, robot_speed2_max_ = 0.0;
  double position_error2_ = 0.0, drift2_ = 0.0, force_error2_ = 0.0, correction2_max_ = 0.0, force2_max_ = 0.0;
  double chatter2_ = 0.0, turn2_max_ = 0.0, turn2_ = 0.0;
};

}  // namespace twoport
