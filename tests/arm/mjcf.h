#pragma once

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <string>

#include "common/arm/parameters.h"

namespace twoport::test {

inline std::string three(const Eigen::Vector3d& v) {
  return fmt::format("{:.17g} {:.17g} {:.17g}", v.x(), v.y(), v.z());
}
inline std::string four(const Eigen::Matrix3d& R) {
  const Eigen::Quaterniond q{R};
  return fmt::format("{:.17g} {:.17g} {:.17g} {:.17g}", q.w(), q.x(), q.y(), q.z());
}

/// The arm in MuJoCo's format: a body a link, rotors as armature, a site at the flange.
inline std::string mjcf(const ArmParameters& arm, const Eigen::Vector3d& gravity) {
  std::string open, close;
  for (const ArmJoint& j : arm.joints) {
    const Eigen::Matrix3d& I = j.inertia;
    open += fmt::format(
        "<body pos='{}' quat='{}'><inertial pos='{}' mass='{:.17g}' fullinertia='{:.17g} {:.17g} {:.17g} {:.17g} "
        "{:.17g} "
        "{:.17g}'/><joint type='hinge' axis='0 0 1' armature='{:.17g}'/>",
        three(j.origin_m), four(j.rotation), three(j.center_m), j.mass_kg, I(0, 0), I(1, 1), I(2, 2), I(0, 1), I(0, 2),
        I(1, 2), j.rotor_inertia_kg_m2);
    close += "</body>";
  }
  return fmt::format(
      "<mujoco><compiler angle='radian'/><option gravity='{}'><flag contact='disable' constraint='disable'/></option>"
      "<worldbody>{}<site name='flange' pos='{}' quat='{}'/>{}</worldbody></mujoco>",
      three(gravity), open, three(arm.flange_m), four(arm.flange_rotation), close);
}

}  // namespace twoport::test
