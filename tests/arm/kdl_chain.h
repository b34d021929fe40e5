#pragma once

#include <kdl/chain.hpp>
#include <string>

#include "common/arm/parameters.h"

namespace twoport::test {

inline KDL::Vector kdl(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}
inline KDL::Rotation kdl(const Eigen::Matrix3d& R) {
  return {R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2)};
}

/// The same arm for KDL; the last segment is the flange.
inline KDL::Chain kdl_chain(const ArmParameters& arm) {
  KDL::Chain chain;
  for (std::size_t i = 0; i < arm.joints.size(); ++i) {
    const ArmJoint& j = arm.joints[i];
    const KDL::Frame link{kdl(j.rotation), kdl(j.origin_m)};
    const Eigen::Matrix3d& I = j.inertia;
    const std::string name = "joint " + std::to_string(i + 1);
    const KDL::Joint joint{
        name, link.p, kdl(Eigen::Vector3d{j.rotation.col(2)}), KDL::Joint::RotAxis, 1.0, 0.0, j.rotor_inertia_kg_m2};
    chain.addSegment(KDL::Segment{
        name, joint, link,
        KDL::RigidBodyInertia{j.mass_kg, kdl(j.center_m),
                              KDL::RotationalInertia{I(0, 0), I(1, 1), I(2, 2), I(0, 1), I(0, 2), I(1, 2)}}});
  }
  chain.addSegment(KDL::Segment{"flange", KDL::Joint{"flange", KDL::Joint::Fixed},
                                KDL::Frame{kdl(arm.flange_rotation), kdl(arm.flange_m)}});
  return chain;
}

}  // namespace twoport::test
