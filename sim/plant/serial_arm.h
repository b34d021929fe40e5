#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <memory>
#include <optional>

#include "common/arm/arm_model.h"
#include "common/contact/environment.h"
#include "common/scene/scene.h"
#include "sim/plant/arm.h"
#include "sim/plant/body_plant.h"

namespace twoport::sim {

/// A serial arm of n revolute joints with torque control that holds a tool in an environment. At every tick its controller turns
/// the commanded wrench f at the tool into joint torques, which are then held:
///
///     τ = clamp( g(q) + Jᵀ (f + G (f + f_s)) + N (k_n (q_0 - q) - d_n q̇) )      N = 1 - Jᵀ Λ J M⁻¹,   Λ = (J M⁻¹ Jᵀ)⁻¹
///
/// f_s: reading of a wrist sensor without errors, the force on the flange through the tool without its weight, low-passed where
/// the scene says so; G: gain of the force feedback, which makes the arm without its tool 1 + G times lighter (N. Hogan, J. Dyn. Syst. Meas.
/// Control 107(1), 1985). With a gain of its own for the rotation G = Λ D⁻¹ Λ⁻¹ D⁻¹ - 1, of the arm without its tool, which is then felt as
/// D Λ D, D = diag(1/√(1 + gain), 1/√(1 + torque_gain)). q_0: the position at the beginning. N lets no torque of the null space accelerate the tool (O. Khatib, IEEE
/// J. Robotics and Automation 3(1), 1987); six joints have none. Near a singular position J M⁻¹ Jᵀ is damped (Y. Nakamura,
/// H. Hanafusa, J. Dyn. Syst. Meas. Control 108(3), 1986); Jᵀ f has no inverse and needs nothing. The plant, by Runge-Kutta 4:
///
///     M q̈ = τ + Jᵀ f_out - d q̇ - τ_c - c(q, q̇) - g(q) + stops          f_out: of environment and hand
///
/// A stop is a spring and damper beyond a joint's limit, which never pulls. τ_c is Coulomb friction: its limit against the velocity of a
/// joint that moves; a joint at rest is held, and does not move at all, while that takes no more than the limit. A step ends where a joint
/// stops or is released. Energy into the arm through the joints is exact: a torque that is held over a tick does τ·(q(k+1) - q(k)),
/// and friction takes its limit times the way.
template <int n>
class SerialArm final : public ArmPlant {
 public:
  using Model = ArmModel<n>;
  using Joints = typename Model::Joints;
  using Vector6 = typename Model::Vector6;

  /// State between two ticks.
  struct State {
    Joints q, v;
  };
  /// Derivative of a state, and powers [W].
  struct Rate {
    Joints q, v;
    double outside;  ///< f_out·V
  };

  SerialArm(const ArmSpec& arm, std::shared_ptr<const Environment<6>> environment, double dt, const Position<6>& start,
            const std::optional<HandOnTool>& hand);

  [[nodiscard]] std::unique_ptr<ArmPlant> copy() const override { return std::make_unique<SerialArm>(*this); }
  BodyState<6> advance(const Force<6>& f) noexcept override;
  void lead(const Position<6>& intended) noexcept override;
  void kick(const Velocity<6>& dv) noexcept override;
  [[nodiscard]] BodyState<6> body() const noexcept {
    return {tool_position(now_.pose), Velocity<6>{now_.tool_velocity}};
  }
  [[nodiscard]] Force<6> outside_force() const noexcept override { return Force<6>{now_.outside}; }
  [[nodiscard]] Force<6> tool_inertia() const noexcept override { return Force<6>{inertial_}; }
  [[nodiscard]] const Eigen::Matrix3d& attitude() const noexcept override { return now_.pose.tool_rotation; }

  [[nodiscard]] const State& state() const noexcept { return s_; }
  [[nodiscard]] const Model& model() const noexcept { return model_; }
  [[nodiscard]] Energy port_energy() const noexcept override { return energy_; }
  /// Energy of all torques into the arm through the joints [J].
  [[nodiscard]] Energy joint_energy() const noexcept { return all_energy_; }
  /// Σ ∫ d q̇² dt of the joints' damping with the work of their Coulomb friction, and ∫ f_out·V dt of environment and hand, by
  /// Runge-Kutta 4 as the motion [J].
  [[nodiscard]] Energy dissipated() const noexcept { return Energy{dissipated_j_}; }
  [[nodiscard]] Energy outside_energy() const noexcept { return Energy{outside_j_}; }
  /// Kinetic energy, weight, and what stops and environment hold [J].
  [[nodiscard]] double mechanical_energy() const noexcept;
  /// Torques of the joints in the last tick [N m], and whether limits took a part of them.
  [[nodiscard]] const Joints& torque() const noexcept { return torque_; }
  [[nodiscard]] bool saturated() const noexcept { return saturated_; }
  void set_state(const State& state) noexcept;

