#include "sim/sim_robot.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace twoport::sim {

template <int N>
SimRobot<N>::SimRobot(const Scene& scene, Seconds dt)
    : environment_{std::make_shared<Environment<N>>(scene.environment, scene.tool)} {
  if (scene.robot) {
    const RobotSpec& robot = *scene.robot;
    state_ = {position<N>(robot.position_m), Velocity<N>{vector<N>(robot.velocity_m_per_s)}};
    if (robot.servo) {
      servo_.emplace(
          Servoed{Admittance<N>{*robot.servo,
                                {.mass_kg = robot.mass_kg,
                                 .inertia_kg_m2 = robot.inertia_kg_m2.empty() ? 0.0 : robot.inertia_kg_m2[0],
                                 .damping_n_s_per_m = robot.damping_n_s_per_m,
                                 .rotational_damping_n_m_s_per_rad = robot.rotational_damping_n_m_s_per_rad}},
                  PositionServo<N>{*robot.servo, state_.x}});
      servo_->body.rest(state_.x);
    } else {
      model(robot, scene.simulation, dt.si());
    }
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

template <int N>
void SimRobot<N>::advance() noexcept {
  if (anchors_move_) [[unlikely]]
    return advance_with_anchors();
  move();
  touch();
}

template <int N>
void SimRobot<N>::move() noexcept {
  if (servo_) [[unlikely]] {
    servo_->body.step(command_.f, sensed_ - command_.not_of_environment, Seconds{dt_s_});
    servo_->robot.advance(servo_->body.x(), dt_s_);
    state_ = {servo_->robot.x(), servo_->robot.v()};
  } else if (auto* exact = std::get_if<Exact>(&plant_)) {
    state_ = exact->advance(command_.f);
  } else if (auto* general = std::get_if<General>(&plant_)) {
    state_ = (*general)->advance(command_.f);
  } else if (std::holds_alternative<Arm>(plant_)) {
    if constexpr (N == 6) state_ = std::get<Arm>(plant_)->advance(command_.f);
  } else {
    state_ = {command_.x_d, command_.v_d};
  }
}

template <int N>
bool SimRobot<N>::kick(const Velocity<N>& dv) noexcept {
  if (servo_) {
    servo_->body.kick(dv);
    return true;
  }
  if (std::holds_alternative<Ideal>(plant_)) return false;
  if (auto* exact = std::get_if<Exact>(&plant_)) exact->kick(dv);
  if (auto* general = std::get_if<General>(&plant_)) (*general)->kick(dv);
  if constexpr (N == 6)
    if (auto* arm = std::get_if<Arm>(&plant_)) (*arm)->kick(dv);
  state_.v += dv;
  return true;
}

template <int N>
bool SimRobot<N>::takes_other_friction() const noexcept {
  const auto* exact = std::get_if<Exact>(&plant_);
  return N > 1 && takes_other_surfaces() && (!exact || exact->takes_friction());
}

template <int N>
Energy SimRobot<N>::set_surface(std::size_t surface, double stiffness_n_per_m, double friction) noexcept {
  const Energy before = environment_->potential(state_.x);
  if (!takes_other_friction()) friction = environment_->world().surfaces[surface].material.friction;
  environment_->set_surface(surface, stiffness_n_per_m, friction);
  if (auto* exact = std::get_if<Exact>(&plant_)) exact->set_surface(stiffness_n_per_m, friction);
  if (auto* general = std::get_if<General>(&plant_)) (*general)->surfaces_have_changed();
  return environment_->potential(state_.x) - before;
}

template <int N>
void SimRobot<N>::advance_with_anchors() noexcept {
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

template <int N>
Force<N> SimRobot<N>::pull(const Spring& s, const Point<kAxes<N>>& f) const noexcept {
  if constexpr (N == 6) {
    SpatialVector sum = SpatialVector::Zero();
    for (int i = 0; const Eigen::Vector3d& point : environment_->tool())
      if (s.acts_on(i++)) sum += SpatialVector{f, (state_.x.attitude() * point).cross(f)};
    return Force<N>{sum};
  } else {
    return Force<N>{f};
  }
}

template <int N>
void SimRobot<N>::model(const RobotSpec& robot, const SimulationSpec& simulation, double dt) {
  if constexpr (N == 6) {
    if (robot.arm) {
      plant_ = Arm{std::make_unique<ArmPlant>(*robot.arm, environment_, dt, state_.x)};
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

template <int N>
void SimRobot<N>::mount_wrist_sensor(const RobotSpec& robot, Seconds dt, std::uint64_t seed) requires(N == 6) {
  ForceSensorSpec unbiased = *robot.force_sensor;
  unbiased.bias_n.clear();
  sensor_ = ForceSensor<N>{unbiased, dt, seed};
  wrist_.emplace(*robot.arm, *robot.force_sensor, seed);
}

template <int N>
void SimRobot<N>::sense_at_wrist() noexcept {
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

template <int N>
void SimRobot<N>::touch() noexcept {
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

TWOPORT_COMPILE(SimRobot);

}  // namespace twoport::sim
