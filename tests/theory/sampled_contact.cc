#include "tests/theory/sampled_contact.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "lab/theory/sampled_loop.h"

namespace twoport::lab {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;

Matrix3d cross_matrix(const Vector3d& r) {
  Matrix3d m;
  m << 0, -r.z(), r.y(), r.z(), 0, -r.x(), -r.y(), r.x(), 0;
  return m;
}

/// G: velocity of the point from the body's.
Eigen::Matrix<double, 3, 6> motion_of(const Vector3d& r) {
  Eigen::Matrix<double, 3, 6> g;
  g << Matrix3d::Identity(), -cross_matrix(r);
  return g;
}

Matrix3d of_point(const SampledContact& c, const Vector3d& normal) {
  const Matrix3d along = normal * normal.transpose();
  return c.stiffness_n_per_m * (along + c.tangential_ratio * (Matrix3d::Identity() - along));
}
/// K6 without K_geo, of a plane with this normal.
Matrix6 elastic(const SampledContact& c, const Vector3d& normal) {
  Matrix6 sum = Matrix6::Zero();
  for (const Vector3d& r : c.points_m) sum += motion_of(r).transpose() * of_point(c, normal) * motion_of(r);
  return sum;
}
Matrix6 geometric(const SampledContact& c, const std::vector<Vector3d>& forces) {
  Matrix6 sum = Matrix6::Zero();
  for (std::size_t i = 0; i < c.points_m.size(); ++i) {
    const Vector3d &f = forces[i], &r = c.points_m[i];
    sum.bottomRightCorner<3, 3>() += f.dot(r) * Matrix3d::Identity() - r * f.transpose();
  }
  return sum;
}

/// The equilibrium in the axes of the body, which is turned by `attitude` (world from body).
struct Balance {
  Vector3d position;
  Matrix3d attitude;
  std::vector<Vector3d> forces;  ///< of the points, in axes of the body
};
Balance balanced(const SampledContact& c) {
  Balance b{Vector3d::Zero(), Matrix3d::Identity(), {}};
  for (int i = 0; i < 12; ++i) {
    const Matrix3d to_body = b.attitude.transpose();
    const Vector3d normal = to_body * c.normal;
    Vector6 wrench;
    wrench << -c.press_n * normal, Vector3d::Zero();
    b.forces.clear();
    for (const Vector3d& r : c.points_m) {
      const Vector3d f = -of_point(c, normal) * (to_body * Vector3d{b.position + b.attitude * r - r});
      b.forces.push_back(f);
      wrench.head<3>() += f;
      wrench.tail<3>() += r.cross(f);
    }
    // Newton's step; the smallest one, so that nothing moves along a neutral direction.
    const Matrix6 K = elastic(c, normal) + (i == 0 ? Matrix6{Matrix6::Zero()} : geometric(c, b.forces));
    Eigen::CompleteOrthogonalDecomposition<Matrix6> solver;
    solver.setThreshold(1e-9);
    solver.compute(K);
    const Vector6 step = solver.solve(wrench);
    b.position += b.attitude * step.head<3>();
    const Vector3d turn = step.tail<3>();
    if (turn.norm() > 0.0)
      b.attitude = b.attitude * Eigen::AngleAxisd{turn.norm(), turn.normalized()}.toRotationMatrix();
  }
  return b;
}

Matrix6 mass_of(const SampledContact& c) {
  Vector6 m;
  m << Vector3d::Constant(c.mass_kg), c.inertia_kg_m2;
  return m.asDiagonal();
}
Vector6 damping_of(const SampledContact& c) {
  Vector6 d;
  d << Vector3d::Constant(c.damping_n_s_per_m), c.rotational_damping_n_m_s_per_rad;
  return d;
}

/// How many directions nothing holds.
int neutral_directions(const SampledContact& c) {
  // In units in which a rotation by 1/length is as large as a translation.
  double length = 0.0;
  for (const Vector3d& r : c.points_m) length = std::max(length, r.norm());
  Vector6 scale;
  scale << Vector3d::Ones(), Vector3d::Constant(1.0 / std::max(length, 1e-9));
  const Matrix6 k = scale.asDiagonal() * contact_stiffness(c) * scale.asDiagonal();
  const Vector6 values = Eigen::SelfAdjointEigenSolver<Matrix6>{0.5 * (k + k.transpose())}.eigenvalues();
  const double largest = values.cwiseAbs().maxCoeff();
  return static_cast<int>((values.array().abs() < 1e-9 * largest).count());
}

}  // namespace

ContactEquilibrium equilibrium(const SampledContact& c) {
  const Balance b = balanced(c);
  ContactEquilibrium e;
  const Eigen::AngleAxisd turned{b.attitude};
  e.displacement << b.position, turned.angle() * turned.axis();
  for (const Vector3d& f : b.forces) e.forces_n.push_back((b.attitude * f).dot(c.normal));
  return e;
}

Matrix6 contact_stiffness(const SampledContact& c) {
  const Balance b = balanced(c);
  return elastic(c, b.attitude.transpose() * c.normal) + geometric(c, b.forces);
}

Matrix6 contact_damping(const SampledContact& c) {
  const Vector3d normal = balanced(c).attitude.transpose() * c.normal;
  Matrix6 sum = Matrix6::Zero();
  for (const Vector3d& r : c.points_m) {
    const Vector6 along = motion_of(r).transpose() * normal;
    sum += c.contact_damping_n_s_per_m * along * along.transpose();
  }
  return sum;
}

