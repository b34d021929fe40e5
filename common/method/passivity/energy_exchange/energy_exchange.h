#pragma once

#include <algorithm>
#include <cmath>

#include "common/base/low_pass.h"
#include "common/coupling/claim.h"
#include "common/method/coupled_by_position.h"
#include "common/method/layers.h"
#include "common/method/passivity/energy_exchange/account.h"
#include "common/method/passivity/energy_exchange/unheld_share.h"
#include "common/method/passivity/hand_spring.h"
#include "common/method/passivity/robot_port.h"
#include "common/method/passivity/tick_reach.h"

namespace twoport {

/// The hand's side of the exchange: an energy spring, and a damper that pays what both sides lack.
///
///     f  = s f_d + γ g                           HandSpring, which has no more than A
///     T  = max(E(0), 2 |f_d|²/2K)                what each side should have
///     λ  = max(0, 2T - A - A')
///     g  = damper of the wish + B_p min(1, (λ/2T)²) v,   B_p = max(B, √(K m)),   at most m/(4T) v
///
/// A force that the limit of its rate could not take away in a tick is not displayed (unheld_share), here and at the robot.
/// Where the layer claims both ports alone, the hand's has no account of its own, and A alone counts.
template <int N>
class EnergyExchangeMaster final : public Copyable<EnergyExchangeMaster<N>, MasterPassivity<N>> {
 public:
  explicit EnergyExchangeMaster(const ControlOptions& o)
      : bounds_hand_{stated_claim(o).hand},
        account_{o.initial_energy},
        hand_{o},
        quarter_mass_{0.25 * per_axis<N>(o.handle_mass_kg, o.handle_inertia_kg_m2)} {
    const CouplingOptions& c = o.coupling;
    const typename Force<N>::Vector stiffness =
        per_axis<N>(c.stiffness_n_per_m, c.rotational_stiffness_n_m_per_rad).cwiseProduct(impedance_scale<N>(o));
    damping_ = per_axis<N>(c.damping_n_s_per_m, c.rotational_damping_n_m_s_per_rad)
                   .cwiseProduct(impedance_scale<N>(o))
                   .cwiseMax((4.0 * stiffness.cwiseProduct(quarter_mass_)).cwiseSqrt());
  }

  Shown<N> limit(const Wish<N>& wish, const MasterInput<N>& in) noexcept override {
    observe(in);
    const Energy needed = std::max(account_.initial(), kMargin * hand_.spring().stored(wish.f, in.dt));
    const Energy lacking = positive_part(2.0 * needed - account_.level() - account_.level_of_other());
    const double paid = paid_;
    paid_ = account_.heard() && lacking.si() > 0.0 ? std::min(1.0, std::pow(lacking / (2.0 * needed), 2)) : 0.0;
    if (in.active) account_.share();
    Shown<N> out;
    out.energy_in = account_.sent();
    out.energy_net = account_.net();
    if (bounds_hand_) {
      hand_.spring().cap(account_.level());
    } else {
      hand_.spring().restart(in.account.net(), account_.level() - account_.initial());
    }
    Force<N> damper = paying(paid, in);
    if (wish.damped) damper += wish.damper;
    hand_.limit(wish, &damper, in, out);
    if (const double held = unheld_share(out.f, hand_.limits(), in.dt); held < 1.0) hand_.reduce(held, out);
    if (wish.bridge != nullptr) [[unlikely]]
      hand_.cross(*wish.bridge, in, out);
    return out;
  }
  [[nodiscard]] bool crosses_bridge() const noexcept override { return true; }
  [[nodiscard]] Energy balance(const Ledger&, Energy slave_in) const noexcept override {
    return std::min(hand_.spring().energy(), account_.balance(slave_in));
  }
  void restart(const Ledger& account, Energy balance) noexcept override {
    net_before_ = account.net();
    account_.restart(handed_over(balance, account));
    hand_.spring().restart(account.net(), put_in_by_hand(balance, account));
    paid_ = 0.0;
  }
  void take_over(const typename Velocity<N>::Vector& ratio) noexcept override {
    hand_.take_over(ratio);
    v_slow_ = Velocity<N>{};
  }

 private:
  static constexpr double kMargin = 2.0, kDamperVelocity_s = 3e-3;

