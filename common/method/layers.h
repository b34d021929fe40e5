#pragma once

#include <algorithm>
#include <memory>
#include <optional>

#include "common/coupling/motor_mask.h"
#include "common/coupling/virtual_coupling.h"
#include "common/method/method.h"

namespace twoport {

// The two layers of a half (common/coupling/layers.h lists them). In each tick
//
//     wish      = transparency.wish(in)            knows nothing of energy
//     shown     = passivity.limit(wish, in)        knows nothing of what the force means
//     transparency.shown(...)                      what was displayed of it
//
// A layer is a folder; it may take the slave's half of another.

// ---- master

/// What the hand should feel in the coming interval. Forces at the master port, power f·v into the network.
template <int N>
struct Wish {
  bool idle = true;     ///< nothing is displayed
  Force<N> f{};         ///< before any passivity control
  Force<N> damper{};    ///< to be displayed besides f: a force b v
  bool damped = false;  ///< there is a damper
  std::optional<Energy>
      stored{};  ///< energy of the model behind f, which f may return; absent: that of a spring, f²/2K

  LayerFigures figures{};       ///< of those of kLayerFigures that the layer declares
  bool bridged = false;         ///< f has a part of the force before a switch
  Bridge<N>* bridge = nullptr;  ///< to be crossed by the layer (MasterPassivity::crosses_bridge)

  [[nodiscard]] Force<N> total() const noexcept { return damped ? f + damper : f; }
};

/// What the passivity layer displays of a wish.
template <int N>
struct Shown {
  Force<N> f{};
  double share = 1.0;     ///< of Wish::f that is in f
  Energy energy_in{};     ///< running total reported to the slave
  Energy energy_net{};    ///< MasterOutput::energy_net
  Energy dissipated{};    ///< in the coming interval
  Energy undissipated{};  ///< deficit that is left in this tick
};

/// Share of `wanted` in `f`, in [0, 1], along `wanted`.
template <int N>
[[nodiscard]] double share_of(const Force<N>& f, const Force<N>& wanted) noexcept {
  const double all = wanted.squared_norm();
  return all > 0.0 ? std::clamp(f.vec().dot(wanted.vec()) / all, 0.0, 1.0) : 1.0;
}

/// Part in [0, 1] of a commanded force that the device has applied, by its translation; 1 below 0.1 N.
template <int N>
[[nodiscard]] double applied_part(const Force<N>& applied, const Force<N>& commanded) noexcept {
  constexpr double kCommanded_n = 0.1;
  const double all = commanded.vec().template head<kAxes<N>>().norm();
  return all > kCommanded_n ? std::min(1.0, applied.vec().template head<kAxes<N>>().norm() / all) : 1.0;
}

template <int N>
class MasterTransparency {
 public:
  virtual ~MasterTransparency() = default;
  static std::unique_ptr<MasterTransparency> make(const ControlOptions& o);
  [[nodiscard]] virtual std::unique_ptr<MasterTransparency> copy() const = 0;
  virtual void start(const DeviceSample<N>& device) noexcept = 0;
  virtual Wish<N> wish(const MasterInput<N>& in) noexcept = 0;
  /// Of the last wish: the force commanded and the share of Wish::f in it.
  virtual void shown(const Force<N>& f, double share, const MasterInput<N>& in) noexcept {
    static_cast<void>(f), static_cast<void>(share), static_cast<void>(in);
  }
  /// The last wish was not finite: nothing is displayed in this tick.
  virtual void failed(const MasterInput<N>& in) noexcept { shown(Force<N>{}, 0.0, in); }
  [[nodiscard]] virtual bool has_payload() const noexcept { return false; }
  virtual void write_payload(Words&) const noexcept {}
};

template <int N>
class MasterPassivity {
 public:
  virtual ~MasterPassivity() = default;
  static std::unique_ptr<MasterPassivity> make(const ControlOptions& o);
  [[nodiscard]] virtual std::unique_ptr<MasterPassivity> copy() const = 0;
  /// Books the interval that has ended, and limits the wish for the coming one.
  virtual Shown<N> limit(const Wish<N>& wish, const MasterInput<N>& in) noexcept = 0;
  /// After a switch, is the bridge to be crossed beside the wish, as the layer has less for the wish than the hand's port has? Else it is a
  /// part of the wish.
  [[nodiscard]] virtual bool crosses_bridge() const noexcept { return false; }
  [[nodiscard]] virtual Energy balance(const Ledger& account, Energy slave_energy_in) const noexcept = 0;
  virtual void restart(const Ledger& account, Energy balance) noexcept = 0;
  /// As MasterHalf's.
  virtual void take_over(const typename Velocity<N>::Vector& ratio) noexcept { static_cast<void>(ratio); }
};

/// The master half of a pair. A wish that is not finite is not displayed, and the node releases the port.
template <int N, class Transparency = MasterTransparency<N>, class Passivity = MasterPassivity<N>>
class MasterPair final : public Copyable<MasterPair<N, Transparency, Passivity>, MasterHalf<N>> {
 public:
  explicit MasterPair(const ControlOptions& o) : motors_{o}, transparency_{o}, passivity_{o} {}

