#pragma once

#include "common/coupling/virtual_coupling.h"
#include "common/method/method.h"

namespace twoport {

/// No passivity control: the virtual coupling acts on the robot as it is.
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
    account_.book(-dot(wanted.f, moved));
    coupling_.move(moved, wanted.v, in.dt);
    return {.command = {.f = wanted.f, .x_d = coupling_.set_point(), .v_d = wanted.v},
            .f_back = measured_ ? in.robot.f_environment : wanted.f,
            .energy_in = account_.absorbed() - base_absorbed_,
            .dissipated = Energy{}};
  }
  SlaveOutput<N> fail_safe() noexcept {
    SlaveOutput<N> out{};
    out.command.x_d = coupling_.set_point();
    out.energy_in = account_.absorbed() - base_absorbed_;
    return out;
  }
  [[nodiscard]] Energy deficit(Energy) const noexcept { return Energy{}; }
  void restart(Energy) noexcept { base_absorbed_ = account_.absorbed(); }
  [[nodiscard]] SlaveHandover<N> handover() const noexcept { return {coupling_.registration(), coupling_.set_point()}; }
  void resume(const SlaveHandover<N>& from) noexcept { coupling_.resume(from.registration, from.set_point); }
  [[nodiscard]] const Position<N>& target() const noexcept { return coupling_.target(); }
  [[nodiscard]] bool has_payload() const noexcept { return coupling_.tells_position(); }
  void write_payload(Words& words) const noexcept { coupling_.tell_position(x_, words); }

 private:
  VirtualCoupling<N> coupling_;
  Ledger account_;  ///< the link's port: f·v_d T out of it
  Energy base_absorbed_;
  Position<N> x_;  ///< of the robot
  bool measured_;
};

}  // namespace twoport
