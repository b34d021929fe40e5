#include "lab/study/adversary.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/base/check.h"
#include "common/base/normal.h"
#include "common/coupling/claim.h"
#include "common/coupling/registration.h"
#include "common/hardware/modulated_transformer.h"
#include "common/method/catalogue.h"
#include "common/passivity/velocity_predictor.h"
#include "common/scene/load.h"
#include "lab/engine/both_nodes.h"
#include "lab/study/map.h"
#include "sim/sim_joints.h"

namespace twoport::lab {
namespace {

/// Largest force of a hand and its change in a tick; the handle's damper, which is not of the hand, has the rest of what is assumed
/// within two. A torque counts by sqrt(m/J) in the change.
constexpr double kHand_n = 50.0, kHandChange_n = 0.45 * kHandForceChange_n;

/// A sequence of random numbers.
class Draw {
 public:
  explicit Draw(std::uint64_t seed) : random_{seed} {}
  double uniform(double from, double to) { return from + (to - from) * random_.uniform(i_++); }
  /// Uniform in the logarithm.
  double decades(double from, double to) { return from * std::pow(to / from, random_.uniform(i_++)); }
  bool once_in(int n) { return uniform(0.0, n) < 1.0; }
  int below(int n) { return static_cast<int>(uniform(0.0, n)); }
  template <int K>
  Eigen::Matrix<double, K, 1> direction() {
    Eigen::Matrix<double, K, 1> v;
    for (int i = 0; i < K; ++i) v[i] = normal(random_, i_++);
    return v.normalized();
  }

 private:
  Random random_;
  std::uint64_t i_ = 0;
};

/// A mass with a damper that its own force, which it chooses, and the port's move. Exact for held forces, for N = 6 with
/// equal moments of inertia.
template <int N>
class Body {
 public:
  using Vector = typename Force<N>::Vector;

  /// `is_hand`: it keeps to the limits of a hand and is never held still.
  Body(double mass_kg, double inertia_kg_m2, double damping_n_s_per_m, bool is_hand, Draw& draw, Seconds dt)
      : dt_{dt.si()}, is_hand_{is_hand}, size_{Vector::Ones()}, draw_{draw} {
    mass_.setConstant(mass_kg);
    damping_.setConstant(damping_n_s_per_m);
    if constexpr (N == 6) {
      mass_.template tail<3>().setConstant(inertia_kg_m2);
      damping_.template tail<3>().setConstant(damping_n_s_per_m * inertia_kg_m2 / mass_kg);
      size_.template tail<3>().setConstant(inertia_kg_m2 / mass_kg / 0.03);  // torque for a force, angle for a length
    }
    rise_s_ = draw.decades(5e-3, 5e-2);
    strength_n_ = draw.decades(1.0, 20.0);
  }

  /// From now on it comes to rest, a hand on a spring where it is, and after `steps` it is held still.
  void rest(int steps) {
    rests_ = true;
    held_after_ = steps;
    target_ = moved_;
    stiffness_ = is_hand_ ? std::min(500.0, 0.1 * mass_[0] / (dt_ * dt_)) : 0.0;
    brake_ = std::min(20.0 * mass_[0], 0.2 * mass_[0] / dt_);
  }
  /// Advances by one tick under the port's force on it, held. Returns ∫v dt, with which the force does its work. N = 6: the
  /// attitude turns by log ΔR = ∫ω dt - T²/12 ω(0)×ω(T), as the axis turns within the tick.
  Displacement<N> advance(const Force<N>& port) {
    const bool begins = !rests_ && left_-- <= 0;
    if (begins) choose();
    if (rests_) {
      does_ = Does::spring, goal_ = target_;
      still_ = is_hand_ && held_after_-- <= 0;
    }
    t_s_ += dt_;
    const Vector p = port.vec(), per_mass = mass_ / mass_[0];
    // Of velocity and position, at once; of the port's force, after its rise.
    Vector at_once = -std::min(strength_n_ * v_.norm(), 0.2 * mass_[0] / dt_) * per_mass.cwiseProduct(v_);
    Vector late = Vector::Zero();
    switch (does_) {
      case Does::spring:
        target_ += dt_ / 0.1 * (goal_ - target_);
        at_once += per_mass.cwiseProduct(stiffness_ * (target_ - moved_) - brake_ * v_);
        break;
      case Does::along:
        late = strength_n_ / (p.norm() + 0.1) * p;
        break;
      case Does::against:
        at_once -= brake_ * per_mass.cwiseProduct(v_);
        late = -gain_ * p;
        break;
      case Does::sine:
        at_once += strength_n_ * std::sin(6.28318530717959 * frequency_hz_ * t_s_) * size_.cwiseProduct(axis_);
        break;
      case Does::nothing:
        break;
    }
    late_ += std::min(1.0, dt_ / rise_s_) * (late - late_);
    if (begins) from_before_ = own_ - at_once - late_;
    from_before_ *= std::max(0.0, 1.0 - dt_ / rise_s_);
    const Vector last = own_;
    own_ = at_once + late_ + from_before_;
    if (is_hand_) {
      const double change_n = ((own_ - last).array() / per_mass.array().sqrt()).matrix().norm();
      if (change_n > kHandChange_n) own_ = last + kHandChange_n / change_n * (own_ - last);
      if (own_.norm() > kHand_n) own_ *= kHand_n / own_.norm();
    }
    Vector by = Vector::Zero();
    const Vector v = v_;
    if (still_) {
      v_.setZero();
      own_ = -p;
    } else {
      const Vector f = own_ + p;
      for (int i = 0; i < N; ++i) {
        const double rate = damping_[i] / mass_[i], end = rate > 0.0 ? f[i] / damping_[i] : 0.0;
        if (rate > 0.0) {
          const double gone = -std::expm1(-rate * dt_);
          by[i] = end * dt_ + (v_[i] - end) * gone / rate;
          v_[i] += (end - v_[i]) * gone;
        } else {
          by[i] = dt_ * (v_[i] + 0.5 * dt_ * f[i] / mass_[i]);
          v_[i] += dt_ * f[i] / mass_[i];
        }
      }
    }
    moved_ += by;
    Vector turned = by;
    if constexpr (N == 6)
      turned.template tail<3>() -=
          dt_ * dt_ / 12.0 * Eigen::Vector3d{v.template tail<3>()}.cross(Eigen::Vector3d{v_.template tail<3>()});
    x_ = x_ + Displacement<N>{turned};
    return Displacement<N>{by};
  }

