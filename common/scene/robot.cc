#include <algorithm>
#include <filesystem>
#include <memory>

#include "common/arm/arm_model.h"
#include "common/scene/arm.h"
#include "common/scene/blocks.h"

namespace twoport {
namespace {

/// Three principal moments; one number stands for all three.
Numbers read_inertia(const Block<schema::Robot>& of) {
  of.only_with_rotation(FIELD(inertia_kg_m2));
  if (of.dof() != 6 || of.has(FIELD(arm))) return {};
  const Count count{1, 3, "for the principal moments"};
  of.require(FIELD(inertia_kg_m2), count.words());
  Numbers moments = of.list(FIELD(inertia_kg_m2), count);
  moments.resize(3, moments[0]);
  const auto [least, most] = std::minmax_element(moments.begin(), moments.end());
  if (!(*least > 0.0)) of.refuse(FIELD(inertia_kg_m2), "hold numbers > 0");
  const double others = moments[0] + moments[1] + moments[2] - *most;
  if (*most > others * (1.0 + 1e-12))
    of.refuse(FIELD(inertia_kg_m2),
              "keep the triangle inequality: no principal moment exceeds the sum of the other two");
  return moments;
}

ForceSensorSpec read_force_sensor(const Block<schema::ForceSensor>& of) {
  return {.noise_n = of.number(FIELD(noise_n), kNotNegative),
          .bias_n = of.list(FIELD(bias_n), of.context().twist()),
          .latency_s = of.number(FIELD(latency_ms), kDelay) * 1e-3};
}

/// The arm, and mass and inertia of the tool at its first pose.
void read_arm(const Block<schema::Robot>& robot, RobotSpec& spec) {
  const auto refuse = [&](const auto& field) {
    if (robot.has(field))
      robot.fail(fmt::format("{} is given, but so is {}: the arm has masses and damping of its own",
                             robot.path_of(field.name), robot.path_of("arm")));
  };
  refuse(FIELD(mass_kg));
  refuse(FIELD(inertia_kg_m2));
  refuse(FIELD(damping_n_s_per_m));
  refuse(FIELD(rotational_damping_n_m_s_per_rad));
  refuse(FIELD(velocity_m_per_s));
  const auto of = robot.block(FIELD(arm));
  of.require(FIELD(file), "be the path of a file");
  std::filesystem::path path = of.text(FIELD(file));
  if (path.is_relative()) path = std::filesystem::path{of.context().file}.parent_path() / path;
  const auto parameters = std::make_shared<const ArmParameters>(load_arm(path.string()));
  ArmSpec arm{.parameters = parameters,
              .joint_position_rad = of.list(FIELD(joint_position_rad), {kArmJoints, kArmJoints, ""}),
              .null_space_stiffness_n_m_per_rad = of.number(FIELD(null_space_stiffness_n_m_per_rad), kNotNegative),
              .null_space_damping_n_m_s_per_rad = of.number(FIELD(null_space_damping_n_m_s_per_rad), kNotNegative),
              .joint_damping_n_m_s_per_rad = of.number(FIELD(joint_damping_n_m_s_per_rad), kNotNegative),
              .tool_mass_kg = of.number(FIELD(tool_mass_kg), kNotNegative),
              .tool_center_m = of.list(FIELD(tool_center_m), {3, 3, ""})};
  if (arm.joint_position_rad.empty()) arm.joint_position_rad = parameters->ready_position_rad;
  for (std::size_t i = 0; i < arm.joint_position_rad.size(); ++i) {
    const ArmJoint& joint = parameters->joints[i];
    if (!(arm.joint_position_rad[i] > joint.lower_rad && arm.joint_position_rad[i] < joint.upper_rad))
      of.refuse(FIELD(joint_position_rad),
                fmt::format("lie within the joints' limits; number {} must be between {} and {}", i + 1,
                            joint.lower_rad, joint.upper_rad));
  }
  // The simulated joints cannot be stepped with more in a few pieces of a tick; real ones have less than 10.
  if (arm.joint_damping_n_m_s_per_rad > 300.0) of.refuse(FIELD(joint_damping_n_m_s_per_rad), "be at most 300");
  if (arm.null_space_damping_n_m_s_per_rad > 300.0)
    of.refuse(FIELD(null_space_damping_n_m_s_per_rad), "be at most 300");
  if (arm.null_space_stiffness_n_m_per_rad > 1e4)
    of.refuse(FIELD(null_space_stiffness_n_m_per_rad), "be at most 10000");
  const ArmModel<kArmJoints> model{*parameters, {arm.tool_mass_kg, vector<3>(arm.tool_center_m)}};
  const auto mobility = tool_mobility(model, vector<kArmJoints>(arm.joint_position_rad));
  spec.mass_kg = 1.0 / largest_eigenvalue(mobility.topLeftCorner<3, 3>());
  spec.inertia_kg_m2.assign(3, 1.0 / largest_eigenvalue(mobility.bottomRightCorner<3, 3>()));
  spec.arm = arm;
}

}  // namespace

RobotSpec read_robot(const Block<schema::Robot>& of) {
  of.only_with_rotation(FIELD(rotational_damping_n_m_s_per_rad));
  RobotSpec spec{
      .mass_kg = of.has(FIELD(arm)) ? 0.0 : of.required(FIELD(mass_kg), kPositive),
      .damping_n_s_per_m = of.number(FIELD(damping_n_s_per_m), kNotNegative),
      .position_m = pose(of, FIELD(position_m)),
      .velocity_m_per_s = of.list(FIELD(velocity_m_per_s), of.context().twist()),
      .force_sensor = std::nullopt,
      .inertia_kg_m2 = read_inertia(of),
      .rotational_damping_n_m_s_per_rad = of.number(FIELD(rotational_damping_n_m_s_per_rad), kNotNegative),
  };
  of.only_with_rotation(FIELD(arm));
  if (of.has(FIELD(arm))) read_arm(of, spec);
  if (of.has(FIELD(force_sensor))) spec.force_sensor = read_force_sensor(of.block(FIELD(force_sensor)));
  return spec;
}

std::vector<Eigen::Vector3d> read_tool(const Block<schema::Tool>& of) {
  std::vector<Eigen::Vector3d> points;
  for (const auto& point : of.blocks(FIELD(contact_point)))
    points.push_back(vector<3>(point.list(FIELD(position_m), {3, 3, ""})));
  for (const auto& part : of.blocks(FIELD(part))) {
    const std::vector<Eigen::Vector3d> more = read_tool_part(part);
    points.insert(points.end(), more.begin(), more.end());
  }
  if (points.empty() && of.dof() == 6) points.push_back(Eigen::Vector3d::Zero());
  return points;
}

}  // namespace twoport
