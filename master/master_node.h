#pragma once

#include <algorithm>
#include <optional>

#include "common/base/time.h"
#include "common/coupling/options.h"
#include "common/coupling/ramp.h"
#include "common/coupling/scaling.h"
#include "common/coupling/spring_damper.h"
#include "common/coupling/tracker.h"
#include "common/hardware/device.h"
#include "common/link/mailbox.h"
#include "common/passivity/controller.h"
#include "common/passivity/handle.h"
#include "common/passivity/observer.h"
#include "common/runtime/modes.h"

namespace twoport {

/// The master half of a delayed two-port: impedance causality, velocity in, force out.
///
///     dE(k)  = f_applied(k-1)·Δx(k)                      exact energy of the held force
///     E_in  += max(dE, 0),   E_out += max(-dE, 0)
///     f      = s_f f_rx                                  or the master's own spring-damper (position-position)
///     f'     = passivate(f, E(0) + min(E_in,slave, E_in) - E_out)     foreseeing how the handle gives way, or by f·v
///
/// The hand never gets back more than the slave says has entered the link there, nor more than it has put in, plus E(0).
/// When the sensor's force comes back, the hand does not feel what moves the robot and cannot pay for it. The motion
/// command then is a source of its own (Artigas, Ryu, Preusche, Hirzinger, IROS 2011): it carries the energy that the hand
/// would put in were the coupling force displayed, E_in of f_coupling,rx(k-1)·Δx(k).
/// Source: Ryu, Artigas, Preusche, Mechatronics 20(7), 2010; the correction is the projected one where chosen.
template <int N>
class MasterNode {
 public:
  struct Output {
    Force<N> command;  ///< at the master port, power f·v into the network
    Report<N> report;
    Force<N> wanted;  ///< before the passivity controller
    Energy dissipated, owed;
    Mode mode;
  };

  explicit MasterNode(const ControlOptions& o)
      : options_{o},
        scaling_{o},
        coupling_{o.coupling},
        tracker_{o.coupling},
        ramp_{o.engage},
        handle_{handle(o)},
        hold_after_{to_duration(o.hold_after.si())},
        release_after_{to_duration(o.release_after.si())} {}

  [[gnu::always_inline]] Output step(const Tick<MasterClock>& tick, const DeviceState<N>& device,
                                     const Known<N>& slave) noexcept {
    if (!all_finite(device.x, device.v, device.applied)) [[unlikely]]
      return let_go(device);
    observe(tick, device, slave);

    const Duration silence = tick.now.time_since_epoch() - slave.heard;
    const Mode was = mode_;
    mode_ = next_mode(mode_, {.heard = slave.any && silence < hold_after_, .silent = silence >= release_after_});
    if (begins(was, mode_)) engage(device);

    const double ramp = ramp_.step(mode_ == Mode::coupled, tick.dt);
    Corrected<Force<N>> out{};
    Force<N> wanted;
    if (mode_ == Mode::coupled || mode_ == Mode::holding) {
      wanted = ramp * reflected(device, slave, tick.dt);
      const Energy available = options_.initial_energy + granted(Energy{slave.energy_in_j}) - returned();
      out = handle_ ? passivate_yielding(wanted, handle_->foreseen(), available, options_.controller, tick.dt)
                    : passivate(wanted, device.v, Budget{available, Energy{}}, options_.controller, tick.dt);
    }
    if (!all_finite(out.out)) [[unlikely]]
      return let_go(device);
    return {.command = out.out,
            .report = {.x = device.x, .v = device.v, .f = out.out, .energy_in_j = offered().si(), .mode = mode_},
            .wanted = wanted,
            .dissipated = out.dissipated,
            .owed = out.owed,
            .mode = mode_};
  }

  /// The other side has started anew and its totals with it: this side's start again too. Unused credit is dropped; a
  /// debt, and what of E(0) is spent, is carried over.
  void rebase(Energy slave_energy_in) noexcept {
    const Energy balance = granted(slave_energy_in) - returned();
    base_absorbed_ = ledger_.absorbed();
    base_offered_ = command_.absorbed();
    base_returned_ = ledger_.returned() - positive_part(-balance);
    mode_ = Mode::idle;
    ramp_.drop();
  }

