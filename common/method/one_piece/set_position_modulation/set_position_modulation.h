#pragma once

#include <algorithm>
#include <cmath>

#include "common/method/coupling_slave.h"
#include "common/method/one_piece/set_position_modulation/gains.h"

namespace twoport {

/// One side of passive set-position modulation: a port of position x on a spring to the set position y. y follows a received
/// position as far as the energy of this side allows.
///
///     A    = E(0) + energy put in at the port + received - sent       P(y) = ½ (y - x)ᵀK(y - x)
///     y(k) = x + s (ȳ - x),   s = min(1, sqrt(A/P(ȳ)))                 so that P(y) <= A
///     sent += max(0, A - P(y) - ceiling)
///
/// The energy put in is exact, damper included; the paper bounds the damper's part from below.
/// Source: Lee, Huang, IEEE T-RO 26(2), 2010.
template <int N>
class SetPositionSpring {
 public:
  using Vector = typename Force<N>::Vector;
  /// `scale`: of the spring; at the master impedance_scale.
  explicit SetPositionSpring(const ControlOptions& o, const Vector& scale = Vector::Ones())
      : initial_{o.initial_energy} {
    const SetPositionGains g = set_position_gains(o);
    stiffness_ = scale.cwiseProduct(per_axis<N>(g.stiffness_n_per_m, g.rotational_stiffness_n_m_per_rad));
    damping_ = per_axis<N>(g.damping_n_s_per_m, g.rotational_damping_n_m_s_per_rad);
    ceiling_ = g.ceiling;
  }

  void start(const Position<N>& x) noexcept { y_ = x; }
  void put_in(Energy e) noexcept { put_in_ += e; }
  /// Moves the set position towards `wanted` as far as energy allows. Returns what the spring has gained by that.
  Energy follow(const Position<N>& wanted, const Position<N>& x, Energy received) noexcept {
    const Energy before = stored(x), available = level(received);
    const Displacement<N> stretch = wanted - x;
    const double needed = stored_at(stretch).si(), most = std::max(0.0, available.si());
    const double s = needed <= most ? 1.0 : std::sqrt(most / needed);
    unreached_ = Energy{(1.0 - s * s) * needed};
    y_ = x + Displacement<N>{s * stretch.vec()};
    const Energy after = stored(x);
    sent_ += positive_part(available - after - ceiling_);
    return after - before;
  }
  /// Of the port on the spring: K (x - y).
  [[nodiscard]] Force<N> spring(const Position<N>& x) const noexcept {
    return Force<N>{stiffness_.cwiseProduct((x - y_).vec())};
  }
  [[nodiscard]] const Vector& damping() const noexcept { return damping_; }
  [[nodiscard]] const Position<N>& set_position() const noexcept { return y_; }
  [[nodiscard]] Energy sent() const noexcept { return sent_; }
  /// A: what the spring may hold.
  [[nodiscard]] Energy level(Energy received) const noexcept { return initial_ + put_in_ + received - sent_; }
  [[nodiscard]] Energy balance(Energy received) const noexcept { return level(received) - initial_; }
  [[nodiscard]] Energy unreached() const noexcept { return unreached_; }
  void restart(Energy balance) noexcept { put_in_ = balance, sent_ = Energy{}; }

 private:
  [[nodiscard]] Energy stored_at(const Displacement<N>& stretch) const noexcept {
    return Energy{0.5 * stretch.vec().cwiseAbs2().dot(stiffness_)};
  }
  [[nodiscard]] Energy stored(const Position<N>& x) const noexcept { return stored_at(y_ - x); }

  Vector stiffness_, damping_;
  Energy initial_, ceiling_, put_in_, sent_, unreached_;
  Position<N> y_;
};

/// Master half: f_m = ρ (K (x_m - y_m) + B v_m); y_m follows the robot's position.
template <int N>
class SetPositionMaster final : public Copyable<SetPositionMaster<N>, MasterHalf<N>> {
 public:
  explicit SetPositionMaster(const ControlOptions& o)
      : tracker_{o.coupling}, side_{o, impedance_scale<N>(o)}, initial_{o.initial_energy} {}

