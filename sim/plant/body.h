#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "common/contact/environment.h"
#include "common/scene/scene.h"
#include "sim/plant/body_plant.h"
#include "sim/plant/rosenbrock.h"

namespace twoport::sim {

/// The equation of motion of a mass (N = 1, 3) or a rigid body (N = 6) under a force f in an environment.
///
///     m v̇ = f - b v + f_env(x, v)         N = 6 also  L̇ = τ - b_r ω + τ_env,  L = R J Rᵀ ω  carried in world axes
///
/// Copies share the environment, which never changes.
template <int N>
class Body {
 public:
  using Vector = PortVector<N>;
  /// The contacts that carry force, ascending. Allocates at construction only.
  class Contacts {
   public:
    /// At most so many.
    explicit Contacts(int most) : all_(static_cast<std::size_t>(most)) {}
    void clear() noexcept { count_ = 0; }
    void push_back(const Touched& t) noexcept { all_[count_++] = t; }
    [[nodiscard]] std::span<const Touched> all() const noexcept { return {all_.data(), count_}; }
    friend bool operator==(const Contacts& a, const Contacts& b) noexcept {
      return std::equal(a.all().begin(), a.all().end(), b.all().begin(), b.all().end());
    }

   private:
    std::vector<Touched> all_;
    std::size_t count_ = 0;
  };

  /// Motion of the body; p is its velocity, for N = 6 its momentum and angular momentum.
  struct Motion {
    PoseWithRotation<N> at;
    Vector p;
  };
  struct Slope {
    Vector v, p;            ///< rates of the position and of Motion::p
    Vector environment;     ///< force on the body
    double friction = 0.0;  ///< sum of the contacts' Coulomb damping [N s/m]; of a slope with all contacts
  };

  /// Up to `few` surfaces all are asked; the results are the same.
  Body(const RobotSpec& robot, std::shared_ptr<const Environment<N>> environment, std::size_t few)
      : mass_{robot.mass_kg},
        damping_{robot.damping_n_s_per_m},
        rotational_damping_{robot.rotational_damping_n_m_s_per_rad},
        environment_{std::move(environment)} {
    if constexpr (N == 6) inertia_ = vector<3>(robot.inertia_kg_m2);
    const auto& surfaces = environment_->world().surfaces;
    if (surfaces.size() > few) near_ = std::make_shared<const BroadPhase<kAxes<N>>>(surfaces);
    const auto solid = [](const Surface& s) { return !std::holds_alternative<Wall>(s.shape); };
    if constexpr (N == 6)
      if (near_->empty() && std::any_of(surfaces.begin(), surfaces.end(), solid))
        clearance_ = environment_->clearance();
  }

  [[nodiscard]] const Environment<N>& environment() const noexcept { return *environment_; }
  /// Of all contacts on the body.
  [[nodiscard]] Vector environment_force(const PoseWithRotation<N>& x, const Vector& v) const noexcept {
    Vector sum = Vector::Zero();
    for_each_contact(x, v, [&](const ContactPort<N>& c) {
      if (c.presses) sum += c.normal + c.tangential;
    });
    return sum;
  }
  [[nodiscard]] double mass() const noexcept { return mass_; }
  /// Rate at which its own damping slows it down [1/s].
  [[nodiscard]] double damping_rate() const noexcept {
    const double linear = damping_ / mass_;
    return N == 6 ? std::max(linear, rotational_damping_ / inertia_.minCoeff()) : linear;
  }
  /// A torque over the square root of the least moment of inertia [√kg m/s²]: times that of a mobility, an acceleration.
  [[nodiscard]] double largest_spin_up(const Eigen::Vector3d& torque) const noexcept {
    return torque.norm() / std::sqrt(inertia_.minCoeff());
  }
  /// Mobility of a point at an arm from the origin: at most 1/m + arm²/J [1/kg].
  [[nodiscard]] double mobility_at(const Eigen::Vector3d& arm) const noexcept {
    return 1.0 / mass_ + arm.squaredNorm() / inertia_.minCoeff();
  }

  [[nodiscard]] Motion motion(const BodyState<N>& s) const noexcept {
    Motion m{s.x, port_vector<N>(s.v.vec())};
    if constexpr (N == 6) {
      const Eigen::Matrix3d& R = m.at.R;
      m.p.linear *= mass_;
      m.p.angular = R * inertia_.cwiseProduct(R.transpose() * m.p.angular);
    }
    return m;
  }
  [[nodiscard]] Vector velocity(const Motion& m) const noexcept {
    if constexpr (N == 6) {
      const Eigen::Matrix3d& R = m.at.R;
      return {m.p.linear / mass_, R * (R.transpose() * m.p.angular).cwiseQuotient(inertia_)};
    } else {
      return m.p;
    }
  }