  void start(const DeviceSample<N>& device) noexcept override { transparency_->start(device); }
  MasterOutput<N> step(const MasterInput<N>& in) noexcept override {
    Wish<N> wish = transparency_->wish(in);
    if (!all_finite(wish.f, wish.damper)) [[unlikely]]
      return not_finite(wish, in);
    Force<N> without_motor{};
    if (!motors_.all()) [[unlikely]]
      without_motor = leave_out(wish);
    if (in.bridge != nullptr) [[unlikely]]
      cross(wish, in);
    Shown<N> shown = motors_.all() ? passivity_->limit(wish, in) : limit_by_motors(wish, in);
    transparency_->shown(shown.f, shown.share, in);
    if (wish.bridge != nullptr) [[unlikely]]
      wish.f += wish.bridge->added();
    if (!motors_.all()) [[unlikely]]
      wish.f += without_motor;
    return {.f = shown.f,
            .wanted = wish.f,
            .energy_in = shown.energy_in,
            .energy_net = shown.energy_net,
            .dissipated = shown.dissipated,
            .undissipated = shown.undissipated,
            .figures = wish.figures};
  }
  [[nodiscard]] Energy balance(const Ledger& account, Energy e) const noexcept override {
    return passivity_->balance(account, e);
  }
  void restart(const Ledger& account, Energy e) noexcept override { passivity_->restart(account, e); }
  void take_over(const typename Velocity<N>::Vector& ratio) noexcept override { passivity_->take_over(ratio); }
  [[nodiscard]] bool has_payload() const noexcept override { return transparency_->has_payload(); }
  void write_payload(Words& words) const noexcept override { transparency_->write_payload(words); }

 private:
  /// Takes from the wish what no motor can display, and returns it.
  Force<N> leave_out(Wish<N>& wish) const noexcept {
    const Force<N> all = wish.f;
    wish.f = motors_(wish.f);
    wish.damper = motors_(wish.damper);
    return all - wish.f;
  }
  /// The passivity layer sees a device of the axes with motors.
  Shown<N> limit_by_motors(const Wish<N>& wish, const MasterInput<N>& in) noexcept {
    DeviceSample<N> device = in.device;
    device.v = motors_(device.v);
    Interval<N> interval = in.interval;
    interval.moved = motors_(interval.moved);
    Shown<N> shown = passivity_->limit(wish, in.of(device, interval));
    shown.f = motors_(shown.f);
    return shown;
  }
  void cross(Wish<N>& wish, const MasterInput<N>& in) noexcept {
    wish.bridge = in.bridge;
    if (passivity_->crosses_bridge()) return;
    wish.f += wish.bridge->step(wish.total(), in.dt);
    wish.bridge = nullptr;
    wish.idle = false;
    wish.bridged = true;
  }
  MasterOutput<N> not_finite(const Wish<N>& wish, const MasterInput<N>& in) noexcept {
    Shown<N> shown = passivity_->limit(Wish<N>{}, in);
    transparency_->failed(in);
    MasterOutput<N> out{};
    out.f = wish.f + wish.damper;
    out.energy_in = shown.energy_in;
    out.undissipated = shown.undissipated;
    return out;
  }

