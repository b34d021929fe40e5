#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "common/base/random.h"
#include "common/hardware/robot.h"
#include "common/scene/scene.h"
#include "sim/environment.h"
#include "sim/integrators.h"
#include "sim/linear.h"
#include "sim/path.h"

namespace twoport::sim {

/// State that an integrator carries: position, velocity (world axes), N = 6 with the body's inertia.
template <int N>
struct BodyState {
  Position<N> x;
  Velocity<N> v;
};

/// Mass under a held force in an environment, integrated by classical Runge-Kutta steps that end where a contact begins
/// or ends. The general case: curved surfaces, Coulomb friction, several walls, rigid bodies.
///
///     m v̇ = f - b v + f_env(x, v)         N = 6 also  L̇ = τ - b_r ω + τ_env,  L = R J Rᵀ ω  carried in world axes
template <int N>
class RungeKuttaPlant {
 public:
  RungeKuttaPlant(const RobotSpec& robot, const Environment<N>& environment, double dt, const BodyState<N>& start)
      : mass_{robot.mass_kg},
        damping_{robot.damping_n_s_per_m},
        rotational_damping_{robot.rotational_damping_n_m_s_per_rad},
        dt_{dt},
        environment_{&environment},
        any_(static_cast<std::size_t>(environment.contacts()), kNearest),
        touched_{any_},
        after_{any_},
        trial_{any_},
        motion_{start.x, start.v.vec()} {
    // What a contact moves: 1/m, and for N = 6 also arm²/J at each point of the tool.
    double all_points = 1.0 / mass_;
    lightness_ = all_points;
    if constexpr (N == 6) {
      inertia_ = vector<3>(robot.inertia_kg_m2);
      all_points = 0.0;
      for (const Eigen::Vector3d& arm : environment.tool()) {
        const double lightness = 1.0 / mass_ + arm.squaredNorm() / inertia_.minCoeff();
        all_points += lightness;
        lightness_ = std::max(lightness_, lightness);
      }
    }
    double stiffness = 0.0, damping = 0.0;
    for (const auto& s : environment.world().surfaces) {
      stiffness += s.material.stiffness_n_per_m;
      damping += s.material.damping_n_s_per_m + s.material.viscous_friction_n_s_per_m;
      friction_ = std::max(friction_, s.material.friction);
    }
    for (const auto& s : environment.world().springs) {
      stiffness += s.stiffness_n_per_m;
      damping += s.damping_n_s_per_m;
    }
    rate_ = std::max(std::sqrt(stiffness * all_points), damping * all_points + damping_ / mass_);
    if constexpr (N == 6) rate_ = std::max(rate_, rotational_damping_ / inertia_.minCoeff());
    motion_ = motion(start);
    slope_ = slope(motion_, held_, touched_);
  }

  [[gnu::noinline]] BodyState<N> advance(Force<N> f) noexcept {
    slope_.p += (f - held_).vec() / (N == 6 ? 1.0 : mass_);
    held_ = f;
    // Steps short against the fastest motion: local error below (0.1)^5/120.
    double rate = rate_;
    if (friction_ > 0.0) {
      const double pressed = std::max(push(f), push(environment_force()));
      rate = std::max(rate, 0.3 * friction_ * pressed * lightness_ / kStictionSpeed);
    }
    if constexpr (N == 6) rate = std::max(rate, slope_.v.template tail<3>().norm());
    const double wanted = dt_ * rate / 0.1;
    const int pieces = wanted < kPieces ? std::max(1, static_cast<int>(std::ceil(wanted))) : kPieces;
    for (int i = 0; i < pieces; ++i) {
      double left = dt_ / pieces;
      for (int cuts = 0; left > 0.0; ++cuts) left -= one(motion_, slope_, f, left, cuts < kCuts);
    }
    return {motion_.at.x, Velocity<N>{slope_.v}};
  }
  [[nodiscard]] Force<N> environment_force() const noexcept { return Force<N>{slope_.environment}; }

