#include "sim/plant/arm.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>

#include "common/base/normal.h"

namespace twoport::sim {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;

constexpr double kStopStiffness = 2e3, kStopDamping = 20.0;           // [N m/rad], [N m s/rad]
constexpr double kSlideStopStiffness = 1e5, kSlideStopDamping = 1e3;  // of prismatic joints [N/m], [N s/m]
// det J M⁻¹ Jᵀ below this part of that at the beginning is nearly singular.
constexpr double kSingular = 1e-3;

/// 0 where the matrix is not positive definite.
double determinant(const Eigen::LLT<Matrix6>& factors) noexcept {
  if (factors.info() != Eigen::Success) return 0.0;
  const double root = factors.matrixLLT().diagonal().prod();
  return root * root;
}

/// The largest eigenvalue of W M⁻¹, W a diagonal of numbers >= 0, by power iteration from below: for the length of steps.
double largest_rate(const ArmModel::Joints& weights, const InertiaFactors& M) noexcept {
  const ArmModel::Joints root = weights.cwiseSqrt();
  ArmModel::Joints x = ArmModel::Joints::Ones(root.size());
  double largest = 0.0;
  for (int i = 0; i < 64; ++i) {
    x = root.cwiseProduct(M.solve(root.cwiseProduct(x)));
    largest = x.norm();
    if (!(largest > 0.0)) return 0.0;
    x /= largest;
  }
  return largest;
}

/// The tool with the hand's mass and inertia on it.
ArmTool with_hand(const ArmSpec& arm, const std::optional<HandOnTool>& hand) {
  ArmTool tool{.mass_kg = arm.tool_mass_kg, .center_m = vector<3>(arm.tool_center_m)};
  if (!hand) return tool;
  const double mass = tool.mass_kg + hand->spec.mass_kg;
  tool.inertia = hand->spec.inertia_kg_m2 * Eigen::Matrix3d::Identity();
  if (!(mass > 0.0)) return tool;
  // Two points: their reduced mass turns about the common centre.
  const Eigen::Vector3d c = tool.center_m;
  tool.inertia +=
      tool.mass_kg * hand->spec.mass_kg / mass * (c.squaredNorm() * Eigen::Matrix3d::Identity() - c * c.transpose());
  tool.center_m = tool.mass_kg / mass * c;
  tool.mass_kg = mass;
  return tool;
}

ArmModel with_tool(const ArmSpec& arm, const ArmTool& tool, const ArmModel::Joints& q, const Position<6>& start) {
  const Eigen::Matrix3d flange = ArmModel{*arm.parameters}.pose(q).tool_rotation;
  return ArmModel{*arm.parameters, tool, flange.transpose() * start.attitude().toRotationMatrix()};
}

}  // namespace

