#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <utility>

#include "common/base/built_for.h"
#include "common/base/time.h"
#include "common/coupling/bridge.h"
#include "common/coupling/joint_metric.h"
#include "common/coupling/options.h"
#include "common/coupling/registration.h"
#include "common/hardware/robot.h"
#include "common/link/mailbox.h"
#include "common/method/alternatives.h"
#include "common/method/method.h"
#include "common/passivity/observer.h"
#include "common/runtime/modes.h"
#include "common/safety/safety_stage.h"

namespace twoport {

/// The slave over a link: force in, motion out. Implements what all methods share: modes, finite checks, the limits
/// at the robot, the account of the link's port. The method's half computes the command.
template <int N, class Half = SlaveHalf<N>>
class SlaveNode {
 public:
  struct Output {
    RobotCommand<N> command;
    PortReport<N> report;
    Energy dissipated;
    Mode mode;
  };

  explicit SlaveNode(const ControlOptions& o, std::span<const ScheduledControl> schedule = {});

  Output step(const Tick<SlaveClock>& tick, const RobotSample<N>& reading, const PeerState<N>& master) noexcept;

  /// As MasterNode::on_peer_restart.
  void on_peer_restart(Energy master_energy_in) noexcept;

  /// As MasterNode::switch_method; set point and registration are kept. The force on the robot is continuous (Bridge): what
  /// that adds does at most the work |f_before - f_new(0)| times the robot's path within engage_s.
  void switch_method(Held<Half>& next) noexcept;

  [[nodiscard]] std::uint32_t epoch() const noexcept { return epoch_; }

  [[nodiscard]] Mode mode() const noexcept { return modes_.mode(); }
  [[nodiscard]] const LimitCounts& limit_counts() const noexcept { return safety_.counts(); }
  /// Words of the method for the report of the last step, if any.
  [[nodiscard]] bool has_payload() const noexcept { return half_->has_payload(); }
  void write_payload(Words& words) const noexcept { half_->write_payload(words, registration_); }
  /// Robot against the delayed, scaled master, at the last step. Null while not coupled.
  [[nodiscard]] const Displacement<N>& position_error() const noexcept { return position_error_; }
  /// The master's position as far as it is known here, in the slave's world.
  [[nodiscard]] Position<N> target() const noexcept { return metric_.joints(half_->target()); }
  /// Net energy that has left the link into the slave [J].
  [[nodiscard]] Energy delivered() const noexcept { return -account_.net(); }

 private:
  /// The command within the limits; the half is told, so that its set point does not run ahead.
  SlaveOutput<N> limited(SlaveOutput<N> half, RobotSample<N> robot, Seconds dt) noexcept {
    RobotCommand<N>& c = half.command;
    const RobotCommand<N> asked = c;
    const bool follows = modes_.active();
    const Position<N> from = follows && commanded_ ? x_d_ : robot.x;
    // A robot that follows the set point exactly is held by it; another one by its force.
    if (follows) c.x_d = safety_.set_point(c.x_d, from, dt, robot.ideal ? &robot.f_environment : nullptr);
    if (!robot.ideal) c.f = safety_(c.f, robot.x, robot.v, dt);
    if (half.f_back.vec() == asked.f.vec()) half.f_back = c.f;
    if (follows && (c.f.vec() != asked.f.vec() || c.x_d.translation() != asked.x_d.translation()))
      half_->limited(half, asked, robot, dt);
    x_d_ = c.x_d;
    commanded_ = follows;
    return half;
  }

  /// As MasterNode::pause.
  void pause() noexcept {
    modes_.release();
    safety_.release();
    safety_.note(Limit::pause);
    bridge_.stop();
  }
  /// What the master has said, still in its world; `words`: those of this method and coupling are among it.
  void hear(const PeerState<N>& master, bool words) noexcept {
    master_ = master;
    if constexpr (N == kJointPort) master_.newest = metric_.scaled(master.newest);
    if (!words) [[unlikely]]
      master_.words.clear();
  }
  /// Registers the worlds: the robot is where the master wants it.
  void engage(const RobotSample<N>& robot, const PeerState<N>& master, bool words) noexcept {
    if (!master.has_report) return;
    hear(master, words);
    registration_.engage(half_->commanded(master_), robot.x);
  }
  /// What the master has said, in this world.
  void arrive(const PeerState<N>& master, bool same_epoch) noexcept {
    hear(master, same_epoch && modes_.shares_coupling());
    x_rx_ = registration_.to_slave(half_->commanded(master_));
    master_.newest = registration_.to_slave(master_.newest);
    master_energy_in_ = same_epoch ? registration_.to_slave(Energy{master.energy_in_j}) : Energy{};
    master_.energy_in_j = master_energy_in_.si();
  }
  /// The master is in another epoch: it has switched, or restarted. Every epoch that it may name has a configuration.
  void follow(RobotSample<N> robot, const PeerState<N>& master) noexcept {
    if (alternatives_.empty() || !master.has_report) return;
    if (Held<Half>* next = alternatives_.of(master.epoch)) {
      (*next)->start(robot, true);
      switch_method(*next);
      if (!modes_.active()) engage(robot, master, true);
      alternatives_.used(master.epoch);
    } else {
      half_->restart(account_, std::min(half_->balance(account_, master_energy_in_), Energy{}));
    }
    epoch_ = master.epoch;
  }

