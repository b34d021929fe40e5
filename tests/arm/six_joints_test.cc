// The arm with six joints: published kinematics, KDL's dynamics, the plant without a null space.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <string>

#include "common/arm/arm_model.h"
#include "common/base/check.h"
#include "common/scene/arm.h"
#include "common/scene/load.h"
#include "sim/sim_robot.h"

#ifdef TWOPORT_KDL
#include <kdl/chaindynparam.hpp>
#include <kdl/chainidsolver_recursive_newton_euler.hpp>

#include "tests/arm/kdl_chain.h"
#endif

namespace twoport::sim {
namespace {

using Arm = ArmModel<6>;
using Joints = Arm::Joints;
using Vector6 = Eigen::Matrix<double, 6, 1>;

const Eigen::Vector3d kGravity{0.0, 0.0, -9.81};
const std::string kFile = TWOPORT_ARMS "/ur5e.textproto";

Joints draw(std::mt19937_64& rng, double size) {
  Joints v;
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
  const Joints g = Arm{of}.gravity_torque(Arm{of}.pose(Joints::Zero()), kGravity);
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
  const SerialArm<6>& arm = *r.arm()->joints<6>();
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
}  // namespace twoport::sim
