#include "common/arm/arm_model.h"

#include <cmath>

namespace twoport {

ArmModel::ArmModel(const ArmParameters& arm, const ArmTool& tool, const Eigen::Matrix3d& tool_rotation)
    : joints_{arm.joints.size()},
      tool_rotation_{arm.flange_rotation * tool_rotation},
      tool_{arm.flange_m},
      fingers_{arm.joints.back().mirrored} {
  for (std::size_t i = 0; i < joints_; ++i) {
    const ArmJoint& j = arm.joints[i];
    links_.at(i) = {
        j.rotation, j.origin_m, j.mass_kg, j.center_m, j.inertia, j.rotor_inertia, j.type == JointType::prismatic};
  }
  Eigen::Matrix3d inertia = tool_rotation_ * tool.inertia * tool_rotation_.transpose();
  Eigen::Vector3d center = tool_ + tool_rotation_ * tool.center_m;
  if (fingers_) {
    const Link& finger = links_[joints_ - 1];
    inertia = Eigen::Matrix3d{finger.rotation * inertia * finger.rotation.transpose()};
    center = Eigen::Vector3d{finger.origin + finger.rotation * center};
  }
  Link& last = links_[joints_ - (fingers_ ? 2 : 1)];
  if (!(tool.mass_kg > 0.0)) {
    last.inertia += inertia;
    return;
  }
  // The tool is part of the last link, and of the one before its fingers.
  const double mass = last.mass + tool.mass_kg;
  const Eigen::Vector3d common = (last.mass * last.center + tool.mass_kg * center) / mass;
  const auto of_point = [](double m, const Eigen::Vector3d& c) -> Eigen::Matrix3d {
    return m * (c.squaredNorm() * Eigen::Matrix3d::Identity() - c * c.transpose());
  };
  last.inertia += of_point(last.mass, last.center - common) + of_point(tool.mass_kg, center - common) + inertia;
  last.mass = mass;
  last.center = common;
}

ArmModel::Pose ArmModel::pose(const Joints& q) const noexcept {
  Pose p;
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  Eigen::Vector3d x = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < joints_; ++i) {
    const Link& link = links_[i];
    const double qi = q[static_cast<int>(i)];
    x += R * link.origin;
    const Eigen::Matrix3d before = R * link.rotation;
    if (link.slides) {
      R = before;
      x += qi * R.col(2);
      p.axis[i].setZero();
      p.moment[i] = R.col(2);
    } else {
      const double c = std::cos(qi), s = std::sin(qi);
      R.col(0) = c * before.col(0) + s * before.col(1);
      R.col(1) = c * before.col(1) - s * before.col(0);
      R.col(2) = before.col(2);
      p.axis[i] = R.col(2);
      p.moment[i] = x.cross(p.axis[i]);
    }
    p.rotation[i] = R;
    p.origin[i] = x;
  }
  p.tool_rotation = R * tool_rotation_;
  p.tool = x + R * tool_;
  if (fingers_) p.tool -= q[size() - 1] * R.col(2);
  return p;
}

ArmModel::Jacobian ArmModel::jacobian(const Pose& p) const noexcept {
  Jacobian J{6, size()};
  for (std::size_t i = 0; i < joints_; ++i) {
    auto column = J.col(static_cast<int>(i));
    if (links_[i].slides)
      column.head<3>() = p.moment[i];
    else
      column.head<3>() = p.axis[i].cross(p.tool - p.origin[i]);
    column.tail<3>() = p.axis[i];
  }
  if (fingers_) J.col(size() - 1).setZero();
  return J;
}

ArmModel::Vector6 ArmModel::bias_acceleration(const Pose& p, const Joints& v) const noexcept {
  Eigen::Vector3d w = Eigen::Vector3d::Zero(), alpha = w, a = w, x = w;
  for (std::size_t i = 0; i < joints_; ++i) {
    const double vi = v[static_cast<int>(i)];
    const Eigen::Vector3d arm = p.origin[i] - x;
    a += alpha.cross(arm) + w.cross(w.cross(arm));
    if (links_[i].slides) {
      if (!fingers_ || i + 1 < joints_) a += 2.0 * vi * w.cross(p.moment[i]);
    } else {
      const Eigen::Vector3d turned = vi * p.axis[i];
      alpha += w.cross(turned);
      w += turned;
    }
    x = p.origin[i];
  }
  const Eigen::Vector3d arm = p.tool - x;
  a += alpha.cross(arm) + w.cross(w.cross(arm));
  Vector6 all;
  all << a, alpha;
  return all;
}