 protected:
  static constexpr int kPieces = 256;  // of a tick, at most
  static constexpr int kCuts = 4;      // contacts that begin or end within one piece, each met on its own
  using Vector = typename Velocity<N>::Vector;
  using Contacts = std::vector<Face>;  // of each contact, the face that carries force
  static double push(const Force<N>& f) noexcept { return f.vec().template head<kAxes<N>>().norm(); }

  // Momenta for N = 6, velocity otherwise.
  struct Motion {
    Placed<N> at;
    Vector p;
  };
  Motion motion(const BodyState<N>& s) const noexcept {
    Motion m{s.x, s.v.vec()};
    if constexpr (N == 6) {
      const Eigen::Matrix3d& R = m.at.R;
      m.p.template head<3>() *= mass_;
      m.p.template tail<3>() = R * inertia_.cwiseProduct(R.transpose() * s.v.vec().template tail<3>());
    }
    return m;
  }
  Velocity<N> velocity(const Motion& m) const noexcept {
    if constexpr (N == 6) {
      const Eigen::Matrix3d& R = m.at.R;
      Vector v;
      v << m.p.template head<3>() / mass_, R * (R.transpose() * m.p.template tail<3>()).cwiseQuotient(inertia_);
      return Velocity<N>{v};
    } else {
      return Velocity<N>{m.p};
    }
  }

  struct Slope {
    Vector v, p;
    Vector environment;  ///< force on the body
  };
  /// `pick` and `touch` as for_each_contact has them.
  template <class Pick, class Touch>
  Slope slope(const Motion& m, const Force<N>& f, Pick pick, Touch touch) const noexcept {
    Velocity<N> v = velocity(m);
    Vector environment = Vector::Zero();
    environment_->for_each_contact(m.at, v, pick,
                                   [&](int i, Face face, const Vector& normal, const Vector& tangential) {
                                     environment += normal + tangential;
                                     touch(static_cast<std::size_t>(i), face);
                                   });
    Vector total = f.vec() + environment;
    if constexpr (N == 6) {
      total.template head<3>() -= damping_ * v.vec().template head<3>();
      total.template tail<3>() -= rotational_damping_ * v.vec().template tail<3>();
      return {v.vec(), total, environment};
    } else {
      return {v.vec(), (total - damping_ * v.vec()) / mass_, environment};
    }
  }
  /// Only with the contacts and faces of `among`: what begins within a step belongs to the next one.
  Slope slope_among(const Motion& m, const Force<N>& f, const Contacts& among) const noexcept {
    return slope(
        m, f, [&](int i) { return among[static_cast<std::size_t>(i)]; }, [](std::size_t, Face) {});
  }
  /// With all that touches, which is told in `touched`.
  [[gnu::flatten]] Slope slope(const Motion& m, const Force<N>& f, Contacts& touched) const noexcept {
    std::fill(touched.begin(), touched.end(), kNone);
    return slope(
        m, f, [](int) { return kNearest; }, [&](std::size_t i, Face face) { touched[i] = face; });
  }

  // For N = 6 the attitude advances by a rotation vector whose rate is ω - ½ r×ω + (1/12) r×(r×ω) for world ω.
  static Vector chart(const Vector& moved, const Vector& v) noexcept {
    if constexpr (N == 6) {
      Vector out = v;
      Eigen::Vector3d r = moved.template tail<3>(), w = v.template tail<3>(), rw = r.cross(w);
      out.template tail<3>() = w - 0.5 * rw + r.cross(rw) / 12.0;
      return out;
    } else {
      (void)moved;
      return v;
    }
  }
  /// From m, where the slope is a.
  [[gnu::flatten]] Motion step(const Motion& m, const Slope& a, const Force<N>& f, const Contacts& among,
                               double h) const noexcept {
    const auto at = [&](const Vector& moved, const Vector& dp) {
      return Motion{m.at.x + Displacement<N>{moved}, m.p + dp};
    };
    Vector xa = chart(Vector::Zero(), a.v);
    Slope b = slope_among(at(0.5 * h * xa, 0.5 * h * a.p), f, among);
    Vector xb = chart(0.5 * h * xa, b.v);
    Slope c = slope_among(at(0.5 * h * xb, 0.5 * h * b.p), f, among);
    Vector xc = chart(0.5 * h * xb, c.v);
    Slope d = slope_among(at(h * xc, h * c.p), f, among);
    Vector xd = chart(h * xc, d.v);
    return at(h / 6.0 * (xa + 2.0 * (xb + xc) + xd), h / 6.0 * (a.p + 2.0 * (b.p + c.p) + d.p));
  }