  void start(const DeviceSample<N>& device) noexcept override {
    side_.start(device.x);
    robot_ = device.x;
    hears_ = false;
  }
  MasterOutput<N> step(const MasterInput<N>& in) noexcept override {
    side_.put_in(in.account.net() - net_before_);
    net_before_ = in.account.net();
    MasterOutput<N> out{};
    const Energy received = in.slave_energy_in;
    RobotInMasterWorld<N> robot;
    if (!in.active) {
      side_.start(in.device.x);
    } else if (read(in.slave.words, robot)) {
      const Velocity<N> v_rx = in.slave.newest.v;
      if (!hears_) robot_ = robot.x.value;
      hears_ = true;
      robot_ = robot_ + tracker_.step(robot_, robot.x.value, v_rx, in.slave.is_new, in.dt) * in.dt;
      side_.follow(robot_, in.device.x, received);
      out.wanted = in.ramp * side_.spring(in.device.x);
      out.f = out.wanted + Force<N>{in.ramp * side_.damping().cwiseProduct(in.device.v.vec())};
      out.undissipated = positive_part(-side_.level(received));
    }
    cross(out, in, initial_);
    out.energy_in = side_.sent();
    return out;
  }
  [[nodiscard]] Energy balance(const Ledger&, Energy slave_in) const noexcept override {
    return side_.balance(slave_in);
  }
  void restart(const Ledger& account, Energy balance) noexcept override {
    net_before_ = account.net();
    side_.restart(handed_over(balance, account));
  }

 private:
  SetpointTracker<N> tracker_;
  SetPositionSpring<N> side_;
  Energy initial_, net_before_;
  Position<N> robot_;  ///< as last heard, in the master's world
  bool hears_ = false;
};

/// Slave half: f_s = K (y_s - x_s) - B v_s; y_s follows the master's position.
template <int N>
class SetPositionSlave final : public Copyable<SetPositionSlave<N>, StoringSlave<N, SetPositionSpring<N>>> {
  using Storing = StoringSlave<N, SetPositionSpring<N>>;
  using Base = Copyable<SetPositionSlave<N>, Storing>;

 public:
  explicit SetPositionSlave(const ControlOptions& o) : Base{coupled_by_position(o, o.coupling), o} {}

  void start(const RobotSample<N>& robot, bool engaged) noexcept override {
    Storing::start(robot, engaged);
    this->side_.start(robot.x);
  }
  SlaveOutput<N> step(const SlaveInput<N>& in) noexcept override {
    auto& side = this->side_;
    this->book(in.robot);
    const auto wanted = this->want(in);
    auto& coupling = this->coupling_;
    SlaveOutput<N> out;
    if (in.robot.ideal || !in.active) {
      side.start(in.robot.x);
      this->f_ = Force<N>{};
      if (this->act(in, wanted.f, wanted.v, wanted.v, out)) out.energy_in = side.sent();
      return out;
    }
    const Energy gained = side.follow(coupling.set_point() + wanted.v * in.dt, in.robot.x, in.master_energy_in);
    const Force<N> spring = -side.spring(in.robot.x), damper = this->damper(in, side.damping());
    if (!this->act(in, spring + damper, wanted.v, wanted.v, out)) return out;
    out.command.x_d = side.set_position();
    // What the link does at the set position is the spring's gain; the damper's work does not come from there.
    out.grounded = dot(out.command.f, out.command.v_d * in.dt) - gained;
    out.energy_in = side.sent();
    this->f_ = out.command.f;
    return out;
  }
  void limited(SlaveOutput<N>& out, const RobotCommand<N>& asked, const RobotSample<N>& robot,
               Seconds dt) noexcept override {
    if (robot.ideal) return this->set_back(out, asked, robot, dt);
    const Energy gained = dot(asked.f, asked.v_d * dt) - out.grounded;
    this->coupling_.limited(out.command, asked, robot, dt);
    out.grounded = dot(out.command.f, out.command.v_d * dt) - gained;
    this->f_ = out.command.f;
  }
  void resume(const Position<N>& set_point) noexcept override {
    Storing::resume(set_point);
    this->side_.start(set_point);
  }
};

}  // namespace twoport
