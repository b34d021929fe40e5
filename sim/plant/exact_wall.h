#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <variant>

#include "sim/plant/body_plant.h"
#include "sim/plant/integrators.h"

namespace twoport::sim {

/// Coulomb friction of a plane wall on a mass on springs, under a held force u:
///
///     across   m n̈ = u_n - c ṅ - k n + f_n,   f_n = K (o - n) - B ṅ
///     along    m ẍ = u - c ẋ - k x - μ f_n ẋ/|ẋ|,   or rests while |u - k x| <= μ f_n
///
/// The motion across is known. Along a line of direction d, d·x + μ n moves as if there was no wall, under d·u + μ u_n: a closed form.
/// Where the velocity turns, it is integrated by Runge-Kutta 4. Stops and releases are located in time.
template <int D>
class WallFriction {
 public:
  using Vector = Eigen::Matrix<double, D, 1>;

  /// The mass without the wall, on its springs; the same across while the wall presses; of the wall.
  Oscillator free{}, across{};
  double coefficient = 0.0, stiffness = 0.0, damping = 0.0, offset = 0.0;

  /// Moves x, v, both along the wall, for h under u, while n and ṅ move from `n` under u_n.
  void advance(Vector& x, Vector& v, const Vector& u, double un, AxisState n, double h) const noexcept {
    double done = 0.0;
    for (int part = 0; done < h; ++part) {
      const double left = h - done;
      const Vector load = u - free.stiffness_n_per_m * x;
      Vector direction = v;
      double moves = 0.0, waits = 0.0;
      if (rests(v)) {
        v.setZero();
        waits = part < kParts ? release(load.norm(), un, n, left) : left;
        if (!(waits < left)) return;
        n = moved_across(n, un, waits);
        direction = load;
      }
      direction.normalize();
      if (part < kParts && turns(load, direction, limit(n)))
        moves = slide_turning(u, un, n, left - waits, x, v);
      else
        moves = slide_straight(direction, u, un, n, left - waits, x, v);
      done += waits + moves;
      if (done < h) n = moved_across(n, un, moves);
    }
  }

  /// Of the wall on a mass that moves with v under the load u - k x along it [N].
  [[nodiscard]] Vector force(const Vector& load, const Vector& v, const AxisState& n) const noexcept {
    const double most = limit(n), pull = load.norm();
    if (!rests(v)) return -most * v.normalized();
    return pull > most ? Vector{-most / pull * load} : Vector{-load};
  }

 private:
  static constexpr int kParts = 256;       ///< of a step, between stops and releases
  static constexpr double kRest = 1e-12;   ///< slower is at rest [m/s]
  static constexpr double kTurn = 0.02;    ///< [rad]: a step of Runge-Kutta 4 errs by kTurn^5/120 of what it moves
  static constexpr double kClose = 1e-15;  ///< so close to a stop the direction does not matter [m]

  static bool rests(const Vector& v) noexcept { return v.squaredNorm() < kRest * kRest; }
  [[nodiscard]] AxisState moved_across(const AxisState& n, double un, double t) const noexcept {
    return t > 0.0 ? propagate(across, n, un + stiffness * offset, 0.0, t) : n;
  }
  /// μ f_n
  [[nodiscard]] double limit(const AxisState& n) const noexcept {
    return coefficient * std::max(0.0, stiffness * (offset - n.x) - damping * n.v);
  }
  [[nodiscard]] static bool turns(const Vector& load, const Vector& direction, double most) noexcept {
    return (load - direction.dot(load) * direction).norm() > 1e-13 * (load.norm() + most);
  }
  /// Until when, between 0 and h, `holds` does.
  template <class Holds>
  static double last(const Holds& holds, double h) noexcept {
    double lo = 0.0, hi = h;
    for (int i = 0; i < 60; ++i) {
      const double t = 0.5 * (lo + hi);
      (holds(t) ? lo : hi) = t;
    }
    return hi;
  }

