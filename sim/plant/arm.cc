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
// Steps: the rate of what oscillates times a step is at most kShort, that of what decays kShort/kDecay, of friction kShort/kStable of 2.8,
// beyond which none is stable. The stages of a step disagree by kError at most [rad/s], [m/s].
constexpr double kShort = 0.1, kDecay = 0.3, kStable = 0.05, kError = 1e-5, kSmallError = kError / 16,
                 kMostSteps = 256.0;
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
                   const Position<6>& start, const std::optional<HandOnTool>& hand,
                   const std::optional<ObjectSpec>& object)
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
  // Rates of the fastest motions, for the length of steps: joints, and one contact of the tool.
  double stiffness = 0.0, damping = 0.0;
  for (const Surface& s : environment_->world().surfaces) {
    stiffness = std::max(stiffness, s.material.stiffness_n_per_m);
    damping = std::max(damping, s.material.all_damping_n_s_per_m());
  }
  const double linear = largest_eigenvalue(mobility_.topLeftCorner<3, 3>()),
               angular = largest_eigenvalue(mobility_.bottomRightCorner<3, 3>());
  for (const Eigen::Vector3d& point : environment_->tool())
    point_mobility_ = std::max(point_mobility_, linear + point.squaredNorm() * angular);
  const Joints most_damping = damping_.array() + arm_.null_space_damping_n_m_s_per_rad;
  rate_ = std::max({std::sqrt(stiffness * point_mobility_), kDecay * damping * point_mobility_,
                    kDecay * largest_rate(most_damping, inertia)});
  stop_rate_ =
      std::max(std::sqrt(largest_rate(stop_stiffness_, inertia)), kDecay * largest_rate(stop_damping_, inertia));
  if (hand_) {
    const HandSpec& h = hand_->spec;
    rate_ = std::max({rate_, std::sqrt(h.stiffness_n_per_m * linear), kDecay * h.damping_n_s_per_m * linear,
                      std::sqrt(h.rotational_stiffness_n_m_per_rad * angular),
                      kDecay * h.rotational_damping_n_m_s_per_rad * angular});
  }
  const int last = model_.size() - 1;
  const double of_last = inertia.solve(Joints::Unit(model_.size(), last))[last];
  const auto hurry = [&](double k, double b, double per_kg) {
    rate_ = std::max({rate_, std::sqrt(k * per_kg), kDecay * b * per_kg});
  };
  if (hand_) hurry(hand_->finger_stiffness, hand_->finger_damping, of_last);
  if (object) {
    const Material& m = object->material;
    hurry(2.0 * m.stiffness_n_per_m, 2.0 * m.damping_n_s_per_m, of_last);
    hurry(2.0 * m.stiffness_n_per_m + stiffness, 2.0 * m.damping_n_s_per_m + damping, 1.0 / object->mass_kg);
    s_.object.x = object->position_m;
    Place at;
    find(s_.q, at);
    const Object::Fingers both = fingers(at, s_);
    object_.emplace(*object, environment_->world().surfaces, std::array{both[0].x, both[1].x});
    at_start_j_ = object_->forces(s_.object, both).elastic_j;
  }
  if (!arm_.joint_coulomb_friction_n_m.empty()) coulomb_ = joint_vector(arm_.joint_coulomb_friction_n_m);
  dry_ = !coulomb_.isZero(0.0);
  torque_ = model_.gravity_torque(pose, kGravity);  // what holds it until the first command
  arrive(0.0);
}

BodyState<6> ArmPlant::advance(const Force<6>& f) noexcept {
  control(f.vec());
  move();
  return body();
}

void ArmPlant::advance_joints(const Force<kJointPort>& torque) noexcept {
  const Joints gravity = model_.gravity_torque(now_.pose, kGravity);
  drive(torque.vec().head(gravity.size()), gravity);
  move();
}
void ArmPlant::kick_joints(const Velocity<kJointPort>& dv) noexcept {
  s_.v += dv.vec().head(s_.v.size());
  arrive(0.0);
}
BodyState<kJointPort> ArmPlant::joints() const noexcept {
  Velocity<kJointPort>::Vector q = Velocity<kJointPort>::Vector::Zero(), v = q;
  q.head(s_.q.size()) = s_.q;
  v.head(s_.v.size()) = s_.v;
  return {Position<kJointPort>{q}, Velocity<kJointPort>{v}};
}
Force<kJointPort> ArmPlant::outside_torque() const noexcept {
  Force<kJointPort>::Vector torque = Force<kJointPort>::Vector::Zero();
  torque.head(s_.q.size()) = now_.jacobian.transpose() * met_.outside;
  torque[s_.q.size() - 1] += met_.on_last_joint;
  return Force<kJointPort>{torque};
}

