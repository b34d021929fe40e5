#pragma once

#include <algorithm>

#include "common/coupling/registration.h"
#include "common/method/layers.h"
#include "common/method/passivity/energy_spring/unheld_share.h"
#include "common/passivity/controller.h"
#include "common/passivity/energy_spring.h"

namespace twoport {

/// The energy spring at the hand (EnergySpring) and an account of the wish's damper (DamperAccount).
///
///     E += f_applied·Δx,   E = min(E, stored + 20 mJ)       what was put in long ago cannot be returned as a kick
///     f  = s f_d + γ g                                      s: energy spring with min(K_c, m_handle/(4 T²));  g: damper
///
/// Claim: the hand's energy is never below -E(0), for any wish, packets and network, and any hand that changes its own force by no more
/// than 20 N within two ticks (EnergySpring).
///
/// Two-port: the robot too gets no more energy than the hand puts in, Σ f·Δx less what leaves at the slave >= -E(0). Each side has
/// E(0)/2; the master sends what E has above a quarter of the stored energy, in place of dropping it, the slave what it has above
/// E(0)/2 + 5 mJ. A force that the limit of its rate cannot hold is not displayed (unheld_share).
template <int N, bool kTwoPort>
class EnergySpringMasterOf final : public Copyable<EnergySpringMasterOf<N, kTwoPort>, MasterPassivity<N>> {
 public:
  explicit EnergySpringMasterOf(const ControlOptions& o)
      : registration_{o},
        limits_{limits_at_device(o)},
        energy_{(kTwoPort ? 0.5 : 1.0) * o.initial_energy,
                o.force_scale * o.motion_scale * o.coupling.stiffness_n_per_m,
                o.force_scale / o.motion_scale * o.coupling.rotational_stiffness_n_m_per_rad, o.handle_mass_kg,
                o.handle_inertia_kg_m2} {}

  Shown<N> limit(const Wish<N>& wish, const MasterInput<N>& in) noexcept override {
    observe(in);
    Shown<N> out;
    out.energy_in = kTwoPort ? sent_ : in.account.absorbed() - base_absorbed_;
    out.undissipated = energy_.undissipated();
    if (wish.idle) {
      f_ = Force<N>{};
      damper_.rest();
      return out;
    }
    Energy stored = wish.stored ? *wish.stored : energy_.stored(wish.f, in.dt);
    if (wish.bridged) [[unlikely]]
      stored = std::max(stored, energy_.stored(wish.f, in.dt));
    if constexpr (kTwoPort) {
      out.energy_in = pass_on(kKept * stored);
    } else {
      energy_.drop_above(stored + Energy{kCredit_j});
    }
    const Velocity<N> v = in.first ? Velocity<N>{} : in.interval.moved / in.ended;
    Force<N> g;
    if (wish.damped) g = damper_.apply(wish.damper, v, energy_, in.dt);
    double s = energy_.scale(wish.f, in.dt, g);
    f_ = wish.damped ? s * wish.f + g : s * wish.f;
    if constexpr (kTwoPort) {
      const double held = unheld_share(f_, limits_, in.dt);
      f_ = held * f_;
      s *= held;
    }
    out.f = f_;
    out.share = s;
    out.dissipated = positive_part(Energy{-(1.0 - s) * dot(wish.f, v).si() * in.dt.si()});
    return out;
  }
  [[nodiscard]] Energy balance(const Ledger&, Energy) const noexcept override { return energy_.energy(); }
  /// What the hand has put in beyond the credit is dropped with the first wish.
  void restart(const Ledger& account, Energy balance) noexcept override {
    base_absorbed_ = account.absorbed();
    sent_ = received_ = Energy{};
    energy_.restart(account.net(), kTwoPort ? handed_over(balance, account) : put_in_by_hand(balance, account));
  }

 private:
  static constexpr double kCredit_j = 20e-3, kKept = 0.25;

  void observe(const MasterInput<N>& in) noexcept {
    const Displacement<N> moved = in.first ? Displacement<N>{} : integral(in.interval, in.ended);
    Energy net = in.account.net();
    if constexpr (kTwoPort) net += received_ = registration_.to_master(in.slave_energy_in);
    energy_.observe(net, moved, in.device.applied, in.ended, in.dt);
    energy_.take_ratio(in.device.ratio, in.device.v, in.dt);
    constexpr int kLinear = N == 6 ? 3 : N;
    energy_.expect_turned(in.device.x.translation().template head<kLinear>().norm() > limits_.workspace_m);
    damper_.observe(moved, applied_part(in.device.applied, f_), in.ended);
  }
  /// Energy beyond `kept` goes to the slave. Returns the total sent.
  [[gnu::noinline]] Energy pass_on(Energy kept) noexcept {
    const Energy surplus = positive_part(energy_.energy() - kept);
    energy_.take(surplus);
    return sent_ += surplus;
  }

