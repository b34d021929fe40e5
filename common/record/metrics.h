#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "common/record/angle.h"
#include "common/record/high_pass.h"
#include "common/record/row.h"
#include "common/record/summary.h"
#include "common/record/verdict.h"

namespace twoport {

/// Turns rows into a summary, one by one, in constant memory.
template <int N>
class Metrics {
 public:
  static constexpr double kFelt = 0.05;  ///< a force below this has no direction to speak of [N]

  Metrics(double rate_hz, double duration_s, double quiet_from_s, double initial_energy_j)
      : rate_hz_{rate_hz},
        initial_energy_j_{initial_energy_j},
        verdict_{quiet_from_s, duration_s, initial_energy_j},
        high_pass_{30.0, rate_hz} {}

  /// Returns false once the run has diverged.
  bool add(const Row<N>& row) noexcept {
    ++rows_;
    last_s_ = row.t_s;
    const auto felt = translational(row.master_f.vec()), wanted = translational(row.master_f_wanted.vec());
    const auto missed = translational(row.position_error.vec());
    min_energy_j_ = std::min(min_energy_j_, row.master_energy_j);
    min_observed_j_ = std::min(min_observed_j_, row.observed_energy_j);
    owed_j_ = std::max(owed_j_, row.undissipated_j);
    dissipated_j_ += row.dissipated_j;
    if (row.dissipated_j > 0.0) ++corrected_ticks_;
    position_error2_ += missed.squaredNorm();
    drift2_ = missed.squaredNorm();

    const auto correction = (felt - wanted).eval();
    const double correction2 = correction.squaredNorm(), felt2 = felt.squaredNorm(), wanted2 = wanted.squaredNorm();
    force_error2_ += correction2;
    correction2_max_ = std::max(correction2_max_, correction2);
    force2_max_ = std::max(force2_max_, felt2);
    const double fast2 = high_pass_.step(felt).squaredNorm();
    chatter2_ += fast2;
    if (wanted2 > kFelt * kFelt) {
      ++contact_rows_;
      if (felt2 > kFelt * kFelt) turn(felt, wanted, correction2, felt2, wanted2);
    }
    const double reach2 = std::max(translational_norm2(row.master_x), translational_norm2(row.slave_x));
    return verdict_.add({.t_s = row.t_s,
                         .reach_m = std::sqrt(reach2),
                         .speed2 = row.master_v.squared_norm() + row.slave_v.squared_norm(),
                         .port_energy_j = row.master_energy_j,
                         .force2 = felt2,
                         .fast_force2 = fast2,
                         .corrected = row.dissipated_j > 0.0,
                         .limited = row.dissipated_j == 0.0 && felt2 < wanted2 * (1.0 - 1e-9)});
  }

  /// Everything that rows tell; what ran, packets and times are the caller's.
  void fill(Summary& s) const {
    const double rows = static_cast<double>(std::max<std::uint64_t>(rows_, 1));
    s.set_steps(count(rows_));
    s.set_rate_hz(rate_hz_);
    // To the end of the last tick: a live loop may have left some out.
    s.set_duration_s(rows_ > 0 ? (std::round(last_s_ * rate_hz_) + 1.0) / rate_hz_ : 0.0);
    s.set_stable(verdict_.stable());
    s.set_verdict(verdict_.text());
    s.set_initial_energy_j(initial_energy_j_);
    s.set_min_port_energy_j(initial_energy_j_ + min_energy_j_);
    s.set_min_observed_energy_j(initial_energy_j_ + min_observed_j_);
    s.set_energy_owed_j(owed_j_);
    s.set_dissipated_j(dissipated_j_);
    s.set_corrected_ticks(count(corrected_ticks_));
    s.set_position_error_rms_m(std::sqrt(position_error2_ / rows));
    s.set_drift_m(std::sqrt(drift2_));
    s.set_force_error_rms_n(std::sqrt(force_error2_ / rows));
    s.set_correction_max_n(std::sqrt(correction2_max_));
    s.set_max_force_n(std::sqrt(force2_max_));
    s.set_chatter_rms_n(std::sqrt(chatter2_ / rows));
    s.set_contact_s(static_cast<double>(contact_rows_) / rate_hz_);
    constexpr double kDegree = 180.0 / std::numbers::pi;
    s.set_force_direction_error_max_deg(kDegree * turn_max_);
    s.set_force_direction_error_rms_deg(
        turned_rows_ > 0 ? kDegree * std::sqrt(turn2_ / static_cast<double>(turned_rows_)) : 0.0);
  }

 private:
  template <class Vector>
  void turn(const Vector& felt, const Vector& wanted, double correction2, double felt2, double wanted2) noexcept {
    ++turned_rows_;
    if (correction2 == 0.0) return;
    const double along = felt.dot(wanted);
    const double across2 = std::max(0.0, felt2 - along * along / wanted2);
    // Parallel to rounding: the rejection says exactly how far.
    const double a = along > 0.0 && across2 < 1e-14 * felt2
                         ? (felt - (along / wanted2) * wanted).norm() / std::sqrt(felt2)
                         : angle(felt, wanted);
    turn_max_ = std::max(turn_max_, a);
    turn2_ += a * a;
  }
  static double translational_norm2(const Position<N>& x) noexcept { return x.translation().squaredNorm(); }

  double rate_hz_, initial_energy_j_;
  Verdict verdict_;
  HighPass<N == 6 ? 3 : N> high_pass_;
  std::uint64_t rows_ = 0, contact_rows_ = 0, turned_rows_ = 0, corrected_ticks_ = 0;
  double last_s_ = 0.0, min_energy_j_ = 0.0, min_observed_j_ = 0.0, owed_j_ = 0.0, dissipated_j_ = 0.0;
  double position_error2_ = 0.0, drift2_ = 0.0, force_error2_ = 0.0, correction2_max_ = 0.0, force2_max_ = 0.0;
  double chatter2_ = 0.0, turn_max_ = 0.0, turn2_ = 0.0;
};

}  // namespace twoport