  /// When within h the wall no longer holds a load of this size; h where it does.
  [[nodiscard]] double release(double load, double un, const AxisState& n, double h) const noexcept {
    const auto holds = [&](double t) { return load <= limit(moved_across(n, un, t)); };
    if (load > limit(n)) return 0.0;
    double until = h;
    if (holds(h)) {
      // The limit may have been least within the step, where it is convex: above its tangent.
      const auto falls = [&](double t) { return rate(moved_across(n, un, t), un) < 0.0; };
      if (!falls(0.0) || load <= limit(n) + coefficient * rate(n, un) * h || falls(h)) return h;
      until = last(falls, h);
      if (holds(until)) return h;
    }
    return last(holds, until);
  }
  /// Of f_n [N/s].
  [[nodiscard]] double rate(const AxisState& n, double un) const noexcept {
    const double acceleration =
        (un + stiffness * offset - across.damping_n_s_per_m * n.v - across.stiffness_n_per_m * n.x) / across.mass_kg;
    return -stiffness * n.v - damping * acceleration;
  }

  /// Slides along a line for h or until it stops. Returns how long.
  double slide_straight(const Vector& direction, const Vector& u, double un, const AxisState& n, double h, Vector& x,
                        Vector& v) const noexcept {
    const double s0 = direction.dot(x), speed = direction.dot(v);
    // Of d·x + μ n, from where it is.
    const double load = direction.dot(u) + coefficient * un - free.stiffness_n_per_m * (s0 + coefficient * n.x);
    const auto along = [&](double t) -> AxisState {
      const AxisState sum = propagate(free, {0.0, speed + coefficient * n.v}, load, 0.0, t),
                      other = moved_across(n, un, t);
      return {sum.x - coefficient * (other.x - n.x), sum.v - coefficient * other.v};
    };
    const auto slows = [&](const AxisState& s, double t) {
      return direction.dot(u) - free.stiffness_n_per_m * (s0 + s.x) - free.damping_n_s_per_m * s.v <
             limit(moved_across(n, un, t));
    };
    AxisState end = along(h);
    double until = h;
    bool stops = end.v < 0.0;
    if (!stops && slows({0.0, speed}, 0.0) && !slows(end, h)) {
      const double slowest = last([&](double t) { return slows(along(t), t); }, h);
      stops = along(slowest).v < 0.0;
      if (stops) until = slowest;
    }
    if (stops) {
      until = last([&](double t) { return along(t).v > 0.0; }, until);
      end = {along(until).x, 0.0};
    }
    x += end.x * direction;
    v = end.v * direction;
    return until;
  }

  /// Slides for h, or until it stops or no longer turns. Returns how long.
  double slide_turning(const Vector& u, double un, const AxisState& n, double h, Vector& x, Vector& v) const noexcept {
    constexpr int kSteps = 20'000;
    const double mass = free.mass_kg;
    const double own_rate = std::max(std::sqrt(across.stiffness_n_per_m / mass), across.damping_n_s_per_m / mass);
    const auto acceleration = [&](const Vector& at, const Vector& speed, double most) -> Vector {
      return (u - free.damping_n_s_per_m * speed - free.stiffness_n_per_m * at -
              most / std::max(speed.norm(), kRest) * speed) /
             mass;
    };
    double t = 0.0;
    AxisState at = n;
    for (int steps = 0; steps < kSteps && t < h; ++steps) {
      const double size = v.norm(), most = limit(at);
      const Vector load = u - free.stiffness_n_per_m * x, direction = v / size, a = acceleration(x, v, most);
      const double slows = -direction.dot(a);
      if (size * size < 2.0 * slows * kClose) {
        const double rest = std::min(size / slows, h - t);
        x += 0.5 * rest * v;
        v.setZero();
        return t + rest;
      }
      if (steps > 0 && !turns(load, direction, most)) return t;
      const double d = std::min(h - t, kTurn / std::max((most + load.norm()) / (mass * size), own_rate));
      const AxisState mid = moved_across(at, un, 0.5 * d);
      at = moved_across(at, un, d);
      const double most_mid = limit(mid), most_end = limit(at);
      step_by(Integrator::rk4, d, 0.0, x, v, [&](double into, const Vector& q, const Vector& speed) -> Vector {
        return into <= 0.0 ? a : acceleration(q, speed, into < d ? most_mid : most_end);
      });
      t = d == h - t ? h : t + d;
    }
    return h;
  }
};

/// Mass on springs and at most one wall: linear on either side of the wall, so each tick is one exact affine map, cut where contact
/// begins or ends, however often within the tick. A contact that is lost and made again within half a radian of the wall's
/// oscillation is not detected. Coulomb friction of the wall, which then has no viscous one, sticks: WallFriction.
template <int D>
class ExactPlant {
 public:
  using Vector = Eigen::Matrix<double, D, 1>;

