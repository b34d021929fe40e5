#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>

#include "common/arm/arm_model.h"
#include "common/arm/tool_load.h"
#include "common/base/random.h"
#include "common/contact/environment.h"
#include "common/scene/scene.h"
#include "sim/plant/body.h"

namespace twoport::sim {

/// A serial arm with torque-controlled joints that holds a tool in an environment. At every tick its controller turns the
/// commanded wrench f at the tool into joint torques, which are then held:
///
///     τ = clamp( g(q) + Jᵀ f + N (k_n (q_0 - q) - d_n q̇) )      N = 1 - Jᵀ Λ J M⁻¹,   Λ = (J M⁻¹ Jᵀ)⁻¹
///
/// q_0: the position at the beginning. N lets no torque of the null space accelerate the tool (O. Khatib, IEEE J. Robotics and
/// Automation 3(1), 1987). Near a singular position J M⁻¹ Jᵀ is damped (Y. Nakamura, H. Hanafusa, J. Dyn. Syst. Meas. Control
/// 108(3), 1986); Jᵀ f has no inverse and needs nothing. The plant, by Runge-Kutta 4:
///
///     M q̈ = τ + Jᵀ f_env - d q̇ - c(q, q̇) - g(q) + stops
///
/// A stop is a spring and damper beyond a joint's limit, which never pulls. Energy into the arm through the joints is exact:
/// a torque that is held over a tick does τ·(q(k+1) - q(k)).
class ArmPlant {
 public:
  using Model = ArmModel<kArmJoints>;
  using Joints = Model::Joints;
  using Vector6 = Model::Vector6;

  /// State between two ticks.
  struct State {
    Joints q, v;
  };

  ArmPlant(const RobotSpec& robot, std::shared_ptr<const Environment<6>> environment, double dt,
           const BodyState<6>& start)
      : environment_{std::move(environment)},
        dt_{dt},
        arm_{*robot.arm},
        home_{vector<kArmJoints>(arm_.joint_position_rad)},
        model_{with_tool(arm_, home_, start.x)},
        s_{home_, Joints::Zero()} {
    for (std::size_t i = 0; i < arm_.parameters->joints.size(); ++i) {
      const ArmJoint& j = arm_.parameters->joints[i];
      const auto c = static_cast<int>(i);
      most_torque_[c] = j.max_torque_n_m, lower_[c] = j.lower_rad, upper_[c] = j.upper_rad;
    }
    pose_ = model_.pose(s_.q);
    base_ = start.x.translation() - pose_.tool;
    const Model::Inertia M = model_.inertia(pose_);
    const auto J = model_.jacobian(pose_);
    mobility_ = J * M.llt().solve(J.transpose());
    regular_ = kSingular * determinant(mobility_);
    // Rates of the fastest motions, for the length of steps: the tool on all that it may touch, and the joints' damping and stops.
    double stiffness = 0.0, damping = 0.0;
    for (const Surface& s : environment_->world().surfaces) {
      stiffness += s.material.stiffness_n_per_m;
      damping += s.material.damping_n_s_per_m + s.material.viscous_friction_n_s_per_m;
      friction_ = std::max(friction_, s.material.friction);
    }
    for (const Spring& s : environment_->world().springs)
      stiffness += s.stiffness_n_per_m, damping += s.damping_n_s_per_m;
    double all_points = 0.0;
    for (const Eigen::Vector3d& point : environment_->tool()) {
      point_mobility_ = largest_eigenvalue(mobility_.topLeftCorner<3, 3>()) +
                        point.squaredNorm() * largest_eigenvalue(mobility_.bottomRightCorner<3, 3>());
      all_points += point_mobility_;
    }
    const double joints =
        1.0 / Eigen::SelfAdjointEigenSolver<Model::Inertia>{M, Eigen::EigenvaluesOnly}.eigenvalues()[0];
    rate_ = std::max({std::sqrt(stiffness * all_points), damping * all_points,
                      (arm_.joint_damping_n_m_s_per_rad + arm_.null_space_damping_n_m_s_per_rad) * joints,
                      std::sqrt(kStopStiffness * joints)});
    update();
  }

  /// One tick under the commanded wrench f.
  [[gnu::noinline]] BodyState<6> advance(const Force<6>& f) noexcept {
    const Joints torque = control(f.vec());
    const Joints before = s_.q;
    double rate = rate_;
    if (friction_ > 0.0)
      rate = std::max(rate, friction_ * translation(from_environment_).norm() * point_mobility_ / kStictionSpeed);
    const int pieces = static_cast<int>(std::clamp(std::ceil(dt_ * rate / 0.1), 1.0, 256.0));
    const double h = dt_ / pieces;
    for (int i = 0; i < pieces; ++i) {
      const State a = rates(s_, torque), b = rates(moved(a, 0.5 * h), torque), c = rates(moved(b, 0.5 * h), torque),
                  d = rates(moved(c, h), torque);
      s_.q += h / 6.0 * (a.q + 2.0 * (b.q + c.q) + d.q);
      s_.v += h / 6.0 * (a.v + 2.0 * (b.v + c.v) + d.v);
    }
    const Joints turned = s_.q - before;
    energy_ += Energy{commanded_.dot(turned)};
    all_energy_ += Energy{torque.dot(turned)};
    update();
    return body();
  }

