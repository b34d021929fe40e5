#include <algorithm>

#include "common/scene/blocks.h"

namespace twoport {
namespace {

/// Three principal moments; one number stands for all three.
Numbers read_inertia(const Block<schema::Robot>& of) {
  if (of.dof() != 6 || of->has_arm()) return {};
  of.require(FIELD(inertia_kg_m2));
  Numbers moments = numbers(of->inertia_kg_m2());
  moments.resize(3, moments[0]);
  const double most = *std::max_element(moments.begin(), moments.end());
  const double others = moments[0] + moments[1] + moments[2] - most;
  if (most > others * (1.0 + 1e-12))
    of.refuse(FIELD(inertia_kg_m2),
              "keep the triangle inequality: no principal moment exceeds the sum of the other two");
  return moments;
}

ForceSensorSpec read_force_sensor(const Block<schema::ForceSensor>& of) {
  return {.noise_n = of->noise_n(), .bias_n = numbers(of->bias_n()), .latency_s = of->latency_ms() * 1e-3};
}

/// The arm, and mass and inertia of the tool at its first pose.
void read_arm_of_robot(const Block<schema::Robot>& robot, RobotSpec& spec) {
  refuse_beside_arm(robot, FIELD(mass_kg), FIELD(inertia_kg_m2), FIELD(damping_n_s_per_m),
                    FIELD(rotational_damping_n_m_s_per_rad), FIELD(velocity_m_per_s));
  spec.arm = read_arm(robot.block(FIELD(arm)));
  const EffectiveInertia felt = effective_inertia(*spec.arm);
  spec.mass_kg = felt.mass_kg;
  spec.inertia_kg_m2.assign(3, felt.inertia_kg_m2);
}

}  // namespace

RobotSpec read_robot(const Block<schema::Robot>& of) {
  if (!of->has_arm()) of.require(FIELD(mass_kg));
  RobotSpec spec{
      .mass_kg = of->has_arm() ? 0.0 : of->mass_kg(),
      .damping_n_s_per_m = of->damping_n_s_per_m(),
      .position_m = pose(of->position_m()),
      .velocity_m_per_s = numbers(of->velocity_m_per_s()),
      .force_sensor = std::nullopt,
      .inertia_kg_m2 = read_inertia(of),
      .rotational_damping_n_m_s_per_rad = of->rotational_damping_n_m_s_per_rad(),
  };
  if (of->has_arm()) read_arm_of_robot(of, spec);
  if (of->has_force_sensor()) spec.force_sensor = read_force_sensor(of.block(FIELD(force_sensor)));
  return spec;
}

std::vector<Eigen::Vector3d> read_tool(const Block<schema::Tool>& of) {
  constexpr double kFarthest_m = 100.0;  // the steps of a contact shrink with its lever arm
  std::vector<Eigen::Vector3d> points;
  const auto add = [&](const auto& block, const Eigen::Vector3d& point) {
    if (!(point.norm() <= kFarthest_m))
      block.fail(fmt::format("{}: a contact point is {:.4g} m from the wrist; it must be at most {:g} m", block.path(),
                             point.norm(), kFarthest_m));
    points.push_back(point);
  };
  for (const auto& point : of.blocks(FIELD(contact_point))) add(point, vector<3>(point->position_m()));
  for (const auto& part : of.blocks(FIELD(part)))
    for (const Eigen::Vector3d& point : read_tool_part(part)) add(part, point);
  if (points.empty() && of.dof() == 6) points.push_back(Eigen::Vector3d::Zero());
  return points;
}

}  // namespace twoport
