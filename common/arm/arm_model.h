#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <cstddef>

#include "common/arm/parameters.h"

namespace twoport {

/// A rigid tool beyond the flange: mass, centre of mass and inertia about it, in tool axes.
struct ArmTool {
  double mass_kg = 0.0;
  Eigen::Vector3d center_m = Eigen::Vector3d::Zero();
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();  ///< [kg m²]
};

/// Kinematics and dynamics of a serial arm with n revolute joints. Every formula in axes of the base, moments about its
/// origin, so that velocities, momenta and composite inertias of links add without rotations. Sizes are fixed; nothing
/// allocates.
///
///     τ = M(q) q̈ + c(q, q̇) + g(q)           M includes the rotors' inertias, as a diagonal
///     V = J(q) q̇                             V of the tool's origin: translation first, axes of the base
///
/// Inverse dynamics by Newton-Euler, inertia matrix by composite bodies (R. Featherstone, Rigid Body Dynamics Algorithms,
/// 2008, chapters 5 and 6), forward dynamics by a Cholesky factorisation of M.
template <int n>
class ArmModel {
 public:
  using Joints = Eigen::Matrix<double, n, 1>;
  using Inertia = Eigen::Matrix<double, n, n>;
  using Jacobian = Eigen::Matrix<double, 6, n>;
  using Vector6 = Eigen::Matrix<double, 6, 1>;

  /// Where everything is at q.
  struct Pose {
    std::array<Eigen::Matrix3d, n> rotation;              ///< base from link
    std::array<Eigen::Vector3d, n> origin, axis, moment;  ///< of joint i: a point, direction z, and origin × z
    Eigen::Matrix3d tool_rotation;                        ///< base from tool
    Eigen::Vector3d tool;                                 ///< the tool's origin [m]
  };

  /// `arm` must have n joints. The tool's frame is turned against the flange's by `tool_rotation` (flange from tool).
  explicit ArmModel(const ArmParameters& arm, const ArmTool& tool = {},
                    const Eigen::Matrix3d& tool_rotation = Eigen::Matrix3d::Identity())
      : tool_rotation_{arm.flange_rotation * tool_rotation}, tool_{arm.flange_m} {
    for (std::size_t i = 0; i < kJoints; ++i) {
      const ArmJoint& j = arm.joints[i];
      Link& link = links_[i];
      link = {j.rotation, j.origin_m, j.mass_kg, j.center_m, j.inertia};
      rotor_[static_cast<int>(i)] = j.rotor_inertia_kg_m2;
    }
    const Eigen::Matrix3d inertia = tool_rotation_ * tool.inertia * tool_rotation_.transpose();
    if (!(tool.mass_kg > 0.0)) {
      links_[kJoints - 1].inertia += inertia;
      return;
    }
    // The tool is part of the last link.
    Link& last = links_[kJoints - 1];
    const Eigen::Vector3d center = tool_ + tool_rotation_ * tool.center_m;
    const double mass = last.mass + tool.mass_kg;
    const Eigen::Vector3d common = (last.mass * last.center + tool.mass_kg * center) / mass;
    last.inertia += of_point(last.mass, last.center - common) + of_point(tool.mass_kg, center - common) + inertia;
    last.mass = mass;
    last.center = common;
  }

  [[nodiscard, gnu::flatten]] Pose pose(const Joints& q) const noexcept {
    Pose p;
    Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
    Eigen::Vector3d x = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < kJoints; ++i) {
      const Link& link = links_[i];
      x += R * link.origin;
      const Eigen::Matrix3d before = R * link.rotation;
      const double c = std::cos(q[static_cast<int>(i)]), s = std::sin(q[static_cast<int>(i)]);
      R.col(0) = c * before.col(0) + s * before.col(1);
      R.col(1) = c * before.col(1) - s * before.col(0);
      R.col(2) = before.col(2);
      p.rotation[i] = R;
      p.origin[i] = x;
      p.axis[i] = R.col(2);
      p.moment[i] = x.cross(p.axis[i]);
    }
    p.tool_rotation = R * tool_rotation_;
    p.tool = x + R * tool_;
    return p;
  }