ArmPlant::ArmPlant(const ArmSpec& arm, std::shared_ptr<const Environment<6>> environment, double dt,
                   const Position<6>& start, const std::optional<HandOnTool>& hand)
    : environment_{std::move(environment)},
      dt_{dt},
      arm_{arm},
      tool_{with_hand(arm, hand)},
      home_{joint_vector(arm_.joint_position_rad)},
      model_{with_tool(arm_, tool_, home_, start)},
      bare_{*arm_.parameters},
      s_{home_, zero_},
      clearance_{environment_->clearance()} {
  senses_tool_ = tool_.mass_kg > 0.0 || !tool_.inertia.isZero(0.0);
  hand_ = hand;
  for (std::size_t i = 0; i < arm_.parameters->joints.size(); ++i) {
    const ArmJoint& j = arm_.parameters->joints[i];
    const auto c = static_cast<int>(i);
    const bool slides = j.type == JointType::prismatic;
    most_torque_[c] = j.max_effort, lower_[c] = j.lower, upper_[c] = j.upper;
    damping_[c] = j.damping.value_or(arm_.joint_damping_n_m_s_per_rad);
    stop_stiffness_[c] = slides ? kSlideStopStiffness : kStopStiffness;
    stop_damping_[c] = slides ? kSlideStopDamping : kStopDamping;
  }
  if (arm_.force_feedback_cutoff_hz > 0.0)
    sensor_weight_ = -std::expm1(-2.0 * std::numbers::pi * arm_.force_feedback_cutoff_hz * dt_);
  const ArmModel::Pose pose = model_.pose(s_.q);
  base_ = start.translation() - pose.tool;
  const InertiaFactors inertia{model_.inertia(pose)};
  mobility_ = inertia.mobility(model_.jacobian(pose));
  regular_ = kSingular * determinant(mobility_.llt());
  // Rates of the fastest motions, for the length of steps: joints, their stops, and one contact of the tool.
  double stiffness = 0.0, damping = 0.0;
  for (const Surface& s : environment_->world().surfaces) {
    stiffness = std::max(stiffness, s.material.stiffness_n_per_m);
    damping = std::max(damping, s.material.all_damping_n_s_per_m());
    friction_ = std::max(friction_, s.material.friction);
  }
  const double linear = largest_eigenvalue(mobility_.topLeftCorner<3, 3>()),
               angular = largest_eigenvalue(mobility_.bottomRightCorner<3, 3>());
  for (const Eigen::Vector3d& point : environment_->tool())
    point_mobility_ = std::max(point_mobility_, linear + point.squaredNorm() * angular);
  const Joints most_damping = damping_.array() + arm_.null_space_damping_n_m_s_per_rad;
  rate_ = std::max({std::sqrt(stiffness * point_mobility_), damping * point_mobility_,
                    largest_rate(most_damping, inertia), std::sqrt(largest_rate(stop_stiffness_, inertia))});
  if (hand_) {
    const HandSpec& h = hand_->spec;
    rate_ = std::max({rate_, std::sqrt(h.stiffness_n_per_m * linear), h.damping_n_s_per_m * linear,
                      std::sqrt(h.rotational_stiffness_n_m_per_rad * angular),
                      h.rotational_damping_n_m_s_per_rad * angular});
  }
  if (!arm_.joint_coulomb_friction_n_m.empty()) coulomb_ = joint_vector(arm_.joint_coulomb_friction_n_m);
  dry_ = !coulomb_.isZero(0.0);
  torque_ = model_.gravity_torque(pose, kGravity);  // what holds it until the first command
  update();
}

BodyState<6> ArmPlant::advance(const Force<6>& f) noexcept {
  move(control(f.vec()));
  return body();
}

void ArmPlant::advance_joints(const Force<kJointPort>& torque) noexcept {
  const Joints gravity = model_.gravity_torque(now_.pose, kGravity);
  const Joints wanted = gravity + torque.vec().head(gravity.size());
  torque_ = wanted.cwiseMin(most_torque_).cwiseMax(-most_torque_);
  saturated_ = torque_ != wanted;
  commanded_ = torque_ - gravity;
  move(torque_);
}
void ArmPlant::kick_joints(const Velocity<kJointPort>& dv) noexcept {
  s_.v += dv.vec().head(s_.v.size());
  update();
}
BodyState<kJointPort> ArmPlant::joints() const noexcept {
  Velocity<kJointPort>::Vector q = Velocity<kJointPort>::Vector::Zero(), v = q;
  q.head(s_.q.size()) = s_.q;
  v.head(s_.v.size()) = s_.v;
  return {Position<kJointPort>{q}, Velocity<kJointPort>{v}};
}
Force<kJointPort> ArmPlant::outside_torque() const noexcept {
  Force<kJointPort>::Vector torque = Force<kJointPort>::Vector::Zero();
  torque.head(s_.q.size()) = now_.jacobian.transpose() * now_.outside;
  return Force<kJointPort>{torque};
}