  /// State between two ticks.
  struct State {
    BodyState<D> body;
    /// Position and velocity along the wall's normal. One packed vector: stored and loaded whole, from tick to tick.
    Eigen::Vector2d across = Eigen::Vector2d::Zero();
    bool in_contact = false;
    Vector friction = Vector::Zero();  ///< Coulomb friction on the mass when the tick ended [N]
  };

  /// Can this environment be stepped exactly?
  static bool fits(const World& world) {
    if (world.surfaces.empty()) return true;
    const Material& m = world.surfaces[0].material;
    return world.surfaces.size() == 1 && std::holds_alternative<Wall>(world.surfaces[0].shape) &&
           (D == 1 || m.friction == 0.0 || m.viscous_friction_n_s_per_m == 0.0);
  }

  /// Integrator::exact; or exact_per_tick or trapezoidal, which detect contacts at the end of each of the tick's `steps`.
  ExactPlant(const RobotSpec& robot, const World& world, double dt, const BodyState<D>& start,
             Integrator method = Integrator::exact, int steps = 1)
      : dt_{dt / steps}, steps_{steps}, method_{method}, cuts_{method == Integrator::exact}, world_{world}, s_{start} {
    Oscillator free{robot.mass_kg, robot.damping_n_s_per_m, 0.0};
    for (const auto& s : world.springs) {
      free.damping_n_s_per_m += s.damping_n_s_per_m;
      free.stiffness_n_per_m += s.stiffness_n_per_m;
      pull_ += s.stiffness_n_per_m * s.anchor_m.head<D>();
    }
    wall_ = !world.surfaces.empty();
    region_[0] = region(free, free, 0.0);
    if (!wall_) return;
    const Surface& w = world.surfaces[0];
    const Wall& plane = std::get<Wall>(w.shape);
    normal_ = plane.normal.head<D>();
    offset_ = plane.offset_m;
    k_ = w.material.stiffness_n_per_m;
    b_ = w.material.damping_n_s_per_m;
    make_contact_region();
    place();
  }

  /// Can its wall have Coulomb friction?
  [[nodiscard]] bool takes_friction() const noexcept {
    return D > 1 && cuts_ && wall_ && world_.surfaces[0].material.viscous_friction_n_s_per_m == 0.0;
  }
  /// From now on the wall has this stiffness and friction.
  void set_surface(double stiffness_n_per_m, double friction) noexcept {
    world_.surfaces[0].material.stiffness_n_per_m = k_ = stiffness_n_per_m;
    world_.surfaces[0].material.friction = friction;
    make_contact_region();
    place();
  }

  /// One tick under the force f.
  const BodyState<D>& advance(const Force<D>& f) noexcept {
    if (steps_ != 1) return advance_in_steps(f);
    step(f);
    return s_.body;
  }
  [[nodiscard]] const BodyState<D>& body() const noexcept { return s_.body; }