  [[no_unique_address]] MotorMask<N> motors_;
  Held<Transparency> transparency_;
  Held<Passivity> passivity_;
};

// ---- slave

/// What the robot should do in the coming interval: a coupling between a set point and the robot.
template <int N>
struct RobotWish {
  Force<N> f{};                      ///< of the coupling, on the robot
  Velocity<N> v{};                   ///< of the set point
  Force<N> damper{};                 ///< on the robot, besides f
  bool damped = false;               ///< there is a damper
  bool grounded = false;             ///< its energy is not of the link
  std::optional<Force<N>> f_back{};  ///< returned to the master; absent: as the passivity layer has it
};

/// What the passivity layer allows of it.
template <int N>
struct RobotPort {
  Force<N> f{};
  Velocity<N> v{};
  Energy dissipated{};
  bool returns_wanted = false;  ///< the master is told the wanted force, not the allowed one
  double damper_share = 1.0;    ///< of the damper that is displayed
};

/// The transparency layer at the slave. It owns the virtual coupling; the pair moves its set point.
template <int N>
class SlaveTransparency {
 public:
  explicit SlaveTransparency(const ControlOptions& o) : coupling_{o} {}
  virtual ~SlaveTransparency() = default;
  static std::unique_ptr<SlaveTransparency> make(const ControlOptions& o);
  [[nodiscard]] virtual std::unique_ptr<SlaveTransparency> copy() const = 0;
  virtual void start(const RobotSample<N>& robot, bool engaged) noexcept {
    coupling_.start(robot.x, engaged);
    x_ = robot.x;
  }
  /// SlaveHalf::commanded.
  virtual Position<N> commanded(const PeerState<N>& master) noexcept { return master.newest.x; }
  virtual RobotWish<N> wish(const SlaveInput<N>& in) noexcept = 0;
  /// The set point has moved; `f` acts on the robot.
  virtual void acted(const Force<N>& f) noexcept { static_cast<void>(f); }
  virtual void resume(const Position<N>& set_point) noexcept { coupling_.resume(set_point); }
  [[nodiscard]] virtual Position<N> target() const noexcept { return coupling_.target(); }
  [[nodiscard]] virtual bool has_payload() const noexcept { return coupling_.tells_position(); }
  /// In the master's world.
  virtual void write_payload(Words& words, const Registration<N>& worlds) const noexcept {
    coupling_.tell_position(x_, worlds, words);
  }
  [[nodiscard]] VirtualCoupling<N>& coupling() noexcept { return coupling_; }
  [[nodiscard]] const VirtualCoupling<N>& coupling() const noexcept { return coupling_; }

 protected:
  /// Force and velocity of the coupling, zero while nothing is coupled.
  typename VirtualCoupling<N>::Wanted want(const SlaveInput<N>& in) noexcept {
    x_ = in.robot.x;
    if (in.active)
      return coupling_.step(in.robot, in.commanded, in.master.newest.v, in.master.is_new, in.coupled, in.dt);
    coupling_.rest(in.robot.x);
    return {};
  }