  [[nodiscard]] const Position<N>& x() const { return x_; }
  [[nodiscard]] Velocity<N> v() const { return Velocity<N>{v_}; }
  /// Of what holds it.
  [[nodiscard]] Force<N> own_force() const { return Force<N>{own_}; }
  [[nodiscard]] const Vector& mass() const { return mass_; }
  [[nodiscard]] const Vector& damping() const { return damping_; }

 private:
  enum class Does : unsigned char { spring, along, against, sine, nothing };

  void choose() {
    left_ = static_cast<int>(draw_.uniform(0.01, 0.3) / dt_);
    does_ = static_cast<Does>(draw_.below(5));
    still_ = !is_hand_ && draw_.once_in(4);
    goal_ = draw_.uniform(0.0, 0.05) * draw_.template direction<N>();
    axis_ = draw_.template direction<N>();
    // A held spring and damper are active beyond these shares.
    stiffness_ = std::min(draw_.decades(100.0, 1500.0), 0.1 * mass_[0] / (dt_ * dt_));
    brake_ = std::min(draw_.decades(0.3, 10.0), 0.2 * mass_[0] / dt_);
    gain_ = draw_.uniform(0.3, 1.5);
    frequency_hz_ = draw_.decades(0.5, 20.0);
  }

  double dt_;
  bool is_hand_;
  Vector mass_, damping_, size_;
  Draw& draw_;
  double rise_s_ = 0.0, strength_n_ = 0.0;
  Position<N> x_;
  Vector v_ = Vector::Zero(), own_ = Vector::Zero(), moved_ = Vector::Zero(), target_ = Vector::Zero();
  Vector late_ = Vector::Zero(), from_before_ = Vector::Zero();  // parts of own_
  bool rests_ = false;
  int held_after_ = 0;
  // What it does for a while.
  int left_ = 0;
  double t_s_ = 0.0;
  Does does_ = Does::nothing;
  bool still_ = false;
  Vector goal_ = Vector::Zero(), axis_ = Vector::Zero();
  double stiffness_ = 0.0, brake_ = 0.0, gain_ = 0.0, frequency_hz_ = 0.0;
};

std::string way(Draw& draw) {
  const double delay_ms = draw.once_in(4) ? 0.0 : draw.decades(1.0, 200.0);
  std::string all = fmt::format("delay_ms: {}", delay_ms);
  if (draw.once_in(2)) all += fmt::format(" jitter_ms: {}", draw.uniform(0.0, 0.5) * delay_ms);
  if (draw.once_in(3)) all += fmt::format(" loss: {}", draw.uniform(0.0, 0.9));
  if (draw.once_in(4)) all += fmt::format(" burst {{ p: {} r: {} }}", draw.decades(1e-3, 0.1), draw.decades(0.01, 0.5));
  if (draw.once_in(3)) all += fmt::format(" duplicate: {}", draw.uniform(0.0, 0.5));
  if (draw.once_in(3)) all += fmt::format(" reorder: {}", draw.uniform(0.0, 0.5));
  if (draw.once_in(4))
    all += fmt::format(" blackout {{ start_s: {} duration_s: {} }}", draw.uniform(0.1, 0.6), draw.decades(0.02, 0.5));
  return all;
}

/// Limits of one side.
std::string limits(const char* name, bool at_robot, Draw& draw) {
  std::string all;
  const int which = draw.below(at_robot ? 6 : 5);
  if (which == 0 || draw.once_in(3)) all += fmt::format(" force_n: {}", draw.decades(0.5, 20.0));
  if (which == 1) all += fmt::format(" force_rate_n_per_s: {}", draw.decades(50.0, 5000.0));
  if (which == 2) all += fmt::format(" power_w: {}", draw.decades(0.05, 5.0));
  if (which == 3) all += fmt::format(" speed_m_per_s: {}", draw.decades(0.03, 1.0));
  if (which == 4) all += fmt::format(" workspace_m: {}", draw.decades(3e-3, 0.1));
  if (which == 5) all += fmt::format(" set_point_step_m: {}", draw.decades(1e-6, 1e-3));
  return fmt::format("{} {{{} }} ", name, all);
}

/// control { ... } of a method; `at_s`: in an entry of the schedule.
std::string method_text(const std::string& method, const char* initial, Draw& draw) {
  const std::size_t plus = method.find('+');
  if (plus == std::string::npos) return fmt::format("passivity {{ method: {}{} }} ", method, initial);
  const TransparencyLayerName* transparency = find_name(kTransparencyLayers, method.substr(0, plus));
  const std::string random =
      transparency != nullptr && transparency->is_random
          ? fmt::format(" random {{ force_n: {} hold_ms: {} }}", draw.decades(0.5, 50.0), draw.decades(0.5, 100.0))
          : std::string{};
  return fmt::format("passivity {{ layer: {}{} }} transparency {{ layer: {}{} }} ", method.substr(plus + 1), initial,
                     method.substr(0, plus), random);
}

Claim usual_claim(const std::string& method) {
  ControlOptions o;
  o.handle_mass_kg = 0.1;
  return choose_method(o, method) ? claim_of(o) : Claim{};
}

/// Switches to pairs that claim the hand's port, as this method does; one to four of them.
std::string schedule_of(const std::string& method, double duration_s, Draw& also) {
  static const std::vector<std::string> claiming = claiming_methods();
  const Claim claim = usual_claim(method);
  std::vector<std::string> others;
  for (const std::string& each : claiming) {
    const Claim of = usual_claim(each);
    if (claim.hand && of.hand) others.push_back(each);
  }
  if (others.empty()) return {};
  std::string all = fmt::format("engage_s: {} ", also.decades(0.01, 1.0));
  std::vector<double> at_s(static_cast<std::size_t>(1 + also.below(4)));
  for (double& each : at_s) each = also.uniform(0.1, 0.9) * duration_s;
  std::sort(at_s.begin(), at_s.end());
  for (const double each : at_s)
    all += fmt::format(
        "schedule {{ at_s: {} {}}} ", each,
        method_text(others[static_cast<std::size_t>(also.below(static_cast<int>(others.size())))], "", also));
  return all;
}

/// Two arms with the same number of joints, a hand that holds the leader's tool, and what the follower's touches.
std::string arms_text(double rate_hz, Draw& draw) {
  constexpr const char* kSeven[] = {"panda", "fr3", "iiwa14"};
  const bool six = draw.once_in(4);
  const auto arm = [&] {
    std::string text = fmt::format("arm {{ file: \"{}\" tool_mass_kg: {} joint_damping_n_m_s_per_rad: {} ",
                                   six ? "ur5e" : kSeven[draw.below(3)], draw.once_in(2) ? 0.0 : draw.decades(0.1, 3.0),
                                   draw.decades(0.05, 5.0));
    if (draw.once_in(6))
      text += fmt::format("joint_coulomb_friction_n_m: [{}] ",
                          fmt::join(std::vector<double>(six ? 6 : 7, draw.decades(0.05, 2.0)), ", "));
    return text + "}";
  };
  std::string text = fmt::format("operator {{ hand {{ mass_kg: {} stiffness_n_per_m: {} damping_n_s_per_m: {} ",
                                 draw.decades(0.02, 0.5), draw.decades(100.0, 2000.0), draw.decades(2.0, 40.0));
  if (draw.once_in(2))
    text +=
        fmt::format("inertia_kg_m2: 1e-4 rotational_stiffness_n_m_per_rad: {} rotational_damping_n_m_s_per_rad: {} ",
                    draw.decades(1.0, 50.0), draw.decades(0.05, 2.0));
  text += "} ";
  for (int left = 2 + draw.below(4); left > 0; --left) {
    const Eigen::Vector3d to = draw.uniform(0.0, 0.1) * draw.direction<3>();
    if (draw.once_in(3))
      text += fmt::format("path {{ sine {{ axis: {} amplitude_m: {} frequency_hz: {} duration_s: {} }} }} ",
                          draw.below(3), draw.decades(0.005, 0.1), draw.decades(0.3, 6.0), draw.uniform(0.2, 1.0));
    else
      text += fmt::format("path {{ move_to {{ position_m: [{}, {}, {}] duration_s: {} }} }} ", to.x(), to.y(), to.z(),
                          draw.uniform(0.1, 1.0));
  }
  if (draw.once_in(4)) text += fmt::format("tremor {{ rms_m: {} }} ", draw.decades(1e-5, 3e-3));
  text += "} device { " + arm();
  text += " } robot { " + arm() + " force_sensor { } }";
  for (int left = 1 + draw.below(3); left > 0; --left) {
    const Eigen::Vector3d n = draw.direction<3>();
    text += fmt::format(
        " environment {{ wall {{ normal: [{}, {}, {}] offset_m: {} stiffness_n_per_m: {} friction: {} }} }}", n.x(),
        n.y(), n.z(), -draw.decades(0.002, 0.08), std::min(draw.decades(300.0, 2e4), 0.02 * rate_hz * rate_hz),
        draw.once_in(2) ? 0.0 : draw.uniform(0.0, 0.8));
  }
  return text;
}

/// Scene of a run; `draw` and `also` go on with what the scene does not hold.
Scene scene_of(const std::string& method, AdversaryRun& run, Draw& draw, Draw& also,
               const std::vector<std::string>& set) {
  constexpr double kRates[] = {250.0, 500.0, 1000.0, 2000.0, 4000.0};
  constexpr double kUnequal[] = {125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0};
  const int dof = run.dof;
  const double rate_hz = kRates[draw.below(5)], mass_kg = draw.decades(0.03, 0.5), robot_kg = draw.decades(0.2, 3.0);
  const bool unequal = also.once_in(3);
  double master_hz = rate_hz, slave_hz = rate_hz;
  if (unequal) master_hz = kUnequal[also.below(6)], slave_hz = kUnequal[also.below(6)];
  if (run.rests) master_hz = std::min(master_hz, 1000.0), slave_hz = std::min(slave_hz, 1000.0);
  // A coupling that the sampled loop holds without a delay.
  const double least_kg = std::min(mass_kg, robot_kg), least_hz = std::min(master_hz, slave_hz);
  const double stiffness = std::min(draw.decades(300.0, 2000.0), 0.05 * least_kg * least_hz * least_hz);
  const double damping = std::min(draw.uniform(0.2, 1.0) * std::sqrt(stiffness * robot_kg), 0.2 * least_kg * least_hz);
  const auto six = [&](double kg) { return dof == 6 ? fmt::format(" inertia_kg_m2: {}", 1e-3 * kg) : std::string{}; };
  std::string text;
  if (dof == kJointPort) {
    text = fmt::format("space: JOINTS duration_s: 1 rate_hz: {} slave_rate_hz: {} seed: {} ", master_hz, slave_hz,
                       draw.below(1 << 30)) +
           arms_text(least_hz, draw);
  } else {
    text = fmt::format(
        "dof: {} duration_s: 1 rate_hz: {} slave_rate_hz: {} seed: {} device {{ mass_kg: {} damping_n_s_per_m: {} "
        "max_force_n: {}",
        dof, master_hz, slave_hz, draw.below(1 << 30), mass_kg, draw.decades(0.01, 0.5), draw.decades(3.0, 30.0));
    text += six(mass_kg) + fmt::format(" }} robot {{ mass_kg: {} force_sensor {{ }}{} }}", robot_kg, six(robot_kg));
  }
  text +=
      fmt::format(" control {{ virtual_coupling {{ stiffness_n_per_m: {} damping_n_s_per_m: {} ", stiffness, damping);
  if (dof == 6)
    text += fmt::format("rotational_stiffness_n_m_per_rad: {} rotational_damping_n_m_s_per_rad: {} ", 1e-3 * stiffness,
                        1e-3 * damping);
  text +=
      "} " + method_text(method,
                         also.once_in(20) ? " initial_energy_j: 1e-3 observer: RECTANGLE" : " initial_energy_j: 1e-3",
                         draw);
  if (also.once_in(3))
    text += fmt::format("force_scale: {} motion_scale: {} ", also.decades(0.1, 10.0), also.decades(0.1, 10.0));
  if (dof != kJointPort && also.once_in(3)) text += limits("device_limits", false, also);
  if (dof != kJointPort && also.once_in(3)) text += limits("robot_limits", true, also);
  const std::string to_slave = way(draw), to_master = way(draw);
  if (run.rests) text += "release_after_s: 0.3 ";
  if (also.once_in(3)) text += schedule_of(method, run.rests ? 2.0 : 1500.0 / master_hz, also);
  text += "} to_slave { " + to_slave + " } to_master { " + to_master + " }";
  if (also.once_in(4))
    text += fmt::format(" slave_clock {{ offset_ms: {} drift_ppm: {} }}", also.uniform(0.0, 1e4),
                        also.uniform(-500.0, 500.0));
  return parse_scene(text, "adversary", set);
}

/// Handle and robot of a run.
template <int N>
struct Bodies {
  Bodies(const Scene& s, Draw& draw, Seconds master_dt, Seconds slave_dt)
      : handle{s.device->mass_kg, 1e-3 * s.device->mass_kg, s.device->damping_n_s_per_m, true, draw, master_dt},
        robot{s.robot->mass_kg, 1e-3 * s.robot->mass_kg, 0.0, false, draw, slave_dt} {}
  Body<N> handle, robot;
};
/// The arms of the scene.
template <>
struct Bodies<kJointPort> {
  template <class Arm>
  class Joints {
   public:
    static constexpr int N = kJointPort;
    Joints(const Scene& s, const ArmSpec& arm, Seconds dt) : arm_{s, dt} {
      for (int i = 0; const ArmJoint& joint : arm.parameters->joints) damping_[i++] = joint.damping.value_or(0.0);
    }
    void rest(int) {
      if constexpr (requires { arm_.hold(); }) {
        arm_.hold();
      } else {
        arm_.silence();
      }
    }
    Displacement<N> advance(const Force<N>& port) {
      const Position<N> before = x();
      if constexpr (requires { arm_.hold(); }) {
        arm_.actuate(-port);
      } else {
        arm_.actuate(RobotCommand<N>{port, {}, {}});
      }
      arm_.advance();
      return x() - before;
    }
    [[nodiscard]] Position<N> x() const { return arm_.sense().x; }
    [[nodiscard]] Velocity<N> v() const { return arm_.sense().v; }
    [[nodiscard]] Force<N> own_force() const { return arm_.environment_force(); }
    [[nodiscard]] Force<N>::Vector mass() const { return Force<N>::Vector::Ones(); }
    [[nodiscard]] const Force<N>::Vector& damping() const { return damping_; }