  /// Position and velocity after a step, from those before and the load at the origin.
  struct Map {
    Eigen::Vector2d x, v, u;
    Map() = default;
    Map(const Response& r, const Oscillator& o)
        : x{1.0 - o.stiffness_n_per_m * r.xu, -o.stiffness_n_per_m * r.vu}, v{r.xv, r.vv}, u{r.xu, r.vu} {}
    Eigen::Vector2d operator()(const Eigen::Vector2d& n, double load) const noexcept {
      return x * n[0] + (v * n[1] + u * load);
    }
  };
  /// The motion without the wall or, while it presses, with it.
  struct Region {
    Oscillator across, along;  ///< the wall's normal; any direction along it
    double load;               ///< of the wall along the normal, at the origin
    double span;               ///< longest move
    Map map;                   ///< of a span, across
    Response full_along;
  };
  [[nodiscard]] const Region& region(bool in_contact) const noexcept { return region_[in_contact]; }
  /// Of the springs at the origin.
  [[nodiscard]] const Vector& pull() const noexcept { return pull_; }

  [[nodiscard]] const State& state() const noexcept { return s_; }
  /// Continues from `state`, of a plant of the same scene.
  void set_state(const State& state) noexcept { s_ = state; }

  /// Adds dv to the velocity.
  void kick(const Velocity<D>& dv) noexcept {
    s_.body.v += dv;
    place();
  }

  /// Of the environment on the mass: Environment::force, to the bit.
  [[nodiscard]] Force<D> environment_force() const noexcept {
    const Vector &x = s_.body.x.translation(), &v = s_.body.v.vec();
    Vector sum = Vector::Zero();
    ContactForce<D> c;
    if (s_.in_contact && world_.surfaces[0].force<D>({s_.across[0] - offset_, normal_}, s_.across[1], v, c))
      for (int i = 0; i < D; ++i)
        sum[i] += c.normal[i] + (rough_ ? s_.friction[i] : c.tangential[i]);  // a call where the compiler deems it rare
    for (const auto& s : world_.springs) sum += s.force<D>(x, v);
    return Force<D>{sum};
  }

 private:
  static constexpr int kCuts = 4096;  ///< beginnings and ends of contact within a tick
  using Normal = Eigen::Vector2d;     ///< as State::across

  [[nodiscard]] Region region(const Oscillator& across, const Oscillator& along, double load) const noexcept {
    const double h = cuts_ && wall_ ? span(across) : dt_;
    const bool exact = method_ != Integrator::trapezoidal;
    const auto response = [&](const Oscillator& o) { return exact ? Response{o, h} : trapezoidal(o, h); };
    return {across, along, load, h, Map{response(across), across}, response(along)};
  }
  /// The maps of the motion in contact, from those of the free one and the wall's material.
  void make_contact_region() noexcept {
    Oscillator across = region_[0].across, along = region_[0].across;
    across.stiffness_n_per_m += k_;
    across.damping_n_s_per_m += b_;
    along.damping_n_s_per_m += world_.surfaces[0].material.viscous_friction_n_s_per_m;
    region_[1] = region(across, along, k_ * offset_);
    const double friction = takes_friction() ? world_.surfaces[0].material.friction : 0.0;
    rough_ = friction > 0.0;
    friction_ = {region_[0].across, across, friction, k_, b_, offset_};
  }
  /// What belongs to s_.body.
  void place() noexcept {
    s_.across = normal(s_.body);
    s_.in_contact = wall_ && contact(s_.across);
    if (rough_) note_friction(pull_);
  }
  void note_friction(const Vector& u) noexcept {
    s_.friction.setZero();
    if (!s_.in_contact) return;
    const Vector ut = along(u) - region_[0].along.stiffness_n_per_m * along(s_.body.x.translation());
    s_.friction = friction_.force(ut, along(s_.body.v.vec()), {s_.across[0], s_.across[1]});
  }
  [[nodiscard]] Vector along(const Vector& a) const noexcept { return a - normal_.dot(a) * normal_; }
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

