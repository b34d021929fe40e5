// The arm with six joints: published kinematics, KDL's dynamics, the plant without a null space.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "common/arm/arm_model.h"
#include "common/base/check.h"
#include "common/scene/arm.h"
#include "common/scene/load.h"
#include "sim/plant/arm.h"
#include "sim/sim_robot.h"

#ifdef TWOPORT_KDL
#include <kdl/chaindynparam.hpp>
#include <kdl/chainidsolver_recursive_newton_euler.hpp>

#include "tests/arm/kdl_chain.h"
#endif

namespace twoport::sim::six_joints_test {
namespace {

using Arm = ArmModel;
using Joints = Arm::Joints;
using Vector6 = Eigen::Matrix<double, 6, 1>;

const Eigen::Vector3d kGravity{0.0, 0.0, -9.81};
const std::string kFile = TWOPORT_ARMS "/ur5e.textproto";

Joints draw(std::mt19937_64& rng, double size) {
  Joints v{6};
  for (int i = 0; i < 6; ++i) v[i] = size * (2.0 * (static_cast<double>(rng() >> 11) * 0x1.0p-53) - 1.0);
  return v;
}

TEST(Ur5e, HasThePublishedKinematics) {
  // Rz(theta) Tz(d) Tx(a) Rx(alpha) for each joint.
  const double h = std::numbers::pi / 2;
  const std::array<double, 6> a{0, -0.425, -0.3922, 0, 0, 0}, d{0.1625, 0, 0, 0.1333, 0.0997, 0.0996},
      alpha{h, 0, 0, h, -h, 0};
  const Arm arm{load_arm(kFile)};
  std::mt19937_64 rng{1};
  for (int k = 0; k < 20; ++k) {
    const Joints q = draw(rng, 3.0);
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    for (std::size_t i = 0; i < 6; ++i)
      T = T * Eigen::AngleAxisd{q[static_cast<int>(i)], Eigen::Vector3d::UnitZ()} *
          Eigen::Translation3d{a[i], 0, d[i]} * Eigen::AngleAxisd{alpha[i], Eigen::Vector3d::UnitX()};
    const Arm::Pose p = arm.pose(q);
    EXPECT_LT((p.tool - T.translation()).norm(), 1e-12);
    EXPECT_LT((p.tool_rotation - T.linear()).norm(), 1e-12);
  }
}

TEST(Ur5e, HasThePublishedMassesAndCentres) {
  // In the DH frame behind each joint, as they are published; joint 0 at zero: weight's torque about a horizontal shoulder.
  const ArmParameters of = load_arm(kFile);
  double mass = 0.0;
  for (const ArmJoint& j : of.joints) mass += j.mass_kg;
  EXPECT_NEAR(mass, 3.761 + 8.058 + 2.846 + 1.37 + 1.3 + 0.365, 1e-12);
  // Stretched out along -x: centres of mass at 0.2125 m, 0.425 + 0.2422 m, and the wrist's, whose offsets are not along x
  // with all joints at zero but for none: 0.8172 m.
  const Joints g = Arm{of}.gravity_torque(Arm{of}.pose(Joints::Zero(6)), kGravity);
  EXPECT_NEAR(std::abs(g[1]), 9.81 * (8.058 * 0.2125 + 2.846 * (0.425 + 0.2422) + (1.37 + 1.3 + 0.365) * 0.8172), 1e-9);
}

TEST(Ur5e, HasKdlsDynamics) {
#ifdef TWOPORT_KDL
  const ArmParameters of = load_arm(kFile);
  const Arm arm{of};
  const KDL::Chain chain = test::kdl_chain(of);
  KDL::ChainIdSolver_RNE inverse{chain, test::kdl(kGravity)};
  KDL::ChainDynParam dynamics{chain, test::kdl(kGravity)};
  std::mt19937_64 rng{2};
  for (int k = 0; k < 100; ++k) {
    const Joints q = draw(rng, 3.0), v = draw(rng, 2.0), acceleration = draw(rng, 5.0);
    KDL::JntArray kq{6}, kv{6}, ka{6}, tau{6};
    kq.data = q, kv.data = v, ka.data = acceleration;
    const Arm::Pose p = arm.pose(q);
    KDL::Wrenches none(chain.getNrOfSegments(), KDL::Wrench::Zero());
    ASSERT_GE(inverse.CartToJnt(kq, kv, ka, none, tau), 0);
    EXPECT_LT((tau.data - arm.inverse_dynamics(p, v, acceleration, kGravity)).cwiseAbs().maxCoeff(), 1e-10);
    KDL::JntSpaceInertiaMatrix M{6};
    ASSERT_GE(dynamics.JntToMass(kq, M), 0);
    EXPECT_LT((M.data - arm.inertia(p)).cwiseAbs().maxCoeff(), 1e-12);
  }
#else
  GTEST_SKIP() << "liborocos-kdl-dev is not installed";
#endif
}

Scene scene(const std::string& more) {
  return parse_scene("dof: 6 duration_s: 1 rate_hz: 2000 robot { arm { file: \"" + kFile + "\" " + more + " } }",
                     "arm");
}
std::string error_of(const std::string& more) {
  try {
    scene(more);
  } catch (const ConfigError& e) {
    return e.what();
  }
  return "";
}

TEST(Ur5e, IsAPlantWithoutANullSpace) {
  SimRobot<6> r{scene("joint_damping_n_m_s_per_rad: 0 tool_mass_kg: 0.5"), Seconds{5e-4}};
  const ArmPlant& arm = *r.arm();
  const Position<6> start = r.state().x;
  for (int k = 0; k < 1000; ++k) r.advance();
  EXPECT_LT((r.state().x - start).vec().norm(), 1e-9) << "it carries its weight";
  const double before = arm.mechanical_energy();
  for (int k = 0; k < 1000; ++k) {
    RobotCommand<6> command;
    Vector6 f;
    f << 2.0 * std::sin(0.01 * k), 1.0, -1.0, 0.02, -0.02, 0.01;
    command.f = Force<6>{f};
    r.actuate(command);
    r.advance();
  }
  EXPECT_GT((r.state().x - start).vec().norm(), 0.01);
  // Runge-Kutta 4 at 0.5 ms.
  EXPECT_NEAR(arm.mechanical_energy() - before, arm.joint_energy().si(), 1e-8);
}

/// Drawn by a spring and damper at the tool along `by` in 2 s, and back.
struct Drawn {
  double fastest = 0.0;    ///< of the joints, as part of the file's largest speed
  double singular = 10.0;  ///< least distance of the watched joint from zero [rad]
  double farthest = 0.0;   ///< of that joint, beyond zero [rad]
  double left = 0.0;       ///< between the tool and where it began, at the end
};
Drawn drawn(const std::string& at, int joint, const Vector6& by) {
  SimRobot<6> r{scene("joint_position_rad: " + at), Seconds{5e-4}};
  const ArmPlant& arm = *r.arm();
  const Position<6> start = r.state().x;
  const double side = arm.state().q[joint] > 0.0 ? 1.0 : -1.0;
  Drawn all;
  for (int k = 0; k < 12000; ++k) {
    const double part = k < 8000 ? 0.5 * (1.0 - std::cos(std::numbers::pi * k / 4000.0)) : 0.0;
    const Vector6 stretch = (start + Displacement<6>{Vector6{part * by}} - r.state().x).vec(), v = r.state().v.vec();
    Vector6 f;
    f << 1000.0 * stretch.head<3>() - 60.0 * v.head<3>(), 10.0 * stretch.tail<3>() - 0.6 * v.tail<3>();
    RobotCommand<6> command;
    command.f = Force<6>{f};
    r.actuate(command);
    r.advance();
    const double now = side * arm.state().q[joint];
    all.fastest = std::max(all.fastest, arm.state().v.cwiseAbs().maxCoeff() / std::numbers::pi);
    all.singular = std::min(all.singular, std::abs(now));
    all.farthest = std::max(all.farthest, -now);
  }
  all.left = (r.state().x - start).vec().norm();
  return all;
}

TEST(Ur5e, GoesThroughAStretchedElbowAndAWristInLineWithinTheSpeedsOfItsJoints) {
  // Outwards by more than the arm reaches: the elbow stretches and bends again.
  Vector6 out;
  out << -0.3, 0.0, 0.0, 0.0, 0.0, 0.0;
  const Drawn elbow = drawn("[0, -0.5, 0.5, 0, -1.5707963267948966, 0]", 2, out);
  std::printf("elbow: within %.4f rad of singular, %.3f of the largest speed, left %.2g\n", elbow.singular,
              elbow.fastest, elbow.left);
  EXPECT_LT(elbow.singular, 0.05);
  EXPECT_LT(elbow.fastest, 1.0);
  EXPECT_LT(elbow.left, 1e-2);
  // Turned about the fifth joint until the axes of the fourth and sixth are one, and beyond; a little askew, which a wrist in line cannot
  // follow.
  const Joints q = joint_vector({0.0, -1.2, 1.4, -1.5, 0.4, 0.0});
  const Arm arm{load_arm(kFile)};
  const Arm::Pose p = arm.pose(q);
  Vector6 turn;
  turn << Eigen::Vector3d::Zero(), -0.8 * p.axis[4] + 0.05 * p.axis[4].cross(p.axis[5]);
  // The scene's tool is at the identity, the base is turned by nothing.
  const Drawn wrist = drawn("[0, -1.2, 1.4, -1.5, 0.4, 0]", 4, turn);
  std::printf("wrist: within %.4f rad of singular, %.3f beyond, %.3f of the largest speed, left %.2g\n", wrist.singular,
              wrist.farthest, wrist.fastest, wrist.left);
  EXPECT_LT(wrist.singular, 1e-2);
  EXPECT_GT(wrist.farthest, 0.1);
  EXPECT_LT(wrist.fastest, 1.0);
  EXPECT_LT(wrist.left, 2e-2) << "2 s after, joints damped by 1 N m s/rad";
}

/// With the fifth joint at `wrist`, which is singular at 0: speed of the joints after a kick of 1 mm/s and 1 mrad/s along every axis, and torque of
/// a force feedback with two gains under 1 N and 0.1 N m.
struct NearSingular {
  double kicked_rad_per_s = 0.0, torque_n_m = 0.0;
};
NearSingular near_singular(double wrist) {
  const Scene s = scene("force_feedback { gain: 3 torque_gain: 9 }");
  const auto nothing = std::make_shared<const Environment<6>>(std::vector<EnvironmentSpec>{});
  ArmPlant arm{*s.robot->arm, nothing, 5e-4, position<6>(s.robot->position_m), std::nullopt};
  const Joints q = joint_vector({0.0, -1.2, 1.4, -1.5, wrist, 0.0});
  NearSingular of;
  arm.set_state({q, Joints::Zero(6)});
  const Arm::Pose p = arm.model().pose(q);
  arm.kick(Velocity<6>{Vector6{Vector6::Constant(1e-3)}});
  of.kicked_rad_per_s = arm.state().v.norm();
  arm.set_state({q, Joints::Zero(6)});
  const Joints gravity = arm.model().gravity_torque(p, kGravity);
  Vector6 f;
  f << 1.0, 1.0, 1.0, 0.1, 0.1, 0.1;
  arm.advance(Force<6>{f});
  of.torque_n_m = (arm.torque() - gravity).norm();
  return of;
}

TEST(Ur5e, DampingBoundsKickAndForceFeedbackNearASingularPosition) {
  for (const double wrist : {0.4, 1e-2, 1e-4, 0.0}) {
    const NearSingular of = near_singular(wrist);
    std::printf("wrist %g rad: kicked %.3g rad/s, torque %.3g N m\n", wrist, of.kicked_rad_per_s, of.torque_n_m);
    EXPECT_LT(of.kicked_rad_per_s, 0.1) << wrist;
    EXPECT_LT(of.torque_n_m, 20.0) << wrist;
  }
}

TEST(Ur5e, TakesNoFieldsOfANullSpace) {
  EXPECT_NE(error_of("null_space_damping_n_m_s_per_rad: 3")
                .find("robot.arm.null_space_damping_n_m_s_per_rad is 3; it must be absent"),
            std::string::npos)
      << error_of("null_space_damping_n_m_s_per_rad: 3");
  EXPECT_NE(error_of("joint_position_rad: [0, 0, 0, 0, 0, 0, 0]").find("must hold 6 numbers"), std::string::npos);
  EXPECT_NE(error_of("force_feedback { gain: -1 }").find("robot.arm.force_feedback.gain is -1; it must be >= 0"),
            std::string::npos);
}

}  // namespace
}  // namespace twoport::sim::six_joints_test
