#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "common/base/random.h"
#include "common/base/vector.h"
#include "common/scene/scene.h"

namespace twoport::sim {

/// Tremor of a hand: on each translational axis a sum of sinusoids, drawn once from a seed.
///
///     x(t) = Σ_j a sin(2π f_j t + φ_j),   a = rms √(2/n),   f_j uniform in the j-th of n equal parts of the band
///
/// A function of time alone, the same on every machine.
template <int N>
class Tremor {
 public:
  Tremor() = default;
  Tremor(const TremorSpec& spec, std::uint64_t seed) {
    if (spec.rms_m == 0.0) return;
    const Random random{seed ^ kStream};
    constexpr double kTurn = 2.0 * std::numbers::pi;
    for (int axis = 0; axis < kAxes; ++axis) {
      for (int j = 0; j < kWaves; ++j) {
        const auto wave = static_cast<std::uint64_t>(axis * kWaves + j);
        const double part = (j + random.uniform(wave, kFrequency)) / kWaves;
        waves_.push_back({.axis = axis,
                          .amplitude_m = spec.rms_m * std::sqrt(2.0 / kWaves),
                          .omega = kTurn * (spec.low_hz + part * (spec.high_hz - spec.low_hz)),
                          .phase = kTurn * random.uniform(wave, kPhase)});
      }
    }
  }

  [[nodiscard]] bool still() const noexcept { return waves_.empty(); }

  struct Sample {
    Displacement<N> x;
    Velocity<N> v;
  };
  /// Out of line, as it is rare.
  [[nodiscard]] Sample at(double t_s) const noexcept {
    typename Displacement<N>::Vector x = Displacement<N>::Vector::Zero(), v = x;
    for (const Wave& w : waves_) {
      const double angle = w.omega * t_s + w.phase;
      x[w.axis] += w.amplitude_m * std::sin(angle);
      v[w.axis] += w.amplitude_m * w.omega * std::cos(angle);
    }
    return {Displacement<N>{x}, Velocity<N>{v}};
  }

 private:
  static constexpr int kAxes = N == 6 ? 3 : N, kWaves = 8;
  static constexpr std::uint64_t kStream = 0x7265306d;
  enum Purpose : unsigned { kFrequency, kPhase };
  struct Wave {
    int axis;
    double amplitude_m, omega, phase;
  };
  std::vector<Wave> waves_;
};

}  // namespace twoport::sim