 private:
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  using Inertia = typename Model::Inertia;

  /// A step of Runge-Kutta 4: where it leads, and works on the way [J].
  struct Step {
    State to;
    double outside, damping;
  };
  /// What a state says of pose, velocity and outside forces.
  struct Kinematics {
    typename Model::Pose pose;
    typename Model::Jacobian jacobian;
    Vector6 tool_velocity, outside;
    double stiffness, damping;  ///< of all contacts that press, together [N/m], [N s/m]
  };

  [[nodiscard]] Position<6> tool_position(const typename Model::Pose& p) const noexcept {
    return {base_ + p.tool, Eigen::Quaterniond{p.tool_rotation}};
  }
  [[nodiscard]] State moved(const Rate& rate, double h) const noexcept {
    return {s_.q + h * rate.q, s_.v + h * rate.v};
  }
  /// Power that the joints' damping takes at these velocities [W].
  [[nodiscard]] double damped(const Joints& v) const noexcept { return v.dot(damping_.cwiseProduct(v)); }
  [[nodiscard]] Joints over_stops(const Joints& q) const noexcept;
  [[nodiscard]] Joints stops(const State& s) const noexcept;
  [[nodiscard]] Eigen::LLT<Matrix6> factors(Matrix6& A) const noexcept;
  [[nodiscard]] Vector6 feedback(const Vector6& f) const noexcept;
  [[nodiscard]] Kinematics kinematics(const State& s, double t) const noexcept;
  void meet_outside(Kinematics& k, double t) const noexcept;
  [[nodiscard]] Joints load(const State& s, const Kinematics& k, const Joints& torque) const noexcept;
  [[nodiscard]] Rate rates(const State& s, const Joints& torque, double t) const noexcept;
  [[nodiscard]] Rate rates_now(const Joints& torque) const noexcept;
  [[nodiscard]] Step runge_kutta(const Rate& a, const Joints& torque, double t, double h) const noexcept;
  [[nodiscard]] Joints acceleration(const Inertia& M, const Joints& load) const noexcept;
  [[nodiscard]] bool keeps(const Step& step, const Joints& torque, double t) const noexcept;
  void choose_directions(const Inertia& M, const Joints& load) noexcept;
  void move_with_friction(const Joints& torque, double longest) noexcept;
  [[nodiscard]] Joints control(const Vector6& wrench) noexcept;
  void update() noexcept;
  void sense_tool() noexcept;

  std::shared_ptr<const Environment<6>> environment_;
  double dt_;
  ArmSpec arm_;
  std::optional<HandOnTool> hand_;
  ArmTool tool_;  ///< with the hand's mass
  Joints home_;
  Model model_, bare_;  ///< with the tool, and without
  Joints most_torque_, lower_, upper_, damping_;
  Joints coulomb_ = Joints::Zero();  ///< friction of the joints [N m]
  bool dry_ = false;                 ///< there is some
  Eigen::Vector3d base_;             ///< in the world
  Matrix6 mobility_;                 ///< J M⁻¹ Jᵀ at the beginning
  double regular_ = 0.0, rate_ = 0.0, friction_ = 0.0, point_mobility_ = 0.0, sensor_weight_ = 1.0;
  State s_;
  Kinematics now_;                     ///< of s_
  Eigen::LLT<Inertia> inertia_;        ///< of s_
  Joints bias_ = Joints::Zero();       ///< c(q, q̇) + g(q) of s_
  Joints direction_ = Joints::Zero();  ///< of a joint with Coulomb friction: 1 or -1; 0 while it is held
  Vector6 inertial_ = Vector6::Zero(), sensed_ = Vector6::Zero();
  Joints torque_ = Joints::Zero(), commanded_ = Joints::Zero();
  bool saturated_ = false, senses_tool_ = false;
  mutable Clearance clearance_;  ///< no state: without it the results are the same
  double dissipated_j_ = 0.0, outside_j_ = 0.0;
  Energy energy_, all_energy_;
};
extern template class SerialArm<6>;
extern template class SerialArm<7>;

}  // namespace twoport::sim