double spectral_radius(const SampledContact& c) {
  const double T = c.period_s;
  const Vector6 d = damping_of(c), m = mass_of(c).diagonal();
  // Exact map of m v̇ = w - d v over a tick, axis by axis.
  Vector6 decay, x_of_v, v_of_w, x_of_w;
  for (int i = 0; i < 6; ++i) {
    const double rate = d[i] / m[i];
    decay[i] = std::exp(-rate * T);
    x_of_v[i] = rate > 0.0 ? -std::expm1(-rate * T) / rate : T;
    v_of_w[i] = x_of_v[i] / m[i];
    // (T - x_of_v)/d loses all digits for small damping: its series there.
    const double rt = rate * T;
    x_of_w[i] =
        rt > 1e-3 ? (T - x_of_v[i]) / d[i]
                  : T * T / m[i] * (0.5 - rt / 6.0 + rt * rt / 24.0 - rt * rt * rt / 120.0 + rt * rt * rt * rt / 720.0);
  }
  const Matrix6 K = contact_stiffness(c), B = contact_damping(c);
  const bool differences = c.contact_damping_n_s_per_m != 0.0;
  const int past = c.delay_ticks + (differences ? 1 : 0);
  // ξ(k), v(k), ξ(k-1) ... ξ(k-past)
  const Eigen::Index size = 12 + 6 * past;
  const auto at = [](int late) -> Eigen::Index { return late == 0 ? 0 : 6 + 6 * late; };
  MatrixXd wrench = MatrixXd::Zero(6, size);
  wrench.middleCols<6>(at(c.delay_ticks)) -= K + B / T;
  if (differences) wrench.middleCols<6>(at(c.delay_ticks + 1)) += B / T;
  MatrixXd map = MatrixXd::Zero(size, size);
  map.topLeftCorner<6, 6>().setIdentity();
  map.block<6, 6>(0, 6) = x_of_v.asDiagonal();
  map.block<6, 6>(6, 6) = decay.asDiagonal();
  map.topRows<6>() += x_of_w.asDiagonal() * wrench;
  map.middleRows<6>(6) += v_of_w.asDiagonal() * wrench;
  for (int late = 1; late <= past; ++late) map.block<6, 6>(at(late), at(late - 1)).setIdentity();

  const Eigen::VectorXcd found = eigenvalues(map);
  std::vector<std::complex<double>> all(found.begin(), found.end());
  std::sort(all.begin(), all.end(), [](auto a, auto b) { return std::abs(a - 1.0) < std::abs(b - 1.0); });
  double radius = 0.0;
  int neutral = neutral_directions(c);
  for (const auto& z : all) {
    if (neutral > 0 && std::abs(z - 1.0) < 1e-6) {
      --neutral;
      continue;
    }
    radius = std::max(radius, std::abs(z));
  }
  return radius;
}

std::vector<ContactMode> contact_modes(const SampledContact& c) {
  const Matrix6 k = contact_stiffness(c);
  const Eigen::GeneralizedSelfAdjointEigenSolver<Matrix6> solver{0.5 * (k + k.transpose()), mass_of(c)};
  std::vector<ContactMode> modes;
  const double largest = solver.eigenvalues().cwiseAbs().maxCoeff();
  for (int i = 0; i < 6; ++i) {
    double value = solver.eigenvalues()[i];
    if (std::abs(value) < 1e-9 * largest) value = 0.0;
    modes.push_back({solver.eigenvectors().col(i), std::copysign(std::sqrt(std::abs(value)), value)});
  }
  return modes;
}

double rule_contact_stiffness(const SampledContact& given) {
  SampledContact c = given;
  const double late = (0.5 + c.delay_ticks) * c.period_s;
  const Matrix6 damping = Matrix6{damping_of(c).asDiagonal()} + contact_damping(c);
  // The modes depend on K a little, through K_geo: start from that of the stiffest press and repeat.
  c.stiffness_n_per_m = damping_of(c)[0] / late;
  double smallest = 0.0;
  for (int i = 0; i < 20; ++i) {
    SampledContact one = c;
    one.stiffness_n_per_m = 1.0;
    const Matrix6 per_stiffness = elastic(one, c.normal), preload = contact_stiffness(c) - elastic(c, c.normal);
    smallest = std::numeric_limits<double>::infinity();
    for (const ContactMode& mode : contact_modes(c)) {
      const double a = mode.shape.dot(per_stiffness * mode.shape);
      if (mode.frequency_rad_per_s == 0.0 || !(a > 0.0)) continue;
      const double k = (mode.shape.dot(damping * mode.shape) / late - mode.shape.dot(preload * mode.shape)) / a;
      smallest = std::min(smallest, k);
    }
    c.stiffness_n_per_m = smallest;
  }
  return smallest;
}

double critical_contact_stiffness(SampledContact c) {
  const auto stable = [&](double k) {
    c.stiffness_n_per_m = k;
    return spectral_radius(c) <= 1.0 + 1e-12;
  };
  const double rule = rule_contact_stiffness(c);
  if (!(rule > 0.0) || !std::isfinite(rule)) return 0.0;
  double low = rule;
  while (!stable(low)) {
    low *= 0.95;
    if (low < 1e-2 * rule) return 0.0;
  }
  double high = low;
  while (stable(high)) {
    low = high;
    high *= 1.02;
    if (high > 1e3 * rule) return std::numeric_limits<double>::infinity();
  }
  for (int i = 0; i < 60 && high - low > 1e-13 * high; ++i) {
    const double middle = 0.5 * (low + high);
    (stable(middle) ? low : high) = middle;
  }
  return low;
}

double critical_modal_stiffness(double inertia, double damping, double period_s) {
  const double fall = -std::expm1(-damping * period_s / inertia);  // 1 - e
  return damping * fall / (fall * inertia / damping - (1.0 - fall) * period_s);
}

}  // namespace twoport::lab
