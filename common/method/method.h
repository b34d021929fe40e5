#pragma once

#include <algorithm>
#include <memory>
#include <type_traits>
#include <utility>

#include "common/base/time.h"
#include "common/coupling/bridge.h"
#include "common/coupling/layers.h"
#include "common/coupling/registration.h"
#include "common/hardware/device.h"
#include "common/hardware/robot.h"
#include "common/link/mailbox.h"
#include "common/passivity/observer.h"
#include "common/passivity/velocity_predictor.h"

namespace twoport {

// A method defines how hand and robot are coupled over a link: a half at the master, a half at the slave, and the data
// between them. Most methods are pairs of layers (layers.h); some are of one piece. The nodes (master/master_node.h, slave/slave_node.h) implement what all methods share: modes, the force
// ramp, finite checks, force limits, the exact account of each port, and restarts of the other side.
//
// The step of a half is pure computation: no clock, no input or output, no allocation, no exception.

/// Input of a master half in one tick. Forces at the master port, power f·v into the network.
template <int N>
struct MasterInput {
  Seconds dt;     ///< of the coming interval
  Seconds ended;  ///< length of the interval that has just ended
  const DeviceSample<N>& device;
  const Interval<N>& interval;    ///< motion of the port since the last tick
  bool first;                     ///< there was no tick before: `interval` is empty
  const PeerState<N>& slave;      ///< in the master's world, but for positions
  Energy slave_energy_in;         ///< the slave's running total of this method
  Energy slave_energy_net;        ///< the slave's newest SlaveOutput::energy_net
  const Ledger& account;          ///< energy into the master port, exact, since the start
  bool active;                    ///< coupled or holding; else the force is zero
  bool paused;                    ///< this side has stood still: what was displayed before is old
  const PortInertia<N>* inertia;  ///< of the port; null: what ControlOptions says of it
  double ramp;                    ///< rises from 0 to 1 after engagement
  Bridge<N>* bridge;              ///< from the force of the method before, after a switch; null: none

