#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>

#include "common/arm/arm_model.h"
#include "common/scene/arm.h"
#include "common/scene/blocks.h"

namespace twoport {
namespace {

// The simulated joints cannot be stepped with more in a few pieces of a tick; real ones have less than 10 N m s/rad.
constexpr Rule kJointDamping{[](double v) { return v >= 0.0 && v <= 300.0; }, "be >= 0 and at most 300"};
constexpr Rule kJointStiffness{[](double v) { return v >= 0.0 && v <= 1e4; }, "be >= 0 and at most 10000"};
constexpr Rule kGain{[](double v) { return v >= 0.0 && v <= 1000.0; }, "be >= 0 and at most 1000"};

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
  std::filesystem::path path = of.text(FIELD(file));
  if (path.empty()) of.refuse(FIELD(file), "be the path of a file");
  if (path.is_relative()) path = std::filesystem::path{of.context().file}.parent_path() / path;
  const auto parameters = std::make_shared<const ArmParameters>(load_arm(path.string()));
  const int joints = static_cast<int>(parameters->joints.size());
  const auto feedback = of.block(FIELD(force_feedback));
  ArmSpec arm{
      .parameters = parameters,
      .joint_position_rad = of.list(FIELD(joint_position_rad), {joints, joints, ""}),
      .null_space_stiffness_n_m_per_rad = of.number(FIELD(null_space_stiffness_n_m_per_rad), kJointStiffness),
      .null_space_damping_n_m_s_per_rad = of.number(FIELD(null_space_damping_n_m_s_per_rad), kJointDamping),
      .joint_damping_n_m_s_per_rad = of.number(FIELD(joint_damping_n_m_s_per_rad), kJointDamping),
      .tool_mass_kg = of.number(FIELD(tool_mass_kg), kNotNegative),
      .tool_center_m = of.list(FIELD(tool_center_m), {3, 3, ""}),
      .force_feedback_gain = feedback.number(FIELD(gain), kGain),
      .force_feedback_torque_gain = feedback.number_or(FIELD(torque_gain), kGain, feedback.number(FIELD(gain), kGain)),
      .force_feedback_cutoff_hz = feedback.has(FIELD(cutoff_hz)) ? feedback.number(FIELD(cutoff_hz), kPositive) : 0.0,
      .joint_coulomb_friction_n_m = of.list(FIELD(joint_coulomb_friction_n_m), {joints, joints, ""})};
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