  // One step of at most h; ends early, if it may, just past the moment at which a contact begins, ends or changes to
  // another face. Takes motion and slope along. Returns its length.
  double one(Motion& m, Slope& a, const Force<N>& f, double h, bool may_cut) noexcept {
    const Contacts& among = may_cut ? touched_ : any_;
    Motion next = step(m, a, f, among, h);
    Slope b = slope(next, f, after_);
    if (may_cut && after_ != touched_) {
      double lo = 0.0, hi = h;
      while (hi - lo > 1e-7 * h) {
        const double mid = 0.5 * (lo + hi);
        const Motion trial = step(m, a, f, among, mid);
        const Slope slope_there = slope(trial, f, trial_);
        if (trial_ == touched_) {
          lo = mid;
        } else {
          hi = mid;
          next = trial;
          b = slope_there;
          std::swap(after_, trial_);
        }
      }
      h = hi;
    }
    m = next;
    a = b;
    std::swap(touched_, after_);
    return h;
  }

  double mass_, damping_, rotational_damping_, dt_, lightness_, rate_ = 0.0, friction_ = 0.0;
  Eigen::Vector3d inertia_ = Eigen::Vector3d::Ones();
  const Environment<N>* environment_;
  Contacts any_, touched_, after_, trial_;
  Motion motion_;
  Slope slope_;  ///< of motion_, under held_
  Force<N> held_;
};

/// The same equation of motion by an integrator as it is usually written, in equal steps, contacts met where a step
/// finds them. N = 6 steps momenta and attitude: symplectic Euler and Verlet as kick and drift.
template <int N>
class SteppedPlant : RungeKuttaPlant<N> {
 public:
  SteppedPlant(const RobotSpec& robot, const Environment<N>& environment, double dt, const BodyState<N>& start,
               const SimulationSpec& simulation)
      : RungeKuttaPlant<N>{robot, environment, dt, start},
        method_{simulation.integrator},
        substeps_{simulation.substeps},
        h_{dt / simulation.substeps} {}

  [[gnu::noinline]] void advance(BodyState<N>& s, Force<N> f) noexcept {
    if constexpr (N == 6) {
      Motion m = this->motion(s);
      for (int i = 0; i < substeps_; ++i) m = one(m, f);
      s = {m.at.x, this->velocity(m)};
    } else {
      Vector q = s.x.translation(), v = s.v.vec();
      const auto a = [&](double, const Vector& at, const Vector& speed) {
        return this->slope_among({Position<N>{at}, speed}, f, this->any_).p;
      };
      for (int i = 0; i < substeps_; ++i) step_by(method_, h_, 0.0, q, v, a);
      s = {Position<N>{q}, Velocity<N>{v}};
    }
  }

 private:
  using typename RungeKuttaPlant<N>::Motion;
  using typename RungeKuttaPlant<N>::Vector;

  Motion one(const Motion& m, const Force<N>& f) const noexcept {
    const auto slope = [&](const Motion& at) { return this->slope_among(at, f, this->any_); };
    const auto drift = [&](const Motion& at) {
      return Motion{at.at.x + Displacement<N>{h_ * this->velocity(at).vec()}, at.p};
    };
    if (method_ == Integrator::rk4) return this->step(m, slope(m), f, this->any_, h_);
    const double kick = method_ == Integrator::symplectic_euler ? h_ : 0.5 * h_;
    Motion next = drift({m.at, m.p + kick * slope(m).p});
    if (method_ == Integrator::velocity_verlet) next.p += kick * slope(next).p;
    return next;
  }

