#pragma once

#include <string_view>

#include "common/method/coupling_slave.h"
#include "common/method/displayed_force.h"
#include "common/method/fixed_damping/gains.h"

namespace twoport {

inline ControlOptions fixed_damping_coupling(const ControlOptions& o) {
  const FixedDampingGains gains = fixed_damping_gains(o);
  CouplingOptions coupling = o.coupling;
  coupling.stiffness_n_per_m = gains.stiffness_n_per_m;
  coupling.rotational_stiffness_n_m_per_rad = gains.rotational_stiffness_n_m_per_rad;
  coupling.damping_n_s_per_m = coupling.rotational_damping_n_m_s_per_rad = 0.0;
  return coupled_by_position(o, coupling);
}

/// Master half of fixed damping (P+d): f_m = ρ K (x_m - x_s,rx) + ρ B v_m.
template <int N>
class FixedDampingMaster {
 public:
  explicit FixedDampingMaster(const ControlOptions& o) : displayed_{fixed_damping_coupling(o)} {
    const FixedDampingGains gains = fixed_damping_gains(o);
    damping_ = per_axis<N>(gains.damping_n_s_per_m, gains.rotational_damping_n_m_s_per_rad);
  }

  void start(const DeviceSample<N>& device) noexcept { displayed_.start(device.x); }
  MasterOutput<N> step(const MasterInput<N>& in) noexcept {
    MasterOutput<N> out{};
    out.energy_in = in.account.absorbed() - base_absorbed_;
    if (!in.active) return out;
    out.wanted = in.ramp * displayed_.step(in.device, in.slave, in.dt);
    out.f = out.wanted + Force<N>{in.ramp * damping_.cwiseProduct(in.device.v.vec())};
    return out;
  }
  [[nodiscard]] Energy deficit(const Ledger&, Energy) const noexcept { return Energy{}; }
  void restart(const Ledger& account, Energy) noexcept { base_absorbed_ = account.absorbed(); }
  static constexpr bool has_payload() noexcept { return false; }
  void write_payload(Words&) const noexcept {}

 private:
  DisplayedForce<N> displayed_;
  typename Force<N>::Vector damping_;
  Energy base_absorbed_;
};

/// Slave half: f_s = K (x_m,rx - x_s) - B v_s.
template <int N>
class FixedDampingSlave : public CouplingSlave<N> {
 public:
  explicit FixedDampingSlave(const ControlOptions& o) : CouplingSlave<N>{fixed_damping_coupling(o)} {
    const FixedDampingGains gains = fixed_damping_gains(o);
    damping_ = per_axis<N>(gains.damping_n_s_per_m, gains.rotational_damping_n_m_s_per_rad);
  }

  SlaveOutput<N> step(const SlaveInput<N>& in) noexcept {
    const auto wanted = this->want(in);
    const Force<N> damper = this->damper(in, damping_);
    return this->act(in, wanted.f + damper, wanted.v, wanted.v, damper);
  }
  void limited(SlaveOutput<N>& out, const RobotCommand<N>& asked, const RobotSample<N>& robot, Seconds dt) noexcept {
    const Energy wished = out.grounded - dot(asked.f, asked.v_d * dt);
    this->set_back(out, asked, robot, dt);
    if (!robot.ideal) out.grounded = dot(Force<N>{-damping_.cwiseProduct(robot.v.vec())}, out.command.v_d * dt);
    report_no_more(out, wished, out.grounded - dot(out.command.f, out.command.v_d * dt));
  }

 private:
  typename Force<N>::Vector damping_;
};

struct FixedDamping {
  static constexpr std::string_view kNames[] = {"FIXED_DAMPING"};
  static constexpr bool kKeepsAccount = false;
  static constexpr std::string_view kSummary =
      "a spring between the two positions and a damper at each side (P+d): stable for any passive hand and environment "
      "at a "
      "known delay, and felt as a brake";
  template <int N>
  using Master = FixedDampingMaster<N>;
  template <int N>
  using Slave = FixedDampingSlave<N>;
};

}  // namespace twoport
