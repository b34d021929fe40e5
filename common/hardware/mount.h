#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace twoport {

/// How a haptic device stands in the scene's world, and what belongs to every device (scene: device_mount).
struct DeviceMount {
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();          ///< of the device's origin in the world
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  ///< turns the device's axes into the world's
  double scale = 1.0;                                            ///< motion in the world over motion of the device
  int clutch_button = -1;                                        ///< while it is pressed the hand moves alone; -1: none
  Eigen::Vector3d carried_force_n = Eigen::Vector3d::Zero();  ///< that the device adds to carry its tool, in world axes
  double let_go_after_s = 0.25;                               ///< without a new reading
  double engage_s = 0.1;                                      ///< force ramp after that and after the clutch

  friend bool operator==(const DeviceMount& a, const DeviceMount& b) {
    return a.position_m == b.position_m && a.rotation.coeffs() == b.rotation.coeffs() && a.scale == b.scale &&
           a.clutch_button == b.clutch_button && a.carried_force_n == b.carried_force_n &&
           a.let_go_after_s == b.let_go_after_s && a.engage_s == b.engage_s;
  }
};

/// What a robot's force sensor carries and reads by itself (scene: robot_mount).
struct RobotMount {
  double tool_mass_kg = 0.0;                                ///< beyond the sensor
  Eigen::Vector3d tool_center_m = Eigen::Vector3d::Zero();  ///< its centre of mass, in tool axes
  Eigen::Matrix<double, 6, 1> bias =
      Eigen::Matrix<double, 6, 1>::Zero();  ///< reading without load, in tool axes [N], [N m]
  Eigen::Vector3d gravity_m_per_s2{0.0, 0.0, -9.80665};
};

}  // namespace twoport
