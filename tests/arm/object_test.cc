// A box between two fingers: free fall, rest, what friction holds and where it gives way, and the account of its energy.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "sim/plant/arm.h"

namespace twoport::sim::object_test {
namespace {

using Eigen::Vector3d;

constexpr double kTick = 1e-3, kGravity = 9.81, kMass = 0.2, kStiffness = 2000.0, kHalf = 0.03;

/// A carriage that slides along z, and fingers along y; damping of the carriage [N s/m].
ArmSpec gantry(double opening_m, double damping = 300.0) {
  const auto slide = [](const Eigen::Matrix3d& rotation, double mass) {
    return ArmJoint{.origin_m = Vector3d::Zero(),
                    .rotation = rotation,
                    .mass_kg = mass,
                    .center_m = Vector3d::Zero(),
                    .inertia = 1e-3 * Eigen::Matrix3d::Identity(),
                    .rotor_inertia = 0.0,
                    .max_effort = 1e3,
                    .max_speed = 10.0,
                    .lower = -10.0,
                    .upper = 10.0,
                    .damping = 0.0,
                    .type = JointType::prismatic};
  };
  auto arm = std::make_shared<ArmParameters>();
  arm->joints.push_back(slide(Eigen::Matrix3d::Identity(), 2.0));
  arm->joints[0].damping = damping;
  arm->joints.push_back(
      slide(Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), Vector3d::UnitY()).toRotationMatrix(), 0.5));
  arm->joints[1].mirrored = true;
  arm->joints[1].damping = 1.0;
  arm->flange_m.setZero();
  arm->flange_rotation.setIdentity();
  ArmSpec spec{};
  spec.parameters = arm;
  spec.joint_position_rad = {0.0, opening_m};
  return spec;
}
ObjectSpec box(double friction, const Vector3d& at = Vector3d::Zero()) {
  return {.mass_kg = kMass,
          .position_m = at,
          .half_size_m = Vector3d{0.02, kHalf, 0.03},
          .target_m = at,
          .material = {kStiffness, 10.0, friction, 0.0}};
}
std::shared_ptr<const Environment<6>> table(double height_m) {
  return std::make_shared<const Environment<6>>(
      std::vector<EnvironmentSpec>{Surface{Wall{Vector3d::UnitZ(), height_m}, Material{5000.0, 20.0, 0.5, 0.0}}});
}
ArmPlant plant(double opening_m, const ObjectSpec& object, double table_m = -1.0, double damping = 300.0) {
  return {gantry(opening_m, damping), table(table_m), kTick, Position<6>{}, std::nullopt, object};
}
Force<kJointPort> torques(double carriage, double fingers) {
  Force<kJointPort>::Vector f = Force<kJointPort>::Vector::Zero();
  f[0] = carriage, f[1] = fingers;
  return Force<kJointPort>{f};
}
/// Fingers that are pressed by n each from the start, in balance.
double opening_at(double n) {
  return kHalf - n / kStiffness;
}

TEST(Object, FallsFreelyAndRestsOnItsWeight) {
  ArmPlant arm = plant(0.1, box(0.8), -0.08);  // 50 mm below the lower face
  for (int k = 1; k <= 100; ++k) {             // it meets the table after 101 ms
    arm.advance_joints(torques(0, 0));
    const double t = k * kTick;
    ASSERT_NEAR(arm.object().x.z(), -0.5 * kGravity * t * t, 1e-12) << k;
  }
  for (int k = 0; k < 3000; ++k) arm.advance_joints(torques(0, 0));
  EXPECT_NEAR(arm.object().x.z(), -0.05 - kMass * kGravity / 5000.0, 1e-9);
  EXPECT_LT(arm.object().v.norm(), 1e-9);
  EXPECT_EQ(arm.outside_torque().squared_norm(), 0.0);
  // What it had, the table has taken, but for what its weight holds.
  const double fallen = kMass * kGravity * -arm.object().x.z(), held = 0.5 * std::pow(kMass * kGravity, 2) / 5000.0;
  EXPECT_NEAR(arm.dissipated_at_object().si(), fallen - held, 1e-5 * fallen);
}

// Two fingers with friction 0.8 hold 2·0.8·4 N = 6.4 N, and the box weighs 1.96 N: it hangs by the springs and does not creep.
TEST(Object, StaysBetweenFingersWhoseFrictionIsMoreThanItsWeight) {
  const double n = 4.0;
  ArmPlant arm = plant(opening_at(n), box(0.8));
  const auto below = [&] { return arm.object().x.z() - arm.body().x.translation().z(); };
  double at_first = 0.0;
  for (int k = 0; k < 4000; ++k) {
    arm.advance_joints(torques(kMass * kGravity, -2.0 * n));
    if (k == 1999) at_first = below();
  }
  EXPECT_NEAR(at_first, -kMass * kGravity / (2.0 * kStiffness), 1e-7);
  EXPECT_NEAR(below(), at_first, 1e-9);
  EXPECT_NEAR(arm.outside_torque()[0], -kMass * kGravity, 1e-6);
  EXPECT_NEAR(arm.outside_torque()[1], 2.0 * n, 1e-6);  // both fingers
}

// With 2·0.2·4 N = 1.6 N of friction it slides with the difference.
TEST(Object, SlidesBetweenFingersWhoseFrictionIsLess) {
  const double n = 4.0, friction = 0.2, held = 2.0 * friction * n, a = kGravity - held / kMass;
  ArmPlant arm = plant(opening_at(n), box(friction));
  const auto push = [&](int ticks) {
    for (int k = 0; k < ticks; ++k) arm.advance_joints(torques(held, -2.0 * n));
  };
  push(50);
  const double v = arm.object().v.z(), z = arm.object().x.z(), taken = arm.dissipated_at_object().si();
  push(50);
  const double way = z - arm.object().x.z() + 0.0;
  EXPECT_NEAR(v - arm.object().v.z(), 0.05 * a, 1e-3 * 0.05 * a);
  EXPECT_NEAR(arm.outside_torque()[0], -held, 1e-6);
  EXPECT_NEAR(arm.dissipated_at_object().si() - taken, held * way, 1e-3 * held * way);
}

// What the joints have put in is kinetic and elastic energy, weight, and what damping and friction have taken.
TEST(Object, KeepsTheAccountOfEnergyWhileItIsTakenAndCarried) {
  ArmPlant arm = plant(0.039, box(0.5, Vector3d{0.0, 0.004, -0.0004}), -0.03, 5.0);
  const double start = arm.mechanical_energy();
  double lifted = 0.0, taken = 0.0;
  for (int k = 0; k < 3000; ++k) {
    const double t = k * kTick;
    const double fingers = t < 2.5 ? -8.0 : 5.0, lift = t < 0.6 ? 0.0 : t < 1.2 ? 4.0 : t < 2.0 ? 1.0 : -1.0;
    arm.advance_joints(torques(lift, fingers));
    lifted = std::max(lifted, arm.object().x.z());
    const double in = arm.joint_energy().si(),
                 out = arm.mechanical_energy() - start + arm.dissipated().si() + arm.dissipated_at_object().si();
    ASSERT_NEAR(in, out, 2e-5) << t;
    // What springs hold, and give back, is not taken.
    const double now = arm.dissipated_at_object().si();
    ASSERT_GE(now, taken - 1e-5) << t;
    taken = std::max(taken, now);
  }
  EXPECT_GT(lifted, 0.05);
  EXPECT_GT(arm.dissipated_at_object().si(), 1e-3);
}

}  // namespace
}  // namespace twoport::sim::object_test
