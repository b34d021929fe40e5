#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>

#include "common/arm/arm_model.h"
#include "common/arm/tool_load.h"
#include "common/contact/environment.h"
#include "common/scene/scene.h"
#include "sim/plant/body_plant.h"
#include "sim/plant/object.h"

namespace twoport::sim {

/// A hand on the tool of an arm: spring and damper between the intended motion and the tool, and a mass that is held to the tool
/// and whose weight the hand carries.
///
///     f = k (x_h - x) + b (ẋ_h - ẋ) + push        rotation: k_r log(R_h Rᵀ) + b_r (ω_h - ω)
///
/// x_h moves linearly within a tick.
struct HandOnTool {
  HandSpec spec;
  Position<6> intended, next;  ///< where the tick begins and ends
  Velocity<6> rate{};
  /// A finger on the last joint, as the hand on the tool [N/m], [N s/m], [m].
  double finger_stiffness = 0.0, finger_damping = 0.0, opening = 0.0, next_opening = 0.0, opening_rate = 0.0;
};

/// A serial arm of 6 to 8 joints with torque control that holds a tool in an environment. At every tick its controller turns
/// the commanded wrench f at the tool into joint torques, which are then held:
///
///     τ = clamp( g(q) + Jᵀ (λ f + G (f + f_s)) + N (k_n (q_0 - q) - d_n q̇) )      N = 1 - Jᵀ Λ J M⁻¹,   Λ = (J M⁻¹ Jᵀ)⁻¹
///
/// λ in [0, 1], the same for all joints, keeps the command beside the other torques within the joints' limits: λ f is what is applied.
/// f_s: reading of a wrist sensor without errors, the force on the flange through the tool without its weight, low-passed where
/// the scene says so; G: gain of the force feedback, which makes the arm without its tool 1 + G times lighter (N. Hogan, J. Dyn. Syst. Meas.
/// Control 107(1), 1985). With a gain of its own for the rotation G = Λ D⁻¹ Λ⁻¹ D⁻¹ - 1, of the arm without its tool, which is then felt as
/// D Λ D, D = diag(1/√(1 + gain), 1/√(1 + torque_gain)). q_0: the position at the beginning. N lets no torque of the null space accelerate the tool (O. Khatib, IEEE
/// J. Robotics and Automation 3(1), 1987); six joints have none. Near a singular position J M⁻¹ Jᵀ is damped (Y. Nakamura,
/// H. Hanafusa, J. Dyn. Syst. Meas. Control 108(3), 1986); Jᵀ f has no inverse and needs nothing. The plant, by Nyström's method of fourth
/// order, whose two inner stages are at one position:
///
///     M q̈ = τ + Jᵀ f_out - d q̇ - τ_c - c(q, q̇) - g(q) + stops          f_out: of environment and hand
///
/// Two fingers (ArmModel::has_fingers) may hold an object, whose motion is integrated with the arm's.
///
/// A stop is a spring and damper beyond a joint's limit, which never pulls. τ_c is Coulomb friction: its limit against the velocity of a
/// joint that moves; a joint at rest is held, and does not move at all, while that takes no more than the limit. A step ends where a joint
/// stops or is released. Energy into the arm through the joints is exact: a torque that is held over a tick does τ·(q(k+1) - q(k)),
/// and friction takes its limit times the way.
class ArmPlant final {
 public:
  using Joints = ArmModel::Joints;
  using Vector6 = ArmModel::Vector6;

  /// State between two ticks.
  struct State {
    Joints q, v;
    Object::Moving object{Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  };
  /// Derivative of a state, and power [W].
  struct Rate {
    Joints q, v;
    double outside;  ///< f_out·V
    Eigen::Vector3d object;
    double contacts;  ///< power of the object's contacts on it and the fingers
  };

  static inline const Eigen::Vector3d kGravity{0.0, 0.0, -9.81};

  ArmPlant(const ArmSpec& arm, std::shared_ptr<const Environment<6>> environment, double dt, const Position<6>& start,
           const std::optional<HandOnTool>& hand = std::nullopt,
           const std::optional<ObjectSpec>& object = std::nullopt);