/// One tick under torque_, in steps that are short against the fastest motion and where their stages agree. With friction each ends where a
/// joint stops or is released.
void ArmPlant::move() noexcept {
  constexpr int kCuts = 64;  // of a tick; beyond, at steps only
  const Joints before = s_.q;
  // The sensor has read the force at the end of the last tick; from now on the hand moves at its new rate.
  if (hand_) met_ = meet(now_, s_, 0.0);
  if (dry_) choose_directions(now_, load(s_, now_, met_) - bias_);
  const double longest = dt_ / std::clamp(std::ceil(dt_ * rate() / kShort), 1.0, kMostSteps),
               shortest = dt_ / kMostSteps;
  int cuts = 0;
  double h = longest;
  for (double t = 0.0;;) {
    const double left = dt_ - t;
    h = h < (1.0 - 1e-12) * left ? h : left;
    const Rate a = rates_now();
    Step next = step(a, t, h);
    while (next.error > kError && h > shortest) next = step(a, t, h *= 0.5);
    const double wanted = next.error < kSmallError ? std::min(2.0 * h, longest) : h;
    const bool whole = h == left;
    double passed = h;
    if (dry_ && cuts < kCuts && !keeps(next, t + h)) {
      ++cuts;
      passed = last_that_keeps(a, t, next, h);
    }
    dissipated_j_ += next.damping + coulomb_.dot((next.to.q - s_.q).cwiseAbs());
    outside_j_ += next.outside;
    contacts_j_ += next.contacts;
    s_ = next.to;
    for (int i = 0; i < model_.size(); ++i)
      if (coulomb_[i] > 0.0 && direction_[i] * s_.v[i] < 0.0) s_.v[i] = 0.0;
    t = whole && passed == left ? dt_ : t + passed;
    if (!(t < dt_)) break;
    arrive(t);
    h = wanted;
  }
  const Joints turned = s_.q - before;
  energy_ += Energy{commanded_.dot(turned)};
  all_energy_ += Energy{torque_.dot(turned)};
  if (hand_) {
    hand_->intended = hand_->next;
    hand_->rate = Velocity<6>{};
    hand_->opening = hand_->next_opening;
    hand_->opening_rate = 0.0;
  }
  arrive(0.0);
}
/// Rate of the fastest motion now [1/s]; of what decays, kDecay of its rate, and of friction what keeps steps stable.
double ArmPlant::rate() const noexcept {
  constexpr double kNear_rad = 1e-3;
  double rate = std::max({rate_, std::sqrt(met_.stiffness * point_mobility_), kDecay * met_.damping * point_mobility_,
                          kStable * met_.friction * point_mobility_});
  const Joints reach = (2.0 * dt_) * s_.v.cwiseAbs() + Joints::Constant(s_.q.size(), kNear_rad);
  if (((s_.q + reach - upper_).array() > 0.0 || (s_.q - reach - lower_).array() < 0.0).any())
    rate = std::max(rate, stop_rate_);
  return rate;
}

