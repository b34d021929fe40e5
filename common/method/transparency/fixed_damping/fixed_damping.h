#pragma once

#include "common/method/coupled_by_position.h"
#include "common/method/layers.h"
#include "common/method/transparency/displayed_force.h"
#include "common/method/transparency/fixed_damping/gains.h"

namespace twoport {

inline ControlOptions fixed_damping_coupling(const ControlOptions& o) {
  const FixedDampingGains gains = fixed_damping_gains(o);
  CouplingOptions coupling = o.coupling;
  coupling.stiffness_n_per_m = gains.stiffness_n_per_m;
  coupling.rotational_stiffness_n_m_per_rad = gains.rotational_stiffness_n_m_per_rad;
  coupling.damping_n_s_per_m = coupling.rotational_damping_n_m_s_per_rad = 0.0;
  return coupled_by_position(o, coupling);
}

/// Master half of fixed damping (P+d): f_m = ρ s K (x_m - x_s,rx) + ρ B v_m, s: impedance_scale.
template <int N>
class FixedDampingMaster final : public Copyable<FixedDampingMaster<N>, MasterTransparency<N>> {
 public:
  explicit FixedDampingMaster(const ControlOptions& o) : displayed_{fixed_damping_coupling(o)} {
    const FixedDampingGains gains = fixed_damping_gains(o);
    damping_ = per_axis<N>(gains.damping_n_s_per_m, gains.rotational_damping_n_m_s_per_rad);
  }
  void start(const DeviceSample<N>& device) noexcept override { displayed_.start(device.x); }
  Wish<N> wish(const MasterInput<N>& in) noexcept override {
    if (!in.active) return {};
    return {.idle = false,
            .f = in.ramp * displayed_.step(in.device, in.slave, in.dt),
            .damper = Force<N>{in.ramp * damping_.cwiseProduct(in.device.v.vec())},
            .damped = true};
  }

 private:
  DisplayedForce<N> displayed_;
  typename Force<N>::Vector damping_;
};

/// Slave half: f_s = K (x_m,rx - x_s) - B v_s.
template <int N>
class FixedDampingSlave final : public Copyable<FixedDampingSlave<N>, SlaveTransparency<N>> {
 public:
  explicit FixedDampingSlave(const ControlOptions& o)
      : Copyable<FixedDampingSlave<N>, SlaveTransparency<N>>{fixed_damping_coupling(o)} {
    const FixedDampingGains gains = fixed_damping_gains(o);
    damping_ = per_axis<N>(gains.damping_n_s_per_m, gains.rotational_damping_n_m_s_per_rad);
  }
  RobotWish<N> wish(const SlaveInput<N>& in) noexcept override {
    const auto wanted = this->want(in);
    RobotWish<N> out{.f = wanted.f, .v = wanted.v, .damped = true, .grounded = true};
    if (in.active && !in.robot.ideal) out.damper = Force<N>{-damping_.cwiseProduct(in.robot.v.vec())};
    return out;
  }

 private:
  typename Force<N>::Vector damping_;
};

}  // namespace twoport
