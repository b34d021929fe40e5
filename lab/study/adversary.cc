#include "lab/study/adversary.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "common/base/check.h"
#include "common/base/normal.h"
#include "common/coupling/registration.h"
#include "common/link/delay_line.h"
#include "common/link/mailbox.h"
#include "common/method/catalogue.h"
#include "common/passivity/velocity_predictor.h"
#include "common/scene/load.h"
#include "lab/engine/loops.h"
#include "lab/study/map.h"
#include "master/master_node.h"
#include "slave/slave_node.h"

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

  /// Advances by one tick under the port's force on it, held. Returns ∫v dt, with which the force does its work. N = 6: the
  /// attitude turns by log ΔR = ∫ω dt - T²/12 ω(0)×ω(T), as the axis turns within the tick.
  Displacement<N> advance(const Force<N>& port) {
    const bool begins = left_-- <= 0;
    if (begins) choose();
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

/// Scene of a run; `draw` goes on with what the scene does not hold.
Scene scene_of(const std::string& method, int dof, Draw& draw, const std::vector<std::string>& set) {
  constexpr double kRates[] = {250.0, 500.0, 1000.0, 2000.0, 4000.0};
  const double rate_hz = kRates[draw.below(5)], mass_kg = draw.decades(0.03, 0.5), robot_kg = draw.decades(0.2, 3.0);
  // A coupling that the sampled loop holds without a delay.
  const double least_kg = std::min(mass_kg, robot_kg);
  const double stiffness = std::min(draw.decades(300.0, 2000.0), 0.05 * least_kg * rate_hz * rate_hz);
  const double damping = std::min(draw.uniform(0.2, 1.0) * std::sqrt(stiffness * robot_kg), 0.2 * least_kg * rate_hz);
  const auto six = [&](double kg) { return dof == 6 ? fmt::format(" inertia_kg_m2: {}", 1e-3 * kg) : std::string{}; };
  std::string text = fmt::format(
      "dof: {} duration_s: 1 rate_hz: {} seed: {} device {{ mass_kg: {} damping_n_s_per_m: {} max_force_n: {}", dof,
      rate_hz, draw.below(1 << 30), mass_kg, draw.decades(0.01, 0.5), draw.decades(3.0, 30.0));
  text += six(mass_kg) + fmt::format(" }} robot {{ mass_kg: {} force_sensor {{ }}{} }}", robot_kg, six(robot_kg));
  text +=
      fmt::format(" control {{ virtual_coupling {{ stiffness_n_per_m: {} damping_n_s_per_m: {} ", stiffness, damping);
  if (dof == 6)
    text += fmt::format("rotational_stiffness_n_m_per_rad: {} rotational_damping_n_m_s_per_rad: {} ", 1e-3 * stiffness,
                        1e-3 * damping);
  const std::size_t plus = method.find('+');
  if (plus == std::string::npos) {
    text += fmt::format("}} passivity {{ method: {} initial_energy_j: 1e-3 }} }}", method);
  } else {
    text += fmt::format("}} passivity {{ layer: {} initial_energy_j: 1e-3 }} ", method.substr(plus + 1));
    const std::string random =
        method.starts_with("RANDOM")
            ? fmt::format(" random {{ force_n: {} hold_ms: {} }}", draw.decades(0.5, 50.0), draw.decades(0.5, 100.0))
            : std::string{};
    text += fmt::format("transparency {{ layer: {}{} }} }}", method.substr(0, plus), random);
  }
  text += " to_slave { " + way(draw) + " } to_master { " + way(draw) + " }";
  return parse_scene(text, "adversary", set);
}

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

/// Error of the handle's predicted velocity: EnergyClaim's e, of the handle's motion and the force that it was under.
template <int N>
class PredictionError {
 public:
  using Vector = typename Force<N>::Vector;
  /// `mobility`: C [m/(N s)].
  explicit PredictionError(const Vector& mobility) : mobility_{mobility} {}

  /// Of a tick under `held` with the mean velocity v.
  const Vector& step(const Vector& v, const Force<N>& held) {
    const Vector added = v - v_ + mobility_.cwiseProduct(held_ + held.vec());
    const Vector e = e_ - 0.25 * before_ + added - added_;
    before_ = e_, e_ = e;
    added_ = added, v_ = v, held_ = held.vec();
    return e_;
  }

 private:
  Vector mobility_, v_ = Vector::Zero(), held_ = Vector::Zero(), added_ = Vector::Zero();
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

template <int N>
AdversaryRun run_of(const std::string& method, AdversaryRun out, Draw& draw, const std::vector<std::string>& set) {
  const Scene scene = scene_of(method, N, draw, set);
  out.rate_hz = scene.rate_hz;
  const Seconds dt{1.0 / scene.rate_hz};
  const EnergyClaim claim = energy_claim(method);
  Body<N> handle{scene.device->mass_kg, 1e-3 * scene.device->mass_kg, scene.device->damping_n_s_per_m, true, draw, dt};
  Body<N> robot{scene.robot->mass_kg, 1e-3 * scene.robot->mass_kg, 0.0, false, draw, dt};
  MasterNode<N> master{scene.control};
  SlaveNode<N> slave{scene.control};
  SimLink<N> link{scene};
  Lie<N> lie{draw};
  const Registration<N> registration{scene.control};
  PredictionError<N> error{0.5 * dt.si() * handle.mass().cwiseInverse()};
  Force<N> held, pushed;
  double hand_j = 0.0, damped_j = 0.0, robot_j = 0.0, largest2 = 0.0;
  const double ticks =
      std::clamp(scene.rate_hz * (1.0 + 4.0 * (scene.to_slave.delay_s + scene.to_master.delay_s)), 1500.0, 4000.0);
  const auto post = [](auto& node, auto& mail, auto& report, Duration now) {
    if (!node.has_payload()) return mail.post(report, now);
    Words words;
    node.write_payload(words);
    mail.post(report, words, now);
  };
  for (int k = 0; k < static_cast<int>(ticks); ++k) {
    const Duration now = tick_time(k, scene.rate_hz);
    if (k > 0) {
      const Displacement<N> driven = robot.advance(pushed);
      const Displacement<N> by = handle.advance(-held);
      if (is_half_a_turn(driven) || is_half_a_turn(by)) break;
      robot_j += dot(pushed, driven).si();
      hand_j += dot(held, by).si();
      damped_j += handle.damping().dot(by.vec().cwiseAbs2()) / dt.si();
      out.unforeseen_j += dt.si() * std::abs(held.vec().dot(error.step(by.vec() / dt.si(), held)));
      largest2 = std::max({largest2, by.squared_norm(), driven.squared_norm()});
    }
    auto to_robot = slave.step({Instant<SlaveClock>{now}, dt}, {robot.x(), robot.v(), -robot.own_force()},
                               link.slave().collect(now));
    pushed = to_robot.command.f;
    post(slave, link.slave(), to_robot.report, now);
    const PeerState<N>& told = link.master().collect(now);
    auto to_hand =
        master.step({Instant<MasterClock>{now}, dt}, {handle.x(), handle.v(), held}, out.lies ? lie.of(told) : told);
    held = to_hand.command;
    post(master, link.master(), to_hand.report, now);
    out.felt_max_n = std::max(out.felt_max_n, held.vec().norm());
    const double hand = hand_j + (claim.device_damping ? damped_j : 0.0);
    out.hand_least_j = std::min(out.hand_least_j, hand);
    if (!out.lies)
      out.both_least_j = std::min(
          out.both_least_j, hand_j - (claim.robot_port ? robot_j : registration.to_master(slave.delivered()).si()));
  }
  const double initial = out.initial_j = scene.control.initial_energy.si();
  const double slack = (claim.predicts ? out.unforeseen_j : 0.0) +
                       (claim.tick_of_spring ? 0.5 * scene.control.coupling.stiffness_n_per_m * largest2 : 0.0);
  constexpr double kNothing = -std::numeric_limits<double>::infinity();
  out.hand_bound_j = claim.hand && (claim.any_packets || !out.lies) ? -initial - slack : kNothing;
  out.both_bound_j = claim.both && !out.lies ? -(claim.shares_initial ? 1.0 : 2.0) * initial - slack : kNothing;
  return out;
}

}  // namespace

EnergyClaim energy_claim(const std::string& method) {
  ControlOptions o;
  if (!choose_method(o, method)) return {};
  if (o.passivity == "ENERGY_SPRING") return {.hand = true, .any_packets = true};
  if (o.passivity == "ENERGY_SPRING_TWO_PORT") return {.both = true, .shares_initial = true};
  // A layer that knows a model displays a force that the robot's port has not paid for.
  const bool by_model = o.transparency == "INTERNAL_MODEL" || o.transparency == "SURFACE_MODEL";
  if (o.passivity == "FORCE_PROJECTED") return {.hand = true, .both = !by_model, .any_packets = true, .predicts = true};
  if (o.passivity == "ENERGY_BOUNDING") return {.hand = true, .any_packets = true, .device_damping = true};
  if (o.passivity == "ENERGY_TANK" || method == "SET_POSITION_MODULATION")
    return {.both = true, .robot_port = true, .tick_of_spring = true};
  return {};
}

AdversaryRun attack(const std::string& method, std::uint64_t seed, const std::vector<std::string>& set) {
  Draw draw{seed};
  constexpr int kSizes[] = {1, 3, 3, 6};
  AdversaryRun run;
  run.seed = seed;
  run.dof = kSizes[draw.below(4)];
  run.lies = draw.once_in(4);
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
      all.runs[m][r] = attack(all.methods[m], o.seed + r);
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
  std::string out =
      fmt::format("{:<24} {:>6} {:<10} {:>12} {:>8} {:>12} {:>8} {:>12} {:>8} {:>11} {:>7}\n", "method", "runs",
                  "claims", "hand mJ", "seed", "told lies mJ", "seed", "both mJ", "seed", "below -E(0)", "broken");
  for (std::size_t m = 0; m < all.methods.size(); ++m) {
    const auto& runs = all.runs[m];
    const EnergyClaim claim = energy_claim(all.methods[m]);
    const AdversaryRun &honest = least(runs, [](const AdversaryRun&r) { return r.lies ? 0.0 : r.hand_least_j; }),
                       &lied = least(runs, [](const AdversaryRun&r) { return r.lies ? r.hand_least_j : 0.0; }),
                       &both = least(runs, [](const AdversaryRun&r) { return r.both_least_j; });
    const auto broken = std::count_if(runs.begin(), runs.end(), [](const AdversaryRun& r) { return r.broken(); });
    const auto below = std::count_if(runs.begin(), runs.end(), [](const AdversaryRun& r) { return r.below(); });
    const std::string claims = claim.hand && claim.both ? "hand, both"
                               : claim.hand             ? "hand"
                               : claim.both             ? "both"
                                                        : "-";
    out += fmt::format("{:<24} {:>6} {:<10} {:>12.7g} {:>8} {:>12.7g} {:>8} {:>12.7g} {:>8} {:>11} {:>7}\n",
                       all.methods[m], runs.size(), claims, 1e3 * honest.hand_least_j, honest.seed,
                       1e3 * lied.hand_least_j, lied.seed, 1e3 * both.both_least_j, both.seed, below, broken);
  }
  return out;
}

std::string broken_runs(const Adversary& all) {
  std::string out;
  for (std::size_t m = 0; m < all.methods.size(); ++m)
    for (const AdversaryRun& run : all.runs[m]) {
      if (!run.broken()) continue;
      const bool hand = run.hand_least_j < run.hand_bound_j - AdversaryRun::kRounding_j;
      out += fmt::format(
          "{}: {} {:.9g} mJ, claimed at least {:.9g} mJ; again: twoport-lab adversary --methods {} --seed {} --runs "
          "1\n",
          all.methods[m], hand ? "hand" : "both", 1e3 * (hand ? run.hand_least_j : run.both_least_j),
          1e3 * (hand ? run.hand_bound_j : run.both_bound_j), all.methods[m], run.seed);
    }
  return out;
}

Table to_table(const Adversary& all) {
  Table table;
  table.columns = {"method",       "seed",         "dof",          "rate_hz",      "lies",
                   "hand_least_j", "hand_bound_j", "both_least_j", "both_bound_j", "unforeseen_j",
                   "felt_max_n",   "below",        "broken"};
  for (std::size_t m = 0; m < all.methods.size(); ++m)
    for (const AdversaryRun& r : all.runs[m])
      table.rows.push_back({all.methods[m], fmt::format("{}", r.seed), r.dof, r.rate_hz, r.lies, r.hand_least_j,
                            Value::finite(r.hand_bound_j), r.both_least_j, Value::finite(r.both_bound_j),
                            r.unforeseen_j, r.felt_max_n, r.below(), r.broken()});
  return table;
}

}  // namespace twoport::lab
