#include "common/scene/arm.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>

#include "common/arm/arm_model.h"
#include "common/base/check.h"
#include "common/base/file.h"
#include "tests/arm/random_arm.h"
#include "tests/support/folder.h"
#include "tests/support/no_alloc.h"

#ifdef TWOPORT_KDL
#include <kdl/chaindynparam.hpp>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainidsolver_recursive_newton_euler.hpp>
#include <kdl/chainjnttojacsolver.hpp>

#include "tests/arm/kdl_chain.h"
#endif

namespace twoport::arm_test {
namespace {

using Arm = ArmModel;
using Joints = Arm::Joints;
using Eigen::Matrix3d;
using Eigen::Vector3d;

const Vector3d kGravity{0.0, 0.0, -9.81};
const std::array<std::string, 3> kArms{"fr3", "panda", "iiwa14"};

ArmParameters parameters(const std::string& name) {
  return load_arm(TWOPORT_ARMS "/" + name + ".textproto");
}

class Draw {
 public:
  explicit Draw(std::uint64_t seed) : rng_{seed} {}
  double between(double low, double high) {
    return low + (high - low) * (static_cast<double>(rng_() >> 11) * 0x1.0p-53);
  }
  Joints joints(double size, int n = 7) {
    Joints v{n};
    for (int i = 0; i < n; ++i) v[i] = between(-size, size);
    return v;
  }
  /// Within the arm's limits.
  Joints position(const ArmParameters& arm) {
    Joints q{arm.joints.size()};
    for (std::size_t i = 0; i < arm.joints.size(); ++i)
      q[static_cast<int>(i)] = between(arm.joints[i].lower, arm.joints[i].upper);
    return q;
  }

