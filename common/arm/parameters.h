#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace twoport {

/// Joints that an arm has at most.
inline constexpr int kMostArmJoints = 8;

enum class JointType : std::uint8_t { revolute, continuous, prismatic };

/// A joint and the link behind it. The link's frame has its z axis along the joint's: a revolute joint turns about it, a prismatic
/// one slides along it. Units of a joint's coordinate, rate and effort: rad, rad/s, N m; prismatic: m, m/s, N.
struct ArmJoint {
  Eigen::Vector3d origin_m;  ///< of the link's frame, in axes of the link before, at joint position 0
  Eigen::Matrix3d rotation;  ///< link before from link, at joint position 0
  double mass_kg;            ///< of the link
  Eigen::Vector3d center_m;  ///< its centre of mass, in its axes
  Eigen::Matrix3d inertia;   ///< about its centre of mass, in its axes [kg m²]
  double rotor_inertia;      ///< of motor and gear, as the joint feels it [kg m²]; prismatic: [kg]
  double max_effort, max_speed;
  double lower, upper;  ///< continuous: infinite
  std::optional<double> damping{},
      coulomb_friction{};  ///< where the file states them [N m s/rad], [N m]; prismatic: [N s/m], [N]
  std::string name{};
  JointType type = JointType::revolute;
  bool mirrored =
      false;  ///< of the last one: two fingers, at ±position along its axis from the flange, which does not move with them
};

/// A serial arm, as a file describes it (proto/arm.proto, arms/; or a URDF).
struct ArmParameters {
  std::string name;
  std::vector<std::string> source;
  std::vector<ArmJoint> joints;  ///< from the base to the flange; 1 to kMostArmJoints
  Eigen::Vector3d flange_m;      ///< in axes of the last link
  Eigen::Matrix3d flange_rotation;
  std::vector<double> ready_position;  ///< of the joints; empty: the file names none
};

}  // namespace twoport