   private:
    Arm arm_;
    Force<N>::Vector damping_ = Force<N>::Vector::Zero();
  };

  Bodies(const Scene& s, Draw&, Seconds master_dt, Seconds slave_dt)
      : handle{s, *s.device->arm, master_dt}, robot{s, *s.robot->arm, slave_dt} {}
  Joints<sim::SimDevice<kJointPort>> handle;
  Joints<sim::SimRobot<kJointPort>> robot;
};

/// While a queue holds them no packets come; afterwards some in a poll, the oldest first, until it is empty.
struct Queue {
  Duration from = Duration::max(), until = Duration::max();
  int at_once = 1 << 30;
};

/// One end of the network: a queue on the way in, and packets that come a second time.
template <int N>
class HostileTransport {
 public:
  using Line = DelayLine<Report<N>>;
  HostileTransport(Line& in, Line& out, const Queue& queue, double repeats, Draw& draw)
      : transport_{in, out}, in_{&in}, queue_{queue}, repeats_{repeats}, draw_{&draw} {
    if (repeats_ > 0.0) kept_.reserve(kKept);
  }

  template <class Visit>
  void poll(Duration now, Visit visit) noexcept {
    const Duration network = now - clock_ahead_;
    if (network >= queue_.from && network < queue_.until) return;
    int left = network >= queue_.until ? queue_.at_once : 1 << 30;
    while (left-- > 0) {
      const Report<N>* r = in_->take(network);
      if (r == nullptr) {
        if (network >= queue_.until) queue_.from = queue_.until = Duration::max();
        break;
      }
      if (repeats_ > 0.0) keep(*r, network);
      visit(*r);
    }
    if (repeats_ > 0.0 && !kept_.empty() && draw_->uniform(0.0, 1.0) < repeats_) {
      const Kept& old = kept_[static_cast<std::size_t>(draw_->below(static_cast<int>(kept_.size())))];
      if (network - old.at <= kAllowed) visit(old.report);
    }
  }
  void send(const auto& r, Duration now) noexcept { transport_.send(r, now); }
  void set_clock_ahead(Duration ahead) noexcept {
    clock_ahead_ = ahead;
    transport_.set_clock_ahead(ahead);
  }