 private:
  std::mt19937_64 rng_;
};

Joints ready(const ArmParameters& arm) {
  return joint_vector(arm.ready_position);
}

// ---- against KDL

// Rounding of some hundred operations on numbers up to 100: measured 3e-14.
constexpr double kRounding = 1e-12;

TEST(ArmAgainstKdl, SameKinematicsAndDynamics) {
#ifdef TWOPORT_KDL
  for (const std::string& name : kArms) {
    SCOPED_TRACE(name);
    const ArmParameters of = parameters(name);
    const Arm arm{of};
    const KDL::Chain chain = test::kdl_chain(of);
    KDL::ChainFkSolverPos_recursive forward{chain};
    KDL::ChainJntToJacSolver to_jacobian{chain};
    KDL::ChainIdSolver_RNE inverse{chain, test::kdl(kGravity)};
    KDL::ChainDynParam dynamics{chain, test::kdl(kGravity)};
    Draw draw{20261122};
    for (int k = 0; k < 100; ++k) {
      const Joints q = draw.position(of), v = draw.joints(2.0), a = draw.joints(5.0);
      KDL::JntArray kq{7}, kv{7}, ka{7}, tau{7};
      kq.data = q, kv.data = v, ka.data = a;
      const Arm::Pose p = arm.pose(q);

      KDL::Frame frame;
      ASSERT_GE(forward.JntToCart(kq, frame), 0);
      for (int i = 0; i < 3; ++i) {
        EXPECT_NEAR(frame.p(i), p.tool[i], kRounding);
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(frame.M(i, c), p.tool_rotation(i, c), kRounding);
      }
      KDL::Jacobian jacobian{7};
      ASSERT_GE(to_jacobian.JntToJac(kq, jacobian), 0);
      EXPECT_LT((jacobian.data - arm.jacobian(p)).cwiseAbs().maxCoeff(), kRounding);
      KDL::Wrenches none(chain.getNrOfSegments(), KDL::Wrench::Zero());
      ASSERT_GE(inverse.CartToJnt(kq, kv, ka, none, tau), 0);
      EXPECT_LT((tau.data - arm.inverse_dynamics(p, v, a, kGravity)).cwiseAbs().maxCoeff(), 100.0 * kRounding);
      KDL::JntSpaceInertiaMatrix M{7};
      ASSERT_GE(dynamics.JntToMass(kq, M), 0);
      EXPECT_LT((M.data - arm.inertia(p)).cwiseAbs().maxCoeff(), kRounding);
      KDL::JntArray gravity{7};
      ASSERT_GE(dynamics.JntToGravity(kq, gravity), 0);
      EXPECT_LT((gravity.data - arm.gravity_torque(p, kGravity)).cwiseAbs().maxCoeff(), 100.0 * kRounding);
    }
  }
#else
  GTEST_SKIP() << "liborocos-kdl-dev is not installed";
#endif
}

// 200 chains of 1 to 8 revolute and prismatic joints with turned tools. Rounding in parts of the largest number: 1.1e-14 was measured.
TEST(RandomArms, HaveTheKinematicsAndDynamicsOfKdl) {
#ifdef TWOPORT_KDL
  test::RandomArms random{20261128};
  std::array<int, 2> of_type{};
  double worst = 0.0;
  for (int k = 0; k < 200; ++k) {
    const test::RandomArm of = random.next();
    const int n = static_cast<int>(of.arm.joints.size());
    SCOPED_TRACE(fmt::format("arm {} with {} joints", k, n));
    for (const ArmJoint& j : of.arm.joints) ++of_type[j.type == JointType::prismatic];
    const Arm arm{of.arm, of.tool, of.tool_rotation};
    const Joints q = random.joints(n, 3.0), v = random.joints(n, 2.0), a = random.joints(n, 5.0);
    const Arm::Pose p = arm.pose(q);
    const KDL::Chain chain = test::kdl_chain(of.arm, of.tool, of.tool_rotation);
    const auto rows = static_cast<unsigned>(n);
    KDL::JntArray kq{rows}, kv{rows}, ka{rows}, tau{rows}, gravity{rows};
    kq.data = q, kv.data = v, ka.data = a;
    const auto differ = [&](const Eigen::MatrixXd& peer, const Eigen::MatrixXd& own) {
      const double error = (peer - own).cwiseAbs().maxCoeff() / (1.0 + peer.cwiseAbs().maxCoeff());
      worst = std::max(worst, error);
      EXPECT_LT(error, 1e-13);
    };

    KDL::Frame frame;
    ASSERT_GE(KDL::ChainFkSolverPos_recursive{chain}.JntToCart(kq, frame), 0);
    differ(Eigen::Map<const Vector3d>{frame.p.data}, p.tool);
    differ(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>{frame.M.data}, p.tool_rotation);
    KDL::Jacobian jacobian{rows};
    ASSERT_GE(KDL::ChainJntToJacSolver{chain}.JntToJac(kq, jacobian), 0);
    differ(jacobian.data, arm.jacobian(p));
    KDL::ChainIdSolver_RNE inverse{chain, test::kdl(kGravity)};
    ASSERT_GE(inverse.CartToJnt(kq, kv, ka, KDL::Wrenches(chain.getNrOfSegments(), KDL::Wrench::Zero()), tau), 0);
    differ(tau.data, arm.inverse_dynamics(p, v, a, kGravity));
    KDL::ChainDynParam dynamics{chain, test::kdl(kGravity)};
    KDL::JntSpaceInertiaMatrix M{n};
    ASSERT_GE(dynamics.JntToMass(kq, M), 0);
    differ(M.data, arm.inertia(p));
    ASSERT_GE(dynamics.JntToGravity(kq, gravity), 0);
    differ(gravity.data, arm.gravity_torque(p, kGravity));
  }
  RecordProperty("worst", fmt::format("{}", worst));
  EXPECT_GT(of_type[0], 200);
  EXPECT_GT(of_type[1], 200);
#else
  GTEST_SKIP() << "liborocos-kdl-dev is not installed";
#endif
}

// ---- laws that need no second program

TEST(RandomArms, AccelerateAsTheirPosesAndTorquesSay) {
  test::RandomArms random{1};
  for (int k = 0; k < 200; ++k) {
    const test::RandomArm of = random.next();
    const int n = static_cast<int>(of.arm.joints.size());
    SCOPED_TRACE(fmt::format("arm {} with {} joints", k, n));
    const Arm arm{of.arm, of.tool, of.tool_rotation};
    const Joints q = random.joints(n, 3.0), v = random.joints(n, 1.0), a = random.joints(n, 5.0);
    const Arm::Pose p = arm.pose(q);
    // Rounding times the condition of M: 2.3e-13 was measured, and 1.1e-15 of the mobility.
    const Joints back = arm.forward_dynamics(p, v, arm.inverse_dynamics(p, v, a, kGravity), kGravity);
    EXPECT_LT((back - a).cwiseAbs().maxCoeff(), 1e-10);
    const Eigen::MatrixXd J = arm.jacobian(p), M = arm.inertia(p), mobility = J * M.inverse() * J.transpose();
    EXPECT_LT((tool_mobility(arm, q) - mobility).cwiseAbs().maxCoeff(), 1e-12 * (1.0 + mobility.cwiseAbs().maxCoeff()));
    // Central differences err by h² and rounding/h, of accelerations up to some 100 m/s².
    constexpr double h = 1e-5;
    const Arm::Vector6 change = (arm.jacobian(arm.pose(q + h * v)) - arm.jacobian(arm.pose(q - h * v))) * v / (2.0 * h);
    EXPECT_LT((arm.bias_acceleration(p, v) - change).cwiseAbs().maxCoeff(), 1e-7);
  }
}

TEST(Arm, InertiaMatrixIsPositiveDefiniteAndThatOfInverseDynamics) {
  for (const std::string& name : kArms) {
    SCOPED_TRACE(name);
    const ArmParameters of = parameters(name);
    const Arm arm{of, {0.5, {0.02, -0.03, 0.08}}};
    Draw draw{1};
    for (int k = 0; k < 50; ++k) {
      const Joints q = draw.position(of);
      const Arm::Pose p = arm.pose(q);
      const Arm::Inertia M = arm.inertia(p);
      EXPECT_EQ((M - M.transpose()).cwiseAbs().maxCoeff(), 0.0);
      EXPECT_EQ(Eigen::LLT<Arm::Inertia>{M}.info(), Eigen::Success) << "positive definite";
      for (int i = 0; i < 7; ++i) {
        const Joints column = arm.inverse_dynamics(p, Joints::Zero(7), Joints::Unit(7, i), Vector3d::Zero());
        EXPECT_LT((column - M.col(i)).cwiseAbs().maxCoeff(), kRounding);
      }
    }
  }
}

TEST(Arm, ForwardDynamicsInvertsInverseDynamics) {
  for (const std::string& name : kArms) {
    SCOPED_TRACE(name);
    const ArmParameters of = parameters(name);
    const Arm arm{of};
    Draw draw{2};
    for (int k = 0; k < 50; ++k) {
      const Joints v = draw.joints(2.0), a = draw.joints(5.0);
      const Arm::Pose p = arm.pose(draw.position(of));
      const Joints back = arm.forward_dynamics(p, v, arm.inverse_dynamics(p, v, a, kGravity), kGravity);
      // Rounding times the condition of M, up to 2e4 without rotors.
      EXPECT_LT((back - a).cwiseAbs().maxCoeff(), 1e-9);
    }
  }
}

TEST(Arm, JacobianIsTheDerivativeOfThePose) {
  for (const std::string& name : kArms) {
    SCOPED_TRACE(name);
    const ArmParameters of = parameters(name);
    const Arm arm{of, {}, Eigen::AngleAxisd{0.7, Vector3d{1, 2, 3}.normalized()}.toRotationMatrix()};
    Draw draw{3};
    for (int k = 0; k < 20; ++k) {
      const Joints q = draw.position(of), v = draw.joints(1.0);
      constexpr double h = 1e-5;  // central differences err by h² ~ 1e-10 and rounding/h ~ 1e-11
      const Arm::Pose p = arm.pose(q), before = arm.pose(q - h * v), after = arm.pose(q + h * v);
      const Arm::Vector6 velocity = arm.jacobian(p) * v;
      EXPECT_LT((velocity.head<3>() - (after.tool - before.tool) / (2.0 * h)).cwiseAbs().maxCoeff(), 1e-8);
      const Eigen::AngleAxisd turned{Matrix3d{after.tool_rotation * before.tool_rotation.transpose()}};
      EXPECT_LT((velocity.tail<3>() - turned.angle() * turned.axis() / (2.0 * h)).cwiseAbs().maxCoeff(), 1e-7);
      const Arm::Vector6 change = (arm.jacobian(after) * v - arm.jacobian(before) * v) / (2.0 * h);
      EXPECT_LT((arm.bias_acceleration(p, v) - change).cwiseAbs().maxCoeff(), 1e-8);
    }
  }
}

// Fingers move the tool by nothing, and everything before them as one body.
TEST(Fingers, LeaveTheToolWhereItIs) {
  const ArmParameters of = parameters("panda_gripper");
  const double mass = 0.3;
  const Vector3d center{0.01, 0.02, 0.05};
  const Arm bare{of}, arm{of, {.mass_kg = mass, .center_m = center}};
  ASSERT_TRUE(arm.has_fingers());
  Draw draw{11};
  for (int run = 0; run < 20; ++run) {
    const Joints q = draw.position(of), v = draw.joints(1.0, 8);
    const double h = 1e-4;
    const auto before = arm.pose(q - h * v), now = arm.pose(q), after = arm.pose(q + h * v);
    const Arm::Jacobian J = arm.jacobian(now);
    EXPECT_TRUE(J.col(7).isZero(0.0));
    EXPECT_LT((J.topRows<3>() * v - (after.tool - before.tool) / (2 * h)).norm(), 1e-6);
    EXPECT_LT((arm.bias_acceleration(now, v).head<3>() - (after.tool - 2 * now.tool + before.tool) / (h * h)).norm(),
              1e-5);
    // One finger is at the joint's position from it, along its axis, and the tool is not on its link: it does not weigh on it.
    const Vector3d of_finger = now.origin[7] - q[7] * now.moment[7];
    EXPECT_NEAR((now.tool - of_finger).dot(now.moment[7]), 0.0, 1e-12);
    EXPECT_NEAR(arm.inertia(now)(7, 7), 0.515, 1e-12);
    // What the tool adds is a mass at its centre.
    const Vector3d c = now.tool_rotation * center;
    Eigen::Matrix<double, 3, 8> of_center = J.topRows<3>();
    for (int i = 0; i < 8; ++i) of_center.col(i) += Vector3d{J.block<3, 1>(3, i)}.cross(c);
    EXPECT_LT((arm.inertia(now) - bare.inertia(now) - mass * of_center.transpose() * of_center).cwiseAbs().maxCoeff(),
              kRounding);
  }
}

// c = Ṁ q̇ - ½ ∂(q̇ᵀ M q̇)/∂q. Gyroscopic torques do no work: the energy below does not see them.
TEST(Arm, TorqueOfVelocitiesIsThatOfLagrange) {
  for (const std::string& name : kArms) {
    SCOPED_TRACE(name);
    const ArmParameters of = parameters(name);
    const Arm arm{of, {0.5, {0.02, -0.03, 0.08}, Vector3d{2e-3, 3e-3, 4e-3}.asDiagonal()}};
    Draw draw{5};
    for (int k = 0; k < 10; ++k) {
      const Joints q = draw.position(of), v = draw.joints(2.0);
      constexpr double h = 1e-5;
      const auto change = [&](const Joints& along) {
        return Arm::Inertia{(arm.inertia(arm.pose(q + h * along)) - arm.inertia(arm.pose(q - h * along))) / (2.0 * h)};
      };
      Joints expected = change(v) * v;
      for (int i = 0; i < 7; ++i) expected[i] -= 0.5 * v.dot(change(Joints::Unit(7, i)) * v);
      EXPECT_LT((arm.bias_torque(arm.pose(q), v, Vector3d::Zero()) - expected).cwiseAbs().maxCoeff(), 1e-7);
    }
  }
}

// What a tool adds to M is that of a rigid body with the velocity of its centre of mass.
TEST(Arm, CarriesATurnedToolAsABody) {
  const ArmParameters of = parameters("fr3");
  const Matrix3d turned = Eigen::AngleAxisd{0.7, Vector3d{1, 2, 3}.normalized()}.toRotationMatrix();
  const Matrix3d moments = Vector3d{2e-3, 3e-3, 4e-3}.asDiagonal();
  const Arm bare{of};
  Draw draw{6};
  for (const double mass : {0.5, 0.0}) {
    const Vector3d center = mass > 0.0 ? Vector3d{0.02, -0.03, 0.08} : Vector3d::Zero();
    const Arm arm{of, {mass, center, moments}, turned};
    for (int k = 0; k < 10; ++k) {
      const Joints q = draw.position(of);
      const Arm::Pose p = arm.pose(q);
      EXPECT_LT((p.tool_rotation - bare.pose(q).tool_rotation * turned).norm(), kRounding);
      const Vector3d c = p.tool_rotation * center;
      Arm::Jacobian J = arm.jacobian(p);
      for (int i = 0; i < 7; ++i) J.block<3, 1>(0, i) += Vector3d{J.block<3, 1>(3, i)}.cross(c);
      const auto linear = J.topRows<3>(), angular = J.bottomRows<3>();
      const Arm::Inertia body = mass * linear.transpose() * linear +
                                angular.transpose() * p.tool_rotation * moments * p.tool_rotation.transpose() * angular;
      EXPECT_LT((arm.inertia(p) - bare.inertia(p) - body).cwiseAbs().maxCoeff(), kRounding) << mass;
    }
  }
}

TEST(Arm, KeepsItsEnergyWithoutTorques) {
  for (const std::string& name : kArms) {
    SCOPED_TRACE(name);
    const ArmParameters of = parameters(name);
    const Arm arm{of};
    Joints q = ready(of), v = 0.5 * Joints::Ones(7);
    const auto acceleration = [&](const Joints& at, const Joints& speed) {
      return arm.forward_dynamics(arm.pose(at), speed, Joints::Zero(7), kGravity);
    };
    const auto energy = [&] { return arm.energy(arm.pose(q), v, kGravity); };
    const double start = energy();
    double largest = 0.0, error = 0.0;
    constexpr double h = 2e-4;
    for (int k = 0; k < 2500; ++k) {
      const Joints a1 = acceleration(q, v), v2 = v + 0.5 * h * a1;
      const Joints a2 = acceleration(q + 0.5 * h * v, v2), v3 = v + 0.5 * h * a2;
      const Joints a3 = acceleration(q + 0.5 * h * v2, v3), v4 = v + h * a3;
      const Joints a4 = acceleration(q + h * v3, v4);
      q += h / 6.0 * (v + 2.0 * (v2 + v3) + v4);
      v += h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4);
      error = std::max(error, std::abs(energy() - start));
      largest = std::max(largest, 0.5 * v.dot(arm.inertia(arm.pose(q)) * v));
    }
    EXPECT_GT(largest, 1.0) << "it falls";
    // Runge-Kutta 4 over half a second, light wrists turning at up to 100 rad/s.
    EXPECT_LT(error, 1e-6 * largest);
  }
}

TEST(Arm, GravityTorqueIsTheSlopeOfThePotential) {
  for (const std::string& name : kArms) {
    SCOPED_TRACE(name);
    const ArmParameters of = parameters(name);
    const Arm arm{of, {0.7, {0.01, 0.02, 0.05}}};
    Draw draw{4};
    const Joints q = draw.position(of);
    const Joints g = arm.gravity_torque(arm.pose(q), kGravity);
    EXPECT_LT((g - arm.bias_torque(arm.pose(q), Joints::Zero(7), kGravity)).cwiseAbs().maxCoeff(), kRounding * 100.0);
    for (int i = 0; i < 7; ++i) {
      constexpr double h = 1e-5;
      const auto potential = [&](double by) {
        return arm.energy(arm.pose(q + by * Joints::Unit(7, i)), Joints::Zero(7), kGravity);
      };
      EXPECT_NEAR(g[i], (potential(h) - potential(-h)) / (2.0 * h), 1e-7);
    }
  }
}

// ---- numbers of the arms

TEST(Fr3, HasItsKnownFiguresInTheReadyPosition) {
  ArmParameters of = parameters("fr3");
  const Joints q = ready(of);
  const Arm arm{of};
  const Arm::Pose p = arm.pose(q);
  EXPECT_NEAR(p.tool.x(), 0.307, 1e-3);
  EXPECT_NEAR(p.tool.y(), 0.0, 1e-12);
  EXPECT_NEAR(p.tool.z(), 0.590, 1e-3);
  // Written with three or two digits, of the published parameters and of a position rounded to three digits.
  const Joints gravity = arm.gravity_torque(p, kGravity);
  const std::array<double, 7> known{0, -1.71, -0.64, 18.96, 0.79, 1.59, 0};
  for (std::size_t i = 0; i < 7; ++i) EXPECT_NEAR(gravity[static_cast<int>(i)], known[i], 0.02) << i;

  const auto effective = [&](const ArmParameters& with) {
    const auto mobility = tool_mobility(Arm{with}, q);
    return Eigen::Matrix<double, 6, 1>{mobility.diagonal().cwiseInverse()};
  };
  const auto heavy = effective(of);
  const std::array<double, 6> with_rotors{11.3, 5.2, 5.3, 0.21, 0.21, 0.17};
  for (std::size_t i = 0; i < 6; ++i)
    EXPECT_NEAR(heavy[static_cast<int>(i)], with_rotors[i], 0.02 * with_rotors[i]) << i;
  for (ArmJoint& j : of.joints) j.rotor_inertia = 0.0;
  const auto light = effective(of);
  const std::array<double, 5> without{1.86, 1.81, 2.90, 0.025, 0.024};
  for (std::size_t i = 0; i < 5; ++i) EXPECT_NEAR(light[static_cast<int>(i)], without[i], 0.02 * without[i]) << i;
}

TEST(Arms, NameTheirSources) {
  for (const std::string& name : kArms) EXPECT_FALSE(parameters(name).source.empty()) << name;
}

TEST(Arms, WrongFilesAreRefusedInASentence) {
  const std::string right = read_whole(TWOPORT_ARMS "/fr3.textproto");
  const auto error_of = [&](const std::string& from, const std::string& to) {
    std::string text = right;
    text.replace(text.find(from), from.size(), to);
    const std::string path = test::own_folder() / "wrong_arm.textproto";
    write_whole(path, text);
    try {
      load_arm(path);
    } catch (const ConfigError& e) {
      return std::string{e.what()};
    }
    return std::string{};
  };
  // What the file's first joint says, what it is replaced by, and what the sentence must hold: thing, value, what is allowed.
  struct Wrong {
    std::string from, to, words;
  };
  const std::string kBody = "origin_m: [0, 0, 0] mass_kg: 1 center_m: [0, 0, 0] inertia_kg_m2: [1, 1, 1] ",
                    kSlide = "joint { type: PRISMATIC max_force_n: 1 max_speed_m_per_s: 1 lower_m: 0 upper_m: 1 " +
                             kBody + "} ";
  for (const Wrong& wrong : {
           Wrong{"mass_kg: 2.92747", "mass_kg: -1", "joint[0].mass_kg is -1; it must be > 0 and at most 1e18"},
           Wrong{"mass_kg: 2.92747", "mass_kg: nan", "joint[0].mass_kg is nan; it must be a finite number"},
           Wrong{"mass_kg: 2.92747", "mass_kg: 2.9 color: 1", "color"},
           Wrong{"mass_kg: 2.92747", "mass_kg: heavy", "heavy"},
           Wrong{"mass_kg: 2.92747", "", "joint[0].mass_kg is missing; it must be > 0"},
           Wrong{"origin_m: [0, 0, 0.333]", "", "joint[0].origin_m is missing; it must hold 3 numbers"},
           Wrong{"origin_m: [0, 0, 0.333]", "origin_m: [0, 0]", "joint[0].origin_m is [0, 0]; it must hold 3 numbers"},
           Wrong{"origin_m: [0, 0, 0.333]", "origin_m: [0, 0, inf]", "joint[0].origin_m is [0, 0, inf]"},
           Wrong{"[0.023927, 0.022482", "[0.923927, 0.022482", "triangle inequality"},
           Wrong{"[0.023927, 0.022482", "[-0.023927, 0.022482", "joint[0].inertia_kg_m2"},
           Wrong{"rotor_inertia_kg_m2: 0.6057", "rotor_inertia_kg_m2: -1",
                 "joint[0].rotor_inertia_kg_m2 is -1; it must be >= 0"},
           Wrong{"max_torque_n_m: 87.0", "max_torque_n_m: 0", "joint[0].max_torque_n_m is 0; it must be > 0"},
           Wrong{"max_torque_n_m: 87.0 ", "", "joint[0].max_torque_n_m is missing; it must be > 0"},
           Wrong{"max_speed_rad_per_s: 2.62", "max_speed_rad_per_s: 0",
                 "joint[0].max_speed_rad_per_s is 0; it must be > 0"},
           Wrong{"lower_rad: -2.7501", "", "joint[0].lower_rad is missing; it must be a finite number"},
           Wrong{"upper_rad: 2.7501", "upper_rad: -3",
                 "joint[0].upper_rad is -3; it must be > lower_rad, which is -2.7501"},
           Wrong{"lower_rad: -2.7501", "lower_rad: -2.7501 lower_m: 0",
                 "joint[0].lower_m is 0; it must be absent: the joint is REVOLUTE"},
           Wrong{"lower_rad: -2.7501", "lower_rad: -2.7501 type: CONTINUOUS",
                 "joint[0].lower_rad is -2.7501; it must be absent: the joint is CONTINUOUS"},
           Wrong{"lower_rad: -2.7501", "lower_rad: -2.7501 type: PRISMATIC",
                 "joint[0].rotor_inertia_kg_m2 is 0.6057; it must be absent: the joint is PRISMATIC"},
           Wrong{"joint {", kSlide + kSlide + "joint {", "joint is given 9 times; an arm must have 1 to 8 joints"},
           Wrong{"joint {", kSlide + "joint { upper_m: 1", "joint[1].upper_m is 1; it must be absent"},
           Wrong{"joint {", "joint { type: PRISMATIC max_force_n: 1 " + kBody + "} joint {",
                 "joint[0].max_speed_m_per_s is missing; it must be > 0"},
           Wrong{"joint {",
                 "joint { type: PRISMATIC max_force_n: 1 max_speed_m_per_s: 1 lower_m: 0 upper_m: 0 " + kBody +
                     "} joint {",
                 "joint[0].upper_m is 0; it must be > lower_m, which is 0"},
           Wrong{"ready_position_rad: [0,", "ready_position_rad: [3,",
                 "it must lie within the joints' limits; number 1 must be between -2.7501 and 2.7501"},
           Wrong{"ready_position_rad: [0,", "ready_position_rad: [0, 0,", "it must hold 7 numbers"},
           Wrong{"ready_position_rad: [0,", "flange_m: [0, 0, 1] ready_position_rad: [0,", "flange_m"},
       }) {
    ASSERT_NE(right.find(wrong.from), std::string::npos) << wrong.from;
    const std::string error = error_of(wrong.from, wrong.to);
    EXPECT_NE(error.find(wrong.words), std::string::npos) << wrong.to << " says \"" << error << "\"";
    EXPECT_NE(error.find("wrong_arm.textproto"), std::string::npos) << error;
  }
  const std::string path = test::own_folder() / "wrong_arm.textproto";
  write_whole(path, "name: \"none\"\n");
  try {
    load_arm(path);
    FAIL();
  } catch (const ConfigError& e) {
    EXPECT_NE(std::string{e.what()}.find("joint is given 0 times; an arm must have 1 to 8 joints"), std::string::npos)
        << e.what();
  }
}

TEST(Arm, AllocatesNothing) {
  const ArmParameters of = parameters("fr3");
  const Arm arm{of};
  const Joints q = ready(of), v = Joints::Ones(7);
  double sum = 0.0;
  NoAlloc guard;
  const Arm::Pose p = arm.pose(q);
  sum += arm.jacobian(p).sum() + arm.inertia(p).sum() + arm.forward_dynamics(p, v, v, kGravity).sum() +
         arm.energy(p, v, kGravity) + arm.bias_acceleration(p, v).sum() + arm.gravity_torque(p, kGravity).sum() +
         tool_mobility(arm, q).sum();
  EXPECT_EQ(guard.seen(), 0);
  EXPECT_TRUE(std::isfinite(sum));
}

}  // namespace
}  // namespace twoport::arm_test