  [[nodiscard]] std::unique_ptr<ArmPlant> copy() const { return std::make_unique<ArmPlant>(*this); }
  /// One tick under the commanded wrench f.
  BodyState<6> advance(const Force<6>& f) noexcept;
  /// One tick under torques of the joints beside those that carry the weight; the energy into the port is theirs. For an arm whose joints
  /// are a port; it has none of advance()'s other controllers.
  void advance_joints(const Force<kJointPort>& torque) noexcept;
  void kick_joints(const Velocity<kJointPort>& dv) noexcept;
  [[nodiscard]] BodyState<kJointPort> joints() const noexcept;
  /// Of environment and hand: Jᵀ f.
  [[nodiscard]] Force<kJointPort> outside_torque() const noexcept;
  /// The hand's intended position at the end of the coming tick.
  void lead(const Position<6>& intended) noexcept;
  /// The same of the finger on the last joint [m].
  void lead_finger(double opening_m) noexcept;
  /// From the coming tick on the hand has this stiffness and damping, at most those of the beginning; none: it lets go. Its mass stays.
  void grip(const HandSpec& hand) noexcept;
  /// Adds dv to the tool's velocity, with the joint motion of the least kinetic energy.
  void kick(const Velocity<6>& dv) noexcept;
  [[nodiscard]] BodyState<6> body() const noexcept {
    return {tool_position(now_.pose), Velocity<6>{met_.tool_velocity}};
  }
  /// Of environment and hand on the tool.
  [[nodiscard]] Force<6> outside_force() const noexcept { return Force<6>{met_.outside}; }
  /// What the wrist sensor adds to that, in world axes at the tool's origin: the inertia of tool and hand, from their mass.
  [[nodiscard]] Force<6> tool_inertia() const noexcept { return Force<6>{inertial()}; }
  [[nodiscard]] const Eigen::Matrix3d& attitude() const noexcept { return now_.pose.tool_rotation; }

  [[nodiscard]] const State& state() const noexcept { return s_; }
  [[nodiscard]] const ArmModel& model() const noexcept { return model_; }
  /// Energy of the applied wrench, or of the applied torques, into the arm through the joints [J].
  [[nodiscard]] Energy port_energy() const noexcept { return energy_; }
  /// Energy of all torques into the arm through the joints [J].
  [[nodiscard]] Energy joint_energy() const noexcept { return all_energy_; }
  /// Σ ∫ d q̇² dt of the joints' damping with the work of their Coulomb friction, and ∫ f_out·V dt of environment and hand, by
  /// the quadrature of the motion's steps [J].
  [[nodiscard]] Energy dissipated() const noexcept { return Energy{dissipated_j_}; }
  [[nodiscard]] Energy outside_energy() const noexcept { return Energy{outside_j_}; }
  /// Of the object; zero where there is none.
  [[nodiscard]] const Object::Moving& object() const noexcept { return s_.object; }
  /// What friction and damping of its contacts have taken [J].
  [[nodiscard]] Energy dissipated_at_object() const noexcept {
    return Energy{at_start_j_ - contacts_j_ - met_.object_elastic_j};
  }
  /// Kinetic energy, weight, and what stops, environment and object hold [J].
  [[nodiscard]] double mechanical_energy() const noexcept;
  /// Torques of the joints in the last tick [N m], prismatic: [N].
  [[nodiscard]] const Joints& torque() const noexcept { return torque_; }
  /// λ of the last tick.
  [[nodiscard]] double applied_part() const noexcept { return applied_part_; }
  void set_state(const State& state) noexcept;

 private:
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  using Inertia = ArmModel::Inertia;

  /// A step: where it leads, works on the way [J], and how far its stages disagree
  /// [rad/s], [m/s].
  struct Step {
    State to;
    double outside, damping, contacts, error;
  };
  /// What a position says.
  struct Place {
    ArmModel::Pose pose;
    ArmModel::Jacobian jacobian;
    Inertia inertia;
    InertiaFactors inverse;  ///< of inertia; not used in the steps of an arm with friction
  };
  /// What a velocity says besides.
  struct Meeting {
    Vector6 tool_velocity, outside;
    double stiffness = 0.0, damping = 0.0, friction = 0.0;  ///< of all contacts that press, together [N/m], [N s/m]
    double on_last_joint = 0.0;  ///< of the hand's finger, and of an object on both fingers [N]
    Eigen::Vector3d on_object = Eigen::Vector3d::Zero();
    double contacts = 0.0, object_elastic_j = 0.0;  ///< of the object [W], [J]
  };