  VirtualCoupling<N> coupling_;
  Position<N> x_;  ///< of the robot
};

/// The passivity layer at the slave. As it stands here it allows everything and reports what the link has taken in.
template <int N>
class SlavePassivity {
 public:
  virtual ~SlavePassivity() = default;
  static std::unique_ptr<SlavePassivity> make(const ControlOptions& o);
  [[nodiscard]] virtual std::unique_ptr<SlavePassivity> copy() const = 0;
  virtual void start(const RobotSample<N>& robot) noexcept { static_cast<void>(robot); }
  /// Books the interval that has ended, and limits the wish for the coming one.
  virtual RobotPort<N> limit(const RobotWish<N>& wish, VirtualCoupling<N>& coupling, const SlaveInput<N>& in) noexcept {
    static_cast<void>(coupling), static_cast<void>(in);
    return {wish.f, wish.v, Energy{}};
  }
  /// `out` is commanded, f of it without the damper; `account`: of the link's port, the coming interval included. Writes energy_in.
  virtual void acted(SlaveOutput<N>& out, const Force<N>& f, const Ledger& account, const SlaveInput<N>& in) noexcept {
    static_cast<void>(f), static_cast<void>(in);
    out.energy_in = reported(account);
  }
  /// The limits at the robot have changed the command; `damper` is the part of the wish's that is in it. Without them the link would
  /// have taken `wished`.
  virtual void limited(SlaveOutput<N>& out, const Force<N>& damper, Energy wished, VirtualCoupling<N>& coupling,
                       const RobotSample<N>& robot, Seconds dt) noexcept {
    static_cast<void>(damper), static_cast<void>(coupling), static_cast<void>(robot);
    report_no_more(out, wished, -leaves(out, dt));
  }
  virtual void release() noexcept {}
  /// The total that is told to the master.
  [[nodiscard]] virtual Energy reported(const Ledger& account) noexcept { return account.absorbed() - base_absorbed_; }
  [[nodiscard]] virtual Energy balance(const Ledger& account, Energy master_energy_in) const noexcept {
    static_cast<void>(account), static_cast<void>(master_energy_in);
    return Energy{};
  }
  virtual void restart(const Ledger& account, Energy balance) noexcept {
    static_cast<void>(balance);
    base_absorbed_ = account.absorbed();
  }

 protected:
  /// What leaves the link with the set point's motion.
  static Energy leaves(const SlaveOutput<N>& out, Seconds dt) noexcept {
    return dot(out.command.f, out.command.v_d * dt) - out.grounded;
  }
  /// Scales the set point's motion so that no more than `most` leaves. Returns what does.
  static Energy leave_at_most(Energy most, SlaveOutput<N>& out, VirtualCoupling<N>& coupling, Seconds dt) noexcept {
    const Energy wished = leaves(out, dt);
    if (!(wished > positive_part(most))) return wished;
    const double part = positive_part(most) / wished;
    const Velocity<N> v = part * out.command.v_d;
    coupling.move((v - out.command.v_d) * dt, Velocity<N>{}, dt);
    out.command.v_d = v;
    out.grounded = part * out.grounded;
    return leaves(out, dt);
  }

  Energy base_absorbed_;
};

/// The slave half of a pair.
template <int N, class Transparency = SlaveTransparency<N>, class Passivity = SlavePassivity<N>>
class SlavePair final : public Copyable<SlavePair<N, Transparency, Passivity>, SlaveHalf<N>> {
 public:
  explicit SlavePair(const ControlOptions& o) : transparency_{o}, passivity_{o} {}

