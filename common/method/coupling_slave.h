#pragma once

#include "common/coupling/virtual_coupling.h"
#include "common/method/coupled_by_position.h"
#include "common/method/method.h"

namespace twoport {

/// What slave halves of one piece around a virtual coupling share: everything but the step.
template <int N>
class CouplingSlave : public SlaveHalf<N> {
 public:
  explicit CouplingSlave(const ControlOptions& o) : coupling_{o} {}

  void start(const RobotSample<N>& robot, bool engaged) noexcept override {
    coupling_.start(robot.x, engaged);
    x_ = robot.x;
  }
  SlaveOutput<N> fail_safe(const Ledger& account) noexcept override {
    SlaveOutput<N> out{};
    out.command.x_d = coupling_.set_point();
    out.energy_in = account.absorbed() - base_absorbed_;
    return out;
  }
  void limited(SlaveOutput<N>& out, const RobotCommand<N>& asked, const RobotSample<N>& robot,
               Seconds dt) noexcept override {
    const Energy wished = out.grounded - dot(asked.f, asked.v_d * dt);
    set_back(out, asked, robot, dt);
    report_no_more(out, wished, out.grounded - dot(out.command.f, out.command.v_d * dt));
  }
  [[nodiscard]] Energy balance(const Ledger&, Energy) const noexcept override { return Energy{}; }
  void restart(const Ledger& account, Energy) noexcept override { base_absorbed_ = account.absorbed(); }
  [[nodiscard]] Position<N> set_point() const noexcept override { return coupling_.set_point(); }
  void resume(const Position<N>& set_point) noexcept override { coupling_.resume(set_point); }
  [[nodiscard]] Position<N> target() const noexcept override { return coupling_.target(); }
  [[nodiscard]] bool has_payload() const noexcept override { return coupling_.tells_position(); }
  void write_payload(Words& words, const Registration<N>& worlds) const noexcept override {
    coupling_.tell_position(x_, worlds, words);
  }

 protected:
  using Vector = typename Force<N>::Vector;

  void set_back(SlaveOutput<N>& out, const RobotCommand<N>& asked, const RobotSample<N>& robot, Seconds dt) noexcept {
    coupling_.limited(out.command, asked, robot, dt);
    out.command.x_d = coupling_.set_point();
  }
  /// Force and velocity of the coupling, zero while nothing is coupled.
  typename VirtualCoupling<N>::Wanted want(const SlaveInput<N>& in) noexcept {
    x_ = in.robot.x;
    if (in.active)
      return coupling_.step(in.robot, in.commanded, in.master.newest.v, in.master.is_new, in.coupled, in.dt);
    coupling_.rest(in.robot.x);
    return {};
  }
  /// The set point moves by v T, and f acts on the robot. False, and nothing changes, where they are not finite.
  bool act(const SlaveInput<N>& in, Force<N> f, const Velocity<N>& v, const Velocity<N>& v_d,
           SlaveOutput<N>& out) noexcept {
    out = no_force_exists(f);
    if (!all_finite(f, v)) [[unlikely]]
      return false;
    if (in.bridge != nullptr) [[unlikely]]
      f += in.bridge->step(f, in.dt);
    const Displacement<N> moved = v * in.dt;
    Ledger account = in.account;
    account.book(-dot(f, moved));
    coupling_.move(moved, v_d, in.dt);
    out.command = {.f = f, .x_d = coupling_.set_point(), .v_d = v};
    out.f_back = f;
    out.energy_in = account.absorbed() - base_absorbed_;
    return true;
  }
  /// -B v of the robot, zero for an ideal one and while nothing is coupled.
  static Force<N> damper(const SlaveInput<N>& in, const Vector& damping) noexcept {
    if (!in.active || in.robot.ideal) return {};
    return Force<N>{-damping.cwiseProduct(in.robot.v.vec())};
  }

  VirtualCoupling<N> coupling_;
  Energy base_absorbed_;
  Position<N> x_;  ///< of the robot
};

/// A coupling slave with a store of energy, `side_`, that books what the robot's port puts in, exactly. Side: put_in, sent, deficit,
/// restart.
template <int N, class Side>
class StoringSlave : public CouplingSlave<N> {
 public:
  StoringSlave(const ControlOptions& coupled, const ControlOptions& o) : CouplingSlave<N>{coupled}, side_{o} {}

  void start(const RobotSample<N>& robot, bool engaged) noexcept override {
    CouplingSlave<N>::start(robot, engaged);
    f_ = Force<N>{};
  }
  SlaveOutput<N> fail_safe(const Ledger& account) noexcept override {
    f_ = Force<N>{};
    SlaveOutput<N> out = CouplingSlave<N>::fail_safe(account);
    out.energy_in = side_.sent();
    return out;
  }
  [[nodiscard]] Energy balance(const Ledger&, Energy master_in) const noexcept override {
    return side_.balance(master_in);
  }
  void restart(const Ledger& account, Energy balance) noexcept override {
    CouplingSlave<N>::restart(account, balance);
    side_.restart(balance);
  }

 protected:
  /// Books the interval that has ended; before want().
  void book(const RobotSample<N>& robot) noexcept { side_.put_in(-dot(f_, robot.x - this->x_)); }

  Side side_;
  Force<N> f_;  ///< on the robot in the last tick
};

}  // namespace twoport