  [[nodiscard]] Mode mode() const noexcept { return mode_; }
  /// What the observer believes the hand has put in, E(0) not included [J].
  [[nodiscard]] Energy observed() const noexcept { return ledger_.net(); }

 private:
  [[nodiscard]] bool measured() const noexcept {
    return options_.architecture == Architecture::position_measured_force;
  }
  [[nodiscard]] Energy offered() const noexcept {
    return measured() ? command_.absorbed() - base_offered_ : absorbed();
  }
  [[nodiscard]] Energy granted(Energy slave_in) const noexcept {
    return Energy{std::min(scaling_.to_master(slave_in).si(), absorbed().si())};
  }
  [[nodiscard]] Energy absorbed() const noexcept { return ledger_.absorbed() - base_absorbed_; }
  [[nodiscard]] Energy returned() const noexcept { return ledger_.returned() - base_returned_; }

  /// A reading that is not finite is none, nor is a force that no double holds: the handle is under no force of ours until
  /// the next tick. The other side takes no report that is not finite.
  [[gnu::always_inline]] Output let_go(const DeviceState<N>& device) noexcept {
    mode_ = Mode::released;
    Output out{};
    out.report = {.x = device.x, .v = device.v, .energy_in_j = offered().si(), .mode = mode_};
    out.mode = mode_;
    return out;
  }

  /// Books what has happened since the last tick.
  [[gnu::always_inline]] void observe(const Tick<MasterClock>& tick, const DeviceState<N>& device,
                                      const Known<N>& slave) noexcept {
    const PortMotion<N> motion{device.x, device.v};
    if (started_) {
      Interval<N> interval = motion - before_;
      ledger_.book(held_energy(options_.observer, device.applied, interval, tick.ended));
      if (measured()) command_.book(held_energy(options_.observer, moving_, interval, tick.ended));
      if (handle_) handle_->step(interval.moved, device.applied, tick.ended, tick.dt);
    }
    if (measured()) moving_ = scaling_.to_master(slave.newest.f_coupling);
    before_ = motion;
    started_ = true;
  }

  /// Nothing where the scene names no mass for the handle: its answer to a force is not known then.
  static std::optional<Handle<N>> handle(const ControlOptions& o) {
    const bool known = o.handle_mass_kg > 0.0 && (N != 6 || o.handle_inertia_kg_m2 > 0.0);
    if (o.controller.method != Method::force_projected || !o.controller.predict || !known) return {};
    return Handle<N>{o.handle_mass_kg, o.handle_inertia_kg_m2};
  }

  void engage(const DeviceState<N>& device) noexcept {
    ramp_.drop();
    x_d_ = device.x;
  }

  [[gnu::always_inline]] Force<N> reflected(const DeviceState<N>& device, const Known<N>& slave, Seconds dt) noexcept {
    if (options_.architecture == Architecture::position_position) return pulled(device, slave, dt);
    return scaling_.to_master(slave.newest.f);
  }
  // By value: the caller keeps what it sensed in registers.
  [[gnu::noinline]] Force<N> pulled(DeviceState<N> device, const Known<N>& slave, Seconds dt) noexcept {
    const Velocity<N> v_rx = scaling_.to_master(slave.newest.v);
    const Velocity<N> v_d = tracker_.step(x_d_, scaling_.to_master(slave.newest.x), v_rx, slave.fresh, dt);
    x_d_ = x_d_ + v_d * dt;
    return coupling_.force(device.x - x_d_, device.v - v_rx);
  }

  ControlOptions options_;
  Scaling<N> scaling_;
  SpringDamper<N> coupling_;
  Tracker<N> tracker_;
  Ramp ramp_;
  std::optional<Handle<N>> handle_;
  Ledger ledger_;   ///< the hand's port
  Ledger command_;  ///< the motion command as a source of its own
  Energy base_absorbed_, base_returned_, base_offered_;
  Force<N> moving_;
  PortMotion<N> before_;
  Position<N> x_d_;
  Duration hold_after_, release_after_;
  Mode mode_ = Mode::idle;
  bool started_ = false;
};

}  // namespace twoport
