#pragma once

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <string>

#include "common/arm/arm_model.h"

namespace twoport::test {

inline std::string three(const Eigen::Vector3d& v) {
  return fmt::format("{:.17g} {:.17g} {:.17g}", v.x(), v.y(), v.z());
}
inline std::string four(const Eigen::Matrix3d& R) {
  const Eigen::Quaterniond q{R};
  return fmt::format("{:.17g} {:.17g} {:.17g} {:.17g}", q.w(), q.x(), q.y(), q.z());
}

inline std::string inertial(double mass, const Eigen::Vector3d& center, const Eigen::Matrix3d& I) {
  return fmt::format(
      "<inertial pos='{}' mass='{:.17g}' fullinertia='{:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g}'/>",
      three(center), mass, I(0, 0), I(1, 1), I(2, 2), I(0, 1), I(0, 2), I(1, 2));
}

/// The arm in MuJoCo's format: a body a link and one for the tool, rotors as armature, a site at the tool.
inline std::string mjcf(const ArmParameters& arm, const Eigen::Vector3d& gravity, const ArmTool& tool = {},
                        const Eigen::Matrix3d& tool_rotation = Eigen::Matrix3d::Identity()) {
  std::string open, close;
  for (const ArmJoint& j : arm.joints) {
    open += fmt::format("<body pos='{}' quat='{}'>{}<joint type='{}' axis='0 0 1' armature='{:.17g}'/>",
                        three(j.origin_m), four(j.rotation), inertial(j.mass_kg, j.center_m, j.inertia),
                        j.type == JointType::prismatic ? "slide" : "hinge", j.rotor_inertia);
    close += "</body>";
  }
  return fmt::format(
      "<mujoco><compiler angle='radian'/><option gravity='{}'><flag contact='disable' constraint='disable'/></option>"
      "<worldbody>{}<body pos='{}' quat='{}'>{}<site name='tool'/></body>{}</worldbody></mujoco>",
      three(gravity), open, three(arm.flange_m), four(arm.flange_rotation * tool_rotation),
      tool.mass_kg > 0.0 ? inertial(tool.mass_kg, tool.center_m, tool.inertia) : "", close);
}

}  // namespace twoport::test
