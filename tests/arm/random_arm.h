#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <random>

#include "common/arm/arm_model.h"

namespace twoport::test {

struct RandomArm {
  ArmParameters arm;
  ArmTool tool;
  Eigen::Matrix3d tool_rotation;  ///< flange from tool
};

/// Chains of 1 to 8 revolute and prismatic joints, with tools.
class RandomArms {
 public:
  explicit RandomArms(std::uint64_t seed) : rng_{seed} {}
  RandomArm next() {
    const auto n = static_cast<int>(1.0 + 8.0 * part());
    RandomArm of{.arm = {.name = {},
                         .source = {},
                         .joints = {},
                         .flange_m = vector(0.3),
                         .flange_rotation = rotation(),
                         .ready_position = {}},
                 .tool = {.mass_kg = 0.1 + part(), .center_m = vector(0.2), .inertia = 0.1 * inertia()},
                 .tool_rotation = rotation()};
    for (int i = 0; i < n; ++i)
      of.arm.joints.push_back({.origin_m = vector(0.5),
                               .rotation = rotation(),
                               .mass_kg = 0.1 + 3.0 * part(),
                               .center_m = vector(0.2),
                               .inertia = inertia(),
                               .rotor_inertia = 0.3 * part(),
                               .max_effort = 100.0,
                               .max_speed = 2.0,
                               .lower = -3.0,
                               .upper = 3.0,
                               .type = part() < 0.5 ? JointType::revolute : JointType::prismatic});
    return of;
  }
  ArmModel::Joints joints(int n, double size) {
    ArmModel::Joints v{n};
    for (int i = 0; i < n; ++i) v[i] = size * (2.0 * part() - 1.0);
    return v;
  }

 private:
  double part() { return static_cast<double>(rng_() >> 11) * 0x1.0p-53; }
  Eigen::Vector3d vector(double size) { return joints(3, size); }
  Eigen::Matrix3d rotation() {
    return Eigen::Quaterniond{Eigen::Vector4d{joints(4, 1.0)}}.normalized().toRotationMatrix();
  }
  /// Of points on three axes, turned.
  Eigen::Matrix3d inertia() {
    const Eigen::Vector3d a = vector(0.3).cwiseAbs();
    const Eigen::Matrix3d R = rotation();
    return R * (a.sum() * Eigen::Vector3d::Ones() - a).asDiagonal() * R.transpose();
  }

  std::mt19937_64 rng_;
};

}  // namespace twoport::test