  void observe(const MasterInput<N>& in) noexcept {
    hand_.observe(in);
    account_.put_in(in.account.net() - net_before_);
    net_before_ = in.account.net();
    account_.hear(in.slave_energy_in, in.slave_energy_net);
    low_pass(v_slow_, in.mean_velocity(), in.dt, kDamperVelocity_s);
  }
  [[nodiscard]] Force<N> paying(double part, const MasterInput<N>& in) const noexcept {
    typename Force<N>::Vector b = part * damping_;
    for (int i = 0; i < N; ++i)
      if (quarter_mass_[i] > 0.0) b[i] = std::min(b[i], quarter_mass_[i] / in.dt.si());
    return Force<N>{in.ramp * b.cwiseProduct(v_slow_.vec())};
  }

  bool bounds_hand_;
  ExchangeAccount account_;
  HandSpring<N> hand_;
  typename Force<N>::Vector damping_, quarter_mass_;  ///< B_p; of the handle, 0 where it is not known
  Velocity<N> v_slow_;                                ///< LP_3ms v
  double paid_ = 0.0;                                 ///< min(1, (λ/2T)²), in the next tick
  Energy net_before_;
};

/// The robot's side: an energy spring whose port is the robot's.
///
///     f = s f_d,   s the largest in [0, 1] with   s² Σ f_d,i²/(2 K_i) <= A - γ W(g)   and   s W(f_d) <= A - γ W(g)
///     γ g          the damper at the robot, γ the largest in [0, 1] with   γ W(g) <= A;   W: TickReach
///
/// The set point follows the master whatever s is: what is missing is made up for as soon as there is energy.
template <int N>
class EnergyExchangeSlave final : public Copyable<EnergyExchangeSlave<N>, SlavePassivity<N>> {
 public:
  explicit EnergyExchangeSlave(const ControlOptions& o)
      : account_{o.motion_scale / o.force_scale * o.initial_energy}, limits_{limits_at_robot(o)} {
    const auto inverse = [](double k) { return k > 0.0 ? 0.5 / k : 0.0; };
    give_ = per_axis<N>(inverse(o.coupling.stiffness_n_per_m), inverse(o.coupling.rotational_stiffness_n_m_per_rad));
  }

  void start(const RobotSample<N>& robot) noexcept override { port_.start(robot); }
  RobotPort<N> limit(const RobotWish<N>& wish, VirtualCoupling<N>&, const SlaveInput<N>& in) noexcept override {
    const auto [out, moved] = port_.observe(in.robot);
    account_.put_in(-out);
    reach_.observe(moved, in.dt);
    account_.hear(in.master_energy_in, in.master_energy_net);
    if (in.active) account_.share();
    if (in.bridge != nullptr) [[unlikely]]  // the force of the method before is not paid from here
      account_.forgive();
    const Energy level = account_.level();
    double damped = reach_.part(wish.damper, level);
    const Energy left = positive_part(level - damped * reach_.most(wish.damper));
    const double stored = wish.f.vec().cwiseAbs2().dot(give_);
    double s = std::min(stored <= left.si() ? 1.0 : std::sqrt(left.si() / stored), reach_.part(wish.f, left));
    const double held = unheld_share(s * wish.f + damped * wish.damper, limits_, in.dt);
    damped *= held;
    s *= held;
    return {.f = s * wish.f,
            .v = wish.v,
            .dissipated = positive_part((1.0 - s) * (dot(wish.f, in.robot.v) * in.dt)),
            .damper_share = damped};
  }
  void acted(SlaveOutput<N>& out, const Force<N>&, const Ledger&, const SlaveInput<N>& in) noexcept override {
    port_.book(out, in.robot, in.dt);
    out.energy_in = account_.sent();
    out.energy_net = account_.net();
  }
  void limited(SlaveOutput<N>& out, const Force<N>&, Energy, VirtualCoupling<N>&, const RobotSample<N>& robot,
               Seconds dt) noexcept override {
    port_.book(out, robot, dt);
  }
  void release() noexcept override { port_.release(); }
  [[nodiscard]] Energy reported(const Ledger&) noexcept override { return account_.sent(); }
  [[nodiscard]] Energy balance(const Ledger&, Energy master_in) const noexcept override {
    return account_.balance(master_in);
  }
  void restart(const Ledger&, Energy balance) noexcept override { account_.restart(balance); }

 private:
  ExchangeAccount account_;
  PortLimits limits_;
  typename Force<N>::Vector give_;  ///< 1/(2K), 0 where there is no spring
  TickReach<N> reach_;
  RobotPortAccount<N> port_;
};

}  // namespace twoport
