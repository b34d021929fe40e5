#pragma once

#include "common/coupling/virtual_coupling.h"
#include "common/method/method.h"

namespace twoport {

/// No passivity control: the force of the virtual coupling acts unchanged.
template <int N>
class NoControlSlave {
 public:
  explicit NoControlSlave(const ControlOptions& o) : coupling_{o}, measured_{returns_measured_force(o)} {}

  void start(const RobotSample<N>& robot, const PeerState<N>& master) noexcept { coupling_.start(robot.x, master); }

  SlaveOutput<N> step(const SlaveInput<N>& in) noexcept {
    x_ = in.robot.x;
    typename VirtualCoupling<N>::Wanted wanted;
    if (in.active) {
      wanted = coupling_.step(in.robot, in.master, in.coupled, in.dt);
    } else {
      coupling_.rest(in.robot.x);
    }
    if (!all_finite(wanted.f, wanted.v)) [[unlikely]]
      return no_force_exists(wanted.f);
    const Displacement<N> moved = wanted.v * in.dt;
    Ledger account = in.account;
    account.book(-dot(wanted.f, moved));
    coupling_.move(moved, wanted.v, in.dt);
    return {.command = {.f = wanted.f, .x_d = coupling_.set_point(), .v_d = wanted.v},
            .f_back = measured_ ? in.robot.f_environment : wanted.f,
            .energy_in = account.absorbed() - base_absorbed_,
            .dissipated = Energy{}};
  }
  SlaveOutput<N> fail_safe(const Ledger& account) noexcept {
    SlaveOutput<N> out{};
    out.command.x_d = coupling_.set_point();
    out.energy_in = account.absorbed() - base_absorbed_;
    return out;
  }
  [[nodiscard]] Energy deficit(const Ledger&, Energy) const noexcept { return Energy{}; }
  void restart(const Ledger& account, Energy) noexcept { base_absorbed_ = account.absorbed(); }
  [[nodiscard]] SlaveHandover<N> handover() const noexcept { return {coupling_.registration(), coupling_.set_point()}; }
  void resume(const SlaveHandover<N>& from) noexcept { coupling_.resume(from.registration, from.set_point); }
  [[nodiscard]] const Position<N>& target() const noexcept { return coupling_.target(); }
  [[nodiscard]] bool has_payload() const noexcept { return coupling_.tells_position(); }
  void write_payload(Words& words) const noexcept { coupling_.tell_position(x_, words); }

 private:
  VirtualCoupling<N> coupling_;
  Energy base_absorbed_;
  Position<N> x_;  ///< of the robot
  bool measured_;
};

}  // namespace twoport