  Integrator method_;
  int substeps_;
  double h_;
};

/// Mass on springs and at most one frictionless or viscous wall: linear on either side of the wall, so each tick is one
/// exact affine map, cut where contact begins or ends. What begins and ends again within a tick, or within half a
/// radian of an oscillation faster than that, is not seen.
template <int D>
class ExactPlant {
 public:
  /// Can this environment be stepped exactly?
  static bool fits(const World<D>& world) {
    if (world.surfaces.empty()) return true;
    return world.surfaces.size() == 1 && world.surfaces[0].shape.kind == Shape<D>::Kind::wall &&
           (D == 1 || world.surfaces[0].material.friction == 0.0);
  }

  /// `world` must outlive this.
  /// Integrator::exact; or exact_per_tick or trapezoidal, which meet contacts at the end of a step.
  ExactPlant(const RobotSpec& robot, const World<D>& world, double dt, const BodyState<D>& start,
             Integrator method = Integrator::exact)
      : dt_{dt}, method_{method}, cuts_{method == Integrator::exact}, world_{&world}, s_{start} {
    Oscillator free{robot.mass_kg, robot.damping_n_s_per_m, 0.0};
    for (const auto& s : world.springs) {
      free.damping_n_s_per_m += s.damping_n_s_per_m;
      free.stiffness_n_per_m += s.stiffness_n_per_m;
      pull_ += s.stiffness_n_per_m * s.anchor;
    }
    wall_ = !world.surfaces.empty();
    region_[0] = region(free, free, 0.0);
    if (!wall_) return;
    const Surface<D>& w = world.surfaces[0];
    normal_ = w.shape.a;
    offset_ = w.shape.r;
    k_ = w.material.stiffness_n_per_m;
    b_ = w.material.damping_n_s_per_m;
    Oscillator across = free, along = free;
    across.stiffness_n_per_m += k_;
    across.damping_n_s_per_m += b_;
    along.damping_n_s_per_m += w.material.viscous_friction_n_s_per_m;
    region_[1] = region(across, along, k_ * offset_);
    n_ = normal(s_);
    in_ = contact(n_);
  }

  [[gnu::always_inline]] const BodyState<D>& advance(const Force<D>& f) noexcept {
    const Vector u = f.vec() + pull_;
    if (!wall_) return glide(u);
    const Region& r = region_[in_];
    const double load = normal_.dot(u) + r.load;
    const Normal n = r.map(n_, load);
    const bool in = contact(n);
    if (r.span < dt_ || in != in_) {
      if (cuts_) return advance_in_parts(u);
      in_ = in;
    }
    s_ = moved(s_, n_, n, u, r, r.full_along);
    n_ = n;
    return s_;
  }
  [[nodiscard]] const BodyState<D>& state() const noexcept { return s_; }

  /// Of the environment on the mass: Environment::force, to the bit.
  [[nodiscard, gnu::always_inline]] Force<D> environment_force() const noexcept {
    const Vector &x = s_.x.translation(), &v = s_.v.vec();
    Vector sum = Vector::Zero();
    ContactForce<D> c;
    if (in_ && world_->surfaces[0].force({offset_ - n_[0], normal_}, n_[1], v, c)) sum += c.normal + c.tangential;
    for (const auto& s : world_->springs) sum += s.force(x, v);
    return Force<D>{sum};
  }

 private:
  using Vector = Eigen::Matrix<double, D, 1>;
  /// Position and velocity along the wall's normal. One packed vector: stored and loaded whole, from tick to tick.
  using Normal = Eigen::Vector2d;

