#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

namespace twoport {

/// A revolute joint and the link behind it. The link's frame has its origin on the joint's axis, which is its z axis.
struct ArmJoint {
  Eigen::Vector3d origin_m;    ///< of the link's frame, in axes of the link before
  Eigen::Matrix3d rotation;    ///< link before from link, at joint position 0
  double mass_kg;              ///< of the link
  Eigen::Vector3d center_m;    ///< its centre of mass, in its axes
  Eigen::Matrix3d inertia;     ///< about its centre of mass, in its axes [kg m²]
  double rotor_inertia_kg_m2;  ///< of motor and gear, as the joint feels it
  double max_torque_n_m, max_speed_rad_per_s;
  double lower_rad, upper_rad;                                            ///< both infinite: it turns for ever
  std::optional<double> damping_n_m_s_per_rad{}, coulomb_friction_n_m{};  ///< where the file states them
  std::string name{};
};

/// A serial arm, as a file describes it (proto/arm.proto, arms/; or a URDF).
struct ArmParameters {
  std::string name;
  std::vector<std::string> source;
  std::vector<ArmJoint> joints;  ///< from the base to the flange
  Eigen::Vector3d flange_m;      ///< in axes of the last link
  Eigen::Matrix3d flange_rotation;
  std::vector<double> ready_position_rad;  ///< empty: the file names none
};

}  // namespace twoport