  /// Of the tool's origin: [m/s] and [rad/s] per [rad/s].
  [[nodiscard, gnu::flatten]] Jacobian jacobian(const Pose& p) const noexcept {
    Jacobian J;
    for (std::size_t i = 0; i < kJoints; ++i) {
      const auto c = static_cast<int>(i);
      J.template block<3, 1>(0, c) = p.axis[i].cross(p.tool - p.origin[i]);
      J.template block<3, 1>(3, c) = p.axis[i];
    }
    return J;
  }
  /// J̇ q̇: acceleration of the tool's origin at q̈ = 0.
  [[nodiscard]] Vector6 bias_acceleration(const Pose& p, const Joints& v) const noexcept {
    Eigen::Vector3d w = Eigen::Vector3d::Zero(), alpha = w, a = w, x = w;
    for (std::size_t i = 0; i < kJoints; ++i) {
      const Eigen::Vector3d arm = p.origin[i] - x, turned = v[static_cast<int>(i)] * p.axis[i];
      a += alpha.cross(arm) + w.cross(w.cross(arm));
      alpha += w.cross(turned);
      w += turned;
      x = p.origin[i];
    }
    const Eigen::Vector3d arm = p.tool - x;
    a += alpha.cross(arm) + w.cross(w.cross(arm));
    Vector6 all;
    all << a, alpha;
    return all;
  }

  /// τ for q̈ under gravity g [m/s²], an acceleration, in axes of the base.
  [[nodiscard, gnu::flatten]] Joints inverse_dynamics(const Pose& p, const Joints& v, const Joints& acceleration,
                                                      const Eigen::Vector3d& gravity) const noexcept {
    // Of the point of each body that is at the base's origin: velocity u and acceleration a; gravity as an acceleration
    // of the base.
    Eigen::Vector3d w = Eigen::Vector3d::Zero(), u = w, alpha = w, a = -gravity;
    std::array<Eigen::Vector3d, n> force, torque;
    for (std::size_t i = 0; i < kJoints; ++i) {
      const double vi = v[static_cast<int>(i)], ai = acceleration[static_cast<int>(i)];
      const Eigen::Vector3d &z = p.axis[i], &m = p.moment[i];
      a += ai * m + vi * (w.cross(m) + u.cross(z));
      alpha += ai * z + vi * w.cross(z);
      w += vi * z;
      u += vi * m;
      const Link& link = links_[i];
      const Eigen::Matrix3d& R = p.rotation[i];
      const Eigen::Vector3d c = p.origin[i] + R * link.center;
      // Acceleration of the centre of mass: the spatial one plus w × its velocity.
      const Eigen::Vector3d a_c = a + alpha.cross(c) + w.cross(u + w.cross(c));
      force[i] = link.mass * a_c;
      const Eigen::Vector3d w_l = R.transpose() * w, alpha_l = R.transpose() * alpha;
      torque[i] = R * (link.inertia * alpha_l + w_l.cross(link.inertia * w_l)) + c.cross(force[i]);
    }
    Joints tau;
    Eigen::Vector3d f = Eigen::Vector3d::Zero(), t = f;
    for (std::size_t i = kJoints; i-- > 0;) {
      f += force[i];
      t += torque[i];
      const auto c = static_cast<int>(i);
      tau[c] = p.axis[i].dot(t) + p.moment[i].dot(f) + rotor_[c] * acceleration[c];
    }
    return tau;
  }
  /// c(q, q̇) + g(q), of which c is zero at rest.
  [[nodiscard]] Joints bias_torque(const Pose& p, const Joints& v, const Eigen::Vector3d& gravity) const noexcept {
    return inverse_dynamics(p, v, Joints::Zero(), gravity);
  }
  /// g(q): what holds the arm at rest.
  [[nodiscard]] Joints gravity_torque(const Pose& p, const Eigen::Vector3d& gravity) const noexcept {
    Joints tau;
    double mass = 0.0;
    Eigen::Vector3d first = Eigen::Vector3d::Zero();
    for (std::size_t i = kJoints; i-- > 0;) {
      const Link& link = links_[i];
      mass += link.mass;
      first += link.mass * (p.origin[i] + p.rotation[i] * link.center);
      tau[static_cast<int>(i)] = -(p.axis[i].dot(first.cross(gravity)) + mass * p.moment[i].dot(gravity));
    }
    return tau;
  }

