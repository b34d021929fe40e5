#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <type_traits>
#include <variant>

#include "common/base/built_for.h"
#include "common/base/copied.h"
#include "common/contact/environment.h"
#include "common/hardware/admittance.h"
#include "common/hardware/robot.h"
#include "common/scene/scene.h"
#include "sim/plant/arm.h"
#include "sim/plant/body_plant.h"
#include "sim/plant/exact_wall.h"
#include "sim/plant/position_servo.h"
#include "sim/sensor.h"
#include "sim/sim_joints.h"

namespace twoport::sim {

/// The slave robot: a mass (N = 1, 3), a rigid body or a serial arm (N = 6) in an environment, with a force sensor.
/// Without a robot block it follows the command exactly. Copies share the environment.
template <int N>
class SimRobot final {
 public:
  SimRobot(const Scene& scene, Seconds dt);

  /// Advances the model by one control period, under the command held since the last actuate.
  void advance() noexcept;
  /// The same without reading the sensor, if no force is needed before the next advance.
  void move() noexcept;

  /// From now on without noise of its sensor.
  void silence() noexcept {
    sensor_.silence();
    anchors_rest_ = true;
  }
  /// Adds dv to its velocity. False where it is ideal.
  bool kick(const Velocity<N>& dv) noexcept;

  /// Can surfaces be changed while running? An arm's model cannot take it.
  [[nodiscard]] bool takes_other_surfaces() const noexcept { return !std::holds_alternative<Arm>(plant_); }
  /// And their friction? A line has none, and the exact maps of a viscous wall know none.
  [[nodiscard]] bool takes_other_friction() const noexcept;
  /// From now on a surface has this stiffness, and, where it can, this friction. Where it presses, that changes the elastic energy
  /// by ΔK d²/2, which is returned: whoever changes it does this work. Of a robot that no copy shares the environment with.
  Energy set_surface(std::size_t surface, double stiffness_n_per_m, double friction) noexcept;

  [[nodiscard]] RobotSample<N> sense() const noexcept {
    if (servo_) [[unlikely]]
      return {servo_->body.x(), servo_->body.v(), sensed_};
    return {state_.x, state_.v, sensed_, std::holds_alternative<Ideal>(plant_)};
  }
  /// The same for run_cycle: the caller advances.
  template <class Clock>
  RobotSample<N> sense(const Tick<Clock>&) const noexcept {
    return sense();
  }
  void actuate(const RobotCommand<N>& command) noexcept { command_ = command; }
  void release() noexcept {
    command_.f = Force<N>{};
    if (servo_) servo_->body.stop();
  }

  [[nodiscard]] const BodyState<N>& state() const { return state_; }
  /// Of the port at which the command acts: the robot, or the body in its place.
  [[nodiscard]] const Position<N>& port() const { return servo_ ? servo_->body.x() : state_.x; }
  /// Of the robot, where the port is another body's.
  [[nodiscard]] const Position<N>* tool() const { return servo_ ? &state_.x : nullptr; }
  /// Coupling force on the robot, held now.
  [[nodiscard]] const Force<N>& held() const { return command_.f; }
  /// True force of the environment on the robot.
  [[nodiscard]] const Force<N>& environment_force() const { return from_environment_; }
  [[nodiscard]] const Environment<N>& environment() const { return *environment_; }
  /// The arm, where there is one.
  [[nodiscard]] const ArmPlant* arm() const noexcept {
    if constexpr (N == 6)
      if (const Arm* arm = std::get_if<Arm>(&plant_)) return arm->get();
    return nullptr;
  }

 private:
  /// One tick under the force of the moving anchors: that of a spring whose anchor is a(t) away from its place is
  /// K a(t) + B da/dt more, at each point of a tool that it acts on. It is held for the tick.
  void advance_with_anchors() noexcept;

  /// Of the force f on every point that the spring acts on.
  [[nodiscard]] Force<N> pull(const Spring& s, const Point<kAxes<N>>& f) const noexcept;

  struct Ideal {};
  /// In place of a plant.
  struct Servoed {
    Admittance<N> body;
    PositionServo<N> robot;
  };
  /// Stands where the exact maps do not exist.
  struct NoMap {
    BodyState<N> advance(const Force<N>&) noexcept { return {}; }
    void kick(const Velocity<N>&) noexcept {}
    void set_surface(double, double) noexcept {}
    [[nodiscard]] bool takes_friction() const noexcept { return false; }
    [[nodiscard]] Force<N> environment_force() const noexcept { return {}; }
  };
  struct NoArm {};
  using Arm = std::conditional_t<N == 6, Copied<ArmPlant>, NoArm>;
  using General = Copied<BodyPlant<N>>;
  using Exact = std::conditional_t<N == 6, NoMap, ExactPlant<kAxes<N>>>;

  void model(const RobotSpec& robot, const SimulationSpec& simulation, double dt);

  /// The arm's sensor is between flange and tool: weight and bias are removed as far as they have been identified.
  void mount_wrist_sensor(const RobotSpec& robot, Seconds dt, std::uint64_t seed) requires(N == 6);
  void sense_at_wrist() noexcept;
  void touch() noexcept;

  std::shared_ptr<Environment<N>> environment_;
  BodyState<N> state_;
  std::variant<Ideal, Exact, General, Arm> plant_;
  std::optional<Servoed> servo_;
  std::optional<WristCompensation> wrist_;  ///< of an arm with a force sensor
  RobotCommand<N> command_;
  Force<N> from_environment_, sensed_;
  Force<N> from_anchors_;  ///< what moving anchors add
  bool anchors_move_ = false, anchors_rest_ = false;
  double dt_s_ = 0.0;
  std::int64_t tick_ = 0;
  ForceSensor<N> sensor_;
};
TWOPORT_DECLARE(SimRobot);

}  // namespace twoport::sim
