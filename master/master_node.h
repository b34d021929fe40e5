#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <utility>

#include "common/base/built_for.h"
#include "common/base/time.h"
#include "common/coupling/bridge.h"
#include "common/coupling/joint_metric.h"
#include "common/coupling/leader_inertia.h"
#include "common/coupling/motor_mask.h"
#include "common/coupling/options.h"
#include "common/coupling/ramp.h"
#include "common/coupling/registration.h"
#include "common/hardware/device.h"
#include "common/link/mailbox.h"
#include "common/method/alternatives.h"
#include "common/method/method.h"
#include "common/passivity/observer.h"
#include "common/runtime/modes.h"
#include "common/safety/safety_stage.h"

namespace twoport {

/// The master over a link: velocity in, force out. Implements what all methods share: modes, the force ramp, finite
/// checks, the limits at the device, the exact account of the hand's port. The method's half computes the force.
template <int N, class Half = MasterHalf<N>>
class MasterNode {
 public:
  struct Output {
    Force<N> command;  ///< at the master port, power f·v into the network
    PortReport<N> report;
    Force<N> wanted;  ///< before the passivity controller
    Energy dissipated, undissipated;
    Mode mode;
    LayerFigures figures{};
  };

  explicit MasterNode(const ControlOptions& o, std::span<const ScheduledControl> schedule = {});

  Output step(const Tick<MasterClock>& tick, const DeviceSample<N>& reading, const PeerState<N>& slave) noexcept;

  /// The slave has restarted and its totals with it: those of this side restart too.
  void on_peer_restart(Energy slave_energy_in) noexcept;

  /// Switches to another method or architecture; `next` then holds the previous one. The force is continuous (Bridge, over
  /// engage_s), now and when the slave's first report under the new one arrives:
  ///
  ///     |f(k) - f(k-1)| <= |change of the new half's own force| + T/engage |f_before - f_new(0)|
  ///
  /// The bridge is a part of what the new half wishes, so that its passivity layer limits it: where the account has not the energy, the
  /// force falls at once. The account goes on with what the one before has left, a deficit included. Totals start from zero in a new
  /// epoch.
  void switch_method(Held<Half>& next) noexcept;
  /// Switches to the next entry of the schedule, after the last one to the first control. Call between ticks.
  void switch_to_next() noexcept {
    if (alternatives_.empty()) return;
    switch_method(*alternatives_.of(epoch_ + 1));
    alternatives_.used(epoch_);
  }
  [[nodiscard]] std::uint32_t epoch() const noexcept { return epoch_; }

  [[nodiscard]] Mode mode() const noexcept { return modes_.mode(); }
  /// Words of the method for the report of the last step, if any.
  [[nodiscard]] bool has_payload() const noexcept { return half_->has_payload(); }
  void write_payload(Words& words) const noexcept { half_->write_payload(words); }
  [[nodiscard]] const LimitCounts& limit_counts() const noexcept { return safety_.counts(); }
  /// Along axes without a motor, so far.
  [[nodiscard]] const NotDisplayed& not_displayed() const noexcept { return not_displayed_; }
  /// For what trace and page show.
  [[nodiscard]] const Registration<N>& worlds() const noexcept { return registration_; }
  /// Observed energy that the hand has put in, E(0) not included [J].
  [[nodiscard]] Energy observed() const noexcept { return account_.net(); }

 private:
  void display_by_motors(const Force<N>& wanted) noexcept {
    command_ = motors_(command_);
    const typename Force<N>::Vector left = wanted.vec() - motors_(wanted).vec();
    not_displayed_.force_n = std::max(not_displayed_.force_n, left.template head<kAxes<N>>().norm());
    if constexpr (N == 6)
      not_displayed_.torque_n_m = std::max(not_displayed_.torque_n_m, left.template tail<3>().norm());
  }
  /// What the slave has said, in this world, without the words of another method or coupling.
  void arrive(const PeerState<N>& slave, bool same_epoch) noexcept {
    slave_ = slave;
    slave_.newest = registration_.to_master(metric_.scaled(slave.newest));
    slave_energy_in_ = same_epoch ? registration_.to_master(Energy{slave.energy_in_j}) : Energy{};
    slave_.energy_in_j = slave_energy_in_.si();
    if (!same_epoch || !modes_.shares_coupling()) [[unlikely]]
      slave_.words.clear();
  }
  /// Its reports change their meaning now.
  void slave_follows() noexcept {
    awaits_slave_ = false;
    bridge_.begin(command_);
  }

  /// This side has stood still for a while: what it knows is old. The coupling begins anew, with its ramp. Of the energy of an
  /// interval in which the device may have let go by itself, only what the hand was given is believed.
  Energy pause(Energy into) noexcept {
    modes_.release();
    safety_.release();
    safety_.note(Limit::pause);
    bridge_.stop();
    ramp_.drop();
    return std::min(into, Energy{});
  }

  /// Energy of the force that was held when readings were not finite, over the motion since the last finite one. How much of that
  /// motion was under it is not known, so only what the hand was given is believed.
  Energy given_unread(Displacement<N> moved) noexcept {
    unread_ = false;
    return std::min(dot(held_unread_, moved), Energy{});
  }

  /// For a reading or force that is not finite the node applies no force until the next tick, after a stop none. The other side
  /// rejects reports that are not finite.
  Output fail_safe(const DeviceSample<N>& device) noexcept {
    modes_.release();
    safety_.release();
    command_ = Force<N>{};
    bridge_.stop();
    ramp_.drop();
    Output out{};
    out.report.x = device.x;
    out.report.v = device.v;
    out.report.energy_in_j = energy_sent_.si();
    out.report.epoch = epoch_;
    out.report.mode = out.mode = modes_.mode();
    return out;
  }

