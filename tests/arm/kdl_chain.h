#pragma once

#include <kdl/chain.hpp>
#include <string>

#include "common/arm/arm_model.h"

namespace twoport::test {

inline KDL::Vector kdl(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}
inline KDL::Rotation kdl(const Eigen::Matrix3d& R) {
  return {R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2)};
}

inline KDL::RigidBodyInertia kdl(double mass, const Eigen::Vector3d& center, const Eigen::Matrix3d& I) {
  return KDL::RigidBodyInertia{mass, kdl(center),
                               KDL::RotationalInertia{I(0, 0), I(1, 1), I(2, 2), I(0, 1), I(0, 2), I(1, 2)}};
}

/// The same arm for KDL; the last segment is the tool.
inline KDL::Chain kdl_chain(const ArmParameters& arm, const ArmTool& tool = {},
                            const Eigen::Matrix3d& tool_rotation = Eigen::Matrix3d::Identity()) {
  KDL::Chain chain;
  for (std::size_t i = 0; i < arm.joints.size(); ++i) {
    const ArmJoint& j = arm.joints[i];
    const KDL::Frame link{kdl(j.rotation), kdl(j.origin_m)};
    const std::string name = "joint " + std::to_string(i + 1);
    const KDL::Joint joint{name,
                           link.p,
                           kdl(Eigen::Vector3d{j.rotation.col(2)}),
                           j.type == JointType::prismatic ? KDL::Joint::TransAxis : KDL::Joint::RotAxis,
                           1.0,
                           0.0,
                           j.rotor_inertia};
    chain.addSegment(KDL::Segment{name, joint, link, kdl(j.mass_kg, j.center_m, j.inertia)});
  }
  chain.addSegment(
      KDL::Segment{"tool", KDL::Joint{"tool", KDL::Joint::Fixed},
                   KDL::Frame{kdl(Eigen::Matrix3d{arm.flange_rotation * tool_rotation}), kdl(arm.flange_m)},
                   kdl(tool.mass_kg, tool.center_m, tool.inertia)});
  return chain;
}

}  // namespace twoport::test