 private:
  struct Kept {
    Report<N> report;
    Duration at;
  };
  static constexpr std::size_t kKept = 32;
  static constexpr Duration kAllowed = std::chrono::milliseconds{100};

  void keep(const Report<N>& r, Duration now) {
    if (kept_.size() < kKept) {
      kept_.push_back({r, now});
    } else {
      kept_[next_++ % kKept] = {r, now};
    }
  }

  SimTransport<N> transport_;
  Line* in_;
  Queue queue_;
  double repeats_;
  Draw* draw_;
  Duration clock_ahead_{0};
  std::vector<Kept> kept_;
  std::size_t next_ = 0;
};

/// What the master is told instead of what the slave says; the lie changes from time to time.
template <int N>
class Lie {
 public:
  explicit Lie(Draw& draw) : draw_{draw} {}
  const PeerState<N>& of(const PeerState<N>& truth) {
    if (left_-- <= 0) {
      left_ = static_cast<int>(draw_.uniform(7.0, 400.0));
      force_ = draw_.uniform(0.0, 20.0) * draw_.template direction<N>();
      if constexpr (N == 6) force_.template tail<3>() *= 0.03;
      jump_ = draw_.uniform(0.0, 0.05) * draw_.template direction<N>();
      factor_ = draw_.uniform(-2.0, 3.0);
      energy_j_ = draw_.decades(1e-3, 1e3);
    }
    told_ = truth;
    if (!truth.has_report) return told_;
    told_.newest.f = Force<N>{force_};
    told_.newest.f_environment = Force<N>{factor_ * force_};
    told_.newest.f_coupling = told_.newest.f;
    told_.newest.x = truth.newest.x + Displacement<N>{jump_};
    told_.newest.v = factor_ * truth.newest.v;
    told_.energy_in_j += energy_j_;
    for (std::size_t i = 0; i < told_.words.count; ++i) told_.words.at[i] *= factor_;
    return told_;
  }

