#pragma once

#include <algorithm>
#include <cmath>

#include "common/base/spatial_vector.h"
#include "common/contact/contact_law.h"
#include "common/passivity/observer.h"
#include "common/scene/scene.h"
#include "sim/plant/integrators.h"
#include "sim/plant/linear.h"

namespace twoport::sim {

/// The handle of a device with the hand's mass, stiffness and damping on it, under a load that is linear in time:
///
///     (m_d + m_h) ẍ = u + w s - (b_d + b_h) ẋ - k_h (x - x(0)) - f_c ẋ/|ẋ|
///
/// The step is the exact solution, with a stop by Coulomb friction resolved inside it. N = 6 rotates like a sphere
/// (isotropic inertia), in rotation-vector coordinates local to the tick.
template <int N>
class HandlePlant {
 public:
  using Vector = PortVector<N>;

  /// State between two ticks.
  struct State {
    Position<N> x;
    Vector v;
  };

  HandlePlant(const DeviceSpec& device, const HandSpec& hand, const SimulationSpec& simulation, double dt,
              const State& start)
      : dt_{dt},
        simulation_{simulation},
        fixed_{simulation.integrator != Integrator::exact && simulation.integrator != Integrator::exact_per_tick},
        coulomb_n_{device.coulomb_friction_n},
        s_{start} {
    const Oscillator axis{device.mass_kg + hand.mass_kg, device.damping_n_s_per_m + hand.damping_n_s_per_m,
                          hand.stiffness_n_per_m};
    const Oscillator turn{device.inertia_kg_m2 + hand.inertia_kg_m2,
                          device.rotational_damping_n_m_s_per_rad + hand.rotational_damping_n_m_s_per_rad,
                          hand.rotational_stiffness_n_m_per_rad};
    axis_ = axis;
    if (axis.mass_kg > 0.0) fill(axis, &PortScale::linear);
    if (N == 6 && turn.mass_kg > 0.0) fill(turn, &PortScale::angular);
  }

  /// Does it have a mass?
  [[nodiscard]] bool moves() const noexcept { return axis_.mass_kg > 0.0; }
  /// One tick under the load u + w s, for one that moves. Returns the motion of the port.
  Interval<N> advance(const Vector& u, const Vector& w) noexcept {
    Vector v0 = s_.v, moved = xv_ * v0 + xu_ * u + xw_ * w, v = vv_ * v0 + vu_ * u + vw_ * w;
    if (fixed_) {
      const Motion m = step_fixed(u, w);
      moved = m.moved, v = m.v;
    } else if (coulomb_n_ != 0.0) {
      const Motion m = step_with_friction(u, w);
      translation(moved) = translation(m.moved), translation(v) = translation(m.v);
    }
    Position<N> before = s_.x;
    if constexpr (N == 6) {
      // From ∫ω dt to the rotation vector of the interval.
      moved.angular -= dt_ * dt_ / 12.0 * v0.angular.cross(v.angular);
      s_ = {before.moved(moved.linear, moved.angular), v};
      // As an observer computes it, except for rounding: the logarithm of a pose is expensive.
      return {Displacement<N>{moved}, Velocity<N>{v0}, Velocity<N>{v}};
    } else {
      s_ = {before + Displacement<N>{moved}, v};
      return {s_.x - before, Velocity<N>{v0}, Velocity<N>{v}};  // as an observer computes it, to the bit
    }
  }

  [[nodiscard]] Velocity<N> velocity() const noexcept { return Velocity<N>{s_.v}; }
  [[nodiscard]] const State& state() const noexcept { return s_; }
  /// Continues from `state`.
  void set_state(const State& state) noexcept { s_ = state; }

 private:
  static constexpr int kStops = 3;  ///< by friction, within one tick
  using Axes = Eigen::Matrix<double, kAxes<N>, 1>;

