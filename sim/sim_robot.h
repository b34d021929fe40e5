#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
#include <random>
#include <vector>

#include "common/hardware/robot.h"
#include "common/scene/scene.h"
#include "sim/environment.h"
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
  RungeKuttaPlant(const RobotSpec& robot, const Environment<N>& environment, double dt)
      : mass_{robot.mass_kg},
        damping_{robot.damping_n_s_per_m},
        rotational_damping_{robot.rotational_damping_n_m_s_per_rad},
        dt_{dt},
        environment_{&environment},
        any_(static_cast<std::size_t>(environment.contacts()), kNearest),
        touched_{any_},
        after_{any_},
        trial_{any_} {
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
  }

  void advance(BodyState<N>& s, const Force<N>& f) noexcept {
    // Steps short against the fastest motion: local error below (0.1)^5/120.
    double rate = rate_;
    if (friction_ > 0.0) {
      const double pressed = std::max(push(f), push(environment_->force(s.x, s.v)));
      rate = std::max(rate, 0.3 * friction_ * pressed * lightness_ / kStictionSpeed);
    }
    if constexpr (N == 6) rate = std::max(rate, s.v.vec().template tail<3>().norm());
    const int pieces = std::clamp(static_cast<int>(std::ceil(dt_ * rate / 0.1)), 1, 256);
    Motion m = motion(s);
    touching(m, touched_);
    for (int i = 0; i < pieces; ++i) {
      double left = dt_ / pieces;
      for (int cuts = 0; left > 0.0; ++cuts) left -= one(m, f, left, cuts < kCuts);
    }
    s = {m.x, velocity(m)};
  }

 private:
  static constexpr int kCuts = 4;  // contacts that begin or end within one piece, each met on its own
  using Vector = typename Velocity<N>::Vector;
  using Contacts = std::vector<Face>;  // of each contact, the face that carries force
  static double push(const Force<N>& f) noexcept { return f.vec().template head<kAxes<N>>().norm(); }

  // Momenta for N = 6, velocity otherwise.
  struct Motion {
    Position<N> x;
    Vector p;
  };
  Motion motion(const BodyState<N>& s) const noexcept {
    Vector p = s.v.vec();
    if constexpr (N == 6) {
      const Eigen::Matrix3d R = s.x.attitude().toRotationMatrix();
      p.template head<3>() *= mass_;
      p.template tail<3>() =
          R * inertia_.cwiseProduct(R.transpose() * s.v.vec().template tail<3>());
    }
    return {s.x, p};
  }
  Velocity<N> velocity(const Motion& m) const noexcept {
    if constexpr (N == 6) {
      const Eigen::Matrix3d R = m.x.attitude().toRotationMatrix();
      Vector v;
      v << m.p.template head<3>() / mass_,
          R * (R.transpose() * m.p.template tail<3>()).cwiseQuotient(inertia_);
      return Velocity<N>{v};
    } else {
      return Velocity<N>{m.p};
    }
  }

  struct Slope {
    Vector v, p;
  };
  // Only with the contacts and faces of `among`: what begins within a step belongs to the next one.
  Slope slope(const Motion& m, const Force<N>& f, const Contacts& among) const noexcept {
    const Velocity<N> v = velocity(m);
    Vector total = f.vec();
    environment_->for_each_contact(m.x, v, [&](int i) { return among[static_cast<std::size_t>(i)]; },
                                   [&](int, Face, const Vector& n, const Vector& t) { total += n + t; });
    if constexpr (N == 6) {
      total.template head<3>() -= damping_ * v.vec().template head<3>();
      total.template tail<3>() -= rotational_damping_ * v.vec().template tail<3>();
      return {v.vec(), total};
    } else {
      return {v.vec(), (total - damping_ * v.vec()) / mass_};
    }
  }

  // For N = 6 the attitude advances by a rotation vector whose rate is ω - ½ r×ω + (1/12) r×(r×ω) for world ω.
  static Vector chart(const Vector& moved, const Vector& v) noexcept {
    if constexpr (N == 6) {
      Vector out = v;
      const Eigen::Vector3d r = moved.template tail<3>(), w = v.template tail<3>(), rw = r.cross(w);
      out.template tail<3>() = w - 0.5 * rw + r.cross(rw) / 12.0;
      return out;
    } else {
      (void)moved;
      return v;
    }
  }
  Motion step(const Motion& m, const Force<N>& f, const Contacts& among, double h) const noexcept {
    const auto at = [&](const Vector& moved, const Vector& dp) {
      return Motion{m.x + Displacement<N>{moved}, m.p + dp};
    };
    const Slope a = slope(m, f, among);
    const Vector xa = chart(Vector::Zero(), a.v);
    const Slope b = slope(at(0.5 * h * xa, 0.5 * h * a.p), f, among);
    const Vector xb = chart(0.5 * h * xa, b.v);
    const Slope c = slope(at(0.5 * h * xb, 0.5 * h * b.p), f, among);
    const Vector xc = chart(0.5 * h * xb, c.v);
    const Slope d = slope(at(h * xc, h * c.p), f, among);
    const Vector xd = chart(h * xc, d.v);
    return at(h / 6.0 * (xa + 2.0 * (xb + xc) + xd), h / 6.0 * (a.p + 2.0 * (b.p + c.p) + d.p));
  }

  void touching(const Motion& m, Contacts& out) const noexcept {
    std::fill(out.begin(), out.end(), kNone);
    environment_->for_each_contact(
        m.x, velocity(m), [](int) { return kNearest; },
        [&](int i, Face face, const Vector&, const Vector&) { out[static_cast<std::size_t>(i)] = face; });
  }

  // One step of at most h; ends early, if it may, just past the moment at which a contact begins, ends or changes to
  // another face. Returns its length.
  double one(Motion& m, const Force<N>& f, double h, bool may_cut) noexcept {
    const Contacts& among = may_cut ? touched_ : any_;
    Motion next = step(m, f, among, h);
    touching(next, after_);
    if (may_cut && after_ != touched_) {
      double lo = 0.0, hi = h;
      while (hi - lo > 1e-7 * h) {
        const double mid = 0.5 * (lo + hi);
        const Motion trial = step(m, f, among, mid);
        touching(trial, trial_);
        if (trial_ == touched_) {
          lo = mid;
        } else {
          hi = mid;
          next = trial;
          std::swap(after_, trial_);
        }
      }
      h = hi;
    }
    m = next;
    std::swap(touched_, after_);
    return h;
  }

  double mass_, damping_, rotational_damping_, dt_, lightness_, rate_ = 0.0, friction_ = 0.0;
  Eigen::Vector3d inertia_ = Eigen::Vector3d::Ones();
  const Environment<N>* environment_;
  Contacts any_, touched_, after_, trial_;
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

  ExactPlant(const RobotSpec& robot, const World<D>& world, double dt) : dt_{dt} {
    Oscillator free{robot.mass_kg, robot.damping_n_s_per_m, 0.0};
    for (const auto& s : world.springs) {
      free.damping_n_s_per_m += s.damping_n_s_per_m;
      free.stiffness_n_per_m += s.stiffness_n_per_m;
      pull_ += s.stiffness_n_per_m * s.anchor;
    }
    wall_ = !world.surfaces.empty();
    region_[0] = Region{free, free, wall_ ? span(free) : dt};
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
    region_[1] = Region{across, along, span(across)};
  }

  void advance(BodyState<D>& s, const Force<D>& f) noexcept {
    Vector x = s.x.translation(), v = s.v.vec();
    if (!wall_) {
      move(region_[0], 0, x, v, f.vec(), dt_);
      s = {Position<D>{x}, Velocity<D>{v}};
      return;
    }
    double left = dt_;
    bool in = contact(x, v);
    for (int cuts = 0; left > 0.0;) {
      const Region& r = region_[in];
      double h = std::min(left, r.span);
      Vector x1 = x, v1 = v;
      move(r, in, x1, v1, f.vec(), h);
      if (cuts < 8 && contact(x1, v1) != in) {
        ++cuts;
        h = crossing(in, x, v, f.vec(), h);
        x1 = x, v1 = v;
        move(r, in, x1, v1, f.vec(), h);
        in = !in;
      }
      x = x1, v = v1;
      left -= h;
    }
    s = {Position<D>{x}, Velocity<D>{v}};
  }

 private:
  using Vector = Eigen::Matrix<double, D, 1>;
  struct Region {
    Oscillator across, along;  ///< the wall's normal; any direction across it
    double span;               ///< longest move
    Response full_across, full_along;
    Region() = default;
    Region(const Oscillator& n, const Oscillator& t, double h)
        : across{n}, along{t}, span{h}, full_across{n, h}, full_along{t, h} {}
  };
  /// A tick, or an equal part of it in which the motion turns by no more than half a radian.
  [[nodiscard]] double span(const Oscillator& o) const noexcept {
    return dt_ / std::ceil(std::max(1.0, 2.0 * dt_ * std::sqrt(o.stiffness_n_per_m / o.mass_kg)));
  }

  [[nodiscard]] bool contact(const Vector& x, const Vector& v) const noexcept {
    const double depth = offset_ - normal_.dot(x);
    return depth > 0.0 && k_ * depth - b_ * normal_.dot(v) > 0.0;
  }

  void move(const Region& r, bool in, Vector& x, Vector& v, const Vector& f, double h) const noexcept {
    const Response across = h == r.span ? r.full_across : Response{r.across, h};
    const Response along = h == r.span ? r.full_along : (D > 1 ? Response{r.along, h} : across);
    const Vector u = f + pull_;
    if (!wall_) {
      const Vector u0 = u - r.along.stiffness_n_per_m * x;
      x += along.xv * v + along.xu * u0;
      v = along.vv * v + along.vu * u0;
      return;
    }
    // Split into the wall's normal and the rest; in contact the wall adds k (offset - n·x) to the normal load.
    const double xn = normal_.dot(x), vn = normal_.dot(v);
    const double un = normal_.dot(u) + (in ? k_ * offset_ : 0.0) - r.across.stiffness_n_per_m * xn;
    const double xn1 = xn + across.xv * vn + across.xu * un, vn1 = across.vv * vn + across.vu * un;
    if constexpr (D == 1) {
      x = xn1 * normal_;
      v = vn1 * normal_;
    } else {
      const Vector xt = x - xn * normal_, vt = v - vn * normal_;
      const Vector ut = u - normal_.dot(u) * normal_ - r.along.stiffness_n_per_m * xt;
      x = xt + along.xv * vt + along.xu * ut + xn1 * normal_;
      v = along.vv * vt + along.vu * ut + vn1 * normal_;
    }
  }

  /// When within h the normal motion, started in region `in`, leaves it.
  double crossing(bool in, const Vector& x, const Vector& v, const Vector& f, double h) const noexcept {
    const Oscillator& o = region_[in].across;
    const AxisState s0{normal_.dot(x), normal_.dot(v)};
    const double u = normal_.dot(f + pull_) + (in ? k_ * offset_ : 0.0) - o.stiffness_n_per_m * s0.x;
    double lo = 0.0, hi = h;
    for (int i = 0; i < 60 && hi - lo > 1e-13 * h; ++i) {
      const double mid = 0.5 * (lo + hi);
      const AxisState d = propagate({o.mass_kg, o.damping_n_s_per_m, o.stiffness_n_per_m}, {0, s0.v}, u, 0, mid);
      const double depth = offset_ - (s0.x + d.x);
      const bool still = (depth > 0.0 && k_ * depth - b_ * d.v > 0.0) == in;
      (still ? lo : hi) = mid;
    }
    return hi;
  }

  double dt_;
  Vector pull_ = Vector::Zero(), normal_ = Vector::Unit(0);
  double offset_ = 0.0, k_ = 0.0, b_ = 0.0;
  bool wall_ = false;
  Region region_[2];
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
      if constexpr (N != 6) {
        if (ExactPlant<N>::fits(environment_.world())) exact_.emplace(spec, environment_.world(), dt.si());
      }
      if (!exact_) general_.emplace(spec, environment_, dt.si());
      if (spec.force_sensor) {
        noise_ = spec.force_sensor->noise_n;
        bias_ = vector<N>(spec.force_sensor->bias_n);
        delay_.resize(static_cast<std::size_t>(std::lround(spec.force_sensor->latency_s / dt.si())));
      }
    }
    touch();
  }
  SimRobot(const SimRobot&) = delete;  // the plant refers to this object's environment

  /// Moves the world on by one control period, under the command held since the last actuate.
  void advance() noexcept {
    if constexpr (N != 6) {
      if (exact_) exact_->advance(state_, command_.f);
    }
    if (general_) general_->advance(state_, command_.f);
    if (!exact_ && !general_) state_ = {command_.x_d, command_.v_d};
    touch();
  }

  RobotState<N> sense() noexcept override { return {state_.x, state_.v, sensed_, !exact_ && !general_}; }
  void actuate(const RobotCommand<N>& command) noexcept override { command_ = command; }
  void release() noexcept override { command_.f = Force<N>{}; }

  [[nodiscard]] const BodyState<N>& state() const { return state_; }
  /// True force of the environment on the robot.
  [[nodiscard]] const Force<N>& environment_force() const { return from_environment_; }
  [[nodiscard]] const Environment<N>& environment() const { return environment_; }

 private:
  static constexpr std::uint64_t kSensorStream = 0x5e4501;

  void touch() noexcept {
    if (environment_.empty()) {
      sensed_ = Force<N>{bias_};
    } else {
      from_environment_ = environment_.force(state_.x, state_.v);
      sensed_ = Force<N>{bias_ - from_environment_.vec()};
    }
    if (noise_ > 0.0) {
      typename Force<N>::Vector n;
      for (int i = 0; i < N; ++i) n[i] = noise_ * normal_(random_);
      sensed_ += Force<N>{n};
    }
    if (!delay_.empty()) {
      std::swap(sensed_, delay_[delay_next_]);
      delay_next_ = (delay_next_ + 1) % delay_.size();
    }
  }

  struct Nothing {
    void advance(BodyState<N>&, const Force<N>&) noexcept {}
  };
  Environment<N> environment_;
  Seconds dt_;
  BodyState<N> state_;
  std::optional<std::conditional_t<N == 6, Nothing, ExactPlant<N == 6 ? 3 : N>>> exact_;
  std::optional<RungeKuttaPlant<N>> general_;
  RobotCommand<N> command_;
  Force<N> from_environment_, sensed_;
  typename Force<N>::Vector bias_ = Force<N>::Vector::Zero();
  double noise_ = 0.0;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  std::vector<Force<N>> delay_;
  std::size_t delay_next_ = 0;
};

}  // namespace twoport::sim