 private:
  Draw& draw_;
  PeerState<N> told_;
  int left_ = 0;
  typename Force<N>::Vector force_, jump_;
  double factor_ = 1.0, energy_j_ = 0.0;
};

/// The master's mailbox, unless `lie` is null with the lie in place of what is there.
template <int N>
struct ToldMail {
  const PeerState<N>& collect(Duration now) noexcept { return lie ? lie->of(mail.collect(now)) : mail.collect(now); }
  void post(auto&&... report) noexcept { mail.post(report...); }

  Mailbox<N, HostileTransport<N>> mail;
  Lie<N>* lie;
};

/// Clutch, locks and scales between hand and master, which change from time to time.
template <int N>
class AtWork {
 public:
  AtWork(bool acts, Seconds engage, Draw& draw) : acts_{acts}, engage_s_{engage.si()}, draw_{draw} {}
  [[nodiscard]] DeviceSample<N> reading(DeviceSample<N> s, double ended_s) {
    if (!acts_) return s;
    if (left_s_ <= 0.0) {
      left_s_ = draw_.decades(0.02, 0.5);
      transformer_.set({.clutched = draw_.once_in(5),
                        .locked = draw_.once_in(3) ? static_cast<std::uint32_t>(draw_.below(1 << N)) : 0U,
                        .motion = draw_.once_in(2) ? draw_.decades(0.05, 1.0) : 1.0,
                        .force = draw_.once_in(2) ? draw_.uniform(0.0, 1.0) : 1.0});
    }
    left_s_ -= ended_s;
    DeviceTruth<N> truth{};
    transformer_.step(s, truth, false, ended_s, engage_s_);
    return s;
  }
  [[nodiscard]] Force<N> to_hand(const Force<N>& f) { return acts_ ? transformer_.to_hand(f) : f; }

 private:
  bool acts_;
  double engage_s_, left_s_ = 0.1;
  Draw& draw_;
  ModulatedTransformer<N> transformer_;
};

/// Error of the handle's predicted velocity: EnergyClaim's e, of the handle's motion and the force that it was under.
template <int N>
class PredictionError {
 public:
  using Vector = typename Force<N>::Vector;
  /// `mobility`: C [m/(N s)].
  explicit PredictionError(const Vector& mobility) : mobility_{mobility}, free_{mobility} {}

  /// Of a tick under `held` with the mean velocity v.
  const Vector& step(const Vector& v, const Force<N>& held) {
    const Vector added = v - v_ + mobility_.cwiseProduct(held_ + held.vec());
    const Vector e = e_ - 0.25 * before_ + added - added_;
    before_ = e_, e_ = e;
    added_ = added, v_ = v, held_ = held.vec();
    return e_;
  }
  /// As PortVelocityPredictor has it. The ratio stays.
  void restart() { v_ = held_ = added_ = e_ = before_ = Vector::Zero(); }
  void take_ratio(const Vector& r, const Velocity<N>& v) {
    for (int i = 0; i < N; ++i) {
      const bool opens = ratio_[i] == 0.0;
      const double by = opens ? 0.0 : r[i] / ratio_[i];
      v_[i] = opens ? v[i] : by * v_[i];
      for (Vector* each : {&added_, &e_, &before_}) (*each)[i] *= by;
      held_[i] *= opens || r[i] == 0.0 ? 0.0 : ratio_[i] / r[i];
    }
    mobility_ = free_.cwiseProduct(r.cwiseAbs2());
    ratio_ = r;
  }

