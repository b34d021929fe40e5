// Ports of joints: the metric, what a scene says of it, limits of single joints, what figures see of the tools, and both simulated arms.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "common/arm/arm_model.h"
#include "common/base/check.h"
#include "common/coupling/joint_metric.h"
#include "common/method/transparency/surface/joint_surface.h"
#include "common/record/tool_view.h"
#include "common/safety/peer_guard.h"
#include "common/safety/safety_stage.h"
#include "common/safety/turning_limits.h"
#include "common/scene/load.h"
#include "sim/sim_joints.h"

namespace twoport::joints_test {
namespace {

constexpr int N = kJointPort;
using Axes = Eigen::Matrix<double, N, 1>;

Scene scene_of(const std::vector<std::string>& overrides = {}) {
  return load_scene(TWOPORT_SCENES "/leader_follower.textproto", overrides);
}
Axes random_axes(std::mt19937& rng, int n = N) {
  std::uniform_real_distribution<double> uniform{-1.0, 1.0};
  Axes v = Axes::Zero();
  for (int i = 0; i < n; ++i) v[i] = uniform(rng);
  return v;
}

// Scaling is exact to rounding, and leaves the power.
TEST(JointMetric, KeepsThePowerAndGoesBack) {
  const ControlOptions control = scene_of().control;
  const JointMetric<N> metric{control};
  std::mt19937 rng{1};
  for (int run = 0; run < 100; ++run) {
    const Force<N> torque{random_axes(rng)};
    const Velocity<N> rate{random_axes(rng)};
    EXPECT_NEAR(dot(metric.scaled(torque), metric.scaled(rate)).si(), dot(torque, rate).si(), 1e-14);
    EXPECT_LT((metric.joints(Force<N>{metric.scaled(torque)}).vec() - torque.vec()).norm(), 1e-15);
    EXPECT_LT((metric.joints(Velocity<N>{metric.scaled(rate)}).vec() - rate.vec()).norm(), 1e-15);
  }
}

TEST(JointScene, ScalesEachJointByTheFollowersInertia) {
  const Scene scene = scene_of();
  EXPECT_EQ(scene.dof, N);
  EXPECT_EQ(scene.joints, 7);
  EXPECT_EQ(scene.coordinates(), 7);
  const ArmModel model{*scene.robot->arm->parameters};
  const ArmModel::Inertia M = model.inertia(model.pose(joint_vector(scene.robot->arm->joint_position_rad)));
  for (int i = 0; i < 7; ++i) EXPECT_NEAR(std::pow(scene.control.joint_scale[i], 2), M(i, i), 1e-12);
  EXPECT_EQ(scene.control.joint_scale[7], 1.0);
}

TEST(JointScene, TakesGainsOfSingleJoints) {
  const Scene scene = scene_of({"control.virtual_coupling.joint_stiffness=[100,90,80,70,60,50,40]",
                                "control.virtual_coupling.joint_damping=[7,6,5,4,3,2,1]"});
  const double stiffness[] = {100, 90, 80, 70, 60, 50, 40}, damping[] = {7, 6, 5, 4, 3, 2, 1};
  for (int i = 0; i < 7; ++i) {
    const double s2 = std::pow(scene.control.joint_scale[i], 2);
    EXPECT_NEAR(s2 * scene.control.coupling.stiffness_n_per_m, stiffness[i], 1e-9);
    EXPECT_NEAR(s2 * scene.control.coupling.damping_of_joints[i], damping[i], 1e-9);
  }
}

// Each names the field, its value or what is there, and what is allowed.
TEST(JointScene, RefusesInWordsWhatJointsHaveNot) {
  const std::vector<std::pair<std::vector<std::string>, std::vector<std::string>>> cases{
      {{"dof=6"}, {"dof is 6", "absent or 7"}},
      {{"control.architecture=RENDER"}, {"control.architecture is RENDER", "link"}},
      {{"control.device_limits={force_n: 5}"}, {"control.device_limits.force_n is 5", "absent", "joint_..."}},
      {{"control.robot_limits={joint_torque_n_m: [5, 5]}"}, {"control.robot_limits.joint_torque_n_m", "7 numbers"}},
      {{"control.robot_limits={joint_torque_n_m: [5, 5, 5, -5, 5, 5, 5]}"},
       {"control.robot_limits.joint_torque_n_m", "> 0"}},
      {{"control.device_limits={joint_torque_n_m: [5, 5, 5, 5, 5, 5, 50]}"},
       {"control.device_limits.joint_torque_n_m", "arm's file", "number 7 must be at most 12"}},
      {{"control.device_limits={joint_speed_rad_per_s: [3, 1, 1, 1, 1, 1, 1]}"},
       {"control.device_limits.joint_speed_rad_per_s", "number 1 must be at most 2.175"}},
      {{"control.device_limits={joint_lower_rad: [-3, -1, -1, -3, -1, 0, -1]}"},
       {"control.device_limits.joint_lower_rad", "number 1 must be at least -2.8973"}},
      {{"control.robot_limits={joint_upper_rad: [1, -1, 1, -1, 1, 3, 1]}"},
       {"control.robot_limits allow joint 2", "-0.5, where it begins"}},
      {{"object={mass_kg: 1 position_m: [0, 0, 0] half_size_m: [1, 1, 1] stiffness_n_per_m: 1}"},
       {"object is given", "two fingers", "mirrored"}},
      {{"operator.finger={stiffness_n_per_m: 1}"}, {"operator.finger is given", "must slide"}},
      {{"control.robot_limits={speed_m_per_s: 5}"}, {"control.robot_limits.speed_m_per_s is 5", "absent"}},
      {{"device.max_force_n=5"}, {"device.max_force_n is 5", "absent"}},
      {{"robot.arm.file=../arms/ur5e.textproto", "robot.arm.joint_position_rad=[0,-1.5,1.5,-1.5,-1.5,0]"},
       {"device.arm has 7 joints", "robot.arm 6", "same number"}},
      {{"control.virtual_coupling.joint_stiffness=[1,2]"}, {"control.virtual_coupling.joint_stiffness", "7 numbers"}},
      {{"control.virtual_coupling.joint_damping=[1,2,3,4,5,6,-7]"}, {"joint_damping", "> 0"}},
      {{"robot.arm.force_feedback={gain: 1}"}, {"robot.arm.force_feedback", "absent"}},
      {{"robot.arm.null_space_stiffness_n_m_per_rad=1"}, {"robot.arm.null_space_stiffness_n_m_per_rad is 1", "absent"}},
      {{"device_mount={scale: 2}"}, {"device_mount", "absent"}},
      {{"robot_mount={tool_mass_kg: 1}"}, {"robot_mount", "absent", "the torques of contacts alone"}},
      {{"control.transparency.layer=PLUGIN", "control.transparency.plugin.file=x.so"},
       {"control.transparency.layer is PLUGIN", "another one where space is JOINTS"}},
      {{"space=CARTESIAN"}, {"dof", "1, 3 or 6"}},
  };
  for (const auto& [overrides, words] : cases) {
    try {
      scene_of(overrides);
      ADD_FAILURE() << overrides[0] << " is read";
    } catch (const ConfigError& e) {
      for (const std::string& each : words)
        EXPECT_NE(std::string{e.what()}.find(each), std::string::npos) << overrides[0] << ": " << e.what();
    }
  }
}

// Those of the scene take the place of the file's, at the side that names them.
TEST(JointScene, TakesLimitsOfSingleJoints) {
  const Scene scene =
      scene_of({"control.robot_limits={joint_torque_n_m: [1, 2, 3, 4, 5, 6, 7]}",
                "control.device_limits={joint_speed_rad_per_s: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7] "
                "joint_lower_rad: [-1, -1, -1, -3, -1, 1, 0] joint_upper_rad: [1, 1, 1, -1, 1, 3, 1]}"});
  const JointLimits robot = scene.control.robot_limits.joints, device = scene.control.device_limits.joints;
  for (int i = 0; i < 7; ++i) {
    EXPECT_EQ(robot.effort[i], i + 1.0);
    EXPECT_NEAR(device.speed[i], 0.1 * (i + 1), 1e-12);
  }
  EXPECT_EQ(robot.speed[0], 2.175);
  EXPECT_EQ(device.effort[6], 12.0);
  EXPECT_EQ(device.lower[3], -3.0);
  EXPECT_EQ(device.upper[5], 3.0);
  EXPECT_EQ(robot.lower[0], -2.8973);
}

// Limits of a joint: those of the arm's file, each by itself; a torque keeps its direction.
TEST(JointLimits, BoundTorqueSpeedAndRange) {
  const Scene scene = scene_of();
  const PortLimits limits = limits_at_robot(scene.control);
  const Axes& s = scene.control.joint_scale;
  SafetyStage<N> stage{limits, 1.0};
  const Position<N> ready{s.cwiseProduct((Axes{} << 0, -0.5, 0, -2.2, 0, 1.8, 0.785, 0).finished())};
  Axes torque = Axes::Zero();
  torque[0] = 10.0, torque[6] = 24.0;  // the last joint stands 12 N m
  const Force<N> out = stage(Force<N>{torque.cwiseQuotient(s)}, ready, Velocity<N>{}, Seconds{1e-3});
  EXPECT_NEAR(out[6] * s[6], 12.0, 1e-9);
  EXPECT_NEAR(out[0] * s[0], 5.0, 1e-9);
  EXPECT_EQ(stage.counts()[Limit::force], 1u);

  Axes rate = Axes::Zero();
  rate[2] = 3.0;  // its speed is 2.175 rad/s
  torque.setZero();
  torque[2] = 1.0, torque[1] = 1.0;
  const Force<N> slow =
      stage(Force<N>{torque.cwiseQuotient(s)}, ready, Velocity<N>{rate.cwiseProduct(s)}, Seconds{1e-3});
  EXPECT_EQ(slow[2], 0.0);
  EXPECT_NEAR(slow[1] * s[1], 1.0, 1e-12);
  EXPECT_EQ(stage.counts()[Limit::speed], 1u);

  Axes beyond = ready.translation();
  beyond[3] = -0.01 * s[3];  // its range ends at -0.0698 rad
  torque.setZero();
  torque[3] = 1.0;
  EXPECT_EQ(stage(Force<N>{torque.cwiseQuotient(s)}, Position<N>{beyond}, Velocity<N>{}, Seconds{1e-3})[3], 0.0);
  torque[3] = -1.0;
  EXPECT_NE(stage(Force<N>{torque.cwiseQuotient(s)}, Position<N>{beyond}, Velocity<N>{}, Seconds{1e-3})[3], 0.0);

  const Position<N> to{ready.translation() + Axes::Constant(1.0)};
  const Position<N> step = stage.set_point(to, ready, Seconds{1e-3}, nullptr);
  const Axes moved = (step.translation() - ready.translation()).cwiseQuotient(s);
  for (int i = 0; i < 4; ++i) EXPECT_LE(std::abs(moved[i]), 2.175e-3 * (1 + 1e-9)) << i;
}

// Where a limit of a joint takes a part of a force, a layer must expect another direction than its own.
TEST(JointLimits, TellWhereAForceMayBeTurned) {
  const Scene scene = scene_of();
  const PortLimits limits = limits_at_device(scene.control);
  const Axes& s = scene.control.joint_scale;
  const Axes ready = s.cwiseProduct((Axes{} << 0, -0.5, 0, -2.2, 0, 1.8, 0.785, 0).finished());
  Axes beyond = ready, rate = Axes::Zero();
  EXPECT_FALSE(may_turn(limits, Position<N>{ready}, Velocity<N>{rate}));
  beyond[3] = -0.01 * s[3];  // its range ends at -0.0698 rad
  EXPECT_TRUE(may_turn(limits, Position<N>{beyond}, Velocity<N>{rate}));
  rate[2] = 3.0 * s[2];  // its speed is 2.175 rad/s
  EXPECT_TRUE(may_turn(limits, Position<N>{ready}, Velocity<N>{rate}));
}

TEST(JointLimits, BoundWhatTheOtherSideClaims) {
  const Scene scene = scene_of();
  PeerGuard<N> guard{limits_of_slave_reports(scene.control)};
  Report<N> report;
  report.sequence = 1;
  report.v = Velocity<N>{Axes::Constant(100.0)};
  report.x = Position<N>{Axes::Constant(50.0)};
  report.f_coupling = Force<N>{Axes::Constant(1e3)};
  guard.pass(report, Duration{0}, [](const Report<N>& r) {
    EXPECT_NEAR(r.v[0], 2.175, 1e-12);
    EXPECT_NEAR(r.v[6], 2.61, 1e-12);
    EXPECT_NEAR(r.x.translation()[0], 2.8973 + 3.0, 1e-9);
    EXPECT_NEAR(r.f_coupling[0], 87.0, 1e-9);
    EXPECT_NEAR(r.f_coupling[6], 12.0, 1e-9);
  });
  EXPECT_EQ(guard.counts()[Limit::peer_motion], 1u);
  EXPECT_EQ(guard.counts()[Limit::peer_force], 1u);
}

// Torques Jᵀ f are the force f, and joint rates the tool's velocity.
TEST(ToolView, SeesForcesAndMotionOfTheTools) {
  const Scene scene = scene_of();
  const ToolView<N> view{scene};
  const ArmModel model{*scene.robot->arm->parameters};
  std::mt19937 rng{2};
  for (int run = 0; run < 50; ++run) {
    Axes q = Axes::Zero();
    q.head<7>() = joint_vector(scene.robot->arm->joint_position_rad) + 0.3 * random_axes(rng, 7).head<7>();
    const auto pose = model.pose(q.head(7));
    const auto J = model.jacobian(pose);
    const Eigen::Vector3d f = random_axes(rng).head<3>();
    Row<N> row;
    row.slave_x = row.master_x = Position<N>{q};
    Axes torque = Axes::Zero();
    torque.head(7) = J.topRows<3>().transpose() * f;
    row.env_f = row.master_f = Force<N>{torque};
    const Axes rate = random_axes(rng, 7);
    row.slave_v = Velocity<N>{rate};
    const Row<3> seen = view(row);
    EXPECT_LT((seen.env_f.vec() - f).norm(), 1e-6);
    EXPECT_LT((seen.master_f.vec() - f).norm(), 1e-6);
    EXPECT_LT((seen.slave_v.vec() - J.topRows<3>() * rate.head(7)).norm(), 1e-12);
    EXPECT_LT((seen.slave_x.translation() - pose.tool).norm(), 1e-12);
  }
}

// A tool that is drawn over a table, there and back, while the elbow swings: the normal and the friction are the table's.
TEST(JointSurface, IsThatOfTheToolWhateverTheJointsDo) {
  const Scene scene = scene_of();
  const ControlOptions& control = scene.control;
  const JointTool tool{control.follower, control.joint_scale};
  JointSurface surface{control};
  const Eigen::Vector3d into = -Eigen::Vector3d::UnitZ();
  const double dt = 1e-3, friction = 0.3;
  Axes q = Axes::Zero();
  q.head<7>() = joint_vector(scene.robot->arm->joint_position_rad);
  const double height = tool.at(Position<N>{q}).tool.z();
  double worst = 0.0;
  for (int k = 0; k < 4000; ++k) {
    const JointTool::At at = tool.at(Position<N>{q});
    Eigen::Vector3d v{0.0, 0.1 * std::sin(2e-3 * k), 0.0};
    v.z() = 10.0 * (height - at.tool.z());
    const Axes swing = 0.3 * std::cos(3e-3 * k) * Axes::Unit(4) + 0.2 * std::sin(5e-3 * k) * Axes::Unit(2);
    const Eigen::Matrix<double, 3, N> J = at.J.topRows<3>();
    const Eigen::Matrix<double, N, 3> back = J.transpose() * (J * J.transpose()).inverse();
    const Axes rate = back * v + swing - back * (J * swing);
    const Eigen::Vector3d force =
        10.0 * (into + friction * v.y() / std::max(std::abs(v.y()), 1e-3) * Eigen::Vector3d::UnitY());
    const Axes& s = control.joint_scale;
    const Axes f = (J.transpose() * force).cwiseQuotient(s);
    const Axes x = q.cwiseProduct(s);
    surface.step(Position<N>{x}, x, rate.cwiseProduct(s), f, Seconds{dt});
    const Axes normal = (J.transpose() * into).cwiseQuotient(s).normalized();
    if (k > 500) worst = std::max(worst, (surface.patch().normal - normal).norm());
    q += rate * dt;
  }
  ASSERT_TRUE(surface.contact());
  EXPECT_LT(worst, 0.02);
  EXPECT_NEAR(surface.patch().friction, friction, 0.02);
}

/// The elbow of a Panda, pressed against a wall: torques of a force on the fourth link, on which the joints beyond it do not act.
struct PressedElbow {
  explicit PressedElbow(const Scene& scene)
      : whole{*scene.robot->arm->parameters}, arm{whole}, start{joint_vector(scene.robot->arm->joint_position_rad)} {
    whole.joints.resize(4);
    whole.flange_m = {-0.08, 0.05, 0.0};
    arm = ArmModel{whole};
  }
  ArmParameters whole;
  ArmModel arm;
  ArmModel::Joints start;
};

// A wall at the elbow is not one at the tool: it is estimated in the axes of the joints, and no joint beyond the elbow takes part.
TEST(JointSurface, IsThatOfTheElbowWhereTheElbowTouches) {
  const Scene scene = scene_of();
  const Axes& s = scene.control.joint_scale;
  const PressedElbow elbow{scene};
  JointSurface surface{scene.control};
  const Eigen::Vector3d into = Eigen::Vector3d{1.0, 0.0, -0.5}.normalized();
  const double stiffness = 5000.0, dt = 1e-3;
  const auto wall = elbow.arm.pose(elbow.start.head(4)).tool;
  for (int k = 0; k < 1000; ++k) {
    Axes q = Axes::Zero(), rate = Axes::Zero();
    q.head<7>() = elbow.start;
    q[1] += 0.01 + 2e-3 * std::sin(0.05 * k), rate[1] = 2e-3 * 50.0 * std::cos(0.05 * k);
    q[5] += 0.1 * std::sin(0.02 * k), rate[5] = 0.1 * 20.0 * std::cos(0.02 * k);
    const auto pose = elbow.arm.pose(q.head(4));
    const Eigen::Vector3d force = std::max(0.0, stiffness * into.dot(pose.tool - wall)) * into;
    Axes torque = Axes::Zero();
    torque.head<4>() = elbow.arm.jacobian(pose).topRows<3>().transpose() * force;
    surface.step(Position<N>{q.cwiseProduct(s)}, q.cwiseProduct(s), rate.cwiseProduct(s), torque.cwiseQuotient(s),
                 Seconds{dt});
  }
  ASSERT_TRUE(surface.contact());
  Axes m = Axes::Zero();
  m.head<4>() = elbow.arm.jacobian(elbow.arm.pose(elbow.start.head(4))).topRows<3>().transpose() * into;
  m = m.cwiseQuotient(s).eval();
  EXPECT_LT((surface.patch().normal - m.normalized()).norm(), 0.03);
  EXPECT_NEAR(surface.patch().stiffness, stiffness * m.squaredNorm(), 0.1 * stiffness * m.squaredNorm());
}

// Where the tool is touched up to 0.1 m from its origin, under friction too, next to no contact is taken for one before the tool; at a link
// before the wrist most are.
TEST(JointTool, TellsALinkBeforeTheToolByItsTorques) {
  const Scene scene = scene_of();
  const Axes& s = scene.control.joint_scale;
  const JointTool tool{scene.control.follower, s};
  const PressedElbow elbow{scene};
  std::mt19937 rng{4};
  int at_tool = 0, at_elbow = 0;
  for (int run = 0; run < 2000; ++run) {
    Axes q = Axes::Zero();
    q.head<7>() = elbow.start + 0.3 * random_axes(rng, 7).head<7>();
    const JointTool::At at = tool.at(Position<N>{q});
    const Eigen::Vector3d force = random_axes(rng).head<3>(), lever = 0.1 * random_axes(rng).head<3>();
    const auto noise = [&](const Axes& torque) -> Axes {
      return torque + 0.01 * torque.norm() * random_axes(rng, 7).cwiseProduct(s) / s.norm();
    };
    const Axes of_tool = at.J.topRows<3>().transpose() * force + at.J.bottomRows<3>().transpose() * lever.cross(force);
    at_tool += tool.is_before_tool(at, Force<N>{noise(of_tool)});
    Axes of_elbow = Axes::Zero();
    of_elbow.head<4>() = elbow.arm.jacobian(elbow.arm.pose(q.head(4))).topRows<3>().transpose() * force;
    at_elbow += tool.is_before_tool(at, Force<N>{noise(of_elbow)});
    EXPECT_FALSE(tool.is_before_tool(at, Force<N>{Axes{at.J.topRows<3>().transpose() * force}}));
  }
  EXPECT_LT(at_tool, 20);
  EXPECT_GT(at_elbow, 1800);
}

// Without friction, hand and contact the work of held torques is what the arm has gained; Runge-Kutta 4 in a millisecond: 1e-7 of it.
TEST(SimJoints, ConserveTheEnergyOfTheirPort) {
  const Scene scene = scene_of({"robot.arm.joint_damping_n_m_s_per_rad=0"});
  sim::SimRobot<N> robot{scene, Seconds{1e-3}};
  const double before = robot.arm()->mechanical_energy();
  double work = 0.0, weight = 0.0;
  std::mt19937 rng{3};
  for (int k = 0; k < 200; ++k) {
    RobotCommand<N> command;
    command.f = Force<N>{(k < 100 ? 2.0 : -2.0) * random_axes(rng, 7)};
    robot.actuate(command);
    const Axes q = robot.state().x.translation();
    robot.advance();
    const Axes moved = robot.state().x.translation() - q;
    work += command.f.vec().dot(moved);
    weight += robot.arm()->torque().dot(moved.head(7)) - command.f.vec().dot(moved);
    ASSERT_EQ(robot.environment_force().squared_norm(), 0.0);
  }
  EXPECT_NEAR(robot.arm()->port_energy().si(), work, 1e-12);
  EXPECT_GT(std::abs(work), 1e-3);
  EXPECT_NEAR(robot.arm()->mechanical_energy() - before, work + weight, 1e-6);
}

// What the table does to the joints is Jᵀ of the force on the tool.
TEST(SimJoints, SenseTheTorquesOfTheEnvironment) {
  const Scene scene = scene_of({"environment[0].wall.offset_m=0.01"});  // it begins 10 mm inside
  const sim::SimRobot<N> robot{scene, Seconds{1e-3}};
  const ToolView<N> view{scene};
  Row<N> row;
  row.slave_x = row.master_x = robot.state().x;
  row.env_f = robot.environment_force();
  const Row<3> seen = view(row);
  EXPECT_NEAR(seen.env_f[2], 50.0, 1e-4);
  EXPECT_NEAR(seen.env_f[0], 0.0, 1e-4);
  EXPECT_EQ(robot.sense().f_environment.vec(), -robot.environment_force().vec());
}

// A command that leaves no room beside the weight is applied in part, in its direction; the account of what was applied is the plant's.
TEST(JointArm, SaysWhatItAppliesBesideItsWeight) {
  const Scene scene = scene_of({"device.arm.tool_mass_kg=2"});
  sim::SimDevice<N> device{scene, Seconds{1e-3}};
  const Force<N> most{Axes::Constant(60.0).cwiseProduct((Axes{} << 1, 1, 1, 1, .1, .1, .1, 0).finished())};
  double booked_j = 0.0;
  int part = 0;
  for (int k = 0; k < 500; ++k) {
    const Force<N> f = (k / 50 % 2 == 0 ? 1.0 : -1.0) * (k % 100 < 25 ? 0.1 : 1.0) * most;
    device.actuate(f);
    const Axes before = device.x().translation();
    device.advance();
    const Force<N> applied = device.sense().applied;
    booked_j += applied.vec().dot(device.x().translation() - before);
    EXPECT_NEAR(device.port_energy().si(), booked_j, 1e-12 * (1.0 + std::abs(booked_j)));
    const double share = applied.vec().dot(f.vec()) / f.vec().squaredNorm();
    EXPECT_LT((applied.vec() - share * f.vec()).norm(), 1e-9) << "in its direction";
    if (share < 1.0 - 1e-12) ++part;
    const auto& torque = device.arm()->torque();
    for (int i = 0; i < torque.size(); ++i)
      EXPECT_LE(std::abs(torque[i]),
                scene.device->arm->parameters->joints[static_cast<std::size_t>(i)].max_effort + 1e-9);
  }
  EXPECT_GT(part, 50);
  EXPECT_LT(part, 450);
}

}  // namespace
}  // namespace twoport::joints_test