  [[nodiscard]] BodyState<6> body() const noexcept {
    const Vector6 v = model_.jacobian(pose_) * s_.v;
    return {tool_position(pose_), Velocity<6>{v}};
  }
  /// Of the environment on the tool.
  [[nodiscard]] Force<6> environment_force() const noexcept { return Force<6>{from_environment_}; }
  /// What the wrist sensor adds to that, in world axes at the tool's origin: the tool's inertia, from its mass.
  [[nodiscard]] Force<6> tool_inertia() const noexcept { return Force<6>{inertial_}; }
  [[nodiscard]] Eigen::Matrix3d attitude() const noexcept { return pose_.tool_rotation; }

  [[nodiscard]] const State& state() const noexcept { return s_; }
  [[nodiscard]] const Model& model() const noexcept { return model_; }
  /// Energy into the arm through the joints [J]: of the commanded wrench, and of all torques.
  [[nodiscard]] Energy port_energy() const noexcept { return energy_; }
  [[nodiscard]] Energy joint_energy() const noexcept { return all_energy_; }
  /// Kinetic energy, weight, and what stops and environment hold [J].
  [[nodiscard]] double mechanical_energy() const noexcept {
    const Joints beyond = over_stops(s_.q);
    return model_.energy(pose_, s_.v, kGravity) + 0.5 * kStopStiffness * beyond.squaredNorm() +
           environment_->potential(tool_position(pose_)).si();
  }
  /// Torques of the joints in the last tick, and the part of it that the limits took from the command [N m].
  [[nodiscard]] const Joints& torque() const noexcept { return torque_; }
  [[nodiscard]] bool saturated() const noexcept { return saturated_; }
  void set_state(const State& state) noexcept {
    s_ = state;
    update();
  }
  /// Adds dv to the tool's velocity, with the joint motion of the least kinetic energy.
  void kick(const Velocity<6>& dv) noexcept {
    const auto J = model_.jacobian(pose_);
    const auto inverse = model_.inertia(pose_).llt();
    Matrix6 A = J * inverse.solve(J.transpose());
    damp(A);
    s_.v += inverse.solve(J.transpose() * A.llt().solve(dv.vec()));
    update();
  }

  static inline const Eigen::Vector3d kGravity{0.0, 0.0, -9.81};

 private:
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  static constexpr double kStopStiffness = 2e3, kStopDamping = 20.0;  ///< [N m/rad], [N m s/rad]
  static constexpr double kSingular =
      1e-3;  ///< det J M⁻¹ Jᵀ below this part of that at the beginning is nearly singular

  static Model with_tool(const ArmSpec& arm, const Joints& q, const Position<6>& start) {
    const ArmTool tool{arm.tool_mass_kg, vector<3>(arm.tool_center_m)};
    const Eigen::Matrix3d flange = Model{*arm.parameters}.pose(q).tool_rotation;
    return Model{*arm.parameters, tool, flange.transpose() * start.attitude().toRotationMatrix()};
  }
  [[nodiscard]] Position<6> tool_position(const Model::Pose& p) const noexcept {
    return {base_ + p.tool, Eigen::Quaterniond{p.tool_rotation}};
  }
  [[nodiscard]] State moved(const State& rate, double h) const noexcept {
    return {s_.q + h * rate.q, s_.v + h * rate.v};
  }

  /// How far each joint is beyond its limits; 0 within them.
  [[nodiscard]] Joints over_stops(const Joints& q) const noexcept {
    return (q - upper_).cwiseMax(0.0) + (q - lower_).cwiseMin(0.0);
  }

  static double determinant(const Matrix6& symmetric) noexcept {
    const Eigen::LDLT<Matrix6> factors{symmetric};
    return factors.vectorD().prod();
  }
  /// Adds what keeps an inverse bounded where the arm is nearly singular.
  void damp(Matrix6& A) const noexcept {
    const double d = determinant(A);
    if (d >= regular_) return;
    A.diagonal() += 0.1 * (1.0 - std::max(0.0, d / regular_)) * mobility_.diagonal();
  }

  /// Torques for the coming tick.
  [[nodiscard]] Joints control(const Vector6& wrench) noexcept {
    const auto J = model_.jacobian(pose_);
    const Joints gravity = model_.gravity_torque(pose_, kGravity);
    Joints within =
        arm_.null_space_stiffness_n_m_per_rad * (home_ - s_.q) - arm_.null_space_damping_n_m_s_per_rad * s_.v;
    const Eigen::LLT<Model::Inertia> inertia{model_.inertia(pose_)};
    Matrix6 A = J * inertia.solve(J.transpose());
    damp(A);
    within -= J.transpose() * A.llt().solve(J * inertia.solve(within));
    const Joints wanted = gravity + J.transpose() * wrench + within;
    torque_ = wanted.cwiseMin(most_torque_).cwiseMax(-most_torque_);
    saturated_ = torque_ != wanted;
    commanded_ = torque_ - gravity - within;
    return torque_;
  }