  /// Only with the contacts and features of `among`, if it is given: a contact that begins within a step belongs to the next one.
  [[nodiscard]] Slope slope_among(const Motion& m, const Vector& f, const Contacts* among) const noexcept {
    if (!among) return slope_of_all(m, f);
    Vector v = velocity(m), environment = Vector::Zero();
    environment_->for_each_contact(m.at, v, among->all(), [&](const ContactPort<N>& c) {
      if (c.presses) environment += c.normal + c.tangential;
    });
    return slope(v, f, environment);
  }
  /// With all contacts, which are returned in `touched`.
  Slope slope(const Motion& m, const Vector& f, Contacts& touched) const noexcept {
    touched.clear();
    double friction = 0.0;
    Vector v = velocity(m), environment = Vector::Zero();
    for_each_contact(m.at, v, [&](const ContactPort<N>& c) {
      if (!c.presses) return;
      environment += c.normal + c.tangential;
      touched.push_back({c.index, c.feature});
      friction += c.coulomb_damping;
    });
    Slope a = slope(v, f, environment);
    a.friction = friction;
    return a;
  }

  /// A classical Runge-Kutta step of h from m, where the slope is a.
  Motion runge_kutta(const Motion& m, const Slope& a, const Vector& f, const Contacts* among, double h) const noexcept {
    Vector xa = position_rate(Vector::Zero(), a.v);
    Slope b = slope_among(moved(m, 0.5 * h * xa, 0.5 * h * a.p), f, among);
    Vector xb = position_rate(0.5 * h * xa, b.v);
    Slope c = slope_among(moved(m, 0.5 * h * xb, 0.5 * h * b.p), f, among);
    Vector xc = position_rate(0.5 * h * xb, c.v);
    Slope d = slope_among(moved(m, h * xc, h * c.p), f, among);
    Vector xd = position_rate(h * xc, d.v);
    return moved(m, h / 6.0 * (xa + 2.0 * (xb + xc) + xd), h / 6.0 * (a.p + 2.0 * (b.p + c.p) + d.p));
  }

  /// A step of h from m, where the slope is a, by RODAS, with the contacts of `among`: for friction that is stiff. Tells
  /// its own error, against what it is allowed: accept it up to 1.
  Motion rosenbrock(const Motion& m, const Slope& a, const Vector& f, const Contacts* among, double h,
                    double& error) const noexcept {
    const auto rates = [&](const Stacked& y) {
      const Vector by = part(y, 0);
      const Slope s = slope_among(moved(m, by, part(y, N)), f, among);
      return stacked(position_rate(by, s.v), s.p);
    };
    constexpr double kDifference = 1e-7;  // [m], [rad], [m/s], [rad/s]
    Eigen::Matrix<double, 2 * N, 2 * N> jacobian;
    for (int i = 0; i < 2 * N; ++i) {
      const double d = i < N ? kDifference : kDifference * momentum_of_unit(i - N);
      Stacked by = Stacked::Zero();
      by[i] = d;
      jacobian.col(i) = (rates(by) - rates(-by)) / (2.0 * d);
    }
    Stacked off;
    const Stacked by = rosenbrock_step<2 * N>(jacobian, stacked(a.v, a.p), h, rates, off);
    error = 0.0;
    for (int i = 0; i < N; ++i) {
      const double size = i < 3 ? 1.0 : kErrorArm;
      error = std::max({error, size * std::abs(off[i]) / kPositionError,
                        size * std::abs(off[N + i]) / momentum_of_unit(i) / kVelocityError});
    }
    return moved(m, part(by, 0), part(by, N));
  }

  /// Motion after h without contacts (N = 6), under a held wrench: the Taylor series, to rounding, of
  ///
  ///     J ω̇ = Jω×ω + t - b_r ω,   ṫ = t×ω,   q̇ = ½ q (0, ω),   m v̇ = f - b v        ω, t = Rᵀτ in body axes
  ///
  /// in pieces short enough for it to converge.
  Motion flight(Motion m, Vector f, double h) const noexcept requires(N == 6) {
    constexpr int kHalvings = 10;
    double left = h, piece = h;
    for (int halvings = 0; left > 0.0;) {
      piece = std::min(piece, left);
      if (series(m, f, piece, halvings == kHalvings)) {
        left -= piece;
      } else {
        piece *= 0.5;
        ++halvings;
      }
    }
    return m;
  }

