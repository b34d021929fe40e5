#pragma once

#include "common/method/transparency/delayed_force/delayed_force.h"

namespace twoport {

/// The delayed force and a damper at the master:  f_d = ρ s_f f_rx,  damper b v_m,  b = 2 N s/m.
template <int N>
class LocalDampingMaster final : public Copyable<LocalDampingMaster<N>, MasterTransparency<N>> {
 public:
  explicit LocalDampingMaster(const ControlOptions& o) : delayed_{o} {}
  void start(const DeviceSample<N>& device) noexcept override { delayed_.start(device); }
  Wish<N> wish(const MasterInput<N>& in) noexcept override {
    Wish<N> out = delayed_.wish(in);
    out.damper = Force<N>{kDamping_n_s_per_m * in.device.v.vec()};
    out.damped = in.active;
    out.figures[layer_figure("local_damping_power_w")] = out.damper.vec().dot(in.device.v.vec());
    return out;
  }

 private:
  static constexpr double kDamping_n_s_per_m = 2.0;
  DelayedForceMaster<N> delayed_;
};

}  // namespace twoport
