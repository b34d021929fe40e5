#pragma once

#include <concepts>

#include "common/base/time.h"
#include "common/coupling/options.h"
#include "common/coupling/registration.h"
#include "common/hardware/device.h"
#include "common/hardware/robot.h"
#include "common/link/mailbox.h"
#include "common/passivity/observer.h"

namespace twoport {

// A method defines how hand and robot are coupled over a link: a half at the master, a half at the slave, and the data
// between them. The nodes (master/master_node.h, slave/slave_node.h) implement what all methods share: modes, the force
// ramp, finite checks, force limits, the exact account of each port, and restarts of the other side.
//
// The step of a half is pure computation: no clock, no input or output, no allocation, no exception.

/// Input of a master half in one tick. Forces at the master port, power f·v into the network.
template <int N>
struct MasterInput {
  Seconds dt;     ///< of the coming interval
  Seconds ended;  ///< length of the interval that has just ended
  const DeviceSample<N>& device;
  const Interval<N>& interval;  ///< motion of the port since the last tick
  bool first;                   ///< there was no tick before: `interval` is empty
  const PeerState<N>& slave;    ///< in the slave's units
  Energy slave_energy_in;       ///< the slave's running total of this method, in its units
  const Ledger& account;        ///< energy into the master port, exact, since the start
  bool active;                  ///< coupled or holding; else the force is zero
  double ramp;                  ///< rises from 0 to 1 after engagement
};
template <int N>
struct MasterOutput {
  Force<N> f;           ///< to be displayed
  Force<N> wanted;      ///< before any passivity controller
  Energy energy_in;     ///< running total reported to the slave: energy that has entered the link here
  Energy dissipated;    ///< by a controller, in the coming interval
  Energy undissipated;  ///< deficit that the controller could not dissipate in this tick
};

/// One tick at the slave. Forces act on the robot; power f·v out of the link.
template <int N>
struct SlaveInput {
  Seconds dt;
  const RobotSample<N>& robot;
  const PeerState<N>& master;  ///< in the master's units
  Energy master_energy_in;     ///< the master's running total of this method, in its units
  const Ledger& account;       ///< energy into the link through the slave's port, until this tick
  bool coupled;                ///< the master's reports arrive and its motion is followed
  bool active;                 ///< coupled or holding
};
template <int N>
struct SlaveOutput {
  RobotCommand<N> command;
  Force<N> f_back;   ///< force returned to the master
  Energy energy_in;  ///< running total reported to the master
  Energy dissipated;
  Energy grounded{};  ///< part of f·v_d T that a grounded element at the robot takes, not the link: a damper's
};

/// State that a slave half passes to its successor.
template <int N>
struct SlaveHandover {
  Registration<N> registration;
  Position<N> set_point;
};

/// Result of a slave half whose force is not finite: its state is unchanged, and the node applies no force.
template <int N>
[[gnu::noinline]] SlaveOutput<N> no_force_exists(Force<N> f) noexcept {
  SlaveOutput<N> out{};
  out.command.f = f;
  return out;
}

/// What the half's command takes from the link was `wished`, and is `taken` within the limits: a total that is reported grows by no
/// more than what is taken.
template <int N>
void report_no_more(SlaveOutput<N>& out, Energy wished, Energy taken) noexcept {
  const Energy more = positive_part(taken) - positive_part(wished);
  if (more.si() < 0.0) out.energy_in += more;
}

/// The limits at the robot have changed the command of the half's last step from `asked` to out.command. The half sets its set point
/// back by that, so that it does not run ahead of the robot, and writes set point, velocity and energies of `out` as they are now.
/// Optional: void H::limited(SlaveOutput<N>& out, const RobotCommand<N>& asked, const RobotSample<N>& robot, Seconds dt).
template <class H, int N>
void tell_limited(H& half, SlaveOutput<N>& out, const RobotCommand<N>& asked, const RobotSample<N>& robot,
                  Seconds dt) noexcept {
  if constexpr (requires { half.limited(out, asked, robot, dt); }) {
    half.limited(out, asked, robot, dt);
  } else {
    const Energy wished = out.grounded - dot(asked.f, asked.v_d * dt);
    if (robot.ideal) out.command.v_d = asked.v_d + (out.command.x_d - asked.x_d) / dt;
    report_no_more(out, wished, out.grounded - dot(out.command.f, out.command.v_d * dt));
  }
}

// clang-format off
// (version 14 knows no concepts)

template <class H, int N>
concept MasterHalf = std::constructible_from<H, const ControlOptions&> &&
    requires(H h, const H& c, const MasterInput<N>& in, Words& words, const DeviceSample<N>& device, const Ledger& account, Energy e) {
  { h.start(device) } noexcept;                                    // a coupling begins here
  { h.step(in) } noexcept -> std::same_as<MasterOutput<N>>;        // every tick, active or not
  { c.deficit(account, e) } noexcept -> std::same_as<Energy>;       // energy returned beyond the available; e: the slave's total
  { h.restart(account, e) } noexcept;                              // all totals start here from zero, with the deficit e
  { c.has_payload() } noexcept -> std::same_as<bool>;              // does it add words to the report of the last step?
  { c.write_payload(words) } noexcept;                             // these words
};

template <class H, int N>
concept SlaveHalf = std::constructible_from<H, const ControlOptions&> &&
    requires(H h, const H& c, const SlaveInput<N>& in, Words& words, const RobotSample<N>& robot, const SlaveHandover<N>& handover, const Ledger& account, Energy e) {
  { h.start(robot, in.master) } noexcept;
  { h.step(in) } noexcept -> std::same_as<SlaveOutput<N>>;
  { h.fail_safe(account) } noexcept -> std::same_as<SlaveOutput<N>>;  // no force from now on; the last energy_in again
  { c.deficit(account, e) } noexcept -> std::same_as<Energy>;       // as at the master; e: the master's total
  { h.restart(account, e) } noexcept;
  { c.has_payload() } noexcept -> std::same_as<bool>;
  { c.write_payload(words) } noexcept;
  { c.handover() } noexcept -> std::same_as<SlaveHandover<N>>;
  { h.resume(handover) } noexcept;                                 // takes over during a coupling
  { c.target() } noexcept -> std::convertible_to<Position<N>>;     // commanded position of the robot
};

/// A method for every size. kSummary is a sentence for lists.
template <class M, int N>
concept MethodOf = MasterHalf<typename M::template Master<N>, N> && SlaveHalf<typename M::template Slave<N>, N>;

// clang-format on

}  // namespace twoport
