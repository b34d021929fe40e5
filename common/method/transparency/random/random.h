#pragma once

#include <cmath>
#include <cstdint>

#include "common/base/random.h"
#include "common/method/layers.h"

namespace twoport {

/// An adversary of passivity layers: a force of a given size in a direction that is drawn anew every `hold_ms`. N = 6: the size is
/// |f|² + K/K_r |τ|², of the coupling's stiffnesses.
template <int N>
class RandomMaster final : public Copyable<RandomMaster<N>, MasterTransparency<N>> {
 public:
  explicit RandomMaster(const ControlOptions& o)
      : random_{o.random.seed ^ kStream}, force_n_{o.random.force_n}, hold_s_{1e-3 * o.random.hold_ms} {
    const CouplingOptions& c = o.coupling;
    if (c.stiffness_n_per_m > 0.0) lever_m_ = std::sqrt(c.rotational_stiffness_n_m_per_rad / c.stiffness_n_per_m);
  }
  void start(const DeviceSample<N>&) noexcept override {}
  Wish<N> wish(const MasterInput<N>& in) noexcept override {
    if (!in.active) return {};
    if (left_s_ <= 0.0) draw();
    left_s_ -= in.dt.si();
    return {.idle = false, .f = in.ramp * f_};
  }

 private:
  static constexpr std::uint64_t kStream = 0x52414e44;  // "RAND"

  void draw() noexcept {
    left_s_ = hold_s_;
    typename Force<N>::Vector f;
    for (int i = 0; i < N; ++i) f[i] = 2.0 * random_.uniform(drawn_, static_cast<unsigned>(i)) - 1.0;
    ++drawn_;
    f *= force_n_ / std::max(f.norm(), 1e-3);
    if constexpr (N == 6) f.template tail<3>() *= lever_m_;
    f_ = Force<N>{f};
  }

  Random random_;
  double force_n_, hold_s_, lever_m_ = 0.1, left_s_ = 0.0;
  std::uint64_t drawn_ = 0;
  Force<N> f_;
};

}  // namespace twoport