  /// q̇ and q̈.
  [[nodiscard]] State rates(const State& s, const Joints& torque) const noexcept {
    const Model::Pose p = model_.pose(s.q);
    const auto J = model_.jacobian(p);
    const Joints total =
        torque + J.transpose() * environment_wrench(p, J * s.v) - arm_.joint_damping_n_m_s_per_rad * s.v + stops(s);
    return {s.v, model_.forward_dynamics(p, s.v, total, kGravity)};
  }
  [[nodiscard]] Vector6 environment_wrench(const Model::Pose& p, const Vector6& v) const noexcept {
    return environment_->force(tool_position(p), Velocity<6>{v}).vec();
  }
  [[nodiscard]] Joints stops(const State& s) const noexcept {
    Joints torque = Joints::Zero();
    for (int i = 0; i < kArmJoints; ++i) {
      if (s.q[i] > upper_[i]) torque[i] = -std::max(0.0, kStopStiffness * (s.q[i] - upper_[i]) + kStopDamping * s.v[i]);
      if (s.q[i] < lower_[i]) torque[i] = std::max(0.0, kStopStiffness * (lower_[i] - s.q[i]) - kStopDamping * s.v[i]);
    }
    return torque;
  }

  /// What the present state says of pose, contact and the tool's inertia.
  void update() noexcept {
    pose_ = model_.pose(s_.q);
    const auto J = model_.jacobian(pose_);
    from_environment_ = port_vector<6>(environment_wrench(pose_, J * s_.v));
    inertial_ = Vector6::Zero();
    if (!(arm_.tool_mass_kg > 0.0)) return;
    const Joints acceleration = rates(s_, torque_).v;
    const Vector6 a = J * acceleration + model_.bias_acceleration(pose_, s_.v), v = J * s_.v;
    const Eigen::Vector3d c = pose_.tool_rotation * vector<3>(arm_.tool_center_m), w = v.tail<3>(), alpha = a.tail<3>();
    const Eigen::Vector3d f = -arm_.tool_mass_kg * (a.head<3>() + alpha.cross(c) + w.cross(w.cross(c)));
    inertial_ << f, c.cross(f);
  }

  std::shared_ptr<const Environment<6>> environment_;
  double dt_;
  ArmSpec arm_;
  Joints home_;
  Model model_;
  Joints most_torque_, lower_, upper_;
  Eigen::Vector3d base_;  ///< in the world
  Matrix6 mobility_;      ///< J M⁻¹ Jᵀ at the beginning
  double regular_ = 0.0, rate_ = 0.0, friction_ = 0.0, point_mobility_ = 0.0;
  State s_;
  Model::Pose pose_;
  SpatialVector from_environment_ = SpatialVector::Zero();
  Vector6 inertial_ = Vector6::Zero();
  Joints torque_ = Joints::Zero(), commanded_ = Joints::Zero();
  bool saturated_ = false;
  Energy energy_, all_energy_;
};

/// Weight of the tool and bias of the wrist sensor as they were identified before the run, from six attitudes read once
/// each, against the true ones.
class WristCompensation {
 public:
  WristCompensation(const ArmSpec& arm, const ForceSensorSpec& sensor, std::uint64_t seed) {
    const Eigen::Vector3d center = vector<3>(arm.tool_center_m);
    true_ = {
        .mass_kg = arm.tool_mass_kg, .first_moment_kg_m = arm.tool_mass_kg * center, .bias = vector<6>(sensor.bias_n)};
    const Random random{seed ^ kStream};
    std::array<WristReading, 6> readings;
    for (std::size_t i = 0; i < readings.size(); ++i) {
      const Eigen::Vector3d axis = Eigen::Vector3d::Unit(static_cast<int>(i % 3));
      readings[i].attitude = Eigen::AngleAxisd{i < 3 ? 1.0 : -1.5, axis}.toRotationMatrix();
      readings[i].wrench = true_.reading(readings[i].attitude, ArmPlant::kGravity);
      for (unsigned k = 0; k < 6; ++k) readings[i].wrench[k] += sensor.noise_n * random.normal(i, k);
    }
    found_ = identify_tool(readings, ArmPlant::kGravity);
  }
  /// What is left of weight and bias in the reading at the attitude R, in tool axes [N], [N m].
  [[nodiscard]] Eigen::Matrix<double, 6, 1> residual(const Eigen::Matrix3d& R) const noexcept {
    return true_.reading(R, ArmPlant::kGravity) - found_.reading(R, ArmPlant::kGravity);
  }

 private:
  static constexpr std::uint64_t kStream = 0x3715;
  ToolLoad true_, found_;
};

}  // namespace twoport::sim
