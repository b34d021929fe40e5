#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "common/record/angle.h"
#include "common/record/held_force.h"
#include "common/record/high_pass.h"
#include "common/record/row.h"
#include "common/record/summary.h"
#include "common/record/sums.h"

namespace twoport {

/// Figures of contact: how the felt force f, Row::master_f, compares with the reference r, Row::reference: the environment's
/// force as it should be felt. Only ticks count in which the robot (device under RENDER) touches the environment, so neither
/// free space nor a silent link improves a figure.
///
///     felt force error      rms |f - r|
///     felt direction error  rms angle between f and r, of ticks with both above kSensed
///     muted share           ticks with |f| < |r|/10, of those with |r| > 0.2 N
///     held force ratio      |mean f| / |mean r| at the end of the last rest in contact: HeldForce
///     free force            rms |f| while both sides are coupled, nothing touches, and nothing touched one delay ago
///
/// Torques likewise with N = 6, in N m at the handle. Of each figure of a layer (kLayerFigures) the mean.
template <int N>
class ContactFigures {
 public:
  static constexpr double kSensed = 0.05;      ///< force from which a sensor reading counts as contact [N]
  static constexpr double kLoud = 0.2;         ///< least reference for the muted share [N]
  static constexpr double kMuted = 0.1;        ///< felt force below this part of the reference is muted
  static constexpr double kTorqueFelt = 1e-3;  ///< torques below this do not count in the direction figure [N m]

  using Vector = typename HeldForce<N>::Vector;

  ContactFigures(double rate_hz, std::optional<std::vector<Rest>> rests)
      : held_force_{rate_hz, std::move(rests)}, torque_high_pass_{30.0, rate_hz} {}

  /// `felt2` is |felt|².
  void add(const Row<N>& row, const Vector& felt, double felt2) noexcept {
    // Counts the rarer of two events: a branch costs less than a store.
    if (!row.coupled) [[unlikely]]
      ++sums_.uncoupled;
    Vector reference = translational(row.reference.vec());
    const double reference2 = reference.squaredNorm();
    if constexpr (N == 6) add_torque(row);
    if (!row.touching) {
      held_force_.interrupt();
      if (row.coupled && reference2 == 0.0) {
        ++sums_.free;
        sums_.free_force2 += felt2;
      }
      return;
    }
    ++sums_.touching;
    for (std::size_t i = 0; i < kLayerFigures.size(); ++i)
      if (N >= kLayerFigures[i].least_dof) layer_figures_[i] += row.figures[i];
    Vector environment = translational(row.env_f.vec());
    const double environment2 = environment.squaredNorm();
    sums_.environment_force += N == 1 ? std::abs(environment[0]) : std::sqrt(environment2);
    sums_.error2 += (felt - reference).squaredNorm();
    if (felt2 > kSensed * kSensed && reference2 > kSensed * kSensed) {
      ++sums_.compared;
      sums_.contact_turn2 += squared_angle(felt, reference, felt2, reference2);
    }
    if (reference2 <= kLoud * kLoud) {
      ++sums_.quiet;
    } else if (felt2 < kMuted * kMuted * reference2) {
      ++sums_.muted;
    }
    const double behind = -environment.dot(translational(row.ahead.vec()));  // times |environment|
    if (behind > 0.0 && behind * behind > sums_.penetration2 * environment2)
      sums_.penetration2 = behind * behind / environment2;
    held_force_.add(row, felt, reference);
  }

  /// As after rows with these sums, without torques.
  void set(const ContactSums<double>& sums, std::optional<double> held_force_ratio, const LayerFigures& figures) {
    sums_ = sums;
    layer_figures_ = figures;
    held_force_.set(held_force_ratio);
  }

  /// `hand`, `link`: as in KnownParts. `rows`: number of rows in all.
  void fill(Summary& s, bool hand, bool link, double rows, double rate_hz) const {
    const double touching = sums_.touching;
    if (link) s.set_coupled_share(rows > 0.0 ? 1.0 - sums_.uncoupled / rows : 0.0);
    s.set_touching_share(touching / std::max(rows, 1.0));
    s.set_contact_s(touching / rate_hz);
    if (hand && sums_.free > 0) s.set_free_force_rms_n(std::sqrt(sums_.free_force2 / sums_.free));
    if (sums_.touching == 0) return;
    s.set_environment_force_mean_n(sums_.environment_force / touching);
    if (link) s.set_penetration_max_m(std::sqrt(sums_.penetration2));
    if (N == 6 && link && following_ > 0)
      s.set_attitude_error_rms_rad(std::sqrt(attitude_error2_ / static_cast<double>(following_)));
    if (!hand) return;
    s.set_felt_force_error_rms_n(std::sqrt(sums_.error2 / touching));
    if (sums_.touching > sums_.quiet) s.set_muted_share(sums_.muted / (sums_.touching - sums_.quiet));
    if (sums_.compared > 0)
      s.set_felt_force_direction_error_rms_deg(180.0 / std::numbers::pi *
                                               std::sqrt(sums_.contact_turn2 / sums_.compared));
    if (const std::optional<double> ratio = held_force_.ratio()) s.set_held_force_ratio(*ratio);
    if (link)
      for (std::size_t i = 0; i < kLayerFigures.size(); ++i)
        if (N >= kLayerFigures[i].least_dof) set_layer_figure(s, kLayerFigures[i].name, layer_figures_[i] / touching);
    if constexpr (N == 6) {
      s.set_felt_torque_error_rms_n_m(std::sqrt(torque_error2_ / touching));
      s.set_torque_chatter_rms_n_m(std::sqrt(torque_chatter2_ / touching));
      if (torque_turned_ > 0)
        s.set_torque_direction_error_max_deg(180.0 / std::numbers::pi * std::sqrt(torque_turn2_max_));
    }
  }

 private:
  void add_torque(const Row<N>& row) noexcept {
    const Eigen::Vector3d felt = row.master_f.vec().template tail<3>();
    const Eigen::Vector3d fast = torque_high_pass_.step(felt);
    if (!row.touching) return;
    torque_chatter2_ += fast.squaredNorm();
    torque_error2_ += (felt - row.reference.vec().template tail<3>()).squaredNorm();
    if (row.following) {
      ++following_;
      attitude_error2_ += row.position_error.vec().template tail<3>().squaredNorm();
    }
    const Eigen::Vector3d wanted = row.master_f_wanted.vec().template tail<3>();
    const double wanted2 = wanted.squaredNorm(), felt2 = felt.squaredNorm();
    if (wanted2 > kTorqueFelt * kTorqueFelt && felt2 > kTorqueFelt * kTorqueFelt) {
      ++torque_turned_;
      torque_turn2_max_ = std::max(torque_turn2_max_, squared_angle(felt, wanted, felt2, wanted2));
    }
  }

  HeldForce<N> held_force_;
  ContactSums<double> sums_{};
  LayerFigures layer_figures_{};
  // N = 6
  std::uint64_t following_ = 0, torque_turned_ = 0;
  HighPass<3> torque_high_pass_;
  double torque_error2_ = 0.0, torque_chatter2_ = 0.0, torque_turn2_max_ = 0.0, attitude_error2_ = 0.0;
};

/// Does this sensor reading indicate contact?
template <int N>
bool senses_contact(const Force<N>& f) noexcept {
  return translational(f.vec()).squaredNorm() > ContactFigures<N>::kSensed * ContactFigures<N>::kSensed;
}

}  // namespace twoport