  /// Moved by a displacement (N = 6: translation and rotation vector) and a change of p.
  [[nodiscard]] static Motion moved(const Motion& m, const Vector& by, const Vector& dp) noexcept {
    if constexpr (N == 6) {
      return {m.at.x.moved(by.linear, by.angular), m.p + dp};
    } else {
      return {Position<N>{m.at.x.translation() + by}, m.p + dp};
    }
  }

 private:
  using Stacked = Eigen::Matrix<double, 2 * N, 1>;  ///< a displacement and a change of Motion::p

  // What a step by RODAS may err by: a contact of 1 kN/m errs by 10 nN.
  static constexpr double kPositionError = 1e-11, kVelocityError = 1e-9;  // [m], [m/s]
  static constexpr double kErrorArm = 0.1;                                // of a rotation [m]

  static Stacked stacked(const Vector& a, const Vector& b) noexcept {
    Stacked y;
    if constexpr (N == 6) {
      y << a.linear, a.angular, b.linear, b.angular;
    } else {
      y.template head<N>() = a;
      y.template tail<N>() = b;
    }
    return y;
  }
  static Vector part(const Stacked& y, int from) noexcept {
    return port_vector<N>(Eigen::Matrix<double, N, 1>{y.template segment<N>(from)});
  }
  /// Motion::p along axis i at 1 m/s or, at least, 1 rad/s.
  [[nodiscard]] double momentum_of_unit(int i) const noexcept {
    if constexpr (N == 6) return i < 3 ? mass_ : inertia_.minCoeff();
    (void)i;
    return 1.0;
  }

  /// One Taylor series of flight(). False, and m unchanged, where it has not converged and need not be accepted.
  [[nodiscard]] bool series(Motion& m, const Vector& f, double h, bool accept) const noexcept requires(N == 6) {
    constexpr std::size_t kTerms = 24;
    constexpr double kRounding = 1e-17, kConverging = 1e-11;
    using Numbers = std::array<double, kTerms>;
    const Eigen::Matrix3d& R = m.at.R;
    const bool pushed = !f.angular.isZero(0.0), damped = rotational_damping_ != 0.0, slowed = damping_ != 0.0;
    // J ω̇ + ω×Jω has the components of `gyration` times ω_y ω_z, ω_z ω_x, ω_x ω_y.
    const Eigen::Vector3d gyration{inertia_[1] - inertia_[2], inertia_[2] - inertia_[0], inertia_[0] - inertia_[1]};
    const Eigen::Vector3d inverse = inertia_.cwiseInverse();
    // Coefficients of (s/h)^k for s of 0 to h.
    Numbers wx, wy, wz, qx, qy, qz, qw;
    std::array<Eigen::Vector3d, kTerms> t;
    const auto omega = [&](std::size_t k) { return Eigen::Vector3d{wx[k], wy[k], wz[k]}; };
    Eigen::Vector3d spin = (R.transpose() * m.p.angular).cwiseProduct(inverse);
    wx[0] = spin.x(), wy[0] = spin.y(), wz[0] = spin.z();
    t[0] = R.transpose() * f.angular;
    qx[0] = qy[0] = qz[0] = 0.0, qw[0] = 1.0;
    Eigen::Vector3d term = m.p.linear / mass_, v = term, x = Eigen::Vector3d::Zero();
    double real = 1.0, i_axis = 0.0, j_axis = 0.0, k_axis = 0.0;
    double spin_size = spin.template lpNorm<1>(), speed_size = v.template lpNorm<1>(), before = 1.0;
    for (std::size_t k = 0; k + 1 < kTerms; ++k) {
      double xy = 0.0, yz = 0.0, zx = 0.0, ax = 0.0, ay = 0.0, az = 0.0, aw = 0.0;
      const auto add = [&](std::size_t i, std::size_t j) {
        xy += wx[i] * wy[j], yz += wy[i] * wz[j], zx += wz[i] * wx[j];
        ax += qw[i] * wx[j] + (qy[i] * wz[j] - qz[i] * wy[j]);
        ay += qw[i] * wy[j] + (qz[i] * wx[j] - qx[i] * wz[j]);
        az += qw[i] * wz[j] + (qx[i] * wy[j] - qy[i] * wx[j]);
        aw += qx[i] * wx[j] + qy[i] * wy[j] + qz[i] * wz[j];
      };
      // The newest coefficients last: the rest of the sum does not wait for them.
      for (std::size_t i = 1; i < k; ++i) add(i, k - i);
      if (k > 0) add(0, k);
      add(k, 0);
      const std::size_t n = k + 1;
      const double step = h / static_cast<double>(n), half = 0.5 * step;
      Eigen::Vector3d torque = gyration.cwiseProduct(Eigen::Vector3d{yz, zx, xy});
      if (pushed) {
        torque += t[k];
        t[n].setZero();
        for (std::size_t i = 0; i <= k; ++i) t[n] += t[i].cross(omega(k - i));
        t[n] *= step;
      }
      if (damped) torque -= rotational_damping_ * omega(k);
      const Eigen::Vector3d w = step * torque.cwiseProduct(inverse);
      wx[n] = w.x(), wy[n] = w.y(), wz[n] = w.z();
      qx[n] = half * ax, qy[n] = half * ay, qz[n] = half * az, qw[n] = -half * aw;
      i_axis += qx[n], j_axis += qy[n], k_axis += qz[n], real += qw[n];
      // Without damping the velocity's series ends after f.
      double speed_change = 0.0;
      if (k < 2 || slowed) {
        x += step * term;
        term *= -step * damping_ / mass_;
        if (k == 0) term += step / mass_ * f.linear;
        v += term;
        speed_size += term.template lpNorm<1>();
        speed_change = term.template lpNorm<1>() / speed_size;
      }
      // Largest new term against what it may be: below rounding, after one that was small already.
      double size = std::max(std::abs(qx[n]) + std::abs(qy[n]) + std::abs(qz[n]) + std::abs(qw[n]), speed_change);
      if (damped) {
        spin += w;
        spin_size += w.template lpNorm<1>();
        size = std::max(size, w.template lpNorm<1>() / spin_size);
      }
      if ((size <= kRounding && before <= kConverging) || (accept && n + 1 == kTerms)) {
        Eigen::Quaterniond to = m.at.x.attitude() * Eigen::Quaterniond{real, i_axis, j_axis, k_axis};
        to.coeffs() *= 1.5 - 0.5 * to.squaredNorm();
        const Vector p{mass_ * v, m.p.angular + h * f.angular};
        m = {Position<6>{m.at.x.translation() + x, to}, p};
        if (damped) m.p.angular = m.at.R * inertia_.cwiseProduct(spin);
        return true;
      }
      before = size;
    }
    return false;
  }