  /// M(q), by composite bodies.
  [[nodiscard, gnu::flatten]] Inertia inertia(const Pose& p) const noexcept {
    Inertia M;
    double mass = 0.0;
    Eigen::Vector3d first = Eigen::Vector3d::Zero();
    Eigen::Matrix3d second = Eigen::Matrix3d::Zero();  // about the base's origin
    for (std::size_t i = kJoints; i-- > 0;) {
      const Link& link = links_[i];
      const Eigen::Matrix3d& R = p.rotation[i];
      const Eigen::Vector3d c = p.origin[i] + R * link.center;
      mass += link.mass;
      first += link.mass * c;
      second += R * link.inertia * R.transpose() + of_point(link.mass, c);
      // Momentum of the composite when joint i turns at 1 rad/s.
      const Eigen::Vector3d linear = mass * p.moment[i] + p.axis[i].cross(first);
      const Eigen::Vector3d angular = second * p.axis[i] + first.cross(p.moment[i]);
      for (std::size_t k = 0; k <= i; ++k) {
        const double m = p.axis[k].dot(angular) + p.moment[k].dot(linear);
        M(static_cast<int>(k), static_cast<int>(i)) = m;
        M(static_cast<int>(i), static_cast<int>(k)) = m;
      }
      M(static_cast<int>(i), static_cast<int>(i)) += rotor_[static_cast<int>(i)];
    }
    return M;
  }

  /// q̈ under joint torques.
  [[nodiscard, gnu::flatten]] Joints forward_dynamics(const Pose& p, const Joints& v, const Joints& torque,
                                                      const Eigen::Vector3d& gravity) const noexcept {
    return inertia(p).llt().solve(torque - bias_torque(p, v, gravity));
  }

  /// ½ q̇ᵀ M q̇ - Σ m g·c [J]
  [[nodiscard]] double energy(const Pose& p, const Joints& v, const Eigen::Vector3d& gravity) const noexcept {
    double e = 0.5 * v.dot(inertia(p) * v);
    for (std::size_t i = 0; i < kJoints; ++i)
      e -= links_[i].mass * gravity.dot(p.origin[i] + p.rotation[i] * links_[i].center);
    return e;
  }

 private:
  static constexpr auto kJoints = static_cast<std::size_t>(n);
  struct Link {
    Eigen::Matrix3d rotation;  ///< link before from this one, at joint position 0
    Eigen::Vector3d origin;    ///< in axes of the link before
    double mass;
    Eigen::Vector3d center;
    Eigen::Matrix3d inertia;  ///< about the centre, in its axes
  };

  /// m (c·c 1 - c cᵀ)
  static Eigen::Matrix3d of_point(double mass, const Eigen::Vector3d& c) noexcept {
    return mass * (c.squaredNorm() * Eigen::Matrix3d::Identity() - c * c.transpose());
  }

  std::array<Link, n> links_;
  Joints rotor_;
  Eigen::Matrix3d tool_rotation_;  ///< last link from tool
  Eigen::Vector3d tool_;           ///< in axes of the last link
};

/// J M⁻¹ Jᵀ, the inverse of the inertia felt at the tool [1/kg], [1/(kg m²)].
template <int n>
Eigen::Matrix<double, 6, 6> tool_mobility(const ArmModel<n>& arm, const Eigen::Matrix<double, n, 1>& q) noexcept {
  const auto p = arm.pose(q);
  const auto J = arm.jacobian(p);
  return J * arm.inertia(p).llt().solve(J.transpose());
}

/// Of a symmetric matrix.
inline double largest_eigenvalue(const Eigen::Matrix3d& symmetric) noexcept {
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>{symmetric, Eigen::EigenvaluesOnly}.eigenvalues()[2];
}

}  // namespace twoport
