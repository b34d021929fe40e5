#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <numbers>
#include <optional>
#include <type_traits>
#include <variant>

#include "common/base/copied.h"
#include "common/contact/environment.h"
#include "common/hardware/robot.h"
#include "common/scene/scene.h"
#include "sim/plant/arm.h"
#include "sim/plant/body_plant.h"
#include "sim/plant/exact_wall.h"
#include "sim/sensor.h"

namespace twoport::sim {

/// The slave robot: a mass (N = 1, 3), a rigid body or a serial arm (N = 6) in an environment, with a force sensor.
/// Without a robot block it follows the command exactly. Copies share the environment.
template <int N>
class SimRobot final {
 public:
  SimRobot(const Scene& scene, Seconds dt)
      : environment_{std::make_shared<Environment<N>>(scene.environment, scene.tool)} {
    if (scene.robot) {
      const RobotSpec& robot = *scene.robot;
      state_ = {position<N>(robot.position_m), Velocity<N>{vector<N>(robot.velocity_m_per_s)}};
      model(robot, scene.simulation, dt.si());
      if (robot.force_sensor) sensor_ = ForceSensor<N>{*robot.force_sensor, dt, scene.seed};
      if constexpr (N == 6) {
        if (robot.arm && robot.force_sensor) mount_wrist_sensor(robot, dt, scene.seed);
      }
    }
    anchors_move_ = std::any_of(environment_->world().springs.begin(), environment_->world().springs.end(),
                                [](const Spring& s) { return s.motion.amplitude_m != 0.0; });
    dt_s_ = dt.si();
    touch();
  }

  /// Advances the model by one control period, under the command held since the last actuate.
  void advance() noexcept {
    if (anchors_move_) [[unlikely]]
      return advance_with_anchors();
    move();
    touch();
  }
  /// The same without reading the sensor, if no force is needed before the next advance.
  void move() noexcept {
    if (auto* exact = std::get_if<Exact>(&plant_)) {
      state_ = exact->advance(command_.f);
    } else if (auto* general = std::get_if<General>(&plant_)) {
      state_ = (*general)->advance(command_.f);
    } else if (std::holds_alternative<Arm>(plant_)) {
      if constexpr (N == 6) state_ = std::get<Arm>(plant_)->advance(command_.f);
    } else {
      state_ = {command_.x_d, command_.v_d};
    }
  }

  /// From now on without noise of its sensor.
  void silence() noexcept {
    sensor_.silence();
    anchors_rest_ = true;
  }
  /// Adds dv to its velocity. False where it is ideal.
  bool kick(const Velocity<N>& dv) noexcept {
    if (std::holds_alternative<Ideal>(plant_)) return false;
    if (auto* exact = std::get_if<Exact>(&plant_)) exact->kick(dv);
    if (auto* general = std::get_if<General>(&plant_)) (*general)->kick(dv);
    if constexpr (N == 6)
      if (auto* arm = std::get_if<Arm>(&plant_)) (*arm)->kick(dv);
    state_.v += dv;
    return true;
  }

  /// Can surfaces be changed while running? An arm's model cannot take it.
  [[nodiscard]] bool takes_other_surfaces() const noexcept { return !std::holds_alternative<Arm>(plant_); }
  /// And their friction? A line has none, and the exact maps of a viscous wall know none.
  [[nodiscard]] bool takes_other_friction() const noexcept {
    const auto* exact = std::get_if<Exact>(&plant_);
    return N > 1 && takes_other_surfaces() && (!exact || exact->takes_friction());
  }
  /// From now on a surface has this stiffness, and, where it can, this friction. Where it presses, that changes the elastic energy
  /// by ΔK d²/2, which is returned: whoever changes it does this work. Of a robot that no copy shares the environment with.
  Energy set_surface(std::size_t surface, double stiffness_n_per_m, double friction) noexcept {
    const Energy before = environment_->potential(state_.x);
    if (!takes_other_friction()) friction = environment_->world().surfaces[surface].material.friction;
    environment_->set_surface(surface, stiffness_n_per_m, friction);
    if (auto* exact = std::get_if<Exact>(&plant_)) exact->set_surface(stiffness_n_per_m, friction);
    if (auto* general = std::get_if<General>(&plant_)) (*general)->surfaces_have_changed();
    return environment_->potential(state_.x) - before;
  }

  [[nodiscard]] RobotSample<N> sense() const noexcept {
    return {state_.x, state_.v, sensed_, std::holds_alternative<Ideal>(plant_)};
  }
  /// The same for run_cycle: the caller advances.
  template <class Clock>
  RobotSample<N> sense(const Tick<Clock>&) const noexcept {
    return sense();
  }
  void actuate(const RobotCommand<N>& command) noexcept { command_ = command; }
  void release() noexcept { command_.f = Force<N>{}; }