  /// Of the port, in the interval that has just ended; zero in the first tick.
  [[nodiscard]] Velocity<N> mean_velocity() const noexcept { return first ? Velocity<N>{} : interval.moved / ended; }
  /// The same tick of another device that has made another motion.
  [[nodiscard]] MasterInput of(const DeviceSample<N>& other, const Interval<N>& made) const noexcept {
    return {dt,      ended,  other,  made,    first, slave, slave_energy_in, slave_energy_net,
            account, active, paused, inertia, ramp,  bridge};
  }
};
template <int N>
struct MasterOutput {
  Force<N> f;              ///< to be displayed
  Force<N> wanted;         ///< before any passivity controller
  Energy energy_in;        ///< running total reported to the slave: energy that has entered the link here
  Energy energy_net{};     ///< E(0) and what has entered at the port, less energy_in
  Energy dissipated;       ///< by a controller, in the coming interval
  Energy undissipated;     ///< deficit that the controller could not dissipate in this tick
  LayerFigures figures{};  ///< Wish::figures
};

/// One tick at the slave. Forces act on the robot; power f·v out of the link.
template <int N>
struct SlaveInput {
  Seconds dt;
  const RobotSample<N>& robot;
  const PeerState<N>& master;     ///< in the slave's world
  const Position<N>& commanded;   ///< SlaveHalf::commanded, in the slave's world
  const Registration<N>& worlds;  ///< for the method's words, which are in the master's world
  Energy master_energy_in;        ///< the master's running total of this method
  Energy master_energy_net;       ///< the master's newest MasterOutput::energy_net
  const Ledger& account;          ///< energy into the link through the slave's port, until this tick
  bool coupled;                   ///< the master's reports arrive and its motion is followed
  bool active;                    ///< coupled or holding
  Bridge<N>* bridge;              ///< as MasterInput's
};
template <int N>
struct SlaveOutput {
  RobotCommand<N> command;
  Force<N> f_back;   ///< force returned to the master
  Energy energy_in;  ///< running total reported to the master
  Energy dissipated;
  Energy energy_net{};  ///< E(0) and what has entered at the port, less energy_in
  Energy grounded{};    ///< part of f·v_d T that a grounded element at the robot takes, not the link: a damper's
};

/// Result of a slave half whose force is not finite: its state is unchanged, and the node applies no force.
template <int N>
SlaveOutput<N> no_force_exists(Force<N> f) noexcept {
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

/// What is left of an account is what the next one begins with; of what was left beyond E(0) no more than the hand has put in.
[[nodiscard]] inline Energy handed_over(Energy balance, const Ledger& account) noexcept {
  return std::min(balance, positive_part(account.net()));
}
/// The same of an account of the hand's port alone: all that the hand has put in. What a method without control has created is not
/// charged: its balance is 0.
[[nodiscard]] inline Energy put_in_by_hand(Energy balance, const Ledger& account) noexcept {
  return std::max(account.net(), std::min(balance, Energy{}));
}

/// The bridge of a method of one piece at the master: it returns energy only as far as the hand's port has it at the present velocity,
/// E(0) + E.
template <int N>
void cross(MasterOutput<N>& out, const MasterInput<N>& in, Energy initial) noexcept {
  if (in.bridge == nullptr) [[likely]]
    return;
  Force<N> added = in.bridge->step(out.f, in.dt);
  const Energy left = initial + in.account.net() - positive_part(dot(-out.f, in.device.v) * in.dt);
  if (const Energy spent = dot(-added, in.device.v) * in.dt; spent > positive_part(left))
    added = (positive_part(left) / spent) * added;
  out.f += added;
  out.wanted += added;
}

/// A half at the master, as MasterNode runs it. The class is chosen when the half is made (make) or when the program is compiled.
template <int N>
class MasterHalf {
 public:
  virtual ~MasterHalf() = default;
  /// The half of the method that `o` names. Throws ConfigError where there is none.
  static std::unique_ptr<MasterHalf> make(const ControlOptions& o);
  [[nodiscard]] virtual std::unique_ptr<MasterHalf> copy() const = 0;
  /// A coupling begins here.
  virtual void start(const DeviceSample<N>& device) noexcept = 0;
  /// Every tick, active or not.
  virtual MasterOutput<N> step(const MasterInput<N>& in) noexcept = 0;
  /// What the account has besides E(0); below 0: the part of E(0) that is used, and what has been returned beyond. `slave_energy_in`: the
  /// slave's total.
  [[nodiscard]] virtual Energy balance(const Ledger& account, Energy slave_energy_in) const noexcept = 0;
  /// All totals start here from zero, with the balance of the account before.
  virtual void restart(const Ledger& account, Energy balance) noexcept = 0;
  /// It runs from now on in place of another half, and knows nothing of the handle's motion. `ratio`: DeviceSample::ratio of the interval
  /// that its next step ends.
  virtual void take_over(const typename Velocity<N>::Vector& ratio) noexcept { static_cast<void>(ratio); }
  /// Does it add words to the report of the last step? Which?
  [[nodiscard]] virtual bool has_payload() const noexcept { return false; }
  virtual void write_payload(Words&) const noexcept {}
};

/// A half at the slave, as SlaveNode runs it.
template <int N>
class SlaveHalf {
 public:
  virtual ~SlaveHalf() = default;
  static std::unique_ptr<SlaveHalf> make(const ControlOptions& o);
  [[nodiscard]] virtual std::unique_ptr<SlaveHalf> copy() const = 0;
  /// A coupling begins here; `engaged`: the master has been heard, and the worlds are registered.
  virtual void start(const RobotSample<N>& robot, bool engaged) noexcept = 0;
  /// Where the master wants the robot, in the master's world, by its position and the method's words.
  virtual Position<N> commanded(const PeerState<N>& master) noexcept { return master.newest.x; }
  virtual SlaveOutput<N> step(const SlaveInput<N>& in) noexcept = 0;
  /// No force from now on; the last energy_in again.
  virtual SlaveOutput<N> fail_safe(const Ledger& account) noexcept = 0;
  /// The limits at the robot have changed the command of the last step from `asked` to out.command. The half sets its set point back
  /// by that, so that it does not run ahead of the robot, and writes set point, velocity and energies of `out` as they are now.
  virtual void limited(SlaveOutput<N>& out, const RobotCommand<N>& asked, const RobotSample<N>& robot,
                       Seconds dt) noexcept = 0;
  [[nodiscard]] virtual Energy balance(const Ledger& account, Energy master_energy_in) const noexcept = 0;
  virtual void restart(const Ledger& account, Energy balance) noexcept = 0;
  [[nodiscard]] virtual Position<N> set_point() const noexcept = 0;
  /// Takes over during a coupling, from the set point of the half before.
  virtual void resume(const Position<N>& set_point) noexcept = 0;
  /// Commanded position of the robot.
  [[nodiscard]] virtual Position<N> target() const noexcept = 0;
  [[nodiscard]] virtual bool has_payload() const noexcept { return false; }
  /// In the master's world.
  virtual void write_payload(Words&, const Registration<N>& worlds) const noexcept { static_cast<void>(worlds); }
};

/// Implements copy() of Base for the class Self.
template <class Self, class Base>
class Copyable : public Base {
 public:
  using Base::Base;
  [[nodiscard]] auto copy() const -> decltype(std::declval<const Base&>().copy()) override {
    return std::make_unique<Self>(static_cast<const Self&>(*this));
  }
};

/// A member whose class is chosen when it is made (T abstract: T::make and copy()) or when the program is compiled. Allocates when made
/// and copied only.
template <class T>
class Held {
 public:
  explicit Held(const ControlOptions& o) : it_{T::make(o)} {}
  Held(const Held& other) : it_{other.it_->copy()} {}
  Held(Held&&) noexcept = default;
  Held& operator=(Held&&) noexcept = default;
  T* operator->() noexcept { return it_.get(); }
  const T* operator->() const noexcept { return it_.get(); }

 private:
  std::unique_ptr<T> it_;
};
// clang-format off
template <class T> requires (!std::is_abstract_v<T>)
class Held<T> {
  // clang-format on
 public:
  explicit Held(const ControlOptions& o) : it_{o} {}
  T* operator->() noexcept { return &it_; }
  const T* operator->() const noexcept { return &it_; }

 private:
  T it_;
};

/// A method chosen by name when the halves are made.
struct AnyMethod {
  template <int N>
  using Master = MasterHalf<N>;
  template <int N>
  using Slave = SlaveHalf<N>;
};

}  // namespace twoport