  void step(const Force<D>& f) noexcept {
    Vector u = f.vec() + pull_;
    if (!wall_) return step_free(u);
    const Region& r = region_[s_.in_contact];
    const double load = normal_.dot(u) + r.load;
    const Normal n = r.map(s_.across, load);
    const bool in = contact(n);
    if (r.span < dt_ || in != s_.in_contact || (rough_ && in)) {
      if (cuts_) return step_in_parts(u);
      s_.in_contact = in;
    } else if (!in && s_.across[1] < 0.0 && n[1] > 0.0 && cuts_) {
      if (contact_at_turn(s_.across, u, dt_)) return step_in_parts(u);
    }
    s_.body = moved(s_.body, s_.across, n, u, r, r.full_along);
    s_.across = n;
  }

  const BodyState<D>& advance_in_steps(Force<D> f) noexcept {
    for (int i = 0; i < steps_; ++i) step(f);
    return s_.body;
  }

  // Of ticks in which contact may begin or end (exact_wall.cc).

  /// Does the mass, which is free at both ends of h, turn around inside the wall?
  [[nodiscard]] bool contact_at_turn(const Normal& from, const Vector& u, double h) const noexcept;
  /// Without the wall, from `from`.
  [[nodiscard]] AxisState free_across(const Normal& from, const Vector& u, double t) const noexcept;
  /// When the free motion, towards the wall at first, turns around within h.
  [[nodiscard]] double turn(const Normal& from, const Vector& u, double h) const noexcept;
  /// A step that is cut where contact begins or ends, and at spans.
  void step_in_parts(Vector u) noexcept;
  [[nodiscard]] BodyState<D> moved(const BodyState<D>& s, const Vector& u, bool in, double h) const noexcept;
  /// When within h the normal motion, started in region `in`, leaves it: regula falsi (Illinois) on what contact() asks
  /// for, until both ends are within 1e-13 h.
  [[nodiscard]] double crossing(bool in, const BodyState<D>& s, const Vector& u, double h) const noexcept;

  /// A step without a wall.
  void step_free(Vector u) noexcept {
    const auto& [across, along, load, span, map, full] = region_[0];
    Vector x = s_.body.x.translation(), v = s_.body.v.vec();
    const Vector u0 = u - along.stiffness_n_per_m * x;
    s_.body.x = Position<D>{x + (full.xv * v + full.xu * u0)};
    s_.body.v = Velocity<D>{full.vv * v + full.vu * u0};
  }

  /// Completes a step whose normal motion has reached `to`.
  [[nodiscard]] BodyState<D> moved(const BodyState<D>& s, const Normal& from, const Normal& to, const Vector& u,
                                   const Region& r, const Response& along) const noexcept {
    if constexpr (D == 1) {
      return {Position<D>{to[0] * normal_}, Velocity<D>{to[1] * normal_}};
    } else {
      const Vector xt = s.x.translation() - from[0] * normal_, vt = s.v.vec() - from[1] * normal_;
      const Vector ut = u - normal_.dot(u) * normal_ - r.along.stiffness_n_per_m * xt;
      return {Position<D>{xt + along.xv * vt + along.xu * ut + to[0] * normal_},
              Velocity<D>{along.vv * vt + along.vu * ut + to[1] * normal_}};
    }
  }

  double dt_;
  int steps_;
  Integrator method_;
  bool cuts_;
  World world_;
  Vector pull_ = Vector::Zero(), normal_ = Vector::Unit(0);
  double offset_ = 0.0, k_ = 0.0, b_ = 0.0;
  bool wall_ = false, rough_ = false;
  Region region_[2];
  WallFriction<D> friction_;

  State s_;
};

extern template class ExactPlant<1>;
extern template class ExactPlant<3>;

}  // namespace twoport::sim
