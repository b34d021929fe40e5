#pragma once

#include <Eigen/Core>
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
ToolLoad identify_tool(std::span<const WristReading> readings, const Eigen::Vector3d& gravity);

}  // namespace twoport