 private:
  Vector mobility_, free_, ratio_ = Vector::Ones(), v_ = Vector::Zero(), held_ = Vector::Zero(),
                           added_ = Vector::Zero();
  Vector e_ = Vector::Zero(), before_ = Vector::Zero();
};

/// Attitudes at the ticks do not tell such a motion from a shorter one.
template <int N>
bool is_half_a_turn(const Displacement<N>& by) {
  if constexpr (N == 6) {
    return by.vec().template tail<3>().norm() > 3.14159265358979;
  } else {
    return false;
  }
}

/// Energies of both ports, and of what the claim counts besides.
template <int N>
struct Energies {
  double hand_j = 0.0, damped_j = 0.0, robot_j = 0.0;  ///< robot_j in the slave's units
  double hand_largest2 = 0.0, robot_largest2 = 0.0;    ///< (motion in a tick)²
};

/// A hand that stands still against a drawn force, behind which there is no robot, pushes; the layer after a switch may give the robot
/// that push.
bool leaves_random_layer(const Scene& scene) {
  return transparency_layer(scene.control).is_random &&
         std::any_of(scene.schedule.begin(), scene.schedule.end(),
                     [](const auto& entry) { return !transparency_layer(entry.control).is_random; });
}

/// When hand and environment begin to rest, are at rest, and the queue flows [s].
constexpr double kRest_s = 0.7, kFlow_s = 1.6, kRestEnd_s = 2.2;

template <int N>
AdversaryRun run_of(const std::string& method, AdversaryRun out, Draw& draw, const std::vector<std::string>& set) {
  Draw also{out.seed ^ 0x6d6f7265};
  out.rests = also.once_in(5) && N != kJointPort;  // an arm that is let go swings on
  const Scene scene = scene_of(method, out, draw, also, set);
  out.rate_hz = scene.master_rate_hz;
  out.switches = static_cast<int>(scene.schedule.size());
  if (out.rests) out.lies = false;
  TickOrder order{scene};
  const Seconds master_dt{1.0 / scene.master_rate_hz}, slave_dt{1.0 / scene.slave_rate_hz};
  const double ticks = std::clamp(
      scene.master_rate_hz * (1.0 + 4.0 * (scene.to_slave.delay_s + scene.to_master.delay_s)), 1500.0, 4000.0);
  const double duration_s =
      out.rests ? kRestEnd_s : std::min(ticks / scene.master_rate_hz, 8000.0 / scene.slave_rate_hz);
  const Claim claim = claim_of(scene.control, scene.schedule);

  Queue to_slave, to_master;
  const auto hold = [&](Queue& queue, double from_s, double until_s) {
    queue.from = to_duration(from_s);
    if (until_s < duration_s) queue.until = to_duration(until_s);
    if (also.once_in(2)) queue.at_once = 1 + also.below(20);
  };
  if (out.rests) {
    const double from_s = also.uniform(0.2, 0.6);
    hold(to_slave, from_s, kFlow_s);
    if (also.once_in(2)) hold(to_master, from_s, kFlow_s);
  } else {
    for (Queue* each : {&to_slave, &to_master})
      if (also.once_in(4)) {
        const double from_s = also.uniform(0.1, 0.7) * duration_s;
        hold(*each, from_s, from_s + also.decades(0.02, 2.0));
      }
    if (also.once_in(10)) hold(also.once_in(2) ? to_slave : to_master, also.uniform(0.1, 0.9) * duration_s, duration_s);
  }
  AtWork<N> at_work{!out.rests && also.once_in(5), scene.control.engage, also};
  const double repeats = also.once_in(4) ? also.decades(0.01, 1.0) : 0.0;

  Bodies<N> bodies{scene, draw, master_dt, order.slave_period()};
  auto& handle = bodies.handle;
  auto& robot = bodies.robot;
  // Of a motion of joints in the metric of the nodes.
  const auto size2 = [&](const Displacement<N>& by) {
    if constexpr (N == kJointPort) {
      return by.vec().cwiseProduct(scene.control.joint_scale).squaredNorm();
    } else {
      return by.squared_norm();
    }
  };
  MasterNode<N> master{scene.control, scene.schedule};
  SlaveNode<N> slave{scene.control, scene.schedule};
  const auto room = [&](const ImpairmentOptions& way, const Queue& queue, double rate_hz) {
    const bool waits = queue.from < Duration::max();
    return packets_in_flight(way, rate_hz) + (waits ? static_cast<std::size_t>(2.0 * duration_s * rate_hz) : 0);
  };
  DelayLine<Report<N>> line_to_slave{scene.to_slave, scene.seed ^ kToSlaveStream,
                                     room(scene.to_slave, to_slave, scene.master_rate_hz)};
  DelayLine<Report<N>> line_to_master{scene.to_master, scene.seed ^ kToMasterStream,
                                      room(scene.to_master, to_master, scene.slave_rate_hz)};
  using Mail = Mailbox<N, HostileTransport<N>>;
  const AgeOptions age = age_of_reports(scene.control);
  Lie<N> lie{draw};
  ToldMail<N> master_mail{Mail{{line_to_master, line_to_slave, to_master, repeats, also}, age},
                          out.lies ? &lie : nullptr};
  Mail slave_mail{{line_to_slave, line_to_master, to_slave, repeats, also}, age};
  SwitchTimes times{scene.schedule};
  const Registration<N> registration{scene.control};
  PredictionError<N> error{0.5 * master_dt.si() * handle.mass().cwiseInverse()};
  Force<N> held, pushed;
  Energies<N> at;
  const auto in_master_units = [&](double j) { return registration.to_master(Energy{j}).si(); };
  const auto note_both = [&] {
    if (out.lies) return;
    const double robot_j = claim.robot_port ? at.robot_j : slave.delivered().si();
    out.both_least_j = std::min(out.both_least_j, at.hand_j - in_master_units(robot_j));
  };
  using Vector = typename Force<N>::Vector;
  const bool rested_only = !leaves_random_layer(scene);
  bool turns = false, rest = false, flows = false;
  Position<N> rested_at, port_before;
  const auto slave_tick = [&](TickAt when) {
    if (when.now > Duration{0}) {
      const Displacement<N> driven = robot.advance(pushed);
      if (is_half_a_turn(driven)) turns = true;
      at.robot_j += dot(pushed, driven).si();
      at.robot_largest2 = std::max(at.robot_largest2, size2(driven));
    }
    slave_mail.transport().set_clock_ahead(when.ahead);
    GivenReading<RobotSample<N>> reading{{robot.x(), robot.v(), -robot.own_force()}};
    const Tick<SlaveClock> tick{Instant<SlaveClock>{when.now + when.ahead}, slave_dt};
    pushed = run_cycle(slave, reading, slave_mail, tick).command.f;
    note_both();
  };
  const auto master_tick = [&](TickAt when) {
    const bool first = when.now == Duration{0};
    if (!first) {
      const Displacement<N> by = handle.advance(-held);
      if (is_half_a_turn(by)) turns = true;
      const double dt_s = master_dt.si();
      at.hand_j += dot(held, by).si();
      at.damped_j += handle.damping().dot(by.vec().cwiseAbs2()) / dt_s;
      at.hand_largest2 = std::max(at.hand_largest2, size2(by));
    }
    const DeviceSample<N> port = at_work.reading({handle.x(), handle.v(), held}, first ? 0.0 : master_dt.si());
    const std::uint32_t epoch = master.epoch();
    while (times.due(to_seconds(when.now).si(), master.epoch())) master.switch_to_next();
    if (!first) {
      const Vector v = (port.x - port_before).vec() / master_dt.si();
      out.unforeseen_j += master_dt.si() * std::abs(port.applied.vec().dot(error.step(v, port.applied)));
      if (master.epoch() != epoch) {
        error.restart();
        error.step(v, port.applied);
      }
    }
    error.take_ratio(port.ratio, port.v);
    port_before = port.x;
    GivenReading<DeviceSample<N>> reading{port};
    const Tick<MasterClock> tick{Instant<MasterClock>{when.now}, master_dt};
    held = at_work.to_hand(run_cycle(master, reading, master_mail, tick).command);
    out.felt_max_n = std::max(out.felt_max_n, held.vec().norm());
    out.hand_least_j = std::min(out.hand_least_j, at.hand_j + (claim.device_damping ? at.damped_j : 0.0));
    note_both();
  };
  const Duration end = to_duration(duration_s);
  const auto tick = [&](TickAt when, const auto& of_side) {
    if (when.now >= end || turns) return false;
    if (out.rests && !rest && to_seconds(when.now).si() >= kRest_s) {
      rest = true;
      handle.rest(static_cast<int>(0.3 / master_dt.si()));
      robot.rest(0);
    }
    of_side(when);
    if (out.rests && rested_only && to_seconds(when.now).si() >= kFlow_s) {
      if (!std::exchange(flows, true)) rested_at = robot.x();
      out.self_moved_m = std::max(out.self_moved_m, (robot.x().translation() - rested_at.translation()).norm());
    }
    return true;
  };
  const auto slave_ticks = [&](TickAt when) { tick(when, slave_tick); };
  order.run(Duration::max(), slave_ticks, [&](TickAt when) { return tick(when, master_tick); });
  const double initial = out.initial_j = scene.control.initial_energy.si();
  const double stiffness = scene.control.coupling.stiffness_n_per_m;
  const double scale = scene.control.force_scale * scene.control.motion_scale;
  const double slack = (claim.predicts ? out.unforeseen_j : 0.0) +
                       (claim.tick_at_hand ? 0.5 * stiffness * std::max(1.0, scale) * at.hand_largest2 : 0.0);
  const double slack_of_robot = claim.tick_at_robot ? 0.5 * stiffness * in_master_units(at.robot_largest2) : 0.0;
  constexpr double kNoBound = -std::numeric_limits<double>::infinity();
  // What the hand does against a prediction is measured of bodies with one mass.
  const bool measured = N != kJointPort || !claim.predicts;
  out.hand_bound_j = claim.hand && !out.rests && measured ? -initial - slack : kNoBound;
  out.both_bound_j =
      claim.both && !out.lies && !out.rests && measured
          ? -initial - (claim.in_hand_joules ? initial : in_master_units(initial)) - slack - slack_of_robot
          : kNoBound;
  return out;
}

}  // namespace

std::vector<std::string> claiming_methods() {
  std::vector<std::string> all;
  for (const MethodName& each : kMethods)
    if (each.one_piece() && each.claim->any()) all.emplace_back(each.name);
  for (const TransparencyLayerName& t : kTransparencyLayers)
    for (const PassivityLayerName& p : kPassivityLayers)
      if (p.claim->any() && !t.is_external) all.push_back(fmt::format("{}+{}", t.name, p.name));
  return all;
}

AdversaryRun attack(const std::string& method, std::uint64_t seed, const std::vector<std::string>& set, bool joints) {
  Draw draw{seed};
  constexpr int kSizes[] = {1, 3, 3, 6};
  AdversaryRun run;
  run.seed = seed;
  run.dof = kSizes[draw.below(4)];
  run.lies = draw.once_in(4);
  if (joints) {
    run.dof = kJointPort;
    return run_of<kJointPort>(method, run, draw, set);
  }
  if (run.dof == 1) return run_of<1>(method, run, draw, set);
  if (run.dof == 3) return run_of<3>(method, run, draw, set);
  return run_of<6>(method, run, draw, set);
}

int Adversary::broken() const {
  int count = 0;
  for (const auto& of_method : runs)
    for (const AdversaryRun& run : of_method) count += run.broken();
  return count;
}
int Adversary::moved_by_themselves() const {
  int count = 0;
  for (const auto& of_method : runs)
    for (const AdversaryRun& run : of_method) count += run.moved_by_itself();
  return count;
}

Adversary attack_all(const AdversaryOptions& o, const Heard& heard) {
  if (o.runs < 1) throw ConfigError{fmt::format("--runs is {}; it must be at least 1", o.runs)};
  Adversary all{.methods = o.methods.empty() ? method_names() : o.methods, .runs = {}};
  check_methods(all.methods, method_names());
  const auto runs = static_cast<std::size_t>(o.runs);
  all.runs.resize(all.methods.size(), std::vector<AdversaryRun>(runs));
  constexpr std::size_t kAtOnce = 100;
  const std::size_t parts = (runs + kAtOnce - 1) / kAtOnce, count = parts * all.methods.size();
  Tally tally{count, heard};
  run_each(count, o.jobs, tally, [&](std::size_t i) {
    const std::size_t m = i / parts, from = i % parts * kAtOnce;
    for (std::size_t r = from; r < std::min(runs, from + kAtOnce); ++r)
      all.runs[m][r] = attack(all.methods[m], o.seed + r, {}, o.joints);
  });
  return all;
}

namespace {

template <class Energy>
const AdversaryRun& least(const std::vector<AdversaryRun>& runs, Energy value) {
  return *std::min_element(runs.begin(), runs.end(),
                           [&](const AdversaryRun& a, const AdversaryRun& b) { return value(a) < value(b); });
}

}  // namespace

std::string to_text(const Adversary& all) {
  std::string out = fmt::format("{:<24} {:>6} {:<10} {:>12} {:>8} {:>12} {:>8} {:>12} {:>8} {:>11} {:>7} {:>10}\n",
                                "method", "runs", "claims", "hand mJ", "seed", "told lies mJ", "seed", "both mJ",
                                "seed", "below -E(0)", "broken", "self-moved");
  for (std::size_t m = 0; m < all.methods.size(); ++m) {
    const auto& runs = all.runs[m];
    const Claim claim = usual_claim(all.methods[m]);
    const AdversaryRun &honest = least(runs, [](const AdversaryRun&r) { return r.lies ? 0.0 : r.hand_least_j; }),
                       &lied = least(runs, [](const AdversaryRun&r) { return r.lies ? r.hand_least_j : 0.0; }),
                       &both = least(runs, [](const AdversaryRun&r) { return r.both_least_j; });
    const auto broken = std::count_if(runs.begin(), runs.end(), [](const AdversaryRun& r) { return r.broken(); });
    const auto below = std::count_if(runs.begin(), runs.end(), [](const AdversaryRun& r) { return r.below(); });
    const auto moved =
        std::count_if(runs.begin(), runs.end(), [](const AdversaryRun& r) { return r.moved_by_itself(); });
    out += fmt::format("{:<24} {:>6} {:<10} {:>12.7g} {:>8} {:>12.7g} {:>8} {:>12.7g} {:>8} {:>11} {:>7} {:>10}\n",
                       all.methods[m], runs.size(), claim.any() ? to_string(claim) : "-", 1e3 * honest.hand_least_j,
                       honest.seed, 1e3 * lied.hand_least_j, lied.seed, 1e3 * both.both_least_j, both.seed, below,
                       broken, moved);
  }
  return out;
}

std::string moved_runs(const Adversary& all) {
  std::string out;
  for (std::size_t m = 0; m < all.methods.size(); ++m)
    for (const AdversaryRun& run : all.runs[m])
      if (run.moved_by_itself())
        out += fmt::format(
            "{}: the robot moved {:.3g} mm by itself; again: twoport-lab adversary --methods {} --seed {} --runs 1\n",
            all.methods[m], 1e3 * run.self_moved_m, all.methods[m], run.seed);
  return out;
}

std::string broken_runs(const Adversary& all) {
  std::string out;
  for (std::size_t m = 0; m < all.methods.size(); ++m)
    for (const AdversaryRun& run : all.runs[m]) {
      if (!run.broken()) continue;
      const bool hand = run.hand_least_j < run.hand_bound_j - AdversaryRun::kRounding_j;
      out += fmt::format(
          "{}: {} {:.9g} mJ, claimed at least {:.9g} mJ; again: twoport-lab adversary{} --methods {} --seed {} "
          "--runs 1\n",
          all.methods[m], hand ? "hand" : "both", 1e3 * (hand ? run.hand_least_j : run.both_least_j),
          1e3 * (hand ? run.hand_bound_j : run.both_bound_j), run.dof == kJointPort ? " --joints" : "", all.methods[m],
          run.seed);
    }
  return out;
}

Table to_table(const Adversary& all) {
  Table table;
  table.columns = {"method",       "seed",         "dof",          "rate_hz",      "lies",       "hand_least_j",
                   "hand_bound_j", "both_least_j", "both_bound_j", "unforeseen_j", "felt_max_n", "below",
                   "broken",       "rests",        "switches",     "self_moved_m"};
  for (std::size_t m = 0; m < all.methods.size(); ++m)
    for (const AdversaryRun& r : all.runs[m])
      table.rows.push_back({all.methods[m], fmt::format("{}", r.seed), r.dof, r.rate_hz, r.lies, r.hand_least_j,
                            Value::finite(r.hand_bound_j), r.both_least_j, Value::finite(r.both_bound_j),
                            r.unforeseen_j, r.felt_max_n, r.below(), r.broken(), r.rests, r.switches, r.self_moved_m});
  return table;
}

}  // namespace twoport::lab