/// One tick under `torque`.
void ArmPlant::move(const Joints& torque) noexcept {
  const Joints before = s_.q;
  // The sensor has read the force at the end of the last tick; from now on the hand moves at its new rate.
  if (hand_) meet_outside(now_, 0.0);
  double rate = std::max({rate_, std::sqrt(now_.stiffness * point_mobility_), now_.damping * point_mobility_});
  if (friction_ > 0.0)
    rate = std::max(rate, friction_ * now_.outside.template head<3>().norm() * point_mobility_ / kStictionSpeed);
  const int pieces = static_cast<int>(std::clamp(std::ceil(dt_ * rate / 0.1), 1.0, 256.0));
  const double h = dt_ / pieces;
  if (dry_) {
    move_with_friction(torque, h);
  } else {
    for (int i = 0; i < pieces; ++i) {
      const double t = i * h;
      const Step step = runge_kutta(i == 0 ? rates_now(torque) : rates(s_, torque, t), torque, t, h);
      s_ = step.to;
      outside_j_ += step.outside;
      dissipated_j_ += step.damping;
    }
  }
  const Joints turned = s_.q - before;
  energy_ += Energy{commanded_.dot(turned)};
  all_energy_ += Energy{torque.dot(turned)};
  if (hand_) {
    hand_->intended = hand_->next;
    hand_->rate = Velocity<6>{};
  }
  update();
}

/// A step of h from s_, at t, where the rate is a.
ArmPlant::Step ArmPlant::runge_kutta(const Rate& a, const Joints& torque, double t, double h) const noexcept {
  const Rate b = rates(moved(a, 0.5 * h), torque, t + 0.5 * h), c = rates(moved(b, 0.5 * h), torque, t + 0.5 * h),
             d = rates(moved(c, h), torque, t + h);
  return {{s_.q + h / 6.0 * (a.q + 2.0 * (b.q + c.q) + d.q), s_.v + h / 6.0 * (a.v + 2.0 * (b.v + c.v) + d.v)},
          h / 6.0 * (a.outside + 2.0 * (b.outside + c.outside) + d.outside),
          h / 6.0 * (damped(a.q) + 2.0 * (damped(b.q) + damped(c.q)) + damped(d.q))};
}

