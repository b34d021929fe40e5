#include "common/scene/held_coupling.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "common/arm/arm_model.h"
#include "common/base/built_for.h"
#include "common/base/eigenvalues.h"

namespace twoport {
namespace {

/// What a tick T makes of a mass m with damping b: v' = a v + g F, x' = x + h v + l F.
struct TickMap {
  double a, g, h, l;
};
TickMap tick_map(double mass, double damping, double period) {
  const double b = std::max(damping, 1e-8 * mass / period);
  const double g = -std::expm1(-b * period / mass) / b, h = mass * g;
  return {std::exp(-b * period / mass), g, h, (period - h) / b};
}

/// |det A| < 1 and |tr A| < 1 + det A (Jury).
bool holds(double mass, double own_damping, double stiffness, double damping, double period) {
  const auto [a, g, h, l] = tick_map(mass, own_damping, period);
  if (stiffness == 0.0) return std::abs(a - g * damping) <= 1.0;
  const double trace = 1.0 - l * stiffness + a - g * damping;
  const double det = (1.0 - l * stiffness) * (a - g * damping) + (h - l * damping) * g * stiffness;
  return std::abs(det) < 1.0 && std::abs(trace) < 1.0 + det;
}

bool holds_arm(const ArmSpec& arm, const CouplingOptions& c, double period) {
  using Square = Eigen::MatrixXd;
  using Vector = Eigen::VectorXd;
  constexpr double kRounding = 1e-6;  // of the double eigenvalue 1 of what nothing holds
  const ArmModel model{*arm.parameters, {.mass_kg = arm.tool_mass_kg, .center_m = vector<3>(arm.tool_center_m)}};
  const int n = model.size();
  const ArmModel::Pose pose = model.pose(joint_vector(arm.joint_position_rad));
  // Joint coordinates in which inertia is 1 and damping is diagonal.
  const Square L = Square{model.inertia(pose)}.llt().matrixL();
  const Square to_modes = L.inverse();
  Vector damping{n};
  for (int i = 0; i < n; ++i)
    damping[i] = arm.parameters->joints[static_cast<std::size_t>(i)].damping.value_or(arm.joint_damping_n_m_s_per_rad);
  const Eigen::SelfAdjointEigenSolver<Square> modes{to_modes * damping.asDiagonal() * to_modes.transpose()};
  const Square J = model.jacobian(pose) * to_modes.transpose() * modes.eigenvectors();
  Eigen::Matrix<double, 6, 1> stiffness, damper;
  const double lighter = 1.0 + arm.force_feedback_gain, turns_lighter = 1.0 + arm.force_feedback_torque_gain;
  stiffness << Eigen::Vector3d::Constant(lighter * c.stiffness_n_per_m),
      Eigen::Vector3d::Constant(turns_lighter * c.rotational_stiffness_n_m_per_rad);
  damper << Eigen::Vector3d::Constant(lighter * c.damping_n_s_per_m),
      Eigen::Vector3d::Constant(turns_lighter * c.rotational_damping_n_m_s_per_rad);
  const Square K = J.transpose() * stiffness.asDiagonal() * J, B = J.transpose() * damper.asDiagonal() * J;
  Vector a{n}, g{n}, h{n}, l{n};
  for (int i = 0; i < n; ++i) {
    const TickMap map = tick_map(1.0, modes.eigenvalues()[i], period);
    a[i] = map.a, g[i] = map.g, h[i] = map.h, l[i] = map.l;
  }
  Square A{2 * n, 2 * n};
  A << Square::Identity(n, n) - l.asDiagonal() * K, Square{h.asDiagonal()} - l.asDiagonal() * B, -(g.asDiagonal() * K),
      Square{a.asDiagonal()} - g.asDiagonal() * B;
  return eigenvalues(A).cwiseAbs().maxCoeff() < 1.0 + kRounding;
}

}  // namespace

bool coupling_holds_robot(const Scene& scene, const CouplingOptions& c) {
  if (!scene.robot) return true;
  const RobotSpec& robot = *scene.robot;
  const double period = 1.0 / scene.slave_rate_hz;
  if constexpr (built_for(6))
    if (robot.arm) return holds_arm(*robot.arm, c, period);
  const auto moves = [&](double inertia, double own_damping, double stiffness, double damping) {
    return inertia > 0.0 && !holds(inertia, own_damping, stiffness, damping, period);
  };
  if (moves(robot.mass_kg, robot.damping_n_s_per_m, c.stiffness_n_per_m, c.damping_n_s_per_m)) return false;
  return scene.dof != 6 || robot.inertia_kg_m2.empty() ||
         !moves(*std::ranges::min_element(robot.inertia_kg_m2), robot.rotational_damping_n_m_s_per_rad,
                c.rotational_stiffness_n_m_per_rad, c.rotational_damping_n_m_s_per_rad);
}

bool coupling_may_drive_robot(const Scene& scene) {
  for (const double part : {1.0, 0.5, 2.0}) {
    CouplingOptions c = scene.control.coupling;
    c.damping_n_s_per_m *= part;
    c.rotational_damping_n_m_s_per_rad *= part;
    if (!coupling_holds_robot(scene, c)) return true;
  }
  return false;
}

}  // namespace twoport