  /// Without a look at what is certainly open.
  template <class Visit>
  void for_each_contact(const PoseWithRotation<N>& x, const Vector& v, const Visit& visit) const noexcept {
    if constexpr (N == 6)
      if (!clearance_.empty()) return environment_->for_each_contact(x, v, clearance_, visit);
    environment_->for_each_contact(x, v, *near_, visit);
  }
  Slope slope_of_all(const Motion& m, const Vector& f) const noexcept {
    Vector v = velocity(m);
    return slope(v, f, environment_force(m.at, v));
  }
  /// Rates at the velocity v under the forces f and `environment`.
  [[nodiscard]] Slope slope(const Vector& v, const Vector& f, const Vector& environment) const noexcept {
    Vector total = f + environment;
    if constexpr (N == 6) {
      total.linear -= damping_ * v.linear;
      total.angular -= rotational_damping_ * v.angular;
      return {v, total, environment};
    } else {
      return {v, (total - damping_ * v) / mass_, environment};
    }
  }

  /// Rate of a displacement that has reached `moved`: for N = 6 the attitude advances by a rotation vector r, whose rate
  /// is ω - ½ r×ω + (1/12) r×(r×ω) for ω in world axes.
  static Vector position_rate(const Vector& moved, const Vector& v) noexcept {
    if constexpr (N == 6) {
      Eigen::Vector3d r = moved.angular, w = v.angular, rw = r.cross(w);
      return {v.linear, w - 0.5 * rw + r.cross(rw) / 12.0};
    } else {
      (void)moved;
      return v;
    }
  }

  double mass_, damping_, rotational_damping_;
  Eigen::Vector3d inertia_ = Eigen::Vector3d::Ones();
  std::shared_ptr<const Environment<N>> environment_;
  std::shared_ptr<const BroadPhase<kAxes<N>>> near_ = std::make_shared<const BroadPhase<kAxes<N>>>();
  mutable Clearance clearance_;  ///< of a tool among solids; no state: without it the results are the same
};

}  // namespace twoport::sim