  void start(const RobotSample<N>& robot, bool engaged) noexcept override {
    transparency_->start(robot, engaged);
    passivity_->start(robot);
  }
  Position<N> commanded(const PeerState<N>& master) noexcept override { return transparency_->commanded(master); }
  SlaveOutput<N> step(const SlaveInput<N>& in) noexcept override {
    VirtualCoupling<N>& coupling = transparency_->coupling();
    RobotWish<N> wish = transparency_->wish(in);
    RobotPort<N> port = passivity_->limit(wish, coupling, in);
    damper_ = port.damper_share * wish.damper;
    if (in.bridge != nullptr) [[unlikely]]
      port.f += in.bridge->step(wish.damped ? port.f + damper_ : port.f, in.dt);
    grounded_ = wish.grounded;
    Force<N> f = wish.damped ? port.f + damper_ : port.f;
    if (!all_finite(f, port.v)) [[unlikely]]
      return no_force_exists(f);
    const Displacement<N> moved = port.v * in.dt;
    const Energy not_of_link = grounded_ ? dot(damper_, moved) : Energy{};
    Ledger account = in.account;
    account.book(not_of_link - dot(f, moved));
    coupling.move(moved, wish.v, in.dt);
    Force<N> f_back = f;  // no conditional expression: one of lvalues is a pointer, which keeps them in memory
    if (wish.f_back)
      f_back = *wish.f_back;
    else if (port.returns_wanted)
      f_back = wish.f;
    SlaveOutput<N> out{.command = {.f = f, .x_d = coupling.set_point(), .v_d = port.v},
                       .f_back = f_back,
                       .energy_in = {},
                       .dissipated = port.dissipated,
                       .grounded = not_of_link};
    passivity_->acted(out, port.f, account, in);
    transparency_->acted(f);
    return out;
  }
  SlaveOutput<N> fail_safe(const Ledger& account) noexcept override {
    transparency_->acted(Force<N>{});
    passivity_->release();
    SlaveOutput<N> out{};
    out.command.x_d = transparency_->coupling().set_point();
    out.energy_in = passivity_->reported(account);
    return out;
  }
  void limited(SlaveOutput<N>& out, const RobotCommand<N>& asked, const RobotSample<N>& robot,
               Seconds dt) noexcept override {
    VirtualCoupling<N>& coupling = transparency_->coupling();
    const Energy wished = out.grounded - dot(asked.f, asked.v_d * dt);
    coupling.limited(out.command, asked, robot, dt);
    const Force<N> damper = applied_of(damper_, out.command.f, asked.f);
    if (grounded_) out.grounded = dot(damper, out.command.v_d * dt);
    passivity_->limited(out, damper, wished, coupling, robot, dt);
    out.command.x_d = coupling.set_point();
    transparency_->acted(out.command.f);
  }
  [[nodiscard]] Energy balance(const Ledger& account, Energy e) const noexcept override {
    return passivity_->balance(account, e);
  }
  void restart(const Ledger& account, Energy e) noexcept override { passivity_->restart(account, e); }
  [[nodiscard]] Position<N> set_point() const noexcept override { return transparency_->coupling().set_point(); }
  void resume(const Position<N>& set_point) noexcept override { transparency_->resume(set_point); }
  [[nodiscard]] Position<N> target() const noexcept override { return transparency_->target(); }
  [[nodiscard]] bool has_payload() const noexcept override { return transparency_->has_payload(); }
  void write_payload(Words& words, const Registration<N>& worlds) const noexcept override {
    transparency_->write_payload(words, worlds);
  }

 private:
  /// Of a damper's force, a part of `asked`, the part that is in `applied`: translation and rotation each by their share of `asked`.
  static Force<N> applied_of(Force<N> damper, const Force<N>& applied, const Force<N>& asked) noexcept {
    const auto share = [](const auto& f, const auto& wanted) {
      const double all = wanted.squaredNorm();
      return all > 0.0 ? std::clamp(f.dot(wanted) / all, 0.0, 1.0) : 0.0;
    };
    typename Force<N>::Vector g = damper.vec();
    g.template head<kAxes<N>>() *=
        share(applied.vec().template head<kAxes<N>>(), asked.vec().template head<kAxes<N>>());
    if constexpr (N == 6)
      g.template tail<3>() *= share(applied.vec().template tail<3>(), asked.vec().template tail<3>());
    return Force<N>{g};
  }

  Held<Transparency> transparency_;
  Held<Passivity> passivity_;
  Force<N> damper_;  ///< of the last wish
  bool grounded_ = false;
};

/// A pair that is chosen when the program is compiled.
template <template <int> class MasterT, template <int> class SlaveT, template <int> class MasterP,
          template <int> class SlaveP>
struct StaticPair {
  template <int N>
  using Master = MasterPair<N, MasterT<N>, MasterP<N>>;
  template <int N>
  using Slave = SlavePair<N, SlaveT<N>, SlaveP<N>>;
};

}  // namespace twoport