  Registration<N> registration_;
  PortLimits limits_;
  EnergySpring<N> energy_;
  DamperAccount<N> damper_;
  Force<N> f_;  ///< commanded in the last tick
  Energy base_absorbed_;
  Energy sent_, received_;  ///< two-port: to the slave, from it
};
template <int N>
using EnergySpringMaster = EnergySpringMasterOf<N, false>;
template <int N>
using EnergySpringTwoPortMaster = EnergySpringMasterOf<N, true>;

/// The slave's side of the two-port: set point and force move as the level of energy at this side allows,
///
///     T f·v_sd <= E(0)/2 + received - sent - E_out          admittance_controller
///
/// Where a limit at the robot changes the command, the set point's motion is scaled to that. What the level has above E(0)/2 + 5 mJ
/// goes back to the master.
template <int N>
class EnergySpringTwoPortSlave final : public Copyable<EnergySpringTwoPortSlave<N>, SlavePassivity<N>> {
 public:
  explicit EnergySpringTwoPortSlave(const ControlOptions& o)
      : initial_{Registration<N>{o}.to_slave(0.5 * o.initial_energy)}, limits_{limits_at_robot(o)} {}

  RobotPort<N> limit(const RobotWish<N>& wish, VirtualCoupling<N>& coupling,
                     const SlaveInput<N>& in) noexcept override {
    if (!all_finite(wish.f, wish.v)) [[unlikely]]
      return {wish.f, wish.v, Energy{}};
    level_ = level(in.account, coupling.registration(), in.master_energy_in);
    const Force<N> wanted = in.robot.ideal ? wish.f : within_limit(wish.f, in.dt);
    PortSolution<N> allowed = admittance_controller(wanted, wish.v, coupling.spring().mobility(in.dt), level_, in.dt);
    if (!in.robot.ideal) allowed.f = within_limit(allowed.f, in.dt);
    sent_before_ = sent_;
    return {allowed.f, allowed.v, allowed.dissipated};
  }
  void acted(SlaveOutput<N>& out, const Force<N>& f, const Ledger&, const SlaveInput<N>& in) noexcept override {
    send_back(dot(f, out.command.v_d) * in.dt);
    out.energy_in = sent_;
  }
  void limited(SlaveOutput<N>& out, const Force<N>&, Energy, VirtualCoupling<N>& coupling, const RobotSample<N>&,
               Seconds dt) noexcept override {
    send_back(this->leave_at_most(level_, out, coupling, dt));
    out.energy_in = sent_;
  }
  [[nodiscard]] Energy reported(const Ledger&) noexcept override { return sent_; }
  [[nodiscard]] Energy balance(const Ledger& account, const Registration<N>& registration,
                               Energy master_in) const noexcept override {
    return level(account, registration, master_in) - initial_;
  }
  void restart(const Ledger& account, Energy balance) noexcept override {
    base_net_ = account.net() - balance;
    sent_ = Energy{};
  }

 private:
  static constexpr double kKept_j = 5e-3;

  /// E(0)/2, what has been received, less what has been sent back and has left through the coupling.
  [[nodiscard]] Energy level(const Ledger& account, const Registration<N>& registration,
                             Energy master_in) const noexcept {
    return initial_ + registration.to_slave(master_in) + (account.net() - base_net_) - sent_;
  }
  /// What is left after `out` has left through the coupling, above E(0)/2 + 5 mJ.
  void send_back(Energy out) noexcept {
    sent_ = sent_before_ + positive_part(level_ - out - initial_ - Energy{kKept_j});
  }
  /// The force that the robot's limits leave of f; beyond it the coupling is a spring whose force does not grow, and what is
  /// applied is what is booked. A force within half of what a tick may change is never held back by the limit of its rate.
  [[nodiscard]] Force<N> within_limit(const Force<N>& f, Seconds dt) const noexcept {
    return unheld_share(f, limits_, dt) * f;
  }

  Energy initial_;
  PortLimits limits_;
  Energy base_net_, sent_;
  Energy level_, sent_before_;  ///< in this tick, before its motion and before what it sends back
};

}  // namespace twoport
