#pragma once

#include "common/method/transparency/delayed_force/delayed_force.h"
#include "common/method/transparency/local_damping/slave.h"

namespace twoport {

/// The delayed force and a damper at the master:  f_d = ρ s_f f_rx,  damper b v_m.
template <int N>
class LocalDampingMaster final : public Copyable<LocalDampingMaster<N>, MasterTransparency<N>> {
 public:
  explicit LocalDampingMaster(const ControlOptions& o) : b_{o.local_damping.damping_n_s_per_m}, delayed_{o} {}
  void start(const DeviceSample<N>& device) noexcept override { delayed_.start(device); }
  Wish<N> wish(const MasterInput<N>& in) noexcept override {
    Wish<N> out = delayed_.wish(in);
    out.damper = Force<N>{b_ * in.device.v.vec()};
    out.damped = in.active;
    out.figures[layer_figure("local_damping_power_w")] = out.damper.vec().dot(in.device.v.vec());
    if (read(in.slave.words, slave_))
      out.figures[layer_figure("robot_speed_m_per_s")] = slave_.robot_speed_m_per_s.value;
    return out;
  }

 private:
  double b_;
  LocalDampingReport slave_;
  DelayedForceMaster<N> delayed_;
};

}  // namespace twoport
