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

// A method is what differs between ways to couple hand and robot over a link: a half at the master, a half at the slave, and
// what they say to each other. Modes, the force ramp, finite checks, limits of force, the exact account of each port and the
// restart of the other side are the nodes' (master/master_node.h, slave/slave_node.h) and the same for every method.
//
// A half is a step from values to values: no clock, no input or output, no allocation, no exception.

/// One tick at the master, as its half sees it. Forces at the master port, power f·v into the network.
template <int N>
struct MasterInput {
  Seconds dt;     ///< of the coming interval
  Seconds ended;  ///< how long the interval was that has just ended
  const DeviceSample<N>& device;
  const Interval<N>& interval;  ///< what the port did since the last tick
  bool first;                   ///< there was no tick before: `interval` is empty
  const PeerState<N>& slave;    ///< in the slave's units
  Energy slave_energy_in;       ///< the slave's running total of this method, in its units
  const Ledger& account;        ///< energy into the master port, exact, since the start
  bool active;                  ///< coupled or holding; else no force is asked for
  double ramp;                  ///< rises from 0 to 1 after engagement
  const Force<N>* carried;      ///< what is left of the force before a switch of methods; null: nothing
};
template <int N>
struct MasterOutput {
  Force<N> f;           ///< to be displayed
  Force<N> wanted;      ///< before any passivity controller
  Energy energy_in;     ///< running total that the slave is told: what has entered the link here
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
  bool coupled;                ///< the master is heard: its motion is followed
  bool active;                 ///< coupled or holding
};
template <int N>
struct SlaveOutput {
  RobotCommand<N> command;
  Force<N> f_back;   ///< what goes back to the master
  Energy energy_in;  ///< running total that the master is told
  Energy dissipated;
};

/// What a slave half leaves to the one that takes over.
template <int N>
struct SlaveHandover {
  Registration<N> registration;
  Position<N> set_point;
};

/// Of a slave half whose force no double holds: it has changed nothing of its state, and the node lets go.
template <int N>
[[gnu::noinline]] SlaveOutput<N> no_force_exists(Force<N> f) noexcept {
  SlaveOutput<N> out{};
  out.command.f = f;
  return out;
}

// clang-format off
// (version 14 knows no concepts)

template <class H, int N>
concept MasterHalf = std::constructible_from<H, const ControlOptions&> &&
    requires(H h, const H& c, const MasterInput<N>& in, Words& words, const DeviceSample<N>& device, const Ledger& account, Energy e) {
  { h.start(device) } noexcept;                                    // a coupling begins here
  { h.step(in) } noexcept -> std::same_as<MasterOutput<N>>;        // every tick, active or not
  { c.deficit(account, e) } noexcept -> std::same_as<Energy>;       // what the hand has got beyond its grant; e: the slave's total
  { h.restart(account, e) } noexcept;                              // all totals start here from zero, with the deficit e
  { c.has_payload() } noexcept -> std::same_as<bool>;              // does it add anything to the report of the last step?
  { c.write_payload(words) } noexcept;                             // then what
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
  { h.resume(handover) } noexcept;                                 // takes over while a coupling goes on
  { c.target() } noexcept -> std::convertible_to<Position<N>>;     // where the robot should be now
};

/// A method for every size. kSummary is a sentence for lists.
template <class M, int N>
concept MethodOf = MasterHalf<typename M::template Master<N>, N> && SlaveHalf<typename M::template Slave<N>, N>;

// clang-format on

}  // namespace twoport