  /// Position and velocity after a step, from those before and the load at the origin.
  struct Map {
    Eigen::Vector2d x, v, u;
    Map() = default;
    Map(const Response& r, const Oscillator& o)
        : x{1.0 - o.stiffness_n_per_m * r.xu, -o.stiffness_n_per_m * r.vu}, v{r.xv, r.vv}, u{r.xu, r.vu} {}
    [[gnu::always_inline]] Normal operator()(const Normal& n, double load) const noexcept {
      return x * n[0] + (v * n[1] + u * load);
    }
  };
  struct Region {
    Oscillator across, along;  ///< the wall's normal; any direction across it
    double load;               ///< of the wall along the normal, at the origin
    double span;               ///< longest move
    Map map;                   ///< of a span, across
    Response full_along;
  };
  [[nodiscard]] Region region(const Oscillator& across, const Oscillator& along, double load) const noexcept {
    const double h = cuts_ && wall_ ? span(across) : dt_;
    const bool exact = method_ != Integrator::trapezoidal;
    const auto response = [&](const Oscillator& o) { return exact ? Response{o, h} : trapezoidal(o, h); };
    return {across, along, load, h, Map{response(across), across}, response(along)};
  }
  [[nodiscard]] Normal normal(const BodyState<D>& s) const noexcept {
    return {normal_.dot(s.x.translation()), normal_.dot(s.v.vec())};
  }
  [[nodiscard]] bool contact(const Normal& n) const noexcept {
    const double depth = offset_ - n[0];
    return depth > 0.0 && k_ * depth - b_ * n[1] > 0.0;
  }
  /// A tick, or an equal part of it in which the motion turns by no more than half a radian.
  [[nodiscard]] double span(const Oscillator& o) const noexcept {
    return dt_ / std::ceil(std::max(1.0, 2.0 * dt_ * std::sqrt(o.stiffness_n_per_m / o.mass_kg)));
  }

  /// A tick without a wall.
  const BodyState<D>& glide(Vector u) noexcept {
    const auto& [across, along, load, span, map, full] = region_[0];
    const Vector x = s_.x.translation(), v = s_.v.vec();
    const Vector u0 = u - along.stiffness_n_per_m * x;
    s_.x = Position<D>{x + (full.xv * v + full.xu * u0)};
    s_.v = Velocity<D>{full.vv * v + full.vu * u0};
    return s_;
  }

  /// A tick that is cut where contact begins or ends, and at spans.
  [[gnu::noinline]] const BodyState<D>& advance_in_parts(Vector u) noexcept {
    double left = dt_;
    bool in = in_;
    for (int cuts = 0; left > 0.0;) {
      double h = std::min(left, region_[in].span);
      BodyState<D> next = moved(s_, u, in, h);
      if (cuts < 8 && contact(normal(next)) != in) {
        ++cuts;
        h = crossing(in, s_, u, h);
        next = moved(s_, u, in, h);
        in = !in;
      }
      s_ = next;
      left -= h;
    }
    n_ = normal(s_);
    in_ = contact(n_);
    return s_;
  }
  [[nodiscard, gnu::noinline]] BodyState<D> moved(const BodyState<D>& s, const Vector& u, bool in,
                                                  double h) const noexcept {
    const Region& r = region_[in];
    const bool whole = h == r.span;
    const Normal from = normal(s);
    const Map map = whole ? r.map : Map{Response{r.across, h}, r.across};
    const Response along = D == 1 || whole ? r.full_along : Response{r.along, h};
    return moved(s, from, map(from, normal_.dot(u) + r.load), u, r, along);
  }

