#pragma once

#include <algorithm>
#include <limits>

#include "common/method/layers.h"
#include "common/passivity/energy_spring.h"
#include "common/safety/turning_limits.h"

namespace twoport {

/// The energy spring at the hand (EnergySpring) and an account of a damper g beside the wish f_d (DamperAccount).
///
///     E += f_applied·Δx,   E = min(E, stored + 20 mJ)       what was put in long ago cannot be returned as a kick
///     f  = s f_d + γ g                                      s: energy spring with min(K_c, m_handle/(4 T²))
///
/// The hand's energy is never below -E(0), for any wish, packets and network, and any hand that changes its own force by no more than
/// 20 N within two ticks (EnergySpring).
template <int N>
class HandSpring {
 public:
  explicit HandSpring(const ControlOptions& o)
      : limits_{limits_at_device(o)},
        spring_{o.initial_energy, o.force_scale * o.motion_scale * o.coupling.stiffness_n_per_m,
                o.force_scale / o.motion_scale * o.coupling.rotational_stiffness_n_m_per_rad, o.handle_mass_kg,
                o.handle_inertia_kg_m2} {}

  void take_over(const typename Velocity<N>::Vector& ratio) noexcept {
    spring_.take_port(ratio);
    damper_.rest();
    f_ = Force<N>{};
  }
  /// Books the interval that has ended.
  void observe(const MasterInput<N>& in) noexcept {
    const Displacement<N> moved = in.first ? Displacement<N>{} : integral(in.interval, in.ended);
    if (in.inertia != nullptr) spring_.take_inertia(*in.inertia);
    spring_.observe(in.account.net(), moved, in.device.applied, in.ended, in.dt);
    spring_.take_ratio(in.device.ratio, in.device.v, in.dt);
    spring_.expect_turned(may_turn(limits_, in.device.x, in.device.v));
    damper_.observe(moved, applied_part(in.device.applied, f_), in.ended);
  }
  /// Writes force, share and energies into `out`. `damper`: null: none.
  void limit(const Wish<N>& wish, const Force<N>* damper, const MasterInput<N>& in, Shown<N>& out) noexcept {
    out.undissipated = spring_.undissipated();
    if (wish.idle) {
      f_ = Force<N>{};
      damper_.rest();
      return;
    }
    Energy stored = wish.stored ? *wish.stored : spring_.stored(wish.f, in.dt);
    if (wish.bridged) [[unlikely]]
      stored = std::max(stored, spring_.stored(wish.f, in.dt));
    spring_.drop_above(stored + Energy{kCredit_j});
    const Velocity<N> v = in.mean_velocity();
    Force<N> g;
    if (damper != nullptr) g = damper_.apply(*damper, v, spring_, in.dt);
    out.share = spring_.scale(wish.f, in.dt, g);
    out.f = damper != nullptr ? out.share * wish.f + g : out.share * wish.f;
    out.dissipated = positive_part(Energy{-(1.0 - out.share) * dot(wish.f, v).si() * in.dt.si()});
    f_ = out.f;
  }
  /// After a switch: adds what is left of the force before, as far as the hand's own account has it.
  void cross(Bridge<N>& bridge, const MasterInput<N>& in, Shown<N>& out) noexcept {
    spring_.cap(Energy{std::numeric_limits<double>::infinity()});
    const Force<N> all = out.f + bridge.step(out.f, in.dt);
    f_ = out.f = spring_.scale(all, in.dt) * all;
  }
  /// Less than limit() has displayed is commanded.
  void reduce(double share, Shown<N>& out) noexcept {
    out.share *= share;
    f_ = out.f = share * out.f;
  }
  [[nodiscard]] EnergySpring<N>& spring() noexcept { return spring_; }
  [[nodiscard]] const EnergySpring<N>& spring() const noexcept { return spring_; }
  [[nodiscard]] const PortLimits& limits() const noexcept { return limits_; }

 private:
  static constexpr double kCredit_j = 20e-3;

  PortLimits limits_;  ///< at the device
  EnergySpring<N> spring_;
  DamperAccount<N> damper_;
  Force<N> f_;  ///< commanded in the last tick
};

}  // namespace twoport