/// A tick in steps of at most `longest`, each ended where a joint stops or its friction releases it.
void ArmPlant::move_with_friction(const Joints& torque, double longest) noexcept {
  constexpr int kCuts = 64;      // of a tick; beyond, at steps only
  constexpr int kHalvings = 40;  // of a step, to find where it ends
  choose_directions(inertia_, load(s_, now_, torque) - bias_);
  Rate a = rates_now(torque);
  int cuts = 0;
  for (double t = 0.0; t < dt_;) {
    double h = longest < (1.0 - 1e-12) * (dt_ - t) ? longest : dt_ - t;
    Step step = runge_kutta(a, torque, t, h);
    const bool whole = h == dt_ - t;
    if (cuts < kCuts && !keeps(step, torque, t + h)) {
      ++cuts;
      double lo = 0.0, hi = h;
      for (int i = 0; i < kHalvings; ++i) {
        const double middle = 0.5 * (lo + hi);
        const Step trial = runge_kutta(a, torque, t, middle);
        if (keeps(trial, torque, t + middle))
          lo = middle;
        else
          hi = middle, step = trial;
      }
      h = hi;
    }
    dissipated_j_ += step.damping + coulomb_.dot((step.to.q - s_.q).cwiseAbs());
    outside_j_ += step.outside;
    s_ = step.to;
    for (int i = 0; i < model_.size(); ++i)
      if (coulomb_[i] > 0.0 && direction_[i] * s_.v[i] < 0.0) s_.v[i] = 0.0;
    t = whole && h == dt_ - t ? dt_ : t + h;
    const Kinematics k = kinematics(s_, t);
    const Inertia M = model_.inertia(k.pose);
    const Joints of_all = load(s_, k, torque) - model_.bias_torque(k.pose, s_.v, kGravity);
    choose_directions(M, of_all);
    a = {s_.v, acceleration(M, of_all), k.outside.dot(k.tool_velocity)};
  }
}
/// q̈ under the torques of all but friction, each joint in its direction.
ArmPlant::Joints ArmPlant::acceleration(const Inertia& M, const Joints& load) const noexcept {
  Inertia A = M;
  Joints b = load - coulomb_.cwiseProduct(direction_);
  for (int i = 0; i < model_.size(); ++i) {
    if (!(coulomb_[i] > 0.0) || direction_[i] != 0.0) continue;
    A.row(i).setZero();
    A.col(i).setZero();
    A(i, i) = 1.0;
    b[i] = 0.0;
  }
  return InertiaFactors{A}.solve(b);
}
/// Has no joint turned back, and does friction still hold those that it held?
bool ArmPlant::keeps(const Step& step, const Joints& torque, double t) const noexcept {
  bool holds = false;
  for (int i = 0; i < model_.size(); ++i) {
    if (direction_[i] * step.to.v[i] < 0.0 && coulomb_[i] > 0.0) return false;
    holds = holds || (direction_[i] == 0.0 && coulomb_[i] > 0.0);
  }
  if (!holds) return true;
  const Kinematics k = kinematics(step.to, t);
  const Inertia M = model_.inertia(k.pose);
  const Joints of_all = load(step.to, k, torque) - model_.bias_torque(k.pose, step.to.v, kGravity),
               carried = of_all - M * acceleration(M, of_all);
  for (int i = 0; i < model_.size(); ++i)
    if (direction_[i] == 0.0 && std::abs(carried[i]) > coulomb_[i]) return false;
  return true;
}
/// Which joints friction holds in s_, and where the others move: those at rest are released one after the other, the one that is farthest
/// beyond its limit first, and held again where that makes them turn against their direction.
void ArmPlant::choose_directions(const Inertia& M, const Joints& load) noexcept {
  for (int i = 0; i < model_.size(); ++i) direction_[i] = s_.v[i] > 0.0 ? 1.0 : s_.v[i] < 0.0 ? -1.0 : 0.0;
  for (int tries = 0; tries < 4 * model_.size(); ++tries) {
    const Joints a = acceleration(M, load), carried = load - M * a;
    int released = -1;
    double most = 1.0;
    bool held_again = false;
    for (int i = 0; i < model_.size(); ++i) {
      if (s_.v[i] != 0.0 || !(coulomb_[i] > 0.0)) continue;
      if (direction_[i] != 0.0) {
        if (direction_[i] * a[i] < 0.0) direction_[i] = 0.0, held_again = true;
      } else if (const double share = std::abs(carried[i]) / coulomb_[i]; share > most) {
        most = share, released = i;
      }
    }
    if (held_again) continue;
    if (released < 0) return;
    direction_[released] = carried[released] > 0.0 ? 1.0 : -1.0;
  }
}

void ArmPlant::lead(const Position<6>& intended) noexcept {
  hand_->next = intended;
  hand_->rate = (intended - hand_->intended) / Seconds{dt_};
}

double ArmPlant::mechanical_energy() const noexcept {
  const Joints beyond = over_stops(s_.q);
  return model_.energy(now_.pose, s_.v, kGravity) + 0.5 * beyond.dot(stop_stiffness_.cwiseProduct(beyond)) +
         environment_->potential(tool_position(now_.pose)).si();
}

void ArmPlant::set_state(const State& state) noexcept {
  s_ = state;
  update();
}

void ArmPlant::kick(const Velocity<6>& dv) noexcept {
  const auto& J = now_.jacobian;
  Matrix6 A = inverse_.mobility(J);
  s_.v += inverse_.solve(J.transpose() * factors(A).solve(dv.vec()));
  update();
}

/// How far each joint is beyond its limits; 0 within them.
ArmPlant::Joints ArmPlant::over_stops(const Joints& q) const noexcept {
  return (q - upper_).cwiseMax(0.0) + (q - lower_).cwiseMin(0.0);
}
ArmPlant::Joints ArmPlant::stops(const State& s) const noexcept {
  Joints torque = zero_;
  for (int i = 0; i < model_.size(); ++i) {
    const double k = stop_stiffness_[i], d = stop_damping_[i] * s.v[i];
    if (s.q[i] > upper_[i]) torque[i] = -std::max(0.0, k * (s.q[i] - upper_[i]) + d);
    if (s.q[i] < lower_[i]) torque[i] = std::max(0.0, k * (lower_[i] - s.q[i]) - d);
  }
  return torque;
}