  [[nodiscard]] Position<6> tool_position(const ArmModel::Pose& p) const noexcept {
    return {base_ + p.tool, Eigen::Quaterniond{p.tool_rotation}};
  }
  /// Power that the joints' damping takes at these velocities [W].
  [[nodiscard]] double damped(const Joints& v) const noexcept { return v.dot(damping_.cwiseProduct(v)); }
  [[nodiscard]] Joints over_stops(const Joints& q) const noexcept;
  [[nodiscard]] Joints stops(const State& s) const noexcept;
  [[nodiscard]] Eigen::LLT<Matrix6> factors(Matrix6& A) const noexcept;
  [[nodiscard]] Vector6 feedback(const Vector6& f) const noexcept;
  [[nodiscard]] double rate() const noexcept;
  void find(const Joints& q, Place& at) const noexcept;
  [[nodiscard]] Object::Fingers fingers(const Place& at, const State& s) const noexcept;
  [[nodiscard]] Meeting meet(const Place& at, const State& s, double t) const noexcept;
  [[nodiscard]] double power(const Meeting& m, const Joints& v) const noexcept;
  [[nodiscard]] Eigen::Vector3d object_acceleration(const Meeting& m) const noexcept;
  [[nodiscard]] Joints load(const State& s, const Place& at, const Meeting& m) const noexcept;
  [[nodiscard]] Rate rates(const Place& at, const State& s, double t) const noexcept;
  [[nodiscard]] Rate rates_now() const noexcept;
  [[nodiscard]] Step step(const Rate& a, double t, double h) const noexcept;
  [[nodiscard]] Joints acceleration(const Place& at, const Joints& load) const noexcept;
  [[nodiscard]] double last_that_keeps(const Rate& a, double t, Step& step, double h) const noexcept;
  [[nodiscard]] bool keeps(const Step& step, double t) const noexcept;
  void choose_directions(const Place& at, const Joints& load) noexcept;
  void control(const Vector6& wrench) noexcept;
  void drive(const Joints& command, const Joints& others) noexcept;
  void move() noexcept;
  void arrive(double t) noexcept;
  [[nodiscard]] Vector6 inertial() const noexcept;

  std::shared_ptr<const Environment<6>> environment_;
  double dt_;
  ArmSpec arm_;
  std::optional<HandOnTool> hand_;
  ArmTool tool_;  ///< with the hand's mass
  Joints home_;
  ArmModel model_, bare_;  ///< with the tool, and without
  std::optional<Object> object_;
  Joints zero_ = Joints::Zero(home_.size());  ///< one a joint
  Joints most_torque_ = zero_, lower_ = zero_, upper_ = zero_, damping_ = zero_, stop_stiffness_ = zero_,
         stop_damping_ = zero_;
  Joints coulomb_ = zero_;  ///< friction of the joints
  bool dry_ = false;        ///< there is some
  Eigen::Vector3d base_;    ///< in the world
  Matrix6 mobility_;        ///< J M⁻¹ Jᵀ at the beginning
  double regular_ = 0.0, rate_ = 0.0, stop_rate_ = 0.0, point_mobility_ = 0.0, sensor_weight_ = 1.0;
  State s_;
  Place now_;                 ///< of s_
  Meeting met_;               ///< of s_
  Joints bias_ = zero_;       ///< c(q, q̇) + g(q) of s_
  Joints direction_ = zero_;  ///< of a joint with Coulomb friction: 1 or -1; 0 while it is held
  Vector6 sensed_ = Vector6::Zero();
  Joints torque_ = zero_, commanded_ = zero_;
  double applied_part_ = 1.0;
  bool senses_tool_ = false;
  mutable Clearance clearance_;  ///< no state: without it the results are the same
  double dissipated_j_ = 0.0, outside_j_ = 0.0, contacts_j_ = 0.0, at_start_j_ = 0.0;
  Energy energy_, all_energy_;
};

/// Weight of the tool and bias of the wrist sensor as they were identified before the run, from six attitudes read once
/// each, against the true ones.
class WristCompensation {
 public:
  WristCompensation(const ArmSpec& arm, const ForceSensorSpec& sensor, std::uint64_t seed);
  /// What is left of weight and bias in the reading at the attitude R, in tool axes [N], [N m].
  [[nodiscard]] Eigen::Matrix<double, 6, 1> residual(const Eigen::Matrix3d& R) const noexcept {
    return true_.reading(R, ArmPlant::kGravity) - found_.reading(R, ArmPlant::kGravity);
  }

 private:
  static constexpr std::uint64_t kStream = 0x3715;
  ToolLoad true_, found_;
};

}  // namespace twoport::sim
