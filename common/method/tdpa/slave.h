#pragma once

#include <algorithm>

#include "common/coupling/virtual_coupling.h"
#include "common/method/method.h"
#include "common/passivity/controller.h"
#include "common/passivity/observer.h"

namespace twoport {

/// The slave half of the two-port time domain passivity approach: admittance causality, force in, velocity out, closed by
/// the virtual coupling.
///
///     f_d, v_d  = force and velocity of the virtual coupling before control; f_d is sent to the master
///     f, v_sd   = controller(f_d, v_d)              so that f·v_sd T <= E(0) + E_in,master - E_out; f acts on the robot
///     dE(k)     = -f·Δx_sd,   E_in += max(dE, 0),   E_out += max(-dE, 0)
///
/// The correction acts along the force, so sliding along a surface is not slowed. The hand feels f_d, not f, so that it
/// can put in the energy that a stalled coupling needs. The sampled coupling is observed at both its ports; energy that it
/// generates is not credited.
/// Source: Ryu, Artigas, Preusche, Mechatronics 20(7), 2010.
template <int N>
class TdpaSlave {
 public:
  explicit TdpaSlave(const ControlOptions& o)
      : coupling_{o},
        initial_{o.initial_energy},
        measured_{returns_measured_force(o)},
        reference_energy_{o.reference_energy} {}

  void start(const RobotSample<N>& robot, const PeerState<N>& master) noexcept {
    coupling_.start(robot.x, master);
    x_before_ = robot.x;
    f_ = Force<N>{};
  }

  [[gnu::always_inline]] SlaveOutput<N> step(const SlaveInput<N>& in) noexcept {
    const RobotSample<N>& robot = in.robot;
    coupling_energy_.book(0, -dot(f_, robot.x - x_before_));
    x_before_ = robot.x;
    if (reference_energy_) follow_reference(robot.x);

    typename VirtualCoupling<N>::Wanted wanted;
    if (in.active) {
      wanted = coupling_.step(robot, in.master, in.coupled, in.dt);
    } else {
      coupling_.rest(robot.x);
    }
    PortSolution<N> allowed = admittance_controller(wanted.f, wanted.v, coupling_.spring().mobility(in.dt),
                                                    available(in.account, in.master_energy_in), in.dt);
    if (!all_finite(allowed.f, allowed.v)) [[unlikely]]
      return no_force_exists(allowed.f);
    f_ = allowed.f;
    Displacement<N> moved = allowed.v * in.dt;
    const Energy into_slave = dot(f_, moved);
    Ledger account = in.account;
    account.book(-into_slave);
    coupling_energy_.book(0, into_slave);
    coupling_.move(moved, wanted.v, in.dt);
    sent_before_j_ = energy_sent_j_;
    return {.command = {.f = f_, .x_d = coupling_.set_point(), .v_d = allowed.v},
            .f_back = measured_ ? robot.f_environment : wanted.f,
            .energy_in = energy_sent(account),
            .dissipated = allowed.dissipated};
  }

  /// As tell_limited.
  void limited(SlaveOutput<N>& out, const RobotCommand<N>& asked, const RobotSample<N>& robot, Seconds dt) noexcept {
    coupling_.limited(out.command, asked, robot, dt);
    out.command.x_d = coupling_.set_point();
    f_ = out.command.f;
    const Energy wished = -dot(asked.f, asked.v_d * dt), taken = -dot(f_, out.command.v_d * dt);
    coupling_energy_.book(0, wished - taken);
    report_no_more(out, wished, taken);
    energy_sent_j_ = std::max(sent_before_j_, out.energy_in.si());
    out.energy_in = Energy{energy_sent_j_};
  }

  SlaveOutput<N> fail_safe(const Ledger& account) noexcept {
    f_ = Force<N>{};
    SlaveOutput<N> out{};
    out.command.x_d = coupling_.set_point();
    out.energy_in = energy_sent(account);
    return out;
  }

  /// As TdpaMaster::deficit and restart.
  [[nodiscard]] Energy deficit(const Ledger& account, Energy master_energy_in) const noexcept {
    return positive_part(returned(account) - coupling_.registration().to_slave(master_energy_in));
  }
  void restart(const Ledger& account, Energy deficit) noexcept {
    base_absorbed_ = account.absorbed();
    base_returned_ = account.returned() - deficit;
    coupling_energy_.book(0, -coupling_energy_.energy());  // charged already, or unused
    worst_coupling_energy_j_ = energy_sent_j_ = 0.0;
  }
  [[nodiscard]] SlaveHandover<N> handover() const noexcept { return {coupling_.registration(), coupling_.set_point()}; }
  void resume(const SlaveHandover<N>& from) noexcept { coupling_.resume(from.registration, from.set_point); }
  [[nodiscard]] const Position<N>& target() const noexcept { return coupling_.target(); }
  [[nodiscard]] bool has_payload() const noexcept { return coupling_.tells_position(); }
  void write_payload(Words& words) const noexcept { coupling_.tell_position(x_before_, words); }

 private:
  [[nodiscard]] Energy returned(const Ledger& account) const noexcept { return account.returned() - base_returned_; }
  [[nodiscard]] Energy available(const Ledger& account, Energy master_energy_in) const noexcept {
    return initial_ + coupling_.registration().to_slave(master_energy_in) - returned(account);
  }

  /// Reference energy: the coupling's account follows the energy of its spring, ½ eᵀK e, in every tick. Energy
  /// dissipated by its damper does not cover energy that it generates later.
  void follow_reference(const Position<N>& x) noexcept {
    const Energy surplus = coupling_energy_.energy() - coupling_.spring().stored(coupling_.set_point() - x);
    coupling_energy_.book(0, -surplus);
    worst_coupling_energy_j_ -= positive_part(-surplus).si();
  }

  /// Energy reported as having entered here, less the energy generated by the sampled coupling. Monotonic.
  Energy energy_sent(const Ledger& account) noexcept {
    if (!reference_energy_)
      worst_coupling_energy_j_ = std::min(worst_coupling_energy_j_, coupling_energy_.energy().si());
    const double earned = (account.absorbed() - base_absorbed_).si() + worst_coupling_energy_j_;
    return Energy{energy_sent_j_ = std::max(energy_sent_j_, earned)};
  }

  VirtualCoupling<N> coupling_;
  Energy initial_;
  bool measured_, reference_energy_;
  Observer<1> coupling_energy_;  ///< of the coupling as a two-port: link port plus robot port
  double worst_coupling_energy_j_ = 0.0, energy_sent_j_ = 0.0;
  double sent_before_j_ = 0.0;  ///< the same before the last step
  Energy base_absorbed_, base_returned_;
  Position<N> x_before_;
  Force<N> f_;
};

}  // namespace twoport