/// Factors of A, to which is added what keeps its inverse bounded where the arm is nearly singular.
Eigen::LLT<ArmPlant::Matrix6> ArmPlant::factors(Matrix6& A) const noexcept {
  Eigen::LLT<Matrix6> of{A};
  const double d = determinant(of);
  if (d >= regular_) return of;
  A.diagonal() += 0.1 * (1.0 - d / regular_) * mobility_.diagonal();
  return of.compute(A);
}

/// Wrench of the force feedback under the wrench f on the arm without its tool: G f, or (Λ D⁻¹ Λ⁻¹ D⁻¹ - 1) f.
ArmPlant::Vector6 ArmPlant::feedback(const Vector6& f) const noexcept {
  const double gain = arm_.force_feedback_gain, torque_gain = arm_.force_feedback_torque_gain;
  if (torque_gain == gain) return gain * f;
  Vector6 lighter;
  lighter << Eigen::Vector3d::Constant(std::sqrt(1.0 + gain)), Eigen::Vector3d::Constant(std::sqrt(1.0 + torque_gain));
  Matrix6 A = InertiaFactors{bare_.inertia(now_.pose)}.mobility(now_.jacobian);
  const Eigen::LLT<Matrix6> inverse = factors(A);
  return inverse.solve(lighter.cwiseProduct(A * lighter.cwiseProduct(f))) - f;
}

/// Torques for the coming tick.
ArmPlant::Joints ArmPlant::control(const Vector6& wrench) noexcept {
  const auto& J = now_.jacobian;
  const Joints gravity = model_.gravity_torque(now_.pose, kGravity);
  Joints within = zero_;
  if (model_.size() > 6) {
    within = arm_.null_space_stiffness_n_m_per_rad * (home_ - s_.q) - arm_.null_space_damping_n_m_s_per_rad * s_.v;
    Matrix6 A = inverse_.mobility(J);
    within -= J.transpose() * factors(A).solve(J * inverse_.solve(within));
  }
  if (arm_.force_feedback_gain > 0.0 || arm_.force_feedback_torque_gain > 0.0) {
    sensed_ += sensor_weight_ * (now_.outside + inertial_ - sensed_);
    within += J.transpose() * feedback(wrench + sensed_);
  }
  const Joints wanted = gravity + J.transpose() * wrench + within;
  torque_ = wanted.cwiseMin(most_torque_).cwiseMax(-most_torque_);
  saturated_ = torque_ != wanted;
  commanded_ = torque_ - gravity - within;
  return torque_;
}

