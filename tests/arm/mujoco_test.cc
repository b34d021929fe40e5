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
#include "tests/support/folder.h"

namespace twoport {
namespace {

using Arm = ArmModel<7>;
using Joints = Arm::Joints;

const Eigen::Vector3d kGravity{0.0, 0.0, -9.81};

struct Simulated {
  std::unique_ptr<mjModel, decltype(&mj_deleteModel)> model{nullptr, mj_deleteModel};
  std::unique_ptr<mjData, decltype(&mj_deleteData)> data{nullptr, mj_deleteData};
};
Simulated load(const ArmParameters& arm) {
  const std::string path = test::own_folder() / "arm.mjcf.xml";
  write_whole(path, test::mjcf(arm, kGravity));
  std::array<char, 500> error{};
  Simulated of;
  of.model.reset(mj_loadXML(path.c_str(), nullptr, error.data(), static_cast<int>(error.size())));
  EXPECT_NE(of.model, nullptr) << error.data();
  if (of.model) of.data.reset(mj_makeData(of.model.get()));
  return of;
}

// MuJoCo turns inertias into their principal axes, which rounds their products: 6e-8 N m were measured, of torques up to 90 N m.
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
    const mjModel* m = peer.model.get();
    mjData* d = peer.data.get();
    double torque = 0.0, inertia = 0.0, tool = 0.0, jacobian = 0.0;
    for (int k = 0; k < 100; ++k) {
      Joints q, v, a;
      for (int i = 0; i < 7; ++i) {
        const ArmJoint& joint = of.joints[static_cast<std::size_t>(i)];
        q[i] = draw(joint.lower_rad, joint.upper_rad), v[i] = draw(-2.0, 2.0), a[i] = draw(-5.0, 5.0);
        d->qpos[i] = q[i], d->qvel[i] = v[i], d->qacc[i] = a[i];
      }
      mj_inverse(m, d);
      const Arm::Pose p = arm.pose(q);
      torque = std::max(
          torque,
          (Eigen::Map<const Joints>{d->qfrc_inverse} - arm.inverse_dynamics(p, v, a, kGravity)).cwiseAbs().maxCoeff());
      Eigen::Matrix<double, 7, 7, Eigen::RowMajor> M;
      mj_fullM(m, M.data(), d->qM);
      inertia = std::max(inertia, (M - arm.inertia(p)).cwiseAbs().maxCoeff());
      tool = std::max(tool, (Eigen::Map<const Eigen::Vector3d>{d->site_xpos} - p.tool).norm());
      Eigen::Matrix<double, 3, 7, Eigen::RowMajor> linear, angular;
      mj_jacSite(m, d, linear.data(), angular.data(), 0);
      const Arm::Jacobian J = arm.jacobian(p);
      jacobian = std::max({jacobian, (linear - J.topRows<3>()).cwiseAbs().maxCoeff(),
                           (angular - J.bottomRows<3>()).cwiseAbs().maxCoeff()});
    }
    fmt::print("{}: torque {:.2g} N m, inertia {:.2g} kg m2, tool {:.2g} m, Jacobian {:.2g}\n", name, torque, inertia,
               tool, jacobian);
    EXPECT_LT(torque, 1e-6);
    EXPECT_LT(inertia, 1e-7);
    EXPECT_LT(tool, 1e-12);
    EXPECT_LT(jacobian, 1e-12);
  }
}

}  // namespace
}  // namespace twoport
