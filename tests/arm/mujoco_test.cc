// Kinematics and dynamics of the arms against MuJoCo, an independent program.

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <mujoco/mujoco.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory>
#include <random>
#include <string>

#include "common/arm/arm_model.h"
#include "common/base/file.h"
#include "common/scene/arm.h"
#include "tests/arm/mjcf.h"
#include "tests/arm/random_arm.h"
#include "tests/support/folder.h"

namespace twoport::mujoco_test {
namespace {

using Arm = ArmModel;
using Joints = Arm::Joints;

const Eigen::Vector3d kGravity{0.0, 0.0, -9.81};

struct Simulated {
  std::unique_ptr<mjModel, decltype(&mj_deleteModel)> model{nullptr, mj_deleteModel};
  std::unique_ptr<mjData, decltype(&mj_deleteData)> data{nullptr, mj_deleteData};
};
Simulated load(const ArmParameters& arm, const ArmTool& tool = {},
               const Eigen::Matrix3d& tool_rotation = Eigen::Matrix3d::Identity()) {
  const std::string path = test::own_folder() / "arm.mjcf.xml";
  write_whole(path, test::mjcf(arm, kGravity, tool, tool_rotation));
  std::array<char, 500> error{};
  Simulated of;
  of.model.reset(mj_loadXML(path.c_str(), nullptr, error.data(), static_cast<int>(error.size())));
  EXPECT_NE(of.model, nullptr) << error.data();
  if (of.model) of.data.reset(mj_makeData(of.model.get()));
  return of;
}

/// The largest differences in parts of the largest number (1 at least).
struct Difference {
  double torque = 0.0, inertia = 0.0, tool = 0.0, jacobian = 0.0;

  void meet(const Arm& arm, const Simulated& peer, const Joints& q, const Joints& v, const Joints& a) {
    const mjModel* m = peer.model.get();
    mjData* d = peer.data.get();
    const auto n = static_cast<int>(q.size());
    std::copy(q.begin(), q.end(), d->qpos), std::copy(v.begin(), v.end(), d->qvel),
        std::copy(a.begin(), a.end(), d->qacc);
    mj_inverse(m, d);
    const auto raise = [](double& most, const Eigen::MatrixXd& theirs, const Eigen::MatrixXd& own) {
      most = std::max(most, (theirs - own).cwiseAbs().maxCoeff() / std::max(1.0, own.cwiseAbs().maxCoeff()));
    };
    const Arm::Pose p = arm.pose(q);
    raise(torque, Eigen::Map<const Eigen::VectorXd>{d->qfrc_inverse, n}, arm.inverse_dynamics(p, v, a, kGravity));
    Eigen::MatrixXd M{n, n};
    mj_fullM(m, M.data(), d->qM);
    raise(inertia, M, arm.inertia(p));
    raise(tool, Eigen::Map<const Eigen::Vector3d>{d->site_xpos}, p.tool);
    raise(tool, Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>{d->site_xmat}, p.tool_rotation);
    Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::RowMajor> linear{3, n}, angular{3, n};
    mj_jacSite(m, d, linear.data(), angular.data(), 0);
    const Arm::Jacobian J = arm.jacobian(p);
    raise(jacobian, linear, J.topRows<3>());
    raise(jacobian, angular, J.bottomRows<3>());
  }
  // MuJoCo turns inertias into their principal axes, which rounds their products: 1.1e-7 of the largest torque was measured. An arm whose
  // inertias are along its axes (iiwa14) differs by 3e-15.
  void expect_rounding(const std::string& name) const {
    fmt::print("{}: torque {:.2g}, inertia {:.2g}, tool {:.2g}, Jacobian {:.2g}\n", name, torque, inertia, tool,
               jacobian);
    EXPECT_LT(torque, 1e-6);
    EXPECT_LT(inertia, 1e-6);
    EXPECT_LT(tool, 1e-13);
    EXPECT_LT(jacobian, 1e-13);
  }
};

TEST(ArmAgainstMuJoCo, SameKinematicsAndDynamics) {
  std::mt19937_64 rng{20261122};
  const auto draw = [&](double low, double high) {
    return low + (high - low) * (static_cast<double>(rng() >> 11) * 0x1.0p-53);
  };
  for (const char* name : {"fr3", "panda", "iiwa14"}) {
    SCOPED_TRACE(name);
    const ArmParameters of = load_arm(fmt::format("{}/{}.textproto", TWOPORT_ARMS, name));
    const Arm arm{of};
    const Simulated peer = load(of);
    ASSERT_NE(peer.data, nullptr);
    Difference most;
    for (int k = 0; k < 100; ++k) {
      Joints q{7}, v{7}, a{7};
      for (int i = 0; i < 7; ++i) {
        const ArmJoint& joint = of.joints[static_cast<std::size_t>(i)];
        q[i] = draw(joint.lower, joint.upper), v[i] = draw(-2.0, 2.0), a[i] = draw(-5.0, 5.0);
      }
      most.meet(arm, peer, q, v, a);
    }
    most.expect_rounding(name);
  }
}

TEST(MuJoCoArms, HaveTheKinematicsAndDynamicsOfMuJoCo) {
  test::RandomArms random{20261128};
  Difference most;
  for (int k = 0; k < 200; ++k) {
    const test::RandomArm of = random.next();
    const int n = static_cast<int>(of.arm.joints.size());
    const Simulated peer = load(of.arm, of.tool, of.tool_rotation);
    ASSERT_NE(peer.data, nullptr);
    const Joints q = random.joints(n, 3.0), v = random.joints(n, 2.0), a = random.joints(n, 5.0);
    most.meet(Arm{of.arm, of.tool, of.tool_rotation}, peer, q, v, a);
  }
  most.expect_rounding("random arms");
}

}  // namespace
}  // namespace twoport::mujoco_test