  void fill(const Oscillator& o, double PortScale::*part) {
    inverse_mass_.*part = 1.0 / o.mass_kg;
    damping_.*part = o.damping_n_s_per_m;
    stiffness_.*part = o.stiffness_n_per_m;
    const Response r = simulation_.integrator == Integrator::trapezoidal ? trapezoidal(o, dt_ / simulation_.substeps)
                                                                         : Response{o, dt_};
    xv_.*part = r.xv, xu_.*part = r.xu, xw_.*part = r.xw;
    vv_.*part = r.vv, vu_.*part = r.vu, vw_.*part = r.vw;
  }

  /// Over one tick: the displacement, and the velocity at its end.
  struct Motion {
    Vector moved, v;
  };
  /// The step by a textbook integrator; Coulomb friction explicit, smooth below kStictionSpeed.
  [[gnu::noinline]] Motion step_fixed(Vector u, Vector w) const noexcept {
    const double h = dt_ / simulation_.substeps;
    const auto load = [&](double t, const Vector& speed) {
      Vector sum = u + t * w;
      if (coulomb_n_ > 0.0) {
        const Axes s = translation(speed);
        translation(sum) -= coulomb_n_ / std::max(s.norm(), kStictionSpeed) * s;
      }
      return sum;
    };
    const auto a = [&](double t, const Vector& q, const Vector& speed) -> Vector {
      return inverse_mass_ * Vector{load(t, speed) - damping_ * speed - stiffness_ * q};
    };
    Vector moved = Vector::Zero(), v = s_.v;
    for (int i = 0; i < simulation_.substeps; ++i) {
      if (simulation_.integrator != Integrator::trapezoidal) {
        step_by(simulation_.integrator, h, i * h, moved, v, a);
        continue;
      }
      const Vector sum = load(i * h, v) - stiffness_ * moved;
      moved += xv_ * v + xu_ * sum + xw_ * w;
      v = vv_ * v + vu_ * sum + vw_ * w;
    }
    return {moved, v};
  }

  /// The translation's step with Coulomb friction: slide against the velocity until it stops along its direction, then
  /// stick if the other forces allow, else slide on.
  [[gnu::noinline]] Motion step_with_friction(Vector load_0, Vector slope_0) const noexcept {
    const Axes u = translation(load_0), w = translation(slope_0);
    Motion m{Vector::Zero(), s_.v};
    Axes &moved = translation(m.moved), &v = translation(m.v);
    double done = 0.0;
    for (int part = 0; done < dt_; ++part) {
      const double h = dt_ - done;
      const Axes load = u + done * w - axis_.stiffness_n_per_m * moved;
      const Axes velocity = v;
      Axes direction = velocity;
      if (velocity.squaredNorm() < 1e-24) {
        if (load.norm() <= coulomb_n_) {
          v.setZero();
          return m;
        }
        direction = load;
      }
      direction.normalize();
      const Axes pushed = load - coulomb_n_ * direction;
      // Motion along the direction of sliding ends where its velocity crosses zero.
      const AxisState along =
          propagate(axis_, {0, direction.dot(velocity)}, direction.dot(pushed), direction.dot(w), h);
      double until = h;
      const bool stops = part < kStops && along.v < 0.0 && direction.dot(velocity) > 0.0;
      if (stops) {
        double lo = 0.0, hi = h;
        for (int i = 0; i < 50; ++i) {
          until = 0.5 * (lo + hi);
          const double vel =
              propagate(axis_, {0, direction.dot(velocity)}, direction.dot(pushed), direction.dot(w), until).v;
          (vel > 0.0 ? lo : hi) = until;
        }
      }
      for (int i = 0; i < kAxes<N>; ++i) {
        const AxisState s = propagate(axis_, {0, velocity[i]}, pushed[i], w[i], until);
        moved[i] += s.x;
        v[i] = s.v;
      }
      if (stops) v -= direction.dot(v) * direction;
      if (v.squaredNorm() < 1e-24) v.setZero();
      done += until;
    }
    return m;
  }

  double dt_;
  SimulationSpec simulation_;
  bool fixed_;  ///< by a textbook integrator
  double coulomb_n_;
  Oscillator axis_;  ///< of translation
  PortScale inverse_mass_, damping_, stiffness_, xv_, xu_, xw_, vv_, vu_, vw_;
  State s_;
};

}  // namespace twoport::sim