ArmModel::Joints ArmModel::inverse_dynamics(const Pose& p, const Joints& v, const Joints& acceleration,
                                            const Eigen::Vector3d& gravity) const noexcept {
  // Of the point of each body that is at the base's origin: velocity u and acceleration a; gravity as an acceleration
  // of the base.
  Eigen::Vector3d w = Eigen::Vector3d::Zero(), u = w, alpha = w, a = -gravity;
  std::array<Eigen::Vector3d, kMost> force, torque;
  for (std::size_t i = 0; i < joints_; ++i) {
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
  Joints tau{size()};
  Eigen::Vector3d f = Eigen::Vector3d::Zero(), t = f;
  for (std::size_t i = joints_; i-- > 0;) {
    f += force[i];
    t += torque[i];
    const auto c = static_cast<int>(i);
    tau[c] = p.axis[i].dot(t) + p.moment[i].dot(f) + links_[i].rotor * acceleration[c];
  }
  return tau;
}

ArmModel::Joints ArmModel::gravity_torque(const Pose& p, const Eigen::Vector3d& gravity) const noexcept {
  Joints tau{size()};
  double mass = 0.0;
  Eigen::Vector3d first = Eigen::Vector3d::Zero();
  for (std::size_t i = joints_; i-- > 0;) {
    const Link& link = links_[i];
    mass += link.mass;
    first += link.mass * (p.origin[i] + p.rotation[i] * link.center);
    tau[static_cast<int>(i)] = -(p.axis[i].dot(first.cross(gravity)) + mass * p.moment[i].dot(gravity));
  }
  return tau;
}

ArmModel::Inertia ArmModel::inertia(const Pose& p) const noexcept {
  Inertia M{size(), size()};
  double mass = 0.0;
  Eigen::Vector3d first = Eigen::Vector3d::Zero();
  Eigen::Matrix3d second = Eigen::Matrix3d::Zero();  // about the base's origin
  for (std::size_t i = joints_; i-- > 0;) {
    const Link& link = links_[i];
    const Eigen::Matrix3d& R = p.rotation[i];
    const Eigen::Vector3d c = p.origin[i] + R * link.center;
    mass += link.mass;
    first += link.mass * c;
    second += R * link.inertia * R.transpose() +
              link.mass * (c.squaredNorm() * Eigen::Matrix3d::Identity() - c * c.transpose());
    // Momentum of the composite when joint i moves at 1 rad/s or 1 m/s.
    const Eigen::Vector3d linear = mass * p.moment[i] + p.axis[i].cross(first);
    const Eigen::Vector3d angular = second * p.axis[i] + first.cross(p.moment[i]);
    for (std::size_t k = 0; k <= i; ++k) {
      const double m = p.axis[k].dot(angular) + p.moment[k].dot(linear);
      M(static_cast<int>(k), static_cast<int>(i)) = m;
      M(static_cast<int>(i), static_cast<int>(k)) = m;
    }
    M(static_cast<int>(i), static_cast<int>(i)) += link.rotor;
  }
  return M;
}

InertiaFactors::InertiaFactors(const ArmModel::Inertia& M) noexcept : lower_{M}, inverse_{M.rows()} {
  const auto n = static_cast<int>(M.rows());
  for (int k = 0; k < n; ++k) {
    inverse_[k] = 1.0 / lower_(k, k);
    for (int j = k + 1; j < n; ++j) {
      const double of = lower_(j, k) * inverse_[k];
      for (int i = j; i < n; ++i) lower_(i, j) -= lower_(i, k) * of;
    }
    for (int i = k + 1; i < n; ++i) lower_(i, k) *= inverse_[k];
  }
}
ArmModel::Joints InertiaFactors::solve(const ArmModel::Joints& b) const noexcept {
  const auto n = static_cast<int>(b.size());
  ArmModel::Joints x = b;
  for (int k = 0; k < n; ++k)
    for (int i = k + 1; i < n; ++i) x[i] -= lower_(i, k) * x[k];
  for (int k = 0; k < n; ++k) x[k] *= inverse_[k];
  for (int i = n; i-- > 0;)
    for (int k = 0; k < i; ++k) x[k] -= lower_(i, k) * x[i];
  return x;
}

ArmModel::Inertia InertiaFactors::inverse() const noexcept {
  const auto n = static_cast<int>(lower_.rows());
  ArmModel::Inertia W = lower_, all{n, n};  // W = L⁻¹ below the diagonal
  for (int j = 0; j < n; ++j)
    for (int i = j + 1; i < n; ++i) {
      double sum = lower_(i, j);
      for (int k = j + 1; k < i; ++k) sum += lower_(i, k) * W(k, j);
      W(i, j) = -sum;
    }
  for (int j = 0; j < n; ++j)
    for (int i = j; i < n; ++i) {
      double sum = i == j ? inverse_[i] : inverse_[i] * W(i, j);
      for (int k = i + 1; k < n; ++k) sum += W(k, i) * (inverse_[k] * W(k, j));
      all(i, j) = all(j, i) = sum;
    }
  return all;
}

Eigen::Matrix<double, 6, 6> InertiaFactors::mobility(const ArmModel::Jacobian& J) const noexcept {
  ArmModel::Jacobian x = J;  // J L⁻ᵀ, and D^(-1/2)
  for (int k = 0; k < J.cols(); ++k)
    for (int i = k + 1; i < J.cols(); ++i) x.col(i) -= lower_(i, k) * x.col(k);
  x = x * inverse_.cwiseSqrt().asDiagonal();
  return x.lazyProduct(x.transpose());
}

ArmModel::Joints ArmModel::forward_dynamics(const Pose& p, const Joints& v, const Joints& torque,
                                            const Eigen::Vector3d& gravity) const noexcept {
  return InertiaFactors{inertia(p)}.solve(torque - bias_torque(p, v, gravity));
}

double ArmModel::energy(const Pose& p, const Joints& v, const Eigen::Vector3d& gravity) const noexcept {
  double e = 0.5 * v.dot(inertia(p) * v);
  for (std::size_t i = 0; i < joints_; ++i)
    e -= links_[i].mass * gravity.dot(p.origin[i] + p.rotation[i] * links_[i].center);
  return e;
}

Eigen::Matrix<double, 6, 6> tool_mobility(const ArmModel& arm, const ArmModel::Joints& q) noexcept {
  const ArmModel::Pose p = arm.pose(q);
  return InertiaFactors{arm.inertia(p)}.mobility(arm.jacobian(p));
}

}  // namespace twoport
