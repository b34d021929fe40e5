#include "sim/plant/handle.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>

#include "sim/plant/rosenbrock.h"

namespace twoport::sim {
namespace {

// Until when, between 0 and h, `holds` does.
template <class Holds>
double last(const Holds& holds, double h) noexcept {
  double lo = 0.0, hi = h, t = h;
  for (int i = 0; i < 50; ++i) {
    t = 0.5 * (lo + hi);
    (holds(t) ? lo : hi) = t;
  }
  return t;
}

}  // namespace

// The end of a tick in which the translation has been solved, and the rotation of a body with three principal moments is
// integrated by Runge-Kutta 4 in world axes, L the angular momentum, r = ∫ω dt:
//
//     L̇ = u + w s - R C Rᵀ ω - k r,   q̇ = ½ (0, ω) q,   ω = R J⁻¹ Rᵀ L
//
// in steps h with h · (fastest rate) <= 0.05: local error below 1e-8 of a step's change.
template <>
Interval<6> HandlePlant<6>::turn_about_principal_axes(SpatialVector moved, SpatialVector v, Eigen::Vector3d u,
                                                      Eigen::Vector3d w) noexcept {
  const Principal& p = *principal_;
  const Vector v0 = s_.v;
  const Eigen::Quaterniond q0 = s_.x.attitude();
  struct Turning {
    Eigen::Vector3d momentum, turned;
    Eigen::Vector4d attitude;
  };
  const auto velocity = [&](const Turning& y) -> Eigen::Vector3d {
    const Eigen::Quaterniond q{y.attitude};
    const Eigen::Matrix3d R = q.normalized().toRotationMatrix();
    return R * (R.transpose() * y.momentum).cwiseQuotient(p.inertia);
  };
  const auto rate = [&](const Turning& y, double t) -> Turning {
    const Eigen::Quaterniond q{y.attitude};
    const Eigen::Matrix3d R = q.normalized().toRotationMatrix();
    const Eigen::Vector3d body = (R.transpose() * y.momentum).cwiseQuotient(p.inertia), omega = R * body;
    const Eigen::Quaterniond dq = Eigen::Quaterniond{0.0, omega.x(), omega.y(), omega.z()} * q;
    return {u + t * w - R * p.damping.cwiseProduct(body) - p.stiffness * y.turned, omega, 0.5 * dq.coeffs()};
  };
  const auto add = [](const Turning& y, const Turning& d, double h) -> Turning {
    return {y.momentum + h * d.momentum, y.turned + h * d.turned, y.attitude + h * d.attitude};
  };
  const double least = p.inertia.minCoeff();
  const double fastest =
      std::max({p.damping.cwiseQuotient(p.inertia).maxCoeff(), std::sqrt(p.stiffness / least), v0.angular.norm()});
  constexpr double kMost = 4096.0;
  const int steps = static_cast<int>(std::clamp(std::ceil(dt_ * fastest / 0.05), 1.0, kMost));
  const double h = dt_ / steps;
  const Eigen::Matrix3d R0 = q0.toRotationMatrix();
  Turning y{R0 * p.inertia.cwiseProduct(R0.transpose() * v0.angular), Eigen::Vector3d::Zero(), q0.coeffs()};
  for (int i = 0; i < steps; ++i) {
    const double t = i * h;
    const Turning a = rate(y, t), b = rate(add(y, a, 0.5 * h), t + 0.5 * h), c = rate(add(y, b, 0.5 * h), t + 0.5 * h),
                  d = rate(add(y, c, h), t + h);
    y = add(add(add(add(y, a, h / 6.0), b, h / 3.0), c, h / 3.0), d, h / 6.0);
  }
  v.angular = velocity(y);
  Eigen::Quaterniond q{y.attitude};
  q.normalize();
  s_ = {Position<6>{s_.x.translation() + moved.linear, q}, v};
  // The rotation vector of the interval; an observer adds what it lacks to ∫ω dt.
  moved.angular = rotation_vector(q * q0.conjugate());
  return {Displacement<6>{moved}, Velocity<6>{v0}, Velocity<6>{v}};
}

// The step by a textbook integrator; Coulomb friction explicit, smooth below kStictionSpeed.
template <int N>
typename HandlePlant<N>::Motion HandlePlant<N>::step_fixed(Vector u, Vector w) const noexcept {
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

// The translation's step with Coulomb friction: it slides against the velocity until it stops, sticks for as long as
// the other forces are no larger, and slides on. Each part ends at its event. Along a line a part is the exact
// solution; where the direction turns, steps by RODAS with control of their error.
template <int N>
typename HandlePlant<N>::Motion HandlePlant<N>::step_with_friction(Vector load_0, Vector slope_0) const noexcept {
  const Axes u = translation(load_0), w = translation(slope_0);
  Motion m{Vector::Zero(), s_.v};
  Axes &moved = translation(m.moved), &v = translation(m.v);
  double done = 0.0;
  for (int part = 0; done < dt_; ++part) {
    Axes load = u + done * w - axis_.stiffness_n_per_m * moved;
    Axes direction = v;
    const bool rests = v.squaredNorm() < kRest * kRest;
    if (rests) {
      v.setZero();
      const double wait = release(load, w);
      if (!(wait < dt_ - done)) return m;
      done += wait;
      load += wait * w;
      direction = load;
    }
    direction.normalize();
    const double left = dt_ - done;
    if constexpr (N > 1) {
      if (part < kParts && turns(load, w, direction, left)) {
        done += slide_turning(load, w, rests ? direction : Axes{Axes::Zero()}, left, moved, v);
        continue;
      }
    }
    done += slide_straight(load, w, direction, left, part < kParts, moved, v);
  }
  return m;
}
// When a load that friction holds, and that grows by w s, exceeds it [s].
template <int N>
double HandlePlant<N>::release(const Axes& load, const Axes& w) const noexcept {
  const double a = w.squaredNorm(), b = load.dot(w), c = load.squaredNorm() - coulomb_n_ * coulomb_n_;
  if (c > 0.0) return 0.0;
  if (a == 0.0) return std::numeric_limits<double>::infinity();
  const double root = std::sqrt(b * b - a * c);
  return b > 0.0 ? -c / (b + root) : (root - b) / a;
}
// Does the direction of sliding turn within `left`?
template <int N>
bool HandlePlant<N>::turns(const Axes& load, const Axes& w, const Axes& direction, double left) const noexcept
    requires(N > 1) {
  const Axes across = load - direction.dot(load) * direction, rate = w - direction.dot(w) * direction;
  return across.norm() + left * rate.norm() > 1e-13 * (load.norm() + coulomb_n_);
}

// Slides along a line for `left` or until it stops. Returns how long.
template <int N>
double HandlePlant<N>::slide_straight(const Axes& load, const Axes& w, const Axes& direction, double left,
                                      bool may_stop, Axes& moved, Axes& v) const noexcept {
  // The acceleration changes its sign at most once within half an oscillation.
  const double span = may_stop ? 2.0 / std::sqrt(axis_.stiffness_n_per_m / axis_.mass_kg) : left;
  const double h = std::min(left, span);
  Axes pushed = load - coulomb_n_ * direction;
  const double speed = direction.dot(v), slope = direction.dot(w);
  if (speed == 0.0) pushed -= std::min(0.0, direction.dot(pushed)) * direction;
  const double push = direction.dot(pushed);
  const auto along = [&](double t) { return propagate(axis_, {0, speed}, push, slope, t); };
  const auto acceleration = [&](const AxisState& s, double t) {
    return push + slope * t - axis_.damping_n_s_per_m * s.v - axis_.stiffness_n_per_m * s.x;
  };
  const AxisState end = along(h);
  double until = h;
  bool stops = may_stop && end.v < 0.0;
  if (may_stop && !stops && acceleration({0, speed}, 0.0) < 0.0 && acceleration(end, h) > 0.0) {
    const double slowest = last([&](double t) { return acceleration(along(t), t) < 0.0; }, h);
    stops = along(slowest).v < 0.0;
    if (stops) until = slowest;
  }
  if (stops) until = last([&](double t) { return along(t).v > 0.0; }, until);
  if (N == 1 && !stops) {
    moved += end.x * direction;
    v = end.v * direction;
    return h;
  }
  for (int i = 0; i < kAxes<N>; ++i) {
    const AxisState s = propagate(axis_, {0, v[i]}, pushed[i], w[i], until);
    moved[i] += s.x;
    v[i] = s.v;
  }
  if (stops) v -= direction.dot(v) * direction;
  if (v.squaredNorm() < kRest * kRest) v.setZero();
  return until;
}
// Slides for `left`, or until it stops, against a velocity that turns; from rest towards `start`. Returns how long.
//
//     m v̇ = load + w s - b v - k x - f_c v/|v|
template <int N>
double HandlePlant<N>::slide_turning(const Axes& load, const Axes& w, const Axes& start, double left, Axes& moved,
                                     Axes& v) const noexcept requires(N > 1) {
  constexpr int kSteps = 500;
  constexpr double kShort = 0.01;  // [rad]: a step of Runge-Kutta 4, which errs by (0.01)^5/120 of the velocity
  constexpr double kPositionError = 1e-13, kVelocityError = 1e-10;  // of a step [m], [m/s]
  constexpr int D = kAxes<N>;
  using Stacked = Eigen::Matrix<double, 2 * D + 1, 1>;  // displacement, velocity, time
  const double mass = axis_.mass_kg, damping = axis_.damping_n_s_per_m, stiffness = axis_.stiffness_n_per_m;
  const double own_rate = std::max(std::sqrt(stiffness / mass), damping / mass);
  Stacked y;
  y << Axes::Zero(), v, 0.0;
  if (!start.isZero(0.0)) {
    // So short that the direction does not turn in it: from rest it turns at w/f_c at most.
    const double push = std::max(0.0, start.dot(load) - coulomb_n_), slope = std::max(0.0, start.dot(w));
    double h = 1e-5 * left;
    AxisState s = propagate(axis_, {0, 0}, push, slope, h);
    while (s.v < 100.0 * kRest && h < left) {
      h = std::min(4.0 * h, left);
      s = propagate(axis_, {0, 0}, push, slope, h);
    }
    y << s.x * start, s.v * start, h;
  }
  const auto rates = [&](const Stacked& at) {
    Stacked rate;
    Axes speed = at.template segment<D>(D);
    const double norm = std::max(speed.norm(), 0.1 * kRest);
    rate << speed,
        (load + at[2 * D] * w - damping * speed - stiffness * at.template head<D>() - coulomb_n_ / norm * speed) / mass,
        1.0;
    return rate;
  };
  double h = left;
  for (int steps = 0; steps < kSteps && y[2 * D] < left; ++steps) {
    const Axes speed = y.template segment<D>(D);
    const double norm = speed.norm();
    if (norm < kRest) break;
    h = std::min(h, left - y[2 * D]);
    const Stacked f0 = rates(y);
    // Not past a stop: at most half of the way there.
    const double slows = -speed.dot(f0.template segment<D>(D)) / norm;
    if (slows * h > 0.5 * norm) h = 0.5 * norm / slows;
    const double rate = std::max(coulomb_n_ / (mass * norm), own_rate);
    if (h * rate < 10.0 * kShort) {
      const double d = std::min(h, kShort / rate);
      const Stacked a = rates(y + 0.5 * d * f0), b = rates(y + 0.5 * d * a), c = rates(y + d * b);
      y += d / 6.0 * (f0 + 2.0 * (a + b) + c);
      continue;
    }
    Eigen::Matrix<double, 2 * D + 1, 2 * D + 1> jacobian = decltype(jacobian)::Zero();
    jacobian.template block<D, D>(0, D).setIdentity();
    jacobian.template block<D, D>(D, 0).diagonal().setConstant(-stiffness / mass);
    const Axes direction = speed / norm;
    jacobian.template block<D, D>(D, D) = (coulomb_n_ / norm * direction * direction.transpose() -
                                           (coulomb_n_ / norm + damping) * Eigen::Matrix<double, D, D>::Identity()) /
                                          mass;
    jacobian.template block<D, 1>(D, 2 * D) = w / mass;
    Stacked off;
    const Stacked by = rosenbrock_step<2 * D + 1>(
        jacobian, f0, h, [&](const Stacked& d) { return rates(y + d); }, off);
    const double error = std::max(off.template head<D>().norm() / kPositionError,
                                  off.template segment<D>(D).norm() / (kVelocityError * std::min(1.0, 1e3 * norm)));
    const double factor = std::clamp(0.9 / std::sqrt(std::sqrt(error)), 0.2, 5.0);
    if (!(error <= 1.0) && h > 1e-12 * left) {
      h *= error > 1.0 ? std::min(factor, 0.9) : 0.2;
      continue;
    }
    y += by;
    h *= factor;
  }
  moved += y.template head<D>();
  v = y.template segment<D>(D);
  return y[2 * D];
}

TWOPORT_COMPILE(HandlePlant);

}  // namespace twoport::sim
