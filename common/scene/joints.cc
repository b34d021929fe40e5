#include "common/scene/joints.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "common/arm/arm_model.h"
#include "common/coupling/layers.h"

namespace twoport {
namespace {

using Inertia = ArmModel::Inertia;
using Axes = Eigen::Matrix<double, kJointPort, 1>;

/// With its tool.
ArmModel model_of(const ArmSpec& arm) {
  return ArmModel{*arm.parameters, {.mass_kg = arm.tool_mass_kg, .center_m = vector<3>(arm.tool_center_m)}};
}
/// M(q) where the run begins.
Inertia inertia_at_start(const ArmSpec& arm) {
  const ArmModel model = model_of(arm);
  return model.inertia(model.pose(joint_vector(arm.joint_position_rad)));
}

/// The least inertia of any motion in the metric s [kg]: the least eigenvalue of S⁻¹ M S⁻¹.
double least_mass_kg(const Inertia& M, const Axes& s) {
  const auto n = M.rows();
  const Axes inverse = s.cwiseInverse();
  const Eigen::MatrixXd scaled = inverse.head(n).asDiagonal() * M * inverse.head(n).asDiagonal();
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>{scaled, Eigen::EigenvaluesOnly}.eigenvalues()[0];
}

double least_damping_n_s_per_m(const ArmSpec& arm, const Axes& s) {
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < arm.parameters->joints.size(); ++i) {
    const double of_axis = s[static_cast<int>(i)];
    least = std::min(least, arm.parameters->joints[i].damping.value_or(0.0) / (of_axis * of_axis));
  }
  return least;
}

/// What the joints of an arm stand, and within that what the scene allows.
JointLimits limits_of(const ArmSpec& arm, const Block<schema::Limits>& of) {
  JointLimits all;
  for (std::size_t i = 0; i < arm.parameters->joints.size(); ++i) {
    const ArmJoint& joint = arm.parameters->joints[i];
    const auto axis = static_cast<Eigen::Index>(i);
    all.effort[axis] = joint.max_effort;
    all.speed[axis] = joint.max_speed;
    all.lower[axis] = joint.lower;
    all.upper[axis] = joint.upper;
  }
  const auto n = static_cast<int>(arm.parameters->joints.size());
  // `within`: does a number go no further than the file's?
  const auto take = [&](const auto& field, JointLimits::Axes& limit, auto within, const char* words) {
    of.need_length(field, n);
    const Numbers given = numbers(field.value(of.message()));
    for (std::size_t i = 0; i < given.size(); ++i) {
      double& of_file = limit[static_cast<Eigen::Index>(i)];
      if (!within(given[i], of_file))
        of.refuse(field, fmt::format("be within the arm's file: number {} must be {} {:g}", i + 1, words, of_file));
      of_file = given[i];
    }
  };
  take(FIELD(joint_torque_n_m), all.effort, std::less_equal<>{}, "at most");
  take(FIELD(joint_speed_rad_per_s), all.speed, std::less_equal<>{}, "at most");
  take(FIELD(joint_lower_rad), all.lower, std::greater_equal<>{}, "at least");
  take(FIELD(joint_upper_rad), all.upper, std::less_equal<>{}, "at most");
  for (int i = 0; i < n; ++i)
    if (const double q = arm.joint_position_rad[static_cast<std::size_t>(i)]; !(all.lower[i] < q && q < all.upper[i]))
      of.fail(fmt::format("{} allow joint {} from {:g} to {:g}; they must hold {:g}, where it begins", of.path(), i + 1,
                          all.lower[i], all.upper[i], q));
  return all;
}

FingerSpec read_finger(const Block<schema::Finger>& of) {
  FingerSpec finger{of->stiffness_n_per_m(), of->damping_n_s_per_m(), {}};
  double now_s = 0.0;
  for (const auto& move : of.blocks(FIELD(move))) {
    const double wait_s = move->start_s() - now_s;
    if (!(wait_s >= 0.0)) move.refuse(FIELD(start_s), fmt::format("be >= {:g}, the end of the move before", now_s));
    if (wait_s > 0.0) finger.path.emplace_back(HoldSpec{wait_s});
    finger.path.emplace_back(MoveToSpec{{move->opening_m()}, move->duration_s()});
    now_s = move->start_s() + move->duration_s();
  }
  return finger;
}

ObjectSpec read_object(const Block<schema::Object>& of) {
  const Eigen::Vector3d position = vector<3>(of->position_m());
  return {.mass_kg = of->mass_kg(),
          .position_m = position,
          .half_size_m = vector<3>(of->half_size_m()),
          .target_m = of->target_m().empty() ? position : Eigen::Vector3d{vector<3>(of->target_m())},
          .material = {.stiffness_n_per_m = of->stiffness_n_per_m(),
                       .damping_n_s_per_m = of->damping_n_s_per_m(),
                       .friction = of->friction(),
                       .viscous_friction_n_s_per_m = 0.0}};
}

/// A number for each joint, each > 0; empty: none are given.
Numbers for_each_joint(const Block<schema::VirtualCoupling>& of, const auto& field, int joints) {
  of.need_length(field, joints);
  return numbers(field.value(of.message()));
}

}  // namespace