  ObserverRule observer_;
  [[no_unique_address]] JointMetric<N> metric_;
  MotorMask<N> motors_;
  NotDisplayed not_displayed_;
  [[no_unique_address]] LeaderInertia<N> inertia_;
  Registration<N> registration_;
  SafetyStage<N> safety_;
  Held<Half> half_;
  Alternatives<Held<Half>> alternatives_;
  Bridge<N> bridge_;
  Ramp ramp_;
  ModeMachine modes_;
  Ledger account_;  ///< the hand's port
  Energy energy_sent_, slave_energy_in_;
  Force<N> command_;
  std::uint32_t epoch_ = 0;
  PeerState<N> slave_;         ///< in this world
  bool awaits_slave_ = false;  ///< it has not switched yet
  PortMotion<N> before_;
  typename Velocity<N>::Vector ratio_ = Velocity<N>::Vector::Ones();  ///< of the last reading
  bool started_ = false;
  bool unread_ = false;   ///< the last reading was not finite
  Force<N> held_unread_;  ///< the force that was held then
};

template <int N, class Half>
MasterNode<N, Half>::MasterNode(const ControlOptions& o, std::span<const ScheduledControl> schedule)
    : observer_{o.observer},
      metric_{o},
      motors_{o},
      inertia_{o},
      registration_{o},
      safety_{limits_at_device(o), -1.0, o.handle_mass_kg, o.handle_inertia_kg_m2},
      half_{o},
      alternatives_{o, schedule},
      bridge_{o.engage},
      ramp_{o.engage},
      modes_{o} {}

template <int N, class Half>
auto MasterNode<N, Half>::step(const Tick<MasterClock>& tick, const DeviceSample<N>& reading,
                               const PeerState<N>& slave) noexcept -> Output {
  if (!all_finite(reading.x, reading.v, reading.applied)) [[unlikely]] {
    if (!unread_) held_unread_ = command_;
    unread_ = true;
    return fail_safe(reading);
  }
  const DeviceSample<N>& device = metric_.scaled(reading);
  PortMotion<N> motion{device.x, device.v};
  Interval<N> interval{};
  const bool paused = started_ && modes_.has_paused(tick);
  if (started_) {
    interval = motion - before_;
    Energy into = held_energy(observer_, device.applied, interval, tick.ended);
    if (paused) [[unlikely]]
      into = pause(into);
    if (unread_) [[unlikely]]
      into += given_unread(interval.moved);
    account_.book(into);
  }
  if (modes_.is_stopped(device.status, slave)) [[unlikely]] {
    before_ = motion;
    started_ = true;
    return fail_safe(reading);
  }
  const Duration now = tick.now.time_since_epoch();
  if (modes_.step(now, slave, modes_.has_let_go(now, device.held))) {
    ramp_.drop();
    half_->start(device);
  }
  const double ramp = ramp_.step(modes_.coupled(), tick.dt);
  const bool same_epoch = slave.epoch == epoch_;
  if (!same_epoch) [[unlikely]]
    awaits_slave_ = true;
  else if (awaits_slave_) [[unlikely]]
    slave_follows();
  arrive(slave, same_epoch);
  MasterOutput<N> half = half_->step({.dt = tick.dt,
                                      .ended = tick.ended,
                                      .device = device,
                                      .interval = interval,
                                      .first = !started_,
                                      .slave = slave_,
                                      .slave_energy_in = slave_energy_in_,
                                      .slave_energy_net = Energy{same_epoch ? slave_.newest.energy_net_j : 0.0},
                                      .account = account_,
                                      .active = modes_.active(),
                                      .paused = paused,
                                      .inertia = inertia_.at(reading.x),
                                      .ramp = ramp,
                                      .bridge = bridge_.over(modes_.active())});
  before_ = motion;
  ratio_ = device.ratio;
  started_ = true;
  energy_sent_ = half.energy_in;
  if (!all_finite(half.f)) [[unlikely]]
    return fail_safe(reading);
  command_ = safety_(motors_.all() ? half.f : motors_(half.f), device.x, device.v, tick.dt);
  if (!motors_.all()) [[unlikely]]
    display_by_motors(half.wanted);
  Force<N> f = metric_.joints(command_);
  return {.command = f,
          .report = {.x = reading.x,
                     .v = reading.v,
                     .f = f,
                     .energy_in_j = half.energy_in.si(),
                     .energy_net_j = half.energy_net.si(),
                     .mode = modes_.mode(),
                     .epoch = epoch_},
          .wanted = metric_.joints(half.wanted),
          .dissipated = half.dissipated,
          .undissipated = half.undissipated,
          .mode = modes_.mode(),
          .figures = half.figures};
}

template <int N, class Half>
void MasterNode<N, Half>::on_peer_restart(Energy slave_energy_in) noexcept {
  half_->restart(account_, std::min(half_->balance(account_, registration_.to_master(slave_energy_in)), Energy{}));
  energy_sent_ = Energy{};
  modes_.reset();
  ramp_.drop();
}

template <int N, class Half>
void MasterNode<N, Half>::switch_method(Held<Half>& next) noexcept {
  next->restart(account_, half_->balance(account_, slave_energy_in_));
  next->take_over(ratio_);
  next->start({.x = before_.x, .v = before_.v, .applied = command_});
  std::swap(half_, next);
  bridge_.begin(command_);
  ramp_.drop();
  energy_sent_ = Energy{};
  ++epoch_;
}

// The same for each number of axes, with halves that are chosen when they are made: compiled once, in master_node.cc.
TWOPORT_DECLARE(MasterNode);

}  // namespace twoport
