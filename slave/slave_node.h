#pragma once

#include <algorithm>

#include "common/base/time.h"
#include "common/coupling/options.h"
#include "common/coupling/ramp.h"
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
///     v_d     commanded motion (Tracker), s_x times the master's
///     v_sd    = v_d - β f(k-1)                       so that f(k-1)·v_sd T <= E(0) + E_in,master - E_out
///     dE(k)   = -f(k-1)·Δx_sd(k)                     f(k-1): the force held in the interval that has just ended
///     E_in   += max(dE, 0),   E_out += max(-dE, 0)
///     f(k)    = K (x_sd - x_s) + B (v_sd - v_s)      acts on the robot, and goes back to the master
///
/// The correction acts along the force, so sliding along a surface is not slowed. The sampled coupling is watched at
/// both its ports; what it creates itself is not passed on as credit.
/// Source: Ryu, Artigas, Preusche, Mechatronics 20(7), 2010.
template <int N>
class SlaveNode {
 public:
  struct Output {
    RobotCommand<N> command;
    Report<N> report;
    Displacement<N> position_error;  ///< robot against the delayed, scaled master
    Energy dissipated, owed;
    Mode mode;
  };

  explicit SlaveNode(const ControlOptions& o)
      : options_{o},
        scaling_{o},
        coupling_{o.coupling},
        tracker_{o.coupling},
        ramp_{o.engage} {
    // The admittance form along f is the force-projected one: both methods are the same here.
    if (options_.controller.method != Method::none) options_.controller.method = Method::classic;
  }

  Output step(const Tick<SlaveClock>& tick, const RobotState<N>& robot, const Known<N>& master) noexcept {
    const Duration silence = tick.now.time_since_epoch() - master.heard;
    const Mode was = mode_;
    mode_ = next_mode(mode_, {.heard = master.any && to_seconds(silence) < options_.hold_after,
                              .silent = to_seconds(silence) >= options_.release_after,
                              .finite = robot.x.finite() && robot.v.finite() && robot.f_environment.finite()});
    if (!started_ || (mode_ == Mode::coupled && (was == Mode::idle || was == Mode::released))) engage(robot);
    created_.book(0, -dot(f_, robot.x - x_before_));
    x_before_ = robot.x;

    Corrected<Velocity<N>> motion{};
    Velocity<N> rate;
    switch (mode_) {
      case Mode::coupled: {
        const Velocity<N> v_rx = scaling_.to_slave(master.newest.v);
        const Velocity<N> v_d = tracker_.step(options_.coupling.drift_compensation ? x_sd_ : x_d_,
                                              scaling_.to_slave(master.newest.x), v_rx, master.fresh, tick.dt);
        motion = passivate(v_d, -f_, Budget{available(master), Energy{}}, options_.controller, tick.dt);
        move(v_d, motion.out, tick.dt);
        rate = v_rx + (motion.out - v_d);
        break;
      }
      case Mode::holding: break;
      case Mode::idle:
      case Mode::released: x_sd_ = x_d_ = robot.x; break;
    }

    const double ramp = ramp_.step(mode_ == Mode::coupled || mode_ == Mode::holding, tick.dt);
    if (mode_ == Mode::idle || mode_ == Mode::released) {
      f_ = Force<N>{};
    } else if (robot.ideal) {
      f_ = ramp * robot.f_environment;
    } else {
      f_ = ramp * coupling_.force(x_sd_ - robot.x, rate - robot.v);
    }

    const bool measured = options_.architecture == Architecture::position_measured_force;
    return {.command = {.f = f_, .x_d = x_sd_, .v_d = rate},
            .report = {.x = robot.x,
                       .v = robot.v,
                       .f = measured ? ramp * robot.f_environment : f_,
                       .f_coupling = f_,
                       .f_environment = robot.f_environment,
                       .energy_in_j = credit(),
                       .mode = mode_},
            .position_error = mode_ == Mode::coupled ? robot.x - tracker_.target() : Displacement<N>{},
            .dissipated = motion.dissipated,
            .owed = motion.owed,
            .mode = mode_};
  }

  /// As MasterNode::rebase.
  void rebase(Energy master_energy_in) noexcept {
    const Energy balance = scaling_.to_slave(master_energy_in) - returned();
    base_absorbed_ = ledger_.absorbed();
    base_returned_ = ledger_.returned() - positive_part(-balance - options_.initial_energy);
    credit_ = 0.0;
    mode_ = Mode::idle;
    ramp_.drop();
  }

  [[nodiscard]] Mode mode() const noexcept { return mode_; }
  /// Net energy that has left the link into the slave [J].
  [[nodiscard]] Energy delivered() const noexcept { return -ledger_.net(); }

 private:
  [[nodiscard]] Energy returned() const noexcept { return ledger_.returned() - base_returned_; }
  [[nodiscard]] Energy available(const Known<N>& master) const noexcept {
    return options_.initial_energy + scaling_.to_slave(Energy{master.energy_in_j}) - returned();
  }

  void engage(const RobotState<N>& robot) noexcept {
    x_before_ = x_sd_ = x_d_ = robot.x;
    f_ = Force<N>{};
    ramp_.drop();
    started_ = true;
  }

  /// x_d moves as commanded, x_sd as allowed; the held force does its work on x_sd.
  void move(const Velocity<N>& v_d, const Velocity<N>& v_sd, Seconds dt) noexcept {
    const Displacement<N> moved = v_sd * dt;
    const Energy into_slave = dot(f_, moved);
    ledger_.book(-into_slave);
    created_.book(0, into_slave);
    x_sd_ = x_sd_ + moved;
    x_d_ = x_d_ + v_d * dt;
  }

  /// What may be claimed as having entered here: not what the sampled coupling has created. Only grows.
  double credit() noexcept {
    created_worst_ = std::min(created_worst_, created_.energy().si());
    const double earned = (ledger_.absorbed() - base_absorbed_).si() + created_worst_;
    return credit_ = std::max(credit_, earned);
  }

  ControlOptions options_;
  Scaling<N> scaling_;
  SpringDamper<N> coupling_;
  Tracker<N> tracker_;
  Ramp ramp_;
  Ledger ledger_;
  Observer<1> created_;  ///< the coupling as a two-port: link port plus robot port
  double created_worst_ = 0.0, credit_ = 0.0;
  Energy base_absorbed_, base_returned_;
  Position<N> x_before_, x_sd_, x_d_;
  Force<N> f_;
  Mode mode_ = Mode::idle;
  bool started_ = false;
};

}  // namespace twoport