/// A step of h from s_, at t, where the rate is a (E. J. Nyström, Acta Soc. Sci. Fennicae 50(13), 1925):
///
///     b, c at q + h/2 v + h²/8 a,  v + h/2 a, v + h/2 b       d at q + h v + h²/2 c,  v + h c
///     q += h v + h²/6 (a + b + c)      v += h/6 (a + 2 b + 2 c + d)
ArmPlant::Step ArmPlant::step(const Rate& a, double t, double h) const noexcept {
  const double m = 0.5 * h;
  const Object::Moving& o = s_.object;
  State s{s_.q + m * s_.v + (0.5 * m * m) * a.v,
          s_.v + m * a.v,
          {o.x + m * o.v + (0.5 * m * m) * a.object, o.v + m * a.object}};
  Place at;
  find(s.q, at);
  const Rate b = rates(at, s, t + m);
  s.v = s_.v + m * b.v;
  s.object.v = o.v + m * b.object;
  const Rate c = rates(at, s, t + m);
  s = {s_.q + h * s_.v + (m * h) * c.v, s_.v + h * c.v, {o.x + h * o.v + (m * h) * c.object, o.v + h * c.object}};
  find(s.q, at);
  const Rate d = rates(at, s, t + h);
  double error = h * (c.v - b.v).cwiseAbs().cwiseMax((a.v - b.v - c.v + d.v).cwiseAbs()).maxCoeff();
  if (object_)
    error = std::max({error, h * (c.object - b.object).cwiseAbs().maxCoeff(),
                      h * (a.object - b.object - c.object + d.object).cwiseAbs().maxCoeff()});
  return {{s_.q + h * s_.v + (h * h / 6.0) * (a.v + b.v + c.v),
           s_.v + h / 6.0 * (a.v + 2.0 * (b.v + c.v) + d.v),
           {o.x + h * o.v + (h * h / 6.0) * (a.object + b.object + c.object),
            o.v + h / 6.0 * (a.object + 2.0 * (b.object + c.object) + d.object)}},
          h / 6.0 * (a.outside + 2.0 * (b.outside + c.outside) + d.outside),
          h / 6.0 * (damped(a.q) + 2.0 * (damped(b.q) + damped(c.q)) + damped(d.q)),
          h / 6.0 * (a.contacts + 2.0 * (b.contacts + c.contacts) + d.contacts),
          error};
}
/// How much of a step of h friction keeps; `step` then is that.
double ArmPlant::last_that_keeps(const Rate& a, double t, Step& step, double h) const noexcept {
  constexpr int kHalvings = 40;
  double lo = 0.0, hi = h;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (lo + hi);
    const Step trial = this->step(a, t, middle);
    if (keeps(trial, t + middle))
      lo = middle;
    else
      hi = middle, step = trial;
  }
  return hi;
}
/// q̈ under the torques of all but friction, each joint in its direction.
ArmPlant::Joints ArmPlant::acceleration(const Place& at, const Joints& load) const noexcept {
  if (!dry_) return at.inverse.solve(load);
  Inertia A = at.inertia;
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
bool ArmPlant::keeps(const Step& step, double t) const noexcept {
  bool holds = false;
  for (int i = 0; i < model_.size(); ++i) {
    if (direction_[i] * step.to.v[i] < 0.0 && coulomb_[i] > 0.0) return false;
    holds = holds || (direction_[i] == 0.0 && coulomb_[i] > 0.0);
  }
  if (!holds) return true;
  Place at;
  find(step.to.q, at);
  const Joints of_all = load(step.to, at, meet(at, step.to, t)) - model_.bias_torque(at.pose, step.to.v, kGravity),
               carried = of_all - at.inertia * acceleration(at, of_all);
  for (int i = 0; i < model_.size(); ++i)
    if (direction_[i] == 0.0 && std::abs(carried[i]) > coulomb_[i]) return false;
  return true;
}
/// Which joints friction holds in s_, and where the others move: those at rest are released one after the other, the one that is farthest
/// beyond its limit first, and held again where that makes them turn against their direction.
void ArmPlant::choose_directions(const Place& at, const Joints& load) noexcept {
  for (int i = 0; i < model_.size(); ++i) direction_[i] = s_.v[i] > 0.0 ? 1.0 : s_.v[i] < 0.0 ? -1.0 : 0.0;
  for (int tries = 0; tries < 4 * model_.size(); ++tries) {
    const Joints a = acceleration(at, load), carried = load - at.inertia * a;
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

void ArmPlant::lead_finger(double opening_m) noexcept {
  hand_->next_opening = opening_m;
  hand_->opening_rate = (opening_m - hand_->opening) / dt_;
}

void ArmPlant::grip(const HandSpec& hand) noexcept {
  HandSpec& h = hand_->spec;
  h.stiffness_n_per_m = hand.stiffness_n_per_m;
  h.damping_n_s_per_m = hand.damping_n_s_per_m;
  h.rotational_stiffness_n_m_per_rad = hand.rotational_stiffness_n_m_per_rad;
  h.rotational_damping_n_m_s_per_rad = hand.rotational_damping_n_m_s_per_rad;
}

double ArmPlant::mechanical_energy() const noexcept {
  const Joints beyond = over_stops(s_.q);
  double of_object = 0.0;
  if (object_)
    of_object =
        met_.object_elastic_j + object_->spec().mass_kg * (0.5 * s_.object.v.squaredNorm() - kGravity.dot(s_.object.x));
  return of_object + model_.energy(now_.pose, s_.v, kGravity) + 0.5 * beyond.dot(stop_stiffness_.cwiseProduct(beyond)) +
         environment_->potential(tool_position(now_.pose)).si();
}

void ArmPlant::set_state(const State& state) noexcept {
  s_ = state;
  arrive(0.0);
}

void ArmPlant::kick(const Velocity<6>& dv) noexcept {
  const auto& J = now_.jacobian;
  Matrix6 A = now_.inverse.mobility(J);
  s_.v += now_.inverse.solve(J.transpose() * factors(A).solve(dv.vec()));
  arrive(0.0);
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
void ArmPlant::control(const Vector6& wrench) noexcept {
  const auto& J = now_.jacobian;
  const Joints gravity = model_.gravity_torque(now_.pose, kGravity);
  Joints within = zero_;
  if (model_.size() > 6) {
    within = arm_.null_space_stiffness_n_m_per_rad * (home_ - s_.q) - arm_.null_space_damping_n_m_s_per_rad * s_.v;
    Matrix6 A = now_.inverse.mobility(J);
    within -= J.transpose() * factors(A).solve(J * now_.inverse.solve(within));
  }
  if (arm_.force_feedback_gain > 0.0 || arm_.force_feedback_torque_gain > 0.0) {
    sensed_ += sensor_weight_ * (met_.outside + inertial() - sensed_);
    within += J.transpose() * feedback(wrench + sensed_);
  }
  drive(J.transpose() * wrench, gravity + within);
}
/// Beside the others that part of the command that keeps the limits; none where the others alone do not.
void ArmPlant::drive(const Joints& command, const Joints& others) noexcept {
  double part = 1.0;
  for (Eigen::Index i = 0; i < command.size(); ++i) {
    const double most = most_torque_[i], room = most - (command[i] > 0.0 ? others[i] : -others[i]);
    if (std::abs(others[i]) > most)
      part = 0.0;
    else if (part * std::abs(command[i]) > room)
      part = room / std::abs(command[i]);
  }
  applied_part_ = part;
  commanded_ = part * command;
  torque_ = (others + commanded_).cwiseMin(most_torque_).cwiseMax(-most_torque_);
}

void ArmPlant::find(const Joints& q, Place& at) const noexcept {
  at.pose = model_.pose(q);
  at.jacobian = model_.jacobian(at.pose);
  at.inertia = model_.inertia(at.pose);
  at.inverse = InertiaFactors{at.inertia};
}
/// What environment and hand do at this pose and velocity.
ArmPlant::Meeting ArmPlant::meet(const Place& place, const State& s, double t) const noexcept {
  Meeting m{.tool_velocity = place.jacobian * s.v, .outside = Vector6::Zero()};
  const Vector6& v = m.tool_velocity;
  if (environment_->empty() && !hand_ && !object_) return m;
  const Position<6> at = tool_position(place.pose);
  if (!environment_->empty()) {
    SpatialVector sum = SpatialVector::Zero();
    environment_->for_each_contact(at, port_vector<6>(v), clearance_, [&](const ContactPort<6>& c) {
      if (!c.presses) return;
      sum += c.normal + c.tangential;
      const auto [stiffness, damping] = environment_->impedance_of(c.index);
      m.stiffness += stiffness;
      m.damping += damping;
      m.friction += c.coulomb_damping;
    });
    m.outside << sum.linear, sum.angular;
  }
  if (hand_) {
    const HandSpec& h = hand_->spec;
    const Vector6 rate = hand_->rate.vec(), push = vector<6>(h.force_n);
    const Position<6> target =
        rate.isZero(0.0) ? hand_->intended : hand_->intended + Displacement<6>{Vector6{t * rate}};
    const Vector6 stretch = (target - at).vec(), by = rate - v;
    m.outside.template head<3>() += h.stiffness_n_per_m * stretch.template head<3>() +
                                    h.damping_n_s_per_m * by.template head<3>() + push.template head<3>();
    m.outside.template tail<3>() += h.rotational_stiffness_n_m_per_rad * stretch.template tail<3>() +
                                    h.rotational_damping_n_m_s_per_rad * by.template tail<3>() +
                                    push.template tail<3>();
    const auto last = s.q.size() - 1;
    m.on_last_joint = hand_->finger_stiffness * (hand_->opening + t * hand_->opening_rate - s.q[last]) +
                      hand_->finger_damping * (hand_->opening_rate - s.v[last]);
  }
  if (object_) {
    const Object::Fingers both = fingers(place, s);
    const Object::Forces f = object_->forces(s.object, both);
    const Eigen::Vector3d along = place.pose.moment[static_cast<std::size_t>(model_.size() - 1)],
                          arm = both[0].x - at.translation();
    m.outside.template head<3>() += f.on_finger[0] + f.on_finger[1];
    m.outside.template tail<3>() += arm.cross(f.on_finger[0] - f.on_finger[1]);
    m.on_last_joint += along.dot(f.on_finger[0] - f.on_finger[1]);
    m.on_object = f.on_box;
    m.contacts = f.power;
    m.object_elastic_j = f.elastic_j;
  }
  return m;
}
/// At ±q along the last joint's axis from the tool.
Object::Fingers ArmPlant::fingers(const Place& place, const State& s) const noexcept {
  const auto last = static_cast<std::size_t>(model_.size() - 1);
  const Eigen::Vector3d &along = place.pose.moment[last], tool = base_ + place.pose.tool;
  const Vector6 v = place.jacobian * s.v;
  const double q = s.q[model_.size() - 1], rate = s.v[model_.size() - 1];
  const Eigen::Vector3d arm = q * along, beside = v.template tail<3>().cross(arm) + rate * along;
  return {Object::Moving{tool + arm, v.template head<3>() + beside},
          Object::Moving{tool - arm, v.template head<3>() - beside}};
}
/// Of environment, hand and object on the arm [W].
double ArmPlant::power(const Meeting& m, const Joints& v) const noexcept {
  return m.outside.dot(m.tool_velocity) + m.on_last_joint * v[v.size() - 1];
}
Eigen::Vector3d ArmPlant::object_acceleration(const Meeting& m) const noexcept {
  if (!object_) return Eigen::Vector3d::Zero();
  return kGravity + m.on_object / object_->spec().mass_kg;
}
/// Torques of all that acts but weight and inertial forces.
ArmPlant::Joints ArmPlant::load(const State& s, const Place& at, const Meeting& m) const noexcept {
  Joints all = torque_ + at.jacobian.transpose() * m.outside - damping_.cwiseProduct(s.v) + stops(s);
  all[all.size() - 1] += m.on_last_joint;
  return all;
}
/// q̇ and q̈.
ArmPlant::Rate ArmPlant::rates(const Place& at, const State& s, double t) const noexcept {
  const Meeting m = meet(at, s, t);
  const Joints of_all = load(s, at, m) - model_.bias_torque(at.pose, s.v, kGravity);
  return {s.v, acceleration(at, of_all), power(m, s.v), object_acceleration(m), m.contacts};
}
/// The same of s_.
ArmPlant::Rate ArmPlant::rates_now() const noexcept {
  return {s_.v, acceleration(now_, load(s_, now_, met_) - bias_), power(met_, s_.v), object_acceleration(met_),
          met_.contacts};
}

/// In s_, at t of the tick.
void ArmPlant::arrive(double t) noexcept {
  find(s_.q, now_);
  if (object_) object_->settle(s_.object, fingers(now_, s_));
  met_ = meet(now_, s_, t);
  bias_ = model_.bias_torque(now_.pose, s_.v, kGravity);
  if (dry_) choose_directions(now_, load(s_, now_, met_) - bias_);
}
ArmPlant::Vector6 ArmPlant::inertial() const noexcept {
  if (!senses_tool_) return Vector6::Zero();
  const Joints acceleration = rates_now().v;
  const Vector6 a = now_.jacobian * acceleration + model_.bias_acceleration(now_.pose, s_.v);
  const Eigen::Vector3d c = now_.pose.tool_rotation * tool_.center_m, w = met_.tool_velocity.template tail<3>(),
                        alpha = a.template tail<3>();
  const Eigen::Vector3d f = -tool_.mass_kg * (a.template head<3>() + alpha.cross(c) + w.cross(w.cross(c)));
  Vector6 all;
  all << f, c.cross(f);
  if (!hand_) return all;
  const Eigen::Matrix3d& R = now_.pose.tool_rotation;
  const Eigen::Vector3d spin = R * (tool_.inertia * (R.transpose() * w));
  all.template tail<3>() -= R * (tool_.inertia * (R.transpose() * alpha)) + w.cross(spin);
  return all;
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
