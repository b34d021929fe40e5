#pragma once

#include <vector>

#include "common/scene/load.h"
#include "common/scene/reader.h"
#include "common/scene/scene.h"

// The blocks of a scene, each checked by itself, and the rules between them. Internal to common/scene. Every error is a
// ConfigError that names file, path, value and what is allowed.

namespace twoport {

/// `of_gripper`: a recording is read for its gripper.
OperatorSpec read_operator(const Block<schema::Operator>& of, bool of_gripper = false);
ArmSpec read_arm(const Block<schema::Arm>& of);
/// The smallest effective inertia and damping at the tool when the run begins, with force feedback.
struct EffectiveInertia {
  double mass_kg, inertia_kg_m2, damping_n_s_per_m, rotational_damping_n_m_s_per_rad;
};
EffectiveInertia effective_inertia(const ArmSpec& arm);
/// Refuses the given ones of `fields` where the block has an arm.
template <class Message>
void refuse_beside_arm(const Block<Message>& of, const auto&... fields) {
  const auto refuse = [&](const auto& field) {
    if (of.has(field))
      of.fail(fmt::format("{} is given, but so is {}: the arm has masses and damping of its own",
                          of.path_of(field.name), of.path_of("arm")));
  };
  (refuse(fields), ...);
}
DeviceSpec read_device(const Block<schema::Device>& of);
ControlOptions read_control(const Block<schema::Control>& of, SceneFor use);
/// The entries of the schedule, each on top of the one before.
std::vector<ScheduledControl> read_schedule(const Block<schema::Control>& of, SceneFor use);
ImpairmentOptions read_impairment(const Block<schema::Impairment>& of);
TransmissionOptions read_transmission(const Block<schema::Impairment>& of);
ClockSpec read_clock(const Block<schema::Clock>& of);
RobotSpec read_robot(const Block<schema::Robot>& of);
EnvironmentSpec read_environment(const Block<schema::Environment>& of);
/// Points on the surface of a part of the tool.
std::vector<Eigen::Vector3d> read_tool_part(const Block<schema::ToolPart>& of);
/// Contact points of the tool and those of its parts; with dof 6 one at the origin where none is given.
std::vector<Eigen::Vector3d> read_tool(const Block<schema::Tool>& of);
DeviceMount read_device_mount(const Block<schema::DeviceMount>& of);
RobotMount read_robot_mount(const Block<schema::RobotMount>& of);
SimulationSpec read_simulation(const Block<schema::Simulation>& of);
ExpectSpec read_expect(const Block<schema::Expect>& of);

/// The gripper's coupling as a scene with dof 1. `scene` is the block that holds it, `values` what was read from there.
Scene read_gripper(const Block<schema::Scene>& scene, const Scene& values, SceneFor use);

/// Rules between blocks. `values` is what was read from `scene`.
void check_rules(const Block<schema::Scene>& scene, const Scene& values, SceneFor use);

/// The plain enums count as the schema's do, so that a value crosses by its number.
template <class Plain, class Schema>
constexpr bool same_number(Plain plain, Schema schema) {
  return static_cast<int>(plain) == static_cast<int>(schema);
}

/// Delays of the packets of one direction, which are sent at `rate_hz` [s], NaN where lost: from this direction's rows of a link's
/// file (common/link/link_trace.h), or from one delay in ms per line; blank lines and what follows a # are skipped. A relative path
/// starts at the scene's folder. Empty: the block names no file.
std::vector<double> read_trace_file(const Block<schema::Impairment>& of, double rate_hz);

}  // namespace twoport
