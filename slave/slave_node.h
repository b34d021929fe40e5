#pragma once

#include <algorithm>

#include "common/base/time.h"
#include "common/coupling/options.h"
#include "common/coupling/scaling.h"
#include "common/coupling/spring_damper.h"
#include "common/coupling/tracker.h"
#include "common/hardware/robot.h"
#include "common/link/mailbox.h"
#include "common/passivity/controller.h"
#include "common/passivity/observer.h"
#include "common/runtime/modes.h"

namespace twoport {

/// The slave half of a delayed two-port: admittance causality, force in, velocity out, closed by the virtual coupling.
///
///     v_d       commanded motion (Tracker), s_x times the master's
///     f_d       = K (x_sd(k-1) + T v_d - x_s) + B (v_rx - v_s)      what the coupling wants; goes back to the master
///     f, v_sd   = yield(f_d, v_d)                  so that f·v_sd T <= E(0) + E_in,master - E_out; f acts on the robot
///     dE(k)     = -f·Δx_sd,   E_in += max(dE, 0),   E_out += max(-dE, 0)
///
/// The correction acts along the force, so sliding along a surface is not slowed. The hand feels f_d, not f: it must be
/// able to put in the energy that a stalled coupling waits for. The sampled coupling is watched at both its ports; what
/// it creates itself is not passed on as credit.
/// Source: Ryu, Artigas, Preusche, Mechatronics 20(7), 2010.
template <int N>
class SlaveNode {
 public:
  struct Output {
    RobotCommand<N> command;
    Report<N> report;
    Energy dissipated;
    Mode mode;
  };

  explicit SlaveNode(const ControlOptions& o)
      : options_{o},
        scaling_{o},
        coupling_{o.coupling},
        tracker_{o.coupling},
        hold_after_{to_duration(o.hold_after.si())},
        release_after_{to_duration(o.release_after.si())} {}

  [[gnu::always_inline]] Output step(const Tick<SlaveClock>& tick, const RobotState<N>& robot,
                                     const Known<N>& master) noexcept {
    if (!all_finite(robot.x, robot.v, robot.f_environment)) [[unlikely]]
      return let_go(robot);
    const Duration silence = tick.now.time_since_epoch() - master.heard;
    const Mode was = mode_;
    mode_ = next_mode(mode_, {.heard = master.any && silence < hold_after_, .silent = silence >= release_after_});
    if (begins(was, mode_) || !started_) engage(robot);
    created_.book(0, -dot(f_, robot.x - x_before_));
    x_before_ = robot.x;
    if (options_.reference_energy) follow_reference(robot.x);

    Velocity<N> v_rx, v_d;
    Force<N> f_d;
    if (mode_ == Mode::idle || mode_ == Mode::released) {
      x_sd_ = x_d_ = robot.x;
    } else {
      if (mode_ == Mode::coupled) {
        v_rx = scaling_.to_slave(master.newest.v);
        v_d = tracker_.step(options_.coupling.drift_compensation ? x_sd_ : x_d_, scaling_.to_slave(master.newest.x),
                            v_rx, master.fresh, tick.dt);
      }
      f_d = robot.ideal ? robot.f_environment : coupling_.force((x_sd_ + v_d * tick.dt) - robot.x, v_rx - robot.v);
    }
    Yielded<N> allowed{f_d, v_d, Energy{}};
    if (options_.controller.method != Method::none)
      allowed = yield(f_d, v_d, coupling_.compliance(tick.dt), available(master), tick.dt);
    if (!all_finite(allowed.f, allowed.v)) [[unlikely]]
      return let_go(robot);
    move(v_d, allowed.v, allowed.f, tick.dt);

    const bool measured = options_.architecture == Architecture::position_measured_force;
    return {.command = {.f = f_, .x_d = x_sd_, .v_d = allowed.v},
            .report = {.x = robot.x,
                       .v = robot.v,
                       .f = measured ? robot.f_environment : f_d,
                       .f_coupling = f_,
                       .f_environment = robot.f_environment,
                       .energy_in_j = credit(),
                       .mode = mode_},
            .dissipated = allowed.dissipated,
            .mode = mode_};
  }

