#pragma once

#include <Eigen/Core>
#include <Eigen/QR>
#include <span>

namespace twoport {

/// What a wrist sensor reads of a tool at rest, in tool axes at the tool's origin: weight and bias.
///
///     f = m g_t + f_b        τ = m c × g_t + τ_b        g_t = Rᵀ g
///
/// Readings are forces of the tool on the sensor.
struct ToolLoad {
  double mass_kg = 0.0;
  Eigen::Vector3d first_moment_kg_m = Eigen::Vector3d::Zero();  ///< m c
  Eigen::Matrix<double, 6, 1> bias = Eigen::Matrix<double, 6, 1>::Zero();

  /// The reading at attitude R (world from tool) under gravity g [m/s²].
  [[nodiscard]] Eigen::Matrix<double, 6, 1> reading(const Eigen::Matrix3d& R,
                                                    const Eigen::Vector3d& gravity) const noexcept {
    const Eigen::Vector3d g = R.transpose() * gravity;
    Eigen::Matrix<double, 6, 1> f;
    f << mass_kg * g, first_moment_kg_m.cross(g);
    return f + bias;
  }
};

/// A reading at rest, without contact.
struct WristReading {
  Eigen::Matrix3d attitude;  ///< world from tool
  Eigen::Matrix<double, 6, 1> wrench;
};

/// Weight and bias from readings in at least three attitudes that differ by more than a turn about the vertical: least squares,
/// exact without noise. Mass and bias of the force first, then first moment and bias of the torque.
inline ToolLoad identify_tool(std::span<const WristReading> readings, const Eigen::Vector3d& gravity) {
  const auto rows = static_cast<Eigen::Index>(3 * readings.size());
  Eigen::MatrixXd forces(rows, 4), torques(rows, 6);
  Eigen::VectorXd f(rows), t(rows);
  for (std::size_t k = 0; k < readings.size(); ++k) {
    const auto row = static_cast<Eigen::Index>(3 * k);
    const Eigen::Vector3d g = readings[k].attitude.transpose() * gravity;
    Eigen::Matrix3d cross;  // c × g = cross c
    cross << 0, g.z(), -g.y(), -g.z(), 0, g.x(), g.y(), -g.x(), 0;
    forces.block<3, 1>(row, 0) = g;
    forces.block<3, 3>(row, 1).setIdentity();
    torques.block<3, 3>(row, 0) = cross;
    torques.block<3, 3>(row, 3).setIdentity();
    f.segment<3>(row) = readings[k].wrench.head<3>();
    t.segment<3>(row) = readings[k].wrench.tail<3>();
  }
  const Eigen::Vector4d of_force = forces.colPivHouseholderQr().solve(f);
  const Eigen::Matrix<double, 6, 1> of_torque = torques.colPivHouseholderQr().solve(t);
  ToolLoad load;
  load.mass_kg = of_force[0];
  load.first_moment_kg_m = of_torque.head<3>();
  load.bias << of_force.tail<3>(), of_torque.tail<3>();
  return load;
}

}  // namespace twoport
