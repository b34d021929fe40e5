#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/file.h"
#include "common/scene/load.h"
#include "sim/plant/arm.h"
#include "sim/sim_robot.h"
#include "tests/support/folder.h"
#include "tests/support/no_alloc.h"

namespace twoport::sim::arm_plant_test {
namespace {

using Eigen::Vector3d;
using Joints = ArmPlant::Joints;
using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr double kPeriod = 5e-4;

SimRobot<6> robot(const std::string& arm = "", const std::string& more = "", const std::string& world = "") {
  return SimRobot<6>{
      parse_scene("dof: 6 duration_s: 1 rate_hz: 2000 robot { arm { file: \"" TWOPORT_ARMS "/fr3.textproto\" " + arm +
                      " } " + more + " } " + world,
                  "arm"),
      Seconds{kPeriod}};
}

Vector6 wrench(double x, double y, double z, double a = 0, double b = 0, double c = 0) {
  Vector6 f;
  f << x, y, z, a, b, c;
  return f;
}
void push(SimRobot<6>& r, const Vector6& f) {
  RobotCommand<6> command;
  command.f = Force<6>{f};
  r.actuate(command);
  r.advance();
}

TEST(ArmPlant, StartsAtTheScenesPoseAndStaysThereWithoutACommand) {
  SimRobot<6> r =
      robot("tool_mass_kg: 0.5 tool_center_m: [0, 0.01, 0.05]", "position_m: [0.1, 0.2, 0.3, 0.8, 0.6, 0, 0]");
  const Position<6> start = r.state().x;
  EXPECT_LT((start.translation() - Vector3d{0.1, 0.2, 0.3}).norm(), 1e-12);
  EXPECT_LT(start.attitude().angularDistance(Eigen::Quaterniond{0.8, 0.6, 0, 0}), 1e-7);
  for (int k = 0; k < 2000; ++k) push(r, Vector6::Zero());
  EXPECT_LT((r.state().x - start).vec().norm(), 1e-9);
}

TEST(ArmPlant, EnergyIsThatOfTheJointTorques) {
  SimRobot<6> r = robot("joint_damping_n_m_s_per_rad: 0", "",
                        "environment { wall { normal: [0, 0, 1] offset_m: -0.01 stiffness_n_per_m: 5000 } }");
  const double start = r.arm()->mechanical_energy();
  double by_wrench = 0.0, largest = 0.0, pressed = 0.0;
  for (int k = 0; k < 2000; ++k) {
    const double t = k * kPeriod;
    const Position<6> before = r.state().x;
    const Vector6 f = wrench(10 * std::sin(7 * t), 5 * std::cos(5 * t), -8, 0.3 * std::sin(9 * t), 0.2, 0.1);
    push(r, f);
    by_wrench += f.dot((r.state().x - before).vec());
    largest = std::max(largest, std::abs(r.arm()->port_energy().si()));
    pressed = std::max(pressed, r.environment_force()[2]);
  }
  EXPECT_GT(pressed, 1.0);
  EXPECT_GT(largest, 0.1);
  // What the joints took in is what is held; Runge-Kutta 4 at contacts that begin within a tick.
  EXPECT_NEAR(r.arm()->mechanical_energy() - start, r.arm()->joint_energy().si(), 1e-6);
  // Torques are held, not the wrench: its work differs by the turning of J in a tick.
  RecordProperty("wrench_against_joints_j", std::to_string(by_wrench - r.arm()->port_energy().si()));
  EXPECT_NEAR(by_wrench, r.arm()->port_energy().si(), 2e-2 * largest);
  EXPECT_NE(by_wrench, r.arm()->port_energy().si());
}

// Torques of the joints, a hand with spring and damper at the tool, damped joints: what comes in is held or dissipated. Nothing touches, so
// all is smooth and Runge-Kutta 4 errs by 1e-11 of it.
TEST(ArmPlant, EnergyOfJointsToolAndDampingBalance) {
  const Scene s = parse_scene(
      "dof: 6 duration_s: 1 rate_hz: 2000 control { architecture: RENDER } device { arm { file: \"" TWOPORT_ARMS
      "/fr3.textproto\" joint_damping_n_m_s_per_rad: 1 } }",
      "arm");
  const auto nothing = std::make_shared<const Environment<6>>(std::vector<EnvironmentSpec>{});
  const Position<6> start = position<6>(s.device->position_m);
  HandSpec spec{};
  spec.stiffness_n_per_m = 300.0, spec.damping_n_s_per_m = 8.0;
  spec.rotational_stiffness_n_m_per_rad = 5.0, spec.rotational_damping_n_m_s_per_rad = 0.1;
  ArmPlant arm{*s.device->arm, nothing, kPeriod, start, HandOnTool{spec, start, start}};
  const double before = arm.mechanical_energy();
  double through = 0.0;
  for (int k = 0; k < 4000; ++k) {
    const double t = k * kPeriod;
    const double last = arm.joint_energy().si();
    arm.lead(start + Displacement<6>{wrench(0.05 * std::sin(2 * t), 0, 0.03 * t, 0, 0.2 * std::sin(3 * t))});
    arm.advance(Force<6>{wrench(10 * std::sin(7 * t), 5 * std::cos(5 * t), -8, 0.3 * std::sin(9 * t), 0.2, 0.1)});
    through += std::abs(arm.joint_energy().si() - last);
  }
  const double in = arm.joint_energy().si() + arm.outside_energy().si();
  const double kept = arm.mechanical_energy() - before + arm.dissipated().si();
  std::printf(
      "joints %.3f J, hand %.3f J, dissipated %.3f J, held %.3f J, balance %.2g J of %.3g J through the joints\n",
      arm.joint_energy().si(), arm.outside_energy().si(), arm.dissipated().si(), arm.mechanical_energy() - before,
      in - kept, through);
  EXPECT_GT(arm.dissipated().si(), 0.1);
  EXPECT_GT(std::abs(arm.outside_energy().si()), 0.1);
  EXPECT_NEAR(in, kept, 1e-9 * through);
}

TEST(ArmPlant, NullSpaceMotionLeavesTheToolAlone) {
  SimRobot<6> r = robot("joint_damping_n_m_s_per_rad: 0");
  const Position<6> start = r.state().x;
  const ArmPlant& arm = *r.arm();
  ArmPlant moved = arm;
  // Velocity with J v = 0.
  const auto J = arm.model().jacobian(arm.model().pose(arm.state().q));
  const Joints free = J.fullPivLu().kernel().col(0).normalized();
  moved.set_state({arm.state().q, 0.05 * free});
  double most = 0.0, swing = 0.0;
  for (int k = 0; k < 8000; ++k) {
    const BodyState<6> now = moved.advance(Force<6>{});
    most = std::max(most, (now.x - start).vec().norm());
    swing = std::max(swing, (moved.state().q - arm.state().q).norm());
  }
  EXPECT_GT(swing, 4e-3);
  RecordProperty("tool_moved", std::to_string(most));
  // The elbow swings and comes back; nothing holds the tool, which is moved by forces that grow with the square of the velocity.
  EXPECT_LT(most, 0.05 * swing);
  EXPECT_LT((moved.state().v).norm(), 1e-2);
}

TEST(ArmPlant, KeepsTheTorqueLimits) {
  SimRobot<6> r = robot();
  push(r, wrench(5000, 0, 0));
  EXPECT_LT(r.arm()->applied_part(), 1.0);
  EXPECT_GT(r.arm()->applied_part(), 0.0);
  EXPECT_LE(r.arm()->torque().cwiseAbs().head<4>().maxCoeff(), 87.0);
  EXPECT_LE(r.arm()->torque().cwiseAbs().tail<3>().maxCoeff(), 12.0);
}

TEST(ArmPlant, StopsHoldTheJoints) {
  SimRobot<6> r = robot("null_space_stiffness_n_m_per_rad: 0");
  for (int k = 0; k < 6000; ++k) push(r, wrench(0, 0, 0, 0, 0, 8));
  const Joints q = r.arm()->state().q;
  double beyond = 0.0;
  const double upper[] = {2.7501, 1.7918, 2.9065, -.1458, 2.8101, 4.5205, 3.0196},
               lower[] = {-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, .54092, -3.0196};
  for (int i = 0; i < 7; ++i) beyond = std::max({beyond, q[i] - upper[i], lower[i] - q[i]});
  EXPECT_GT(beyond, 0.0) << "it has reached a stop";
  EXPECT_LT(beyond, 0.05);
}

/// The seven joints on a rail along x.
Scene on_a_rail(const std::string& more = "") {
  std::string text = read_whole(TWOPORT_ARMS "/fr3.textproto");
  const auto put = [&](const std::string& before, const std::string& what) { text.insert(text.find(before), what); };
  put("joint {",
      "joint { type: PRISMATIC origin_m: [0, 0, 0.1] rotation_rpy_rad: [0, 1.5707963267948966, 0] mass_kg: 20 "
      "center_m: [0, 0, 0] "
      "inertia_kg_m2: [0.5, 0.5, 0.5] max_force_n: 500 max_speed_m_per_s: 1 lower_m: -0.5 upper_m: 0.5 }\n");
  const std::string ready = "ready_position_rad: [";
  text.insert(text.find(ready) + ready.size(), "0.1, ");
  const std::string path = test::own_folder() / "on_a_rail.textproto";
  write_whole(path, text);
  return parse_scene("dof: 6 duration_s: 1 rate_hz: 2000 robot { arm { file: \"" + path + "\" " + more + "} }", "arm");
}

TEST(ArmPlant, OnARailKeepsItsEnergy) {
  SimRobot<6> r{on_a_rail("joint_damping_n_m_s_per_rad: 0"), Seconds{kPeriod}};
  ASSERT_EQ(r.arm()->state().q.size(), 8);
  const Position<6> start = r.state().x;
  for (int k = 0; k < 500; ++k) push(r, Vector6::Zero());
  EXPECT_LT((r.state().x - start).vec().norm(), 1e-9) << "it carries its weight";
  // Drawn by 0.2 m along the rail in a second.
  const double before = r.arm()->mechanical_energy();
  for (int k = 0; k < 2000; ++k) {
    Vector6 by = Vector6::Zero();
    by[0] = 0.1 * (1.0 - std::cos(3.14159265358979 * k / 2000.0));
    const Vector6 stretch = (start + Displacement<6>{by} - r.state().x).vec(), v = r.state().v.vec();
    Vector6 f;
    f << 1000.0 * stretch.head<3>() - 60.0 * v.head<3>(), 10.0 * stretch.tail<3>() - 0.6 * v.tail<3>();
    push(r, f);
  }
  EXPECT_GT(r.arm()->state().q[0] - 0.1, 0.005);
  EXPECT_NEAR((r.state().x - start).vec()[0], 0.2, 0.02);
  EXPECT_NEAR(r.arm()->mechanical_energy() - before, r.arm()->joint_energy().si(), 1e-6);
}

// 38 kg at 0.5 m/s are 4.8 J, which the spring of a stop takes within 10 mm.
TEST(ArmPlant, ARailEndsAtItsStop) {
  const Scene scene = on_a_rail();
  const auto nothing = std::make_shared<const Environment<6>>(std::vector<EnvironmentSpec>{});
  ArmPlant arm{*scene.robot->arm, nothing, kPeriod, {}};
  ArmPlant::State state = arm.state();
  state.q[0] = 0.49, state.v[0] = 0.5;
  arm.set_state(state);
  double farthest = 0.0, slowest = 0.5;
  for (int k = 0; k < 200; ++k) {
    arm.advance({});
    farthest = std::max(farthest, arm.state().q[0]), slowest = std::min(slowest, arm.state().v[0]);
  }
  EXPECT_GT(farthest, 0.5005);
  EXPECT_LT(farthest, 0.51);
  EXPECT_LT(slowest, 0.0) << "it comes back";
}

TEST(ArmPlant, LeavesASingularPositionGracefully) {
  SimRobot<6> r = robot();
  // Pulled out until the elbow is straight, and pushed back.
  double fastest = 0.0, farthest = 0.0;
  const Position<6> start = r.state().x;
  for (int k = 0; k < 12000; ++k) {
    const Velocity<6> v = r.state().v;
    Vector6 f = -40.0 * v.vec();
    f.tail<3>() *= 0.05;
    f[0] += k < 6000 ? 30.0 : -30.0;
    push(r, f);
    ASSERT_TRUE(r.state().x.finite() && r.state().v.finite());
    fastest = std::max(fastest, r.arm()->state().v.cwiseAbs().maxCoeff());
    farthest = std::max(farthest, r.state().x.translation().x() - start.translation().x());
  }
  EXPECT_GT(farthest, 0.25) << "the elbow is nearly straight";
  EXPECT_LT(fastest, 20.0);
  EXPECT_LT(r.state().x.translation().x() - start.translation().x(), 0.8 * farthest) << "it comes back";
}

TEST(WristSensor, WeightAndBiasAreRemoved) {
  const std::string tool = "tool_mass_kg: 0.73 tool_center_m: [0, 0.01, 0.05]",
                    bias = "bias_n: [1.5, -2, 0.7, 0.05, -0.08, 0.02]";
  SimRobot<6> r = robot(tool, "force_sensor { " + bias + " }");
  double most = 0.0;
  for (int k = 0; k < 500; ++k) {
    push(r, Vector6::Zero());
    most = std::max(most, r.sense().f_environment.vec().norm());
  }
  EXPECT_LT(most, 1e-9);
  // Turned: the tool's inertia is felt, its weight is not.
  for (int k = 0; k < 2000; ++k) push(r, wrench(0, 0, 0, k < 1000 ? 1.0 : -1.0, 0, 0));
  for (int k = 0; k < 12000; ++k) {
    Vector6 brake = -20.0 * r.state().v.vec();
    brake.tail<3>() *= 0.1;
    push(r, brake);
  }
  EXPECT_GT((r.state().x.attitude()).angularDistance(Eigen::Quaterniond::Identity()), 0.1);
  EXPECT_LT(r.sense().f_environment.vec().head<3>().norm(), 0.05);
  EXPECT_LT(r.sense().f_environment.vec().tail<3>().norm(), 5e-3);
}

TEST(WristSensor, ShowsTheContactWrenchWithinItsNoise) {
  SimRobot<6> r = robot("tool_mass_kg: 0.5 tool_center_m: [0, 0, 0.05]",
                        "force_sensor { noise_n: 0.05 bias_n: [1.5, -2, 0.7, 0.05, -0.08, 0.02] }",
                        "environment { wall { normal: [0, 0, 1] offset_m: -0.002 stiffness_n_per_m: 5000 "
                        "damping_n_s_per_m: 100 } } tool { contact_point { position_m: [0.02, 0, 0] } }");
  for (int k = 0; k < 12000; ++k) {
    Vector6 f = -60.0 * r.state().v.vec();
    f.tail<3>() *= 0.1;
    f[2] -= 10.0;
    push(r, f);
  }
  int beyond = 0, readings = 0;
  for (int k = 0; k < 400; ++k) {
    push(r, wrench(0, 0, -10));
    const Vector6 error = r.sense().f_environment.vec() + r.environment_force().vec();
    // Six readings have told weight and bias: their error adds to that of a reading.
    for (int i = 0; i < 6; ++i) beyond += std::abs(error[i]) > 3.0 * 0.05 * std::sqrt(1.0 + 1.0), ++readings;
  }
  EXPECT_GT(r.environment_force().vec().head<3>().norm(), 5.0);
  EXPECT_LT(beyond, readings / 50);
}

TEST(ArmPlant, AllocatesNothing) {
  SimRobot<6> r =
      robot("tool_mass_kg: 0.5", "force_sensor { noise_n: 0.05 }",
            "environment { wall { normal: [0, 0, 1] offset_m: 0.001 stiffness_n_per_m: 5000 friction: 0.3 } }");
  NoAlloc guard;
  for (int k = 0; k < 100; ++k) push(r, wrench(1, 2, -3, 0.1, 0.2, 0.3));
  EXPECT_EQ(guard.seen(), 0);
}

}  // namespace
}  // namespace twoport::sim::arm_plant_test