  /// As MasterNode::rebase.
  void rebase(Energy master_energy_in) noexcept {
    const Energy balance = scaling_.to_slave(master_energy_in) - returned();
    base_absorbed_ = ledger_.absorbed();
    base_returned_ = ledger_.returned() - positive_part(-balance);
    created_.book(0, -created_.energy());  // charged already, or unused
    created_worst_ = credit_ = 0.0;
    mode_ = Mode::idle;
  }

  [[nodiscard]] Mode mode() const noexcept { return mode_; }
  /// Robot against the delayed, scaled master, at the last step. Null while not coupled.
  [[nodiscard]] Displacement<N> position_error() const noexcept {
    return mode_ == Mode::coupled ? x_before_ - tracker_.target() : Displacement<N>{};
  }
  /// Net energy that has left the link into the slave [J].
  [[nodiscard]] Energy delivered() const noexcept { return -ledger_.net(); }

 private:
  [[nodiscard]] Energy returned() const noexcept { return ledger_.returned() - base_returned_; }
  [[nodiscard]] Energy available(const Known<N>& master) const noexcept {
    return options_.initial_energy + scaling_.to_slave(Energy{master.energy_in_j}) - returned();
  }

  /// A reading that is not finite is none, nor is a force that no double holds: nothing acts on the robot until the next
  /// tick. The other side takes no report that is not finite.
  [[gnu::always_inline]] Output let_go(const RobotState<N>& robot) noexcept {
    mode_ = Mode::released;
    f_ = Force<N>{};
    Output out{};
    out.command.x_d = x_sd_;
    out.report = {
        .x = robot.x, .v = robot.v, .f_environment = robot.f_environment, .energy_in_j = credit(), .mode = mode_};
    out.mode = mode_;
    return out;
  }

  void engage(const RobotState<N>& robot) noexcept {
    x_before_ = x_sd_ = x_d_ = robot.x;
    f_ = Force<N>{};
    started_ = true;
  }

  /// x_d moves as commanded, x_sd as allowed, against the force f that is held from now on.
  void move(const Velocity<N>& v_d, const Velocity<N>& v_sd, const Force<N>& f, Seconds dt) noexcept {
    f_ = f;
    const Displacement<N> moved = v_sd * dt;
    const Energy into_slave = dot(f_, moved);
    ledger_.book(-into_slave);
    created_.book(0, into_slave);
    x_sd_ = x_sd_ + moved;
    if (!options_.coupling.drift_compensation) x_d_ = x_d_ + v_d * dt;
  }

  /// Reference energy: the coupling has to hold what its spring would, ½ eᵀK e, tick for tick. What its damper has
  /// dissipated does not pay for what it creates later.
  void follow_reference(const Position<N>& x) noexcept {
    const Energy surplus = created_.energy() - coupling_.stored(x_sd_ - x);
    created_.book(0, -surplus);
    created_worst_ -= positive_part(-surplus).si();
  }

  /// What may be claimed as having entered here: not what the sampled coupling has created. Only grows.
  double credit() noexcept {
    if (!options_.reference_energy) created_worst_ = std::min(created_worst_, created_.energy().si());
    const double earned = (ledger_.absorbed() - base_absorbed_).si() + created_worst_;
    return credit_ = std::max(credit_, earned);
  }

  ControlOptions options_;
  Scaling<N> scaling_;
  SpringDamper<N> coupling_;
  Tracker<N> tracker_;
  Ledger ledger_;
  Observer<1> created_;  ///< the coupling as a two-port: link port plus robot port
  double created_worst_ = 0.0, credit_ = 0.0;
  Energy base_absorbed_, base_returned_;
  Position<N> x_before_, x_sd_, x_d_;
  Force<N> f_;
  Duration hold_after_, release_after_;
  Mode mode_ = Mode::idle;
  bool started_ = false;
};

}  // namespace twoport
