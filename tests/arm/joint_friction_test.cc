// Coulomb friction in the joints of an arm: a joint at rest is held exactly, and the energy that friction takes is its limit times the way.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "common/base/file.h"
#include "common/scene/load.h"
#include "sim/plant/arm.h"
#include "sim/sim_robot.h"
#include "tests/support/folder.h"
#include "tests/support/no_alloc.h"

namespace twoport::sim::joint_friction_test {
namespace {

using Joints = ArmPlant::Joints;
using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr double kPeriod = 5e-4;

SimRobot<6> robot(const std::string& arm, const std::string& world = "") {
  return SimRobot<6>{
      parse_scene("dof: 6 duration_s: 1 rate_hz: 2000 robot { arm { file: \"" TWOPORT_ARMS "/fr3.textproto\" " + arm +
                      " } } " + world,
                  "arm"),
      Seconds{kPeriod}};
}
void push(SimRobot<6>& r, const Vector6& f) {
  r.actuate({.f = Force<6>{f}, .x_d = {}, .v_d = {}});
  r.advance();
}
Vector6 torque_z(double t) {
  Vector6 f = Vector6::Zero();
  f[5] = t;
  return f;
}

/// The first joint alone: its axis is vertical, so that its inertia does not change and no weight turns it; friction locks the others.
const std::string kFirst =
    "joint_damping_n_m_s_per_rad: 0 null_space_stiffness_n_m_per_rad: 0 null_space_damping_n_m_s_per_rad: 0 "
    "joint_coulomb_friction_n_m: [0.4, 500, 500, 500, 500, 500, 500]";

TEST(JointFriction, HoldsUpToItsLimit) {
  SimRobot<6> r = robot(kFirst);
  const ArmPlant& arm = *r.arm();
  const Joints start = arm.state().q;
  for (int k = 0; k < 4000; ++k) push(r, torque_z(0.3999 * std::sin(0.01 * k)));
  EXPECT_EQ(arm.state().q, start);
  EXPECT_TRUE(arm.state().v.isZero(0.0));
  EXPECT_EQ(arm.joint_energy().si(), 0.0);
}

TEST(JointFriction, OfOneJointIsTheClosedForm) {
  // τ for 200 ticks, then nothing: q = (τ - τ_c) t²/2M, and it stops after the time that M v/τ_c takes, within a tick.
  SimRobot<6> r = robot(kFirst);
  const ArmPlant& arm = *r.arm();
  const Joints start = arm.state().q;
  const double M = arm.model().inertia(arm.model().pose(start))(0, 0), torque = 0.713, limit = 0.4;
  const double turned_on = 200 * kPeriod, speed = (torque - limit) / M * turned_on, stop = M * speed / limit;
  double off = 0.0;
  for (int k = 1; k <= 600; ++k) {
    push(r, torque_z(k <= 200 ? torque : 0.0));
    const double t = k * kPeriod, slowing = std::min(t - turned_on, stop);
    const double q = k <= 200 ? 0.5 * (torque - limit) / M * t * t
                              : 0.5 * speed * turned_on + speed * slowing - 0.5 * limit / M * slowing * slowing;
    off = std::max(off, std::abs(arm.state().q[0] - start[0] - q));
    ASSERT_EQ(arm.state().q.tail<6>(), start.tail<6>());
  }
  EXPECT_EQ(arm.state().v[0], 0.0);
  const double way = arm.state().q[0] - start[0];
  std::printf("%.2g rad off, stops %.6g ticks after the torque, at %.6g rad; account %.2g J\n", off, stop / kPeriod,
              way, arm.dissipated().si() - arm.joint_energy().si());
  EXPECT_LT(off, 1e-12);
  EXPECT_NEAR(arm.dissipated().si(), limit * way, 1e-15);
  EXPECT_NEAR(arm.joint_energy().si(), limit * way, 1e-12);
}

/// Half of what separates both directions in the identified friction of a Panda's joints.
const std::string kPanda = "joint_coulomb_friction_n_m: [0.273, 0.436, 0.32, 0.64, 0.42, 0.152, 0.282]";

TEST(JointFriction, EnergyOfAllJointsBalances) {
  SimRobot<6> r = robot(kPanda);
  const ArmPlant& arm = *r.arm();
  const double before = arm.mechanical_energy();
  double off = 0.0, last = 0.0;
  int held = 0, moved = 0, all_held = 0;
  for (int k = 0; k < 8000; ++k) {
    const double t = k * kPeriod;
    Vector6 f;
    f << 4 * std::sin(7 * t), 3 * std::cos(5 * t), -2 * std::sin(3 * t), 0.9 * std::sin(9 * t), 0.4,
        0.6 * std::sin(4 * t);
    if (k > 7000) f.setZero();
    const ArmPlant::State was = arm.state();
    push(r, f);
    off = std::max(off, std::abs(arm.joint_energy().si() - (arm.mechanical_energy() - before) - arm.dissipated().si()));
    ASSERT_GE(arm.dissipated().si(), last);
    last = arm.dissipated().si();
    for (int i = 0; i < 7; ++i) {
      const bool rests = was.v[i] == 0.0 && arm.state().v[i] == 0.0 && was.q[i] == arm.state().q[i];
      ++(rests ? held : moved);
    }
    all_held += arm.state().v.isZero(0.0);
  }
  std::printf(
      "friction and damping took %.4g J; %d ticks of a joint held, %d moving, %d with all held; account %.2g J\n", last,
      held, moved, all_held, off);
  EXPECT_GT(held, 1000);
  EXPECT_GT(moved, 1000);
  EXPECT_GT(all_held, 100);
  EXPECT_GT(last, 0.1);
  EXPECT_LT(off, 1e-8);
}

#ifdef TWOPORT_URDF
/// Where an arm of a URDF has the tool after 0.2 s under a constant wrench.
Eigen::Vector3d pushed(const std::string& urdf, const std::string& damping) {
  const std::string path = test::own_folder() / "pushed.urdf";
  write_whole(path, urdf);
  SimRobot<6> r{
      parse_scene(
          "dof: 6 duration_s: 1 robot { arm { file: \"" + path +
              "\" joint_position_rad: [0, -0.6, 1.6, 0.6, -1.5, 0] joint_coulomb_friction_n_m: [0, 0, 0, 0, 0, 0] " +
              damping + " } }",
          "arm"),
      Seconds{1e-3}};
  for (int k = 0; k < 200; ++k) push(r, (Vector6() << 20.0, 5.0, -3.0, 0.1, 0.2, 0.3).finished());
  return r.sense().x.translation();
}
TEST(JointDamping, OfAUrdfIsThatOfEachJoint) {
  const std::string from = "damping=\"0.5\"", urdf = read_whole(TWOPORT_ARMS "/six_joints.urdf");
  std::string even = urdf;
  for (std::size_t at = even.find(from); at != even.npos; at = even.find(from))
    even.replace(at, from.size(), "damping=\"2\"");
  const Eigen::Vector3d all_alike = pushed(urdf, "joint_damping_n_m_s_per_rad: 2");
  EXPECT_EQ(pushed(even, ""), all_alike);
  EXPECT_GT((pushed(urdf, "") - all_alike).norm(), 1e-5);
}
#endif

TEST(JointFriction, AllocatesNothing) {
  SimRobot<6> r =
      robot(kPanda, "environment { wall { normal: [0, 0, 1] offset_m: 0.001 stiffness_n_per_m: 5000 friction: 0.3 } }");
  NoAlloc guard;
  for (int k = 0; k < 100; ++k) push(r, torque_z(std::sin(0.2 * k)));
  EXPECT_EQ(guard.seen(), 0);
}

}  // namespace
}  // namespace twoport::sim::joint_friction_test