ArmPlant::Kinematics ArmPlant::kinematics(const State& s, double t) const noexcept {
  Kinematics k;
  k.pose = model_.pose(s.q);
  k.jacobian = model_.jacobian(k.pose);
  k.tool_velocity = k.jacobian * s.v;
  meet_outside(k, t);
  return k;
}
/// What environment and hand do at this pose and velocity.
void ArmPlant::meet_outside(Kinematics& k, double t) const noexcept {
  const Vector6& v = k.tool_velocity;
  const Position<6> at = tool_position(k.pose);
  SpatialVector sum = SpatialVector::Zero();
  k.stiffness = k.damping = 0.0;
  if (!environment_->empty())
    environment_->for_each_contact(at, port_vector<6>(v), clearance_, [&](const ContactPort<6>& c) {
      if (!c.presses) return;
      sum += c.normal + c.tangential;
      const auto [stiffness, damping] = environment_->impedance_of(c.index);
      k.stiffness += stiffness;
      k.damping += damping;
    });
  k.outside << sum.linear, sum.angular;
  if (hand_) {
    const HandSpec& h = hand_->spec;
    const Vector6 rate = hand_->rate.vec(), push = vector<6>(h.force_n);
    const Position<6> target =
        rate.isZero(0.0) ? hand_->intended : hand_->intended + Displacement<6>{Vector6{t * rate}};
    const Vector6 stretch = (target - at).vec(), by = rate - v;
    k.outside.template head<3>() += h.stiffness_n_per_m * stretch.template head<3>() +
                                    h.damping_n_s_per_m * by.template head<3>() + push.template head<3>();
    k.outside.template tail<3>() += h.rotational_stiffness_n_m_per_rad * stretch.template tail<3>() +
                                    h.rotational_damping_n_m_s_per_rad * by.template tail<3>() +
                                    push.template tail<3>();
  }
}
/// Torques of all that acts but weight and inertial forces.
ArmPlant::Joints ArmPlant::load(const State& s, const Kinematics& k, const Joints& torque) const noexcept {
  return torque + k.jacobian.transpose() * k.outside - damping_.cwiseProduct(s.v) + stops(s);
}
/// q̇ and q̈.
ArmPlant::Rate ArmPlant::rates(const State& s, const Joints& torque, double t) const noexcept {
  const Kinematics k = kinematics(s, t);
  const double outside = k.outside.dot(k.tool_velocity);
  const Joints of_all = load(s, k, torque);
  if (dry_) {
    const Joints all = of_all - model_.bias_torque(k.pose, s.v, kGravity);
    return {s.v, acceleration(model_.inertia(k.pose), all), outside};
  }
  return {s.v, model_.forward_dynamics(k.pose, s.v, of_all, kGravity), outside};
}
/// The same where the tick begins.
ArmPlant::Rate ArmPlant::rates_now(const Joints& torque) const noexcept {
  const Joints of_all = load(s_, now_, torque) - bias_;
  const double outside = now_.outside.dot(now_.tool_velocity);
  return {s_.v, dry_ ? acceleration(inertia_, of_all) : inverse_.solve(of_all), outside};
}

void ArmPlant::update() noexcept {
  now_ = kinematics(s_, 0.0);
  inertia_ = model_.inertia(now_.pose);
  inverse_ = InertiaFactors{inertia_};
  bias_ = model_.bias_torque(now_.pose, s_.v, kGravity);
  if (dry_) choose_directions(inertia_, load(s_, now_, torque_) - bias_);
  if (senses_tool_) sense_tool();
}
/// The inertial wrench of tool and hand.
void ArmPlant::sense_tool() noexcept {
  const Joints acceleration = rates_now(torque_).v;
  const Vector6 a = now_.jacobian * acceleration + model_.bias_acceleration(now_.pose, s_.v);
  const Eigen::Vector3d c = now_.pose.tool_rotation * tool_.center_m, w = now_.tool_velocity.template tail<3>(),
                        alpha = a.template tail<3>();
  const Eigen::Vector3d f = -tool_.mass_kg * (a.template head<3>() + alpha.cross(c) + w.cross(w.cross(c)));
  inertial_ << f, c.cross(f);
  if (!hand_) return;
  const Eigen::Matrix3d& R = now_.pose.tool_rotation;
  const Eigen::Vector3d spin = R * (tool_.inertia * (R.transpose() * w));
  inertial_.template tail<3>() -= R * (tool_.inertia * (R.transpose() * alpha)) + w.cross(spin);
}

WristCompensation::WristCompensation(const ArmSpec& arm, const ForceSensorSpec& sensor, std::uint64_t seed) {
  const Eigen::Vector3d center = vector<3>(arm.tool_center_m);
  true_ = {
      .mass_kg = arm.tool_mass_kg, .first_moment_kg_m = arm.tool_mass_kg * center, .bias = vector<6>(sensor.bias_n)};
  const Random random{seed ^ kStream};
  std::array<WristReading, 6> readings;
  for (std::size_t i = 0; i < readings.size(); ++i) {
    const Eigen::Vector3d axis = Eigen::Vector3d::Unit(static_cast<int>(i % 3));
    readings[i].attitude = Eigen::AngleAxisd{i < 3 ? 1.0 : -1.5, axis}.toRotationMatrix();
    readings[i].wrench = true_.reading(readings[i].attitude, ArmPlant::kGravity);
    for (unsigned k = 0; k < 6; ++k) readings[i].wrench[k] += sensor.noise_n * normal(random, i, k);
  }
  found_ = identify_tool(readings, ArmPlant::kGravity);
}

}  // namespace twoport::sim
