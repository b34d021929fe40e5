#pragma once

#include <algorithm>
#include <optional>

#include "common/method/layers.h"
#include "common/passivity/controller.h"
#include "common/passivity/velocity_predictor.h"
#include "common/safety/turning_limits.h"

namespace twoport {

/// The master side of the two-port time domain passivity approach: impedance causality, velocity in, force out.
///
///     dE(k)  = f_applied(k-1)·Δx(k)                      exact energy of the held force (the node's account)
///     E_in  += max(dE, 0),   E_out += max(-dE, 0)
///     f'     = controller(f, A)
///     A      = E(0) + E_in,slave - E_out                  CLASSIC, as published
///     A      = E(0) + min(E_in,slave, E_in) - E_out       FORCE_PROJECTED; what the hand puts in cancels a deficit (below)
///
/// The controller predicts the port's velocity under the force (projected, if the mass at the handle is known), or
/// uses the present velocity. The energy returned to the hand is at most E(0) plus the energy that the slave reports as received;
/// under FORCE_PROJECTED also at most E(0) plus the energy that the hand has put in, whatever is reported.
///
/// When the sensor's force is displayed, the hand does not feel the force that moves the robot and cannot supply its energy.
/// The motion command is then a separate source (Artigas, Ryu, Preusche, Hirzinger, IROS 2011): it carries the energy that
/// the hand would put in if the coupling force were displayed, E_in of f_coupling,rx(k-1)·Δx(k).
/// Source: Ryu, Artigas, Preusche, Mechatronics 20(7), 2010; the correction is the projected one where chosen.
template <int N>
class TimeDomainMaster final : public Copyable<TimeDomainMaster<N>, MasterPassivity<N>> {
 public:
  explicit TimeDomainMaster(const ControlOptions& o)
      : controller_{controller_at_the_handle(o)},
        observer_{o.observer},
        initial_{o.initial_energy},
        as_published_{o.controller.method == Method::classic},
        measured_{returns_measured_force(o)},
        limits_{limits_at_device(o)},
        predictor_{predictor(o)} {}

  Shown<N> limit(const Wish<N>& wish, const MasterInput<N>& in) noexcept override {
    observe(in);
    if (!as_published_) keep_for_deficit(in.account, in.slave_energy_in);
    Corrected<Force<N>> allowed{};
    Shown<N> out;
    const Energy available = initial_ + transmittable_energy(in.account, in.slave_energy_in) - returned(in.account);
    if (!wish.idle) {
      Force<N> wanted = wish.total();
      allowed = within(wanted, available, in);
      out.share = share_of(allowed.out, wanted);
    }
    if (wish.bridge != nullptr) [[unlikely]]  // as far as the hand's port has it
      allowed = within(allowed.out + wish.bridge->step(allowed.out, in.dt),
                       std::max(available, initial_ + in.account.net()), in);
    out.f = allowed.out;
    out.energy_in = energy_sent(in.account);
    out.dissipated = allowed.dissipated;
    out.undissipated = allowed.undissipated;
    return out;
  }

  [[nodiscard]] bool crosses_bridge() const noexcept override { return true; }
  [[nodiscard]] Energy balance(const Ledger& account, Energy slave_energy_in) const noexcept override {
    return transmittable_energy(account, slave_energy_in) - returned(account);
  }
  void restart(const Ledger& account, Energy balance) noexcept override {
    base_absorbed_ = absorbed_before_ = account.absorbed();
    base_sent_ = command_.absorbed();
    base_returned_ = account.returned() + handed_over(balance, account);
  }
  void take_over(const typename Velocity<N>::Vector& ratio) noexcept override {
    if (predictor_) predictor_->restart(ratio);
  }

 private:
  Corrected<Force<N>> within(const Force<N>& wanted, Energy available, const MasterInput<N>& in) const noexcept {
    return predictor_ ? predictive_impedance_controller(wanted, predictor_->prediction(), available, controller_, in.dt,
                                                        may_turn(limits_, in.device.x, in.device.v))
                      : passivity_controller(wanted, in.device.v, Budget{available, Energy{}}, controller_, in.dt);
  }
  /// Empty if the mass at the handle is not known, as its response to a force is then unknown.
  static std::optional<PortVelocityPredictor<N>> predictor(const ControlOptions& o) {
    const bool known = o.handle_mass_kg > 0.0 && (N != 6 || o.handle_inertia_kg_m2 > 0.0);
    if (o.controller.method != Method::force_projected || !o.controller.predict || !known) return {};
    return PortVelocityPredictor<N>{o.handle_mass_kg, o.handle_inertia_kg_m2};
  }

  void observe(const MasterInput<N>& in) noexcept {
    if (!in.first) {
      if (measured_) command_.book(held_energy(observer_, command_force_, in.interval, in.ended));
      if (predictor_) {
        if (in.inertia != nullptr) predictor_->take_inertia(*in.inertia);
        predictor_->step(integral(in.interval, in.ended), in.device.applied, in.ended, in.dt);
        predictor_->take_ratio(in.device.ratio, in.device.v, in.dt);
      }
    }
    if (measured_) command_force_ = in.slave.newest.f_coupling;
  }

  /// Energy that the hand puts in while there is a deficit cancels the deficit and is not sent to the slave:
  ///
  ///     kept(k) = min(dE(k), E_out - E(0) - E_in,slave)  where both are > 0;    E_out -= kept,   E_in -= kept
  ///
  /// So what the controller takes in against a deficit ends the deficit.
  void keep_for_deficit(const Ledger& account, Energy slave_energy_in) noexcept {
    const Energy put_in = account.absorbed() - absorbed_before_;
    absorbed_before_ = account.absorbed();
    const Energy over = returned(account) - (initial_ + slave_energy_in);
    const Energy kept = positive_part(Energy{std::min(put_in.si(), over.si())});
    base_returned_ += kept;
    base_absorbed_ += kept;
  }

  [[nodiscard]] Energy energy_sent(const Ledger& account) const noexcept {
    return measured_ ? command_.absorbed() - base_sent_ : absorbed(account);
  }
  [[nodiscard]] Energy transmittable_energy(const Ledger& account, Energy slave_in) const noexcept {
    return as_published_ ? slave_in : std::min(slave_in, absorbed(account));
  }
  [[nodiscard]] Energy absorbed(const Ledger& account) const noexcept { return account.absorbed() - base_absorbed_; }
  [[nodiscard]] Energy returned(const Ledger& account) const noexcept { return account.returned() - base_returned_; }

  ControllerOptions controller_;
  ObserverRule observer_;
  Energy initial_;
  bool as_published_, measured_;
  PortLimits limits_;  ///< at the device
  std::optional<PortVelocityPredictor<N>> predictor_;
  Ledger command_;  ///< the motion command as a separate source
  Force<N> command_force_;
  Energy base_absorbed_, base_returned_, base_sent_, absorbed_before_;
};

}  // namespace twoport