  /// As MasterNode::fail_safe.
  Output fail_safe(const RobotSample<N>& robot) noexcept {
    modes_.release();
    safety_.release();
    commanded_ = false;
    position_error_ = {};
    command_ = Force<N>{};
    bridge_.stop();
    SlaveOutput<N> half = half_->fail_safe(account_);
    Output out{};
    out.command = half.command;
    out.report.x = robot.x;
    out.report.v = robot.v;
    out.report.f_environment = robot.f_environment;
    out.report.energy_in_j = half.energy_in.si();
    out.report.energy_net_j = half.energy_net.si();
    out.report.epoch = epoch_;
    out.report.mode = out.mode = modes_.mode();
    return out;
  }

  [[no_unique_address]] JointMetric<N> metric_;
  Registration<N> registration_;
  Held<Half> half_;
  Alternatives<Held<Half>> alternatives_;
  Bridge<N> bridge_;
  ModeMachine modes_;
  SafetyStage<N> safety_;
  Position<N> x_d_;  ///< the last set point, while one is commanded
  bool commanded_ = false;
  Ledger account_;  ///< the link's port
  Displacement<N> position_error_;
  Force<N> command_;  ///< of the last tick
  Energy master_energy_in_;
  PeerState<N> master_;  ///< in this world
  Position<N> x_rx_;     ///< SlaveHalf::commanded, in this world
  std::uint32_t epoch_ = 0;
  bool started_ = false;
};

template <int N, class Half>
SlaveNode<N, Half>::SlaveNode(const ControlOptions& o, std::span<const ScheduledControl> schedule)
    : metric_{o},
      registration_{o},
      half_{o},
      alternatives_{o, schedule},
      bridge_{o.engage},
      modes_{o},
      safety_{limits_at_robot(o), 1.0, o.known.robot_mass_kg, o.known.robot_inertia_kg_m2} {}

template <int N, class Half>
auto SlaveNode<N, Half>::step(const Tick<SlaveClock>& tick, const RobotSample<N>& reading,
                              const PeerState<N>& master) noexcept -> Output {
  if (modes_.is_stopped(reading.status, master) || !all_finite(reading.x, reading.v, reading.f_environment))
      [[unlikely]]
    return fail_safe(reading);
  const RobotSample<N>& robot = metric_.scaled(reading);
  if (modes_.has_paused(tick)) [[unlikely]]
    pause();
  if (master.epoch != epoch_) [[unlikely]]
    follow(robot, master);  // a coupling that begins now is of the new method
  const bool shared = modes_.shares_coupling();
  const bool begins = modes_.step(tick.now.time_since_epoch(), master, master.newest.mode == Mode::let_go);
  // The robot follows what the hand does once the master says that it is coupled too.
  const bool shares = modes_.shares_coupling();
  if (begins || (shares && !shared) || !started_) {
    half_->start(robot, master.has_report);
    engage(robot, master, shares);
    commanded_ = false;
  }
  started_ = true;
  const bool same_epoch = master.epoch == epoch_;
  arrive(master, same_epoch);
  SlaveOutput<N> half = half_->step({.dt = tick.dt,
                                     .robot = robot,
                                     .master = master_,
                                     .commanded = x_rx_,
                                     .worlds = registration_,
                                     .master_energy_in = master_energy_in_,
                                     .master_energy_net = Energy{same_epoch ? master_.newest.energy_net_j : 0.0},
                                     .account = account_,
                                     .coupled = modes_.coupled() && shares,
                                     .active = modes_.active() && shares,
                                     .bridge = bridge_.over(modes_.active() && !robot.ideal)});
  if (!all_finite(half.command.f, half.command.v_d, half.command.x_d)) [[unlikely]]
    return fail_safe(reading);
  if (safety_.any()) [[unlikely]]
    half = limited(half, robot, tick.dt);
  command_ = half.command.f;
  account_.book(half.grounded - dot(half.command.f, half.command.v_d * tick.dt));
  position_error_ =
      modes_.coupled() && shares ? metric_.joints(Displacement<N>{robot.x - half_->target()}) : Displacement<N>{};
  RobotCommand<N> command = metric_.joints(half.command);
  return {.command = command,
          .report = {.x = reading.x,
                     .v = reading.v,
                     .f = metric_.joints(half.f_back),
                     .f_coupling = command.f,
                     .f_environment = reading.f_environment,
                     .position_error = position_error_,
                     .energy_in_j = half.energy_in.si(),
                     .energy_net_j = half.energy_net.si(),
                     .mode = modes_.mode(),
                     .epoch = epoch_},
          .dissipated = half.dissipated,
          .mode = modes_.mode()};
}

template <int N, class Half>
void SlaveNode<N, Half>::on_peer_restart(Energy master_energy_in) noexcept {
  half_->restart(account_, std::min(half_->balance(account_, registration_.to_slave(master_energy_in)), Energy{}));
  modes_.reset();
}

template <int N, class Half>
void SlaveNode<N, Half>::switch_method(Held<Half>& next) noexcept {
  next->restart(account_, half_->balance(account_, master_energy_in_));
  if (modes_.active()) next->resume(half_->set_point());
  std::swap(half_, next);
  bridge_.begin(command_);
  ++epoch_;
}

// As MasterNode.
TWOPORT_DECLARE(SlaveNode);

}  // namespace twoport