void read_joints(const Block<schema::Scene>& of, Scene& scene) {
  const Block coupling = of.block(FIELD(control)).block(FIELD(virtual_coupling));
  const auto refuse = [&](const auto& block, const auto& field, const char* why) {
    if (block.has(field)) block.refuse(field, fmt::format("be absent: {}", why));
  };
  if (scene.dof != kJointPort) {
    refuse(coupling, FIELD(joint_stiffness), "it needs space JOINTS");
    refuse(coupling, FIELD(joint_damping), "it needs space JOINTS");
    const Block control = of.block(FIELD(control));
    for (const auto& limits : {control.block(FIELD(device_limits)), control.block(FIELD(robot_limits))}) {
      refuse(limits, FIELD(joint_torque_n_m), "it needs space JOINTS");
      refuse(limits, FIELD(joint_speed_rad_per_s), "it needs space JOINTS");
      refuse(limits, FIELD(joint_lower_rad), "it needs space JOINTS");
      refuse(limits, FIELD(joint_upper_rad), "it needs space JOINTS");
    }
    if (of->has_object()) of.fail("object is given, but space is CARTESIAN; it must be JOINTS");
    if (of->operator_().has_finger()) of.fail("operator.finger is given, but space is CARTESIAN; it must be JOINTS");
    return;
  }
  constexpr const char* kOfArm = "with space JOINTS each joint has limits of its own, the arm's file's or joint_...";
  const Block control = of.block(FIELD(control));
  for (const auto& limits : {control.block(FIELD(device_limits)), control.block(FIELD(robot_limits))}) {
    refuse(limits, FIELD(force_n), kOfArm);
    refuse(limits, FIELD(torque_n_m), kOfArm);
    refuse(limits, FIELD(force_rate_n_per_s), kOfArm);
    refuse(limits, FIELD(speed_m_per_s), kOfArm);
    refuse(limits, FIELD(angular_speed_rad_per_s), kOfArm);
    refuse(limits, FIELD(set_point_step_m), kOfArm);
    refuse(limits, FIELD(workspace_m), kOfArm);
  }
  refuse(of.block(FIELD(device)), FIELD(max_force_n), kOfArm);
  refuse(of, FIELD(gripper), "with space JOINTS it is the last joint of the arms");
  refuse(of, FIELD(device_mount), "space JOINTS couples joints, wherever the arms stand");
  refuse(of, FIELD(robot_mount), "with space JOINTS the driver senses the torques of contacts alone");
  refuse(control, FIELD(registration), "space JOINTS couples joints, wherever the arms stand");
  if (scene.control.architecture == Architecture::render || scene.control.architecture == Architecture::uncontrolled)
    control.refuse(FIELD(architecture), "be one with a link where space is JOINTS");
  const auto need_arm = [&](const auto& part, bool has) {
    if (!has)
      of.fail(
          fmt::format("{}.arm is missing; it must be given where space is JOINTS: its joints are the port", part.name));
  };
  need_arm(FIELD(device), scene.device && scene.device->arm);
  need_arm(FIELD(robot), scene.robot && scene.robot->arm);
  const ArmSpec &leader = *scene.device->arm, &follower = *scene.robot->arm;
  scene.joints = static_cast<int>(leader.parameters->joints.size());
  const auto n = static_cast<std::size_t>(scene.joints);
  if (follower.parameters->joints.size() != n)
    of.fail(
        fmt::format("device.arm has {} joints and robot.arm {}; they must have the same number where space is "
                    "JOINTS; arms that differ are coupled at their tools, without it",
                    n, follower.parameters->joints.size()));
  if (of->has_dof() && of->dof() != scene.joints)
    of.refuse(FIELD(dof), fmt::format("be absent or {}, the number of the arms' joints, where space is JOINTS", n));

  if (of->has_object()) {
    if (!follower.parameters->joints.back().mirrored)
      of.fail(
          "object is given, but the last joint of robot.arm is no two fingers; it must be mirrored in the arm's file");
    scene.object = read_object(of.block(FIELD(object)));
  }
  const Block hand = of.block(FIELD(operator_));
  if (hand->has_finger()) {
    if (!hand->has_hand()) of.fail("operator.finger is given without operator.hand; both must be");
    if (leader.parameters->joints.back().type != JointType::prismatic)
      of.fail("operator.finger is given, but the last joint of device.arm turns; it must slide");
    scene.finger = read_finger(hand.block(FIELD(finger)));
  }

  const JointLimits of_device = limits_of(leader, control.block(FIELD(device_limits))),
                    of_robot = limits_of(follower, control.block(FIELD(robot_limits)));
  const Numbers stiffness = for_each_joint(coupling, FIELD(joint_stiffness), scene.joints),
                damping = for_each_joint(coupling, FIELD(joint_damping), scene.joints);
  const Inertia of_leader = inertia_at_start(leader), of_follower = inertia_at_start(follower);
  Axes s = Axes::Ones();
  for (int i = 0; i < scene.joints; ++i) {
    const auto at = static_cast<std::size_t>(i);
    s[i] = std::sqrt(stiffness.empty() ? of_follower(i, i) : stiffness[at] / coupling->stiffness_n_per_m());
  }
  const auto leads = std::make_shared<const ArmModel>(model_of(leader)),
             follows = std::make_shared<const ArmModel>(model_of(follower));
  const auto tell = [&](ControlOptions& c) {
    if (transparency_layer(c).is_external)
      of.fail(
          fmt::format("control.transparency.layer is {}, which knows handle and tool only; it must be another one "
                      "where space is JOINTS",
                      c.transparency));
    c.joint_scale = s;
    c.leader = leads;
    c.follower = follows;
    if (!damping.empty()) {
      for (int i = 0; i < scene.joints; ++i)
        c.coupling.damping_of_joints[i] = damping[static_cast<std::size_t>(i)] / (s[i] * s[i]);
      c.coupling.damping_n_s_per_m = c.coupling.damping_of_joints.head(scene.joints).minCoeff();
    }
    // A joint has its arm's limits; power is what it is in any metric.
    c.device_limits = {.power_w = c.device_limits.power_w, .joints = of_device};
    c.robot_limits = {.power_w = c.robot_limits.power_w, .joints = of_robot};
    c.handle_mass_kg = least_mass_kg(of_leader, s);
    c.known.robot_mass_kg = least_mass_kg(of_follower, s);
    c.known.device_damping_n_s_per_m = least_damping_n_s_per_m(leader, s);
  };
  tell(scene.control);
  for (ScheduledControl& each : scene.schedule) tell(each.control);
}

}  // namespace twoport