  [[nodiscard]] const BodyState<N>& state() const { return state_; }
  /// Coupling force on the robot, held now.
  [[nodiscard]] const Force<N>& held() const { return command_.f; }
  /// True force of the environment on the robot.
  [[nodiscard]] const Force<N>& environment_force() const { return from_environment_; }
  [[nodiscard]] const Environment<N>& environment() const { return *environment_; }
  /// The arm, where there is one.
  [[nodiscard]] const ArmPlant* arm() const noexcept requires(N == 6) {
    const Arm* arm = std::get_if<Arm>(&plant_);
    return arm ? arm->get() : nullptr;
  }

 private:
  /// One tick under the force of the moving anchors: that of a spring whose anchor is a(t) away from its place is
  /// K a(t) + B da/dt more, at each point of a tool that it acts on. It is held for the tick.
  void advance_with_anchors() noexcept {
    if (!anchors_rest_) {
      from_anchors_ = Force<N>{};
      const double t = static_cast<double>(tick_++) * dt_s_;
      for (const Spring& s : environment_->world().springs) {
        const double w = 2.0 * std::numbers::pi * s.motion.frequency_hz;
        const double f_n =
            s.motion.amplitude_m * (s.stiffness_n_per_m * std::sin(w * t) + s.damping_n_s_per_m * w * std::cos(w * t));
        from_anchors_ += pull(s, f_n * Point<kAxes<N>>::Unit(s.motion.axis));
      }
    }
    const Force<N> commanded = command_.f;
    command_.f += from_anchors_;
    move();
    command_.f = commanded;
    touch();
  }

  /// Of the force f on every point that the spring acts on.
  [[nodiscard]] Force<N> pull(const Spring& s, const Point<kAxes<N>>& f) const noexcept {
    if constexpr (N == 6) {
      SpatialVector sum = SpatialVector::Zero();
      for (int i = 0; const Eigen::Vector3d& point : environment_->tool())
        if (s.acts_on(i++)) sum += SpatialVector{f, (state_.x.attitude() * point).cross(f)};
      return Force<N>{sum};
    } else {
      return Force<N>{f};
    }
  }

  struct Ideal {};
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
  using Exact = std::conditional_t<N == 6, NoMap, ExactPlant<N == 6 ? 3 : N>>;

  void model(const RobotSpec& robot, const SimulationSpec& simulation, double dt) {
    if constexpr (N == 6) {
      if (robot.arm) {
        plant_ = Arm{make_arm(*robot.arm, environment_, dt, state_.x)};
        return;
      }
    }
    const Integrator method = simulation.integrator;
    if constexpr (N != 6) {
      const bool map = method == Integrator::exact_per_tick || method == Integrator::trapezoidal;
      if (map || (method == Integrator::exact && Exact::fits(environment_->world()))) {
        plant_.template emplace<Exact>(robot, environment_->world(), dt, state_, method, map ? simulation.substeps : 1);
        return;
      }
    }
    plant_ = General{make_body_plant<N>(robot, environment_, dt, state_, simulation)};
  }

  /// The arm's sensor is between flange and tool: weight and bias are removed as far as they have been identified.
  void mount_wrist_sensor(const RobotSpec& robot, Seconds dt, std::uint64_t seed) requires(N == 6) {
    ForceSensorSpec unbiased = *robot.force_sensor;
    unbiased.bias_n.clear();
    sensor_ = ForceSensor<N>{unbiased, dt, seed};
    wrist_.emplace(*robot.arm, *robot.force_sensor, seed);
  }
  void sense_at_wrist() noexcept {
    if constexpr (N == 6) {
      const ArmPlant& arm = *std::get<Arm>(plant_);
      from_environment_ = arm.outside_force();
      if (anchors_move_) from_environment_ += from_anchors_;
      Force<N> at_wrist = from_environment_ + arm.tool_inertia();
      if (wrist_) {
        const Eigen::Matrix3d R = arm.attitude();
        const Eigen::Matrix<double, 6, 1> rest = wrist_->residual(R);
        Eigen::Matrix<double, 6, 1> world;
        world << R * rest.head<3>(), R * rest.tail<3>();
        at_wrist += Force<N>{world};
      }
      sensed_ = sensor_.sample(at_wrist);
    }
  }

  void touch() noexcept {
    if (const auto* exact = std::get_if<Exact>(&plant_))
      from_environment_ = exact->environment_force();
    else if (const auto* general = std::get_if<General>(&plant_))
      from_environment_ = (*general)->environment_force();
    else if (std::holds_alternative<Arm>(plant_)) {
      sense_at_wrist();
      return;
    } else
      from_environment_ = environment_->force(state_.x, state_.v);
    if (anchors_move_) [[unlikely]]
      from_environment_ += from_anchors_;
    sensed_ = sensor_.sample(from_environment_);
  }

  std::shared_ptr<Environment<N>> environment_;
  BodyState<N> state_;
  std::variant<Ideal, Exact, General, Arm> plant_;
  std::optional<WristCompensation> wrist_;  ///< of an arm with a force sensor
  RobotCommand<N> command_;
  Force<N> from_environment_, sensed_;
  Force<N> from_anchors_;  ///< what moving anchors add
  bool anchors_move_ = false, anchors_rest_ = false;
  double dt_s_ = 0.0;
  std::int64_t tick_ = 0;
  ForceSensor<N> sensor_;
};

}  // namespace twoport::sim