  /// The wall's normal, which has gone on to `to`, and the rest.
  [[nodiscard, gnu::always_inline]] BodyState<D> moved(const BodyState<D>& s, const Normal& from, const Normal& to,
                                                       const Vector& u, const Region& r,
                                                       const Response& along) const noexcept {
    if constexpr (D == 1) {
      return {Position<D>{to[0] * normal_}, Velocity<D>{to[1] * normal_}};
    } else {
      const Vector xt = s.x.translation() - from[0] * normal_, vt = s.v.vec() - from[1] * normal_;
      const Vector ut = u - normal_.dot(u) * normal_ - r.along.stiffness_n_per_m * xt;
      return {Position<D>{xt + along.xv * vt + along.xu * ut + to[0] * normal_},
              Velocity<D>{along.vv * vt + along.vu * ut + to[1] * normal_}};
    }
  }

  /// When within h the normal motion, started in region `in`, leaves it: regula falsi (Illinois) on what contact() asks
  /// for, until both ends are within 1e-13 h.
  double crossing(bool in, const BodyState<D>& s, const Vector& u, double h) const noexcept {
    const Oscillator& o = region_[in].across;
    const Normal n = normal(s);
    const double load = normal_.dot(u) + region_[in].load - o.stiffness_n_per_m * n[0];
    const auto pressed = [&](double t) {
      const AxisState d = propagate(o, {0, n[1]}, load, 0, t);
      const double elastic = k_ * (offset_ - n[0] - d.x);
      return std::min(elastic, elastic - b_ * d.v);
    };
    double lo = 0.0, hi = h, at_lo = std::copysign(pressed(lo), in ? 1.0 : -1.0), at_hi = pressed(hi);
    for (int i = 0, stuck = 0; i < 60 && hi - lo > 1e-13 * h; ++i) {
      const double secant = hi - at_hi * (hi - lo) / (at_hi - at_lo), inset = 0.4e-13 * h;
      const double t = std::clamp(std::isfinite(secant) ? secant : 0.5 * (lo + hi), lo + inset, hi - inset);
      const double at = pressed(t);
      if ((at > 0.0) == in) {
        lo = t, at_lo = at;
        if (stuck < 0) at_hi *= 0.5;
        stuck = -1;
      } else {
        hi = t, at_hi = at;
        if (stuck > 0) at_lo *= 0.5;
        stuck = 1;
      }
    }
    return hi;
  }

  double dt_;
  Integrator method_;
  bool cuts_;
  const World<D>* world_;
  Vector pull_ = Vector::Zero(), normal_ = Vector::Unit(0);
  double offset_ = 0.0, k_ = 0.0, b_ = 0.0;
  bool wall_ = false;
  Region region_[2];

  BodyState<D> s_;
  Normal n_ = Normal::Zero();  ///< of s_
  bool in_ = false;            ///< contact
};

/// The slave robot behind its seam: a mass (N = 1, 3) or a rigid body (N = 6) in an environment, with a force sensor.
/// Without a robot block it is ideal: it is where it is told to be.
template <int N>
class SimRobot final : public Robot<N> {
 public:
  SimRobot(const Scene& scene, Seconds dt) : environment_{scene}, dt_{dt}, random_{scene.seed ^ kSensorStream} {
    if (scene.robot) {
      const RobotSpec& spec = *scene.robot;
      state_.x = position<N>(spec.position_m);
      state_.v = Velocity<N>{vector<N>(spec.velocity_m_per_s)};
      model(spec, scene.simulation);
      if (spec.force_sensor) {
        noise_ = spec.force_sensor->noise_n;
        bias_ = vector<N>(spec.force_sensor->bias_n);
        delay_.resize(static_cast<std::size_t>(std::lround(spec.force_sensor->latency_s / dt.si())));
        blurred_ = noise_ > 0.0 || !delay_.empty();
      }
    }
    touch();
  }
  SimRobot(const SimRobot&) = delete;  // the plant refers to this object's environment

  /// Moves the world on by one control period, under the command held since the last actuate.
  [[gnu::always_inline]] void advance() noexcept {
    move();
    touch();
  }
  /// The same where nobody asks for a force before the next advance: the sensor is not read.
  [[gnu::always_inline]] void move() noexcept {
    if (exact_) {
      state_ = exact_->advance(command_.f);
      for (int i = 1; i < maps_; ++i) state_ = exact_->advance(command_.f);
    } else if (general_) {
      state_ = general_->advance(command_.f);
    } else if (stepped_) {
      stepped_->advance(state_, command_.f);
    } else {
      state_ = {command_.x_d, command_.v_d};
    }
  }

