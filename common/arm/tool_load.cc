#include "common/arm/tool_load.h"

#include <Eigen/QR>
#include <cstddef>

namespace twoport {

ToolLoad identify_tool(std::span<const WristReading> readings, const Eigen::Vector3d& gravity) {
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
