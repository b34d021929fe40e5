#pragma once

#include <algorithm>
#include <tuple>

#include "common/base/vector.h"
#include "common/coupling/options.h"
#include "common/coupling/registration.h"
#include "common/coupling/setpoint_tracker.h"
#include "common/coupling/spring_damper.h"
#include "common/hardware/robot.h"
#include "common/link/mailbox.h"

namespace twoport {

/// What the slave adds to its packets under POSITION_POSITION.
template <int N>
struct RobotInMasterWorld {
  Latest<Position<N>> x;
  auto fields() { return std::tie(x); }
};

/// The virtual coupling of the slave: a spring-damper between the commanded motion and the robot.
///
///     v_d   = tracker(x_rx, v_rx)                            commanded motion, s_x times the master's
///     f_d   = K (x_sd + T v_d - x_s) + B (v_rx - v_s)        force of the coupling before control
///     x_sd += T v_sd                                         set point, moved as the controller allows
///
/// For an ideal robot f_d is the sensor's force.
template <int N>
class VirtualCoupling {
 public:
  explicit VirtualCoupling(const ControlOptions& o)
      : drift_compensation_{o.coupling.drift_compensation},
        by_position_{o.architecture == Architecture::position_position},
        spring_{o.coupling},
        tracker_{o.coupling} {}

  struct Wanted {
    Force<N> f;
    Velocity<N> v;
  };
  /// A coupling begins at the robot's position; `engaged`: the worlds are registered.
  void start(const Position<N>& robot, bool engaged) noexcept {
    engaged_ = engaged;
    rest(robot);
  }
  /// Continues from the state of another coupling.
  void resume(const Position<N>& set_point) noexcept {
    engaged_ = true;
    rest(set_point);
  }
  /// While nothing is coupled the set point stays at the robot.
  void rest(const Position<N>& robot) noexcept { x_sd_ = x_d_ = robot; }

  /// Force and velocity before control; `coupled`: the master's reports arrive, else the command is constant. `x_rx`, `v_rx`: the
  /// commanded motion, `fresh` in this tick.
  Wanted step(const RobotSample<N>& robot, const Position<N>& x_rx, const Velocity<N>& v_rx, bool fresh, bool coupled,
              Seconds dt) noexcept {
    Wanted out;
    Velocity<N> v;
    if (coupled) {
      out.v = tracker_.step(drift_compensation_ ? x_sd_ : x_d_, x_rx, v_rx, fresh, dt);
      v = tracker_.velocity();
    }
    out.f = robot.ideal ? robot.f_environment : spring_.force((x_sd_ + out.v * dt) - robot.x, v - robot.v);
    return out;
  }
  /// Position of the robot in the master's world, for a position-position master; empty before the first engagement.
  [[nodiscard]] bool tells_position() const noexcept { return by_position_ && engaged_; }
  static void tell_position(const Position<N>& robot, const Registration<N>& worlds, Words& words) noexcept {
    write(RobotInMasterWorld<N>{{worlds.to_master(robot)}}, words);
  }
  /// Moves the set point by `moved`, the allowed displacement, and the command by T v_d.
  void move(const Displacement<N>& moved, const Velocity<N>& v_d, Seconds dt) noexcept {
    x_sd_ = x_sd_ + moved;
    if (!drift_compensation_) x_d_ = x_d_ + v_d * dt;
  }

  /// The limits at the robot have changed the command of the last step from `asked` to `command`: the set point goes back, and the
  /// stretch to the part of it whose force is applied. Writes the set point's motion into `command`.
  ///
  ///     e = x_sd + (x_d - x_d,asked) - x,   x_sd = x + s e,   s = f·e/(f_asked·e) in [0, 1]; translation and rotation each
  ///
  /// An ideal robot stands at the set point: s = 1.
  void limited(RobotCommand<N>& command, const RobotCommand<N>& asked, const RobotSample<N>& robot,
               Seconds dt) noexcept {
    const Position<N> from = x_sd_ + -(asked.v_d * dt);
    x_sd_ = x_sd_ + (command.x_d - asked.x_d);
    if (!robot.ideal) {
      typename Displacement<N>::Vector e = (x_sd_ - robot.x).vec();
      e.template head<kAxes<N>>() *= applied_part(command.f.vec().template head<kAxes<N>>(),
                                                  asked.f.vec().template head<kAxes<N>>(), e.template head<kAxes<N>>());
      if constexpr (N == 6)
        e.template tail<3>() *=
            applied_part(command.f.vec().template tail<3>(), asked.f.vec().template tail<3>(), e.template tail<3>());
      x_sd_ = robot.x + Displacement<N>{e};
    }
    command.v_d = (x_sd_ - from) / dt;
  }

  [[nodiscard]] const Position<N>& set_point() const noexcept { return x_sd_; }
  /// Estimate of the master's position.
  [[nodiscard]] const Position<N>& target() const noexcept { return tracker_.target(); }
  [[nodiscard]] SpringDamper<N>& spring() noexcept { return spring_; }

 private:
  static double applied_part(const auto& f, const auto& asked, const auto& e) noexcept {
    const double wanted = asked.dot(e), has = f.dot(e);
    return wanted > 0.0 && has < wanted ? std::max(0.0, has) / wanted : 1.0;
  }

  bool drift_compensation_, by_position_;
  SpringDamper<N> spring_;
  SetpointTracker<N> tracker_;
  Position<N> x_sd_, x_d_;
  bool engaged_ = false;
};

}  // namespace twoport