  RobotState<N> sense() noexcept override {
    if (exact_ && !blurred_) return {state_.x, state_.v, Force<N>{bias_ - environment_force().vec()}, false};
    return {state_.x, state_.v, sensed_, !exact_ && !general_ && !stepped_};
  }
  void actuate(const RobotCommand<N>& command) noexcept override { command_ = command; }
  void release() noexcept override { command_.f = Force<N>{}; }

  [[nodiscard]] const BodyState<N>& state() const { return state_; }
  /// Coupling force on the robot, held now.
  [[nodiscard]] const Force<N>& held() const { return command_.f; }
  /// True force of the environment on the robot.
  [[nodiscard, gnu::always_inline]] Force<N> environment_force() const {
    return exact_ ? exact_->environment_force() : from_environment_;
  }
  [[nodiscard]] const Environment<N>& environment() const { return environment_; }

 private:
  static constexpr std::uint64_t kSensorStream = 0x5e4501;

  void model(const RobotSpec& spec, const SimulationSpec& simulation) {
    const Integrator method = simulation.integrator;
    const bool map = method == Integrator::exact_per_tick || method == Integrator::trapezoidal;
    if constexpr (N != 6) {
      maps_ = map ? simulation.substeps : 1;
      if (map || (method == Integrator::exact && ExactPlant<N>::fits(environment_.world())))
        return void(exact_.emplace(spec, environment_.world(), dt_.si() / maps_, state_, method));
    }
    if (method == Integrator::exact) {
      general_.emplace(spec, environment_, dt_.si(), state_);
    } else {
      stepped_.emplace(spec, environment_, dt_.si(), state_, simulation);
    }
  }

  [[gnu::always_inline]] void touch() noexcept {
    if (exact_ && !blurred_) return;  // told when asked
    from_environment_ = exact_     ? exact_->environment_force()
                        : general_ ? general_->environment_force()
                                   : environment_.force(state_.x, state_.v);
    sensed_ = Force<N>{bias_ - from_environment_.vec()};
    if (blurred_) blur();
  }
  /// Noise and latency of the force sensor.
  [[gnu::noinline]] void blur() noexcept {
    if (noise_ > 0.0) {
      typename Force<N>::Vector n;
      for (int i = 0; i < N; ++i) n[i] = noise_ * random_.normal(sample_, static_cast<unsigned>(i));
      sensed_ += Force<N>{n};
      ++sample_;
    }
    if (!delay_.empty()) {
      std::swap(sensed_, delay_[delay_next_]);
      delay_next_ = (delay_next_ + 1) % delay_.size();
    }
  }

  struct Nothing {
    const BodyState<N>& advance(const Force<N>&) noexcept { return state; }
    Force<N> environment_force() const noexcept { return {}; }
    BodyState<N> state;
  };
  Environment<N> environment_;
  Seconds dt_;
  BodyState<N> state_;
  std::optional<std::conditional_t<N == 6, Nothing, ExactPlant<N == 6 ? 3 : N>>> exact_;
  std::optional<RungeKuttaPlant<N>> general_;
  std::optional<SteppedPlant<N>> stepped_;
  int maps_ = 1;  ///< of `exact_` in a tick
  RobotCommand<N> command_;
  Force<N> from_environment_, sensed_;
  typename Force<N>::Vector bias_ = Force<N>::Vector::Zero();
  double noise_ = 0.0;
  bool blurred_ = false;  ///< by noise or latency
  Random random_;
  std::uint64_t sample_ = 0;  ///< of the force sensor
  std::vector<Force<N>> delay_;
  std::size_t delay_next_ = 0;
};

}  // namespace twoport::sim
