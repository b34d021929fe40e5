#pragma once

#include <algorithm>
#include <cmath>

#include "common/method/coupled_by_position.h"
#include "common/method/layers.h"
#include "common/method/passivity/energy_tank/gains.h"
#include "common/method/passivity/robot_port.h"
#include "common/method/passivity/tick_reach.h"
#include "common/passivity/controller.h"

namespace twoport {

/// The energy tank of one side.
///
///     H     = E(0) + energy put in at the port + received - sent        sent += β T H
///     f     = s f_d,   s the largest in [0, 1] with   s² Σ f_d,i²/(2 K_i) <= H   and   s P T <= H
///
/// P: power of f_d out of this side at the present velocity. The first limit is that of a spring K that holds H: it vanishes
/// with the level and does not depend on the velocity.
template <int N>
class EnergyTankSide {
 public:
  explicit EnergyTankSide(const ControlOptions& o)
      : initial_{o.initial_energy}, transfer_per_s_{energy_tank_gains(o).transfer_per_s} {
    const CouplingOptions& c = o.coupling;
    const auto inverse = [](double k) { return 0.5 / std::max(k, 1e-6); };
    give_ = per_axis<N>(inverse(c.stiffness_n_per_m), inverse(c.rotational_stiffness_n_m_per_rad));
  }

  void put_in(Energy e) noexcept { put_in_ += e; }
  [[nodiscard]] Energy level(Energy received) const noexcept { return initial_ + put_in_ + received - sent_; }
  void send(Energy received, Seconds dt) noexcept {
    sent_ += std::min(1.0, transfer_per_s_ * dt.si()) * positive_part(level(received));
  }
  [[nodiscard]] Force<N> limited(const Force<N>& f, Power out, Energy level, Seconds dt) const noexcept {
    const double h = std::max(0.0, level.si()), needed = f.vec().cwiseAbs2().dot(give_);
    double s = needed <= h ? 1.0 : std::sqrt(h / needed);
    if (const double spent = (out * dt).si(); s * spent > h) s = h / spent;
    return s * f;
  }
  [[nodiscard]] Energy sent() const noexcept { return sent_; }
  [[nodiscard]] Energy balance(Energy received) const noexcept { return level(received) - initial_; }
  void restart(Energy balance) noexcept { put_in_ = balance, sent_ = Energy{}; }

 private:
  Energy initial_, put_in_, sent_;
  double transfer_per_s_;
  typename Force<N>::Vector give_;  ///< 1/(2K)
};

/// The tank at the hand, and a damper that fills it:  f_m = s f_d + α max(0, H_d - H) v,  at most m/(4T).
template <int N>
class EnergyTankMaster final : public Copyable<EnergyTankMaster<N>, MasterPassivity<N>> {
 public:
  explicit EnergyTankMaster(const ControlOptions& o)
      : initial_{o.initial_energy}, side_{o}, gains_{energy_tank_gains(o)}, handle_mass_kg_{o.handle_mass_kg} {
    const CouplingOptions& c = o.coupling;
    const double turned = c.damping_n_s_per_m > 0.0 ? c.rotational_damping_n_m_s_per_rad / c.damping_n_s_per_m : 0.0;
    shape_ = per_axis<N>(1.0, turned);
  }

  Shown<N> limit(const Wish<N>& wish, const MasterInput<N>& in) noexcept override {
    side_.put_in(in.account.net() - net_before_);
    net_before_ = in.account.net();
    const Energy received = in.slave_energy_in;
    Shown<N> out;
    if (in.active) {
      side_.send(received, in.dt);
      const Energy level = side_.level(received);
      const Force<N> wanted = wish.total();
      double b = gains_.level_gain_n_s_per_m_per_j * positive_part(gains_.desired_level - level).si();
      if (handle_mass_kg_ > 0.0) b = std::min(b, 0.25 * handle_mass_kg_ / in.dt.si());
      const Force<N> damper{in.ramp * b * shape_.cwiseProduct(in.device.v.vec())};
      const Force<N> limited = within(wanted, level, in);
      out.f = limited + damper;
      out.share = share_of(limited, wanted);
      if (wish.bridge != nullptr) [[unlikely]]  // as far as the hand's port has it
        out.f = within(out.f + wish.bridge->step(out.f, in.dt), std::max(level, initial_ + in.account.net()), in);
      out.dissipated = positive_part(dot(out.f - wanted, in.device.v) * in.dt);
      out.undissipated = positive_part(-level);
    }
    out.energy_in = side_.sent();
    return out;
  }
  [[nodiscard]] bool crosses_bridge() const noexcept override { return true; }
  [[nodiscard]] Energy balance(const Ledger&, Energy slave_in) const noexcept override {
    return side_.balance(slave_in);
  }
  void restart(const Ledger& account, Energy balance) noexcept override {
    net_before_ = account.net();
    side_.restart(handed_over(balance, account));
  }

 private:
  [[nodiscard]] Force<N> within(const Force<N>& f, Energy level, const MasterInput<N>& in) const noexcept {
    return side_.limited(f, -dot(f, in.device.v), level, in.dt);
  }

  Energy initial_;
  EnergyTankSide<N> side_;
  EnergyTankGains gains_;
  double handle_mass_kg_;
  typename Force<N>::Vector shape_;  ///< of the filling damper: rotation against translation
  Energy net_before_;
};

/// The tank at the robot: the robot's work is taken from it.
template <int N>
class EnergyTankSlave final : public Copyable<EnergyTankSlave<N>, SlavePassivity<N>> {
 public:
  explicit EnergyTankSlave(const ControlOptions& o) : side_{o} {}

  void start(const RobotSample<N>& robot) noexcept override { port_.start(robot); }
  RobotPort<N> limit(const RobotWish<N>& wish, VirtualCoupling<N>&, const SlaveInput<N>& in) noexcept override {
    const auto [out, moved] = port_.observe(in.robot);
    side_.put_in(-out);
    reach_.observe(moved, in.dt);
    const Energy received = in.master_energy_in;
    if (in.active) side_.send(received, in.dt);
    const Energy level = side_.level(received);
    const double damped = reach_.part(wish.damper, level);
    const Force<N> f = side_.limited(wish.f, dot(wish.f, in.robot.v), level - damped * reach_.most(wish.damper), in.dt);
    return {
        .f = f, .v = wish.v, .dissipated = positive_part(dot(wish.f - f, in.robot.v) * in.dt), .damper_share = damped};
  }
  void acted(SlaveOutput<N>& out, const Force<N>&, const Ledger&, const SlaveInput<N>& in) noexcept override {
    port_.book(out, in.robot, in.dt);
    out.energy_in = side_.sent();
  }
  void limited(SlaveOutput<N>& out, const Force<N>&, Energy, VirtualCoupling<N>&, const RobotSample<N>& robot,
               Seconds dt) noexcept override {
    port_.book(out, robot, dt);
  }
  void release() noexcept override { port_.release(); }
  [[nodiscard]] Energy reported(const Ledger&) noexcept override { return side_.sent(); }
  [[nodiscard]] Energy balance(const Ledger&, Energy master_in) const noexcept override {
    return side_.balance(master_in);
  }
  void restart(const Ledger&, Energy balance) noexcept override { side_.restart(balance); }

 private:
  EnergyTankSide<N> side_;
  TickReach<N> reach_;
  RobotPortAccount<N> port_;
};

}  // namespace twoport
