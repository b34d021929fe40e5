#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>

#include "common/record/row.h"
#include "common/record/verdict.h"
#include "common/scene/scene.h"

namespace twoport {

/// Judges a run by its own rows, one by one, in constant memory: what a live side can do, and the laboratory where it is to
/// run nothing beside the scene. Only what comes after the operator's path has ended tells a loop from the hand that moves
/// it: before, only a divergence is seen.
template <int N>
class RunJudge {
 public:
  /// What is known of the run.
  struct Known {
    double rate_hz;
    double duration_s;              ///< planned; infinity: until somebody ends it
    double quiet_from_s;            ///< when the operator's path ends; infinity: not known, or never
    double initial_energy_j = 0.0;  ///< E(0)
    bool controller = false;        ///< there is a passivity controller
    bool unseen = false;            ///< one at the other side may act, and the rows do not say so
    bool coarse = false;            ///< an encoder or Coulomb friction is in the loop
    bool link = false;              ///< there is another side
  };
  static constexpr double kDiverged = 1000.0;  // [m/s], [rad/s]

  explicit RunJudge(const Known& known) : known_{known}, after_{2 * N, 2} {
    scale_.dof = N;
    scale_.rate_hz = known.rate_hz;
    scale_.speed.assign(2 * N, 0.0);
    scale_.early.assign(2 * N, 0.0);
  }

  /// Returns false once the run has diverged: a value is not finite, or a speed is beyond 1000 m/s or rad/s and ten times
  /// that of the first row. There is no use in going on.
  bool add(const Row<N>& row) noexcept {
    const double speed2 = row.master_v.squared_norm() + row.slave_v.squared_norm();
    if (rows_++ == 0) first_speed2_ = speed2;
    const double reach2 = std::max(row.master_x.translation().squaredNorm(), row.slave_x.translation().squaredNorm());
    if (!(speed2 <= std::max(kDiverged * kDiverged, 100.0 * first_speed2_)) || !std::isfinite(reach2) ||
        !std::isfinite(row.master_energy_j)) {
      diverged_ = true;
      diverged_at_s_ = row.t_s;
      return false;
    }
    scale_.reach_m = std::max(scale_.reach_m, std::sqrt(reach2));
    const std::array v = velocities(row);
    for (std::size_t i = 0; i < 2 * N; ++i) scale_.speed[i] = std::max(scale_.speed[i], std::abs(v[i]));
    if (row.t_s < 0.05 * known_.duration_s) scale_.early = scale_.speed;
    coupled_ = coupled_ || row.mode == Mode::coupled;
    acted_ = acted_ || row.dissipated_j > 0.0;
    energy_j_ = row.master_energy_j;
    if (row.t_s >= known_.quiet_from_s) {
      const std::array energies{row.master_energy_j, row.master_energy_j};
      after_.add(v, energies, events(row));
      acted_after_ = acted_after_ || row.dissipated_j > 0.0;
    }
    return true;
  }

  [[nodiscard]] bool diverged() const { return diverged_; }
  [[nodiscard]] const MotionScale& scale() const { return scale_; }
  /// Of both sides, the master's first.
  static std::array<double, 2 * N> velocities(const Row<N>& row) noexcept {
    std::array<double, 2 * N> v;
    for (int i = 0; i < N; ++i) v[i] = row.master_v.vec()[i], v[N + i] = row.slave_v.vec()[i];
    return v;
  }
  static TrendRecord::Events events(const Row<N>& row) noexcept {
    const double wanted2 = row.master_f_wanted.squared_norm();
    return {.touching = row.env_f.squared_norm() > 0.0,
            .limited = row.dissipated_j == 0.0 && row.master_f.squared_norm() < wanted2 * (1.0 - 1e-9)};
  }

  /// Why no run of this kind can be judged, whatever follows it. Empty: it can.
  [[nodiscard]] std::string not_judged() const;
  [[nodiscard]] Verdict verdict() const;

 private:
  Known known_;
  MotionScale scale_;
  TrendRecord after_;  ///< what came after the path's end
  std::uint64_t rows_ = 0;
  double first_speed2_ = 0.0, diverged_at_s_ = 0.0, energy_j_ = 0.0;
  bool diverged_ = false, coupled_ = false, acted_ = false, acted_after_ = false;
};

/// Is something in the scene that makes a loop nonlinear however small its motion: an encoder, Coulomb friction?
bool is_coarse(const Scene& scene);
/// May a passivity controller act?
bool has_controller(const Scene& scene);

extern template class RunJudge<1>;
extern template class RunJudge<3>;
extern template class RunJudge<6>;

}  // namespace twoport
