#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>

#include "common/arm/arm_model.h"
#include "common/scene/arm.h"
#include "common/scene/blocks.h"

namespace twoport {
namespace {

template <int n>
EffectiveInertia effective_inertia(const ArmSpec& arm) {
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  const ArmTool tool{.mass_kg = arm.tool_mass_kg, .center_m = vector<3>(arm.tool_center_m)};
  const Eigen::Matrix<double, n, 1> q = vector<n>(arm.joint_position_rad);
  const ArmModel<n> with_tool{*arm.parameters, tool};
  Matrix6 mobility = tool_mobility(with_tool, q);
  const double lighter = 1.0 + arm.force_feedback_gain, turns_lighter = 1.0 + arm.force_feedback_torque_gain;
  if (lighter > 1.0 || turns_lighter > 1.0) {
    const Matrix6 alone = tool_mobility(ArmModel<n>{*arm.parameters}, q).inverse(), whole = mobility.inverse();
    Matrix6 felt = alone;
    felt.topLeftCorner<3, 3>() /= lighter;
    felt.bottomRightCorner<3, 3>() /= turns_lighter;
    felt.topRightCorner<3, 3>() /= std::sqrt(lighter * turns_lighter);
    felt.bottomLeftCorner<3, 3>() /= std::sqrt(lighter * turns_lighter);
    mobility = (felt + (whole - alone)).inverse();
  }
  const auto J = with_tool.jacobian(with_tool.pose(q));
  const Matrix6 by_damping = J * J.transpose();
  return {.mass_kg = 1.0 / largest_eigenvalue(mobility.topLeftCorner<3, 3>()),
          .inertia_kg_m2 = 1.0 / largest_eigenvalue(mobility.bottomRightCorner<3, 3>()),
          .damping_n_s_per_m =
              arm.joint_damping_n_m_s_per_rad / lighter / largest_eigenvalue(by_damping.topLeftCorner<3, 3>()),
          .rotational_damping_n_m_s_per_rad = arm.joint_damping_n_m_s_per_rad / turns_lighter /
                                              largest_eigenvalue(by_damping.bottomRightCorner<3, 3>())};
}

}  // namespace

ArmSpec read_arm(const Block<schema::Arm>& of) {
  of.require(FIELD(file), "be the path of a file");
  std::filesystem::path path = of->file();
  if (path.empty()) of.refuse(FIELD(file), "be the path of a file");
  if (path.is_relative()) path = std::filesystem::path{of.context().file}.parent_path() / path;
  const auto parameters = std::make_shared<const ArmParameters>(load_arm(path.string()));
  const int joints = static_cast<int>(parameters->joints.size());
  const auto feedback = of.block(FIELD(force_feedback));
  of.need_length(FIELD(joint_position_rad), joints);
  of.need_length(FIELD(joint_coulomb_friction_n_m), joints);
  ArmSpec arm{.parameters = parameters,
              .joint_position_rad = numbers(of->joint_position_rad()),
              .null_space_stiffness_n_m_per_rad = of->null_space_stiffness_n_m_per_rad(),
              .null_space_damping_n_m_s_per_rad = of->null_space_damping_n_m_s_per_rad(),
              .joint_damping_n_m_s_per_rad = of->joint_damping_n_m_s_per_rad(),
              .tool_mass_kg = of->tool_mass_kg(),
              .tool_center_m = numbers(of->tool_center_m()),
              .force_feedback_gain = feedback->gain(),
              .force_feedback_torque_gain = GIVEN(feedback, torque_gain).value_or(feedback->gain()),
              .force_feedback_cutoff_hz = feedback->has_cutoff_hz() ? feedback->cutoff_hz() : 0.0,
              .joint_coulomb_friction_n_m = numbers(of->joint_coulomb_friction_n_m())};
  for (const double friction : arm.joint_coulomb_friction_n_m)
    if (!(friction >= 0.0)) of.refuse(FIELD(joint_coulomb_friction_n_m), "be >= 0 each");
  if (arm.joint_position_rad.empty()) arm.joint_position_rad = parameters->ready_position_rad;
  for (std::size_t i = 0; i < arm.joint_position_rad.size(); ++i) {
    const ArmJoint& joint = parameters->joints[i];
    if (!(arm.joint_position_rad[i] > joint.lower_rad && arm.joint_position_rad[i] < joint.upper_rad))
      of.refuse(FIELD(joint_position_rad),
                fmt::format("lie within the joints' limits; number {} must be between {} and {}", i + 1,
                            joint.lower_rad, joint.upper_rad));
  }
  if (joints < 7) {
    const auto refuse = [&](const auto& field) {
      if (of.has(field)) of.refuse(field, fmt::format("be absent: an arm of {} joints has no null space", joints));
    };
    refuse(FIELD(null_space_stiffness_n_m_per_rad));
    refuse(FIELD(null_space_damping_n_m_s_per_rad));
    arm.null_space_stiffness_n_m_per_rad = arm.null_space_damping_n_m_s_per_rad = 0.0;
  }
  return arm;
}

EffectiveInertia effective_inertia(const ArmSpec& arm) {
  return arm.parameters->joints.size() == 6 ? effective_inertia<6>(arm) : effective_inertia<7>(arm);
}

}  // namespace twoport
