#pragma once

#include <algorithm>
#include <cmath>
#include <string_view>

#include "common/method/coupling_slave.h"
#include "common/method/displayed_force.h"
#include "common/method/energy_tank/gains.h"
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
  [[nodiscard]] Energy deficit(Energy received) const noexcept { return positive_part(initial_ - level(received)); }
  void restart(Energy deficit) noexcept { put_in_ = -deficit, sent_ = Energy{}; }

 private:
  Energy initial_, put_in_, sent_;
  double transfer_per_s_;
  typename Force<N>::Vector give_;  ///< 1/(2K)
};

/// Master half of the two-layer method: a transparency layer (the force of the architecture), and a passivity layer of an
/// energy tank and a damper that fills it:  f_m = s f_d + α max(0, H_d - H) v,  at most m/(4T).
template <int N>
class EnergyTankMaster {
 public:
  explicit EnergyTankMaster(const ControlOptions& o)
      : displayed_{o}, side_{o}, gains_{energy_tank_gains(o)}, handle_mass_kg_{o.handle_mass_kg} {
    const CouplingOptions& c = o.coupling;
    const double turned = c.damping_n_s_per_m > 0.0 ? c.rotational_damping_n_m_s_per_rad / c.damping_n_s_per_m : 0.0;
    shape_ = per_axis<N>(1.0, turned);
  }

  void start(const DeviceSample<N>& device) noexcept { displayed_.start(device.x); }
  MasterOutput<N> step(const MasterInput<N>& in) noexcept {
    side_.put_in(in.account.net() - net_before_);
    net_before_ = in.account.net();
    const Energy received = displayed_.registration().to_master(in.slave_energy_in);
    MasterOutput<N> out{};
    if (in.active) {
      side_.send(received, in.dt);
      const Energy level = side_.level(received);
      out.wanted = in.ramp * displayed_.step(in.device, in.slave, in.dt);
      double b = gains_.level_gain_n_s_per_m_per_j * positive_part(gains_.desired_level - level).si();
      if (handle_mass_kg_ > 0.0) b = std::min(b, 0.25 * handle_mass_kg_ / in.dt.si());
      const Force<N> damper{in.ramp * b * shape_.cwiseProduct(in.device.v.vec())};
      out.f = side_.limited(out.wanted, -dot(out.wanted, in.device.v), level, in.dt) + damper;
      out.dissipated = positive_part(dot(out.f - out.wanted, in.device.v) * in.dt);
      out.undissipated = positive_part(-level);
    }
    out.energy_in = side_.sent();
    return out;
  }
  [[nodiscard]] Energy deficit(const Ledger&, Energy slave_in) const noexcept {
    return side_.deficit(displayed_.registration().to_master(slave_in));
  }
  void restart(const Ledger& account, Energy deficit) noexcept {
    net_before_ = account.net();
    side_.restart(deficit);
  }
  static constexpr bool has_payload() noexcept { return false; }
  void write_payload(Words&) const noexcept {}

 private:
  DisplayedForce<N> displayed_;
  EnergyTankSide<N> side_;
  EnergyTankGains gains_;
  double handle_mass_kg_;
  typename Force<N>::Vector shape_;  ///< of the filling damper: rotation against translation
  Energy net_before_;
};

/// Slave half: the force of the virtual coupling, limited by the slave's tank. The robot's work is taken from the tank.
template <int N>
class EnergyTankSlave : public StoringSlave<N, EnergyTankSide<N>> {
 public:
  explicit EnergyTankSlave(const ControlOptions& o)
      : StoringSlave<N, EnergyTankSide<N>>{o, o}, measured_{returns_measured_force(o)} {}

  SlaveOutput<N> step(const SlaveInput<N>& in) noexcept {
    auto& side = this->side_;
    this->book(in.robot);
    const auto wanted = this->want(in);
    const Energy received = this->coupling_.registration().to_slave(in.master_energy_in);
    if (in.active) side.send(received, in.dt);
    const Force<N> f = side.limited(wanted.f, dot(wanted.f, in.robot.v), side.level(received), in.dt);
    SlaveOutput<N> out = this->act(in, f, wanted.v, wanted.v);
    out.grounded = dot(f, (out.command.v_d - in.robot.v) * in.dt);  // the port of this side is the robot's
    out.f_back = measured_ ? in.robot.f_environment : f;
    out.dissipated = positive_part(dot(wanted.f - f, in.robot.v) * in.dt);
    out.energy_in = side.sent();
    this->f_ = out.command.f;
    return out;
  }
  void limited(SlaveOutput<N>& out, const RobotCommand<N>& asked, const RobotSample<N>& robot, Seconds dt) noexcept {
    this->set_back(out, asked, robot, dt);
    out.grounded = dot(out.command.f, (out.command.v_d - robot.v) * dt);
    this->f_ = out.command.f;
  }

 private:
  bool measured_;
};

struct EnergyTank {
  static constexpr std::string_view kNames[] = {"ENERGY_TANK"};
  static constexpr std::string_view kSummary =
      "two layers: any force, limited by an energy tank at each side; the tanks exchange energy and the hand fills "
      "them";
  template <int N>
  using Master = EnergyTankMaster<N>;
  template <int N>
  using Slave = EnergyTankSlave<N>;
};

}  // namespace twoport
