#include <algorithm>
#include <set>

#include "common/hardware/admittance.h"
#include "common/scene/blocks.h"

namespace twoport {
namespace {

/// Three principal moments; one number stands for all three.
Numbers read_inertia(const Block<schema::Robot>& of) {
  if (of.dof() != 6 || of->has_arm() || (of->has_servo() && of->inertia_kg_m2_size() == 0)) return {};
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
  if (of->has_arm() && of->has_servo()) of.refuse(FIELD(servo), "be absent beside an arm, which follows forces");
  if (!of->has_arm() && !of->has_servo()) of.require(FIELD(mass_kg));
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
  if (of->has_servo()) {
    const Block<schema::PositionServo> servo = of.block(FIELD(servo));
    spec.servo = Servo{.period = Seconds{1.0 / servo->rate_hz()},
                       .delay = Seconds{servo->delay_ms() * 1e-3},
                       .lag = Seconds{servo->lag_ms() * 1e-3}};
    const AdmittanceBody body{};
    if (!of->has_mass_kg()) spec.mass_kg = body.mass_kg;
    if (!of->has_damping_n_s_per_m()) spec.damping_n_s_per_m = body.damping_n_s_per_m;
    if (of.dof() == 6 && spec.inertia_kg_m2.empty()) spec.inertia_kg_m2.assign(3, body.inertia_kg_m2);
    if (!of->has_rotational_damping_n_m_s_per_rad())
      spec.rotational_damping_n_m_s_per_rad = body.rotational_damping_n_m_s_per_rad;
  }
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

static_assert(same_number(Integrator::exact, schema::Simulation::EXACT) &&
              same_number(Integrator::exact_per_tick, schema::Simulation::EXACT_PER_TICK) &&
              same_number(Integrator::symplectic_euler, schema::Simulation::SYMPLECTIC_EULER) &&
              same_number(Integrator::trapezoidal, schema::Simulation::TRAPEZOIDAL) &&
              same_number(Integrator::velocity_verlet, schema::Simulation::VELOCITY_VERLET) &&
              same_number(Integrator::rk4, schema::Simulation::RK4) &&
              same_number(Integrator::dormand_prince, schema::Simulation::DORMAND_PRINCE) &&
              same_number(Integrator::dormand_prince, schema::Simulation::Integrator_MAX));

SimulationSpec read_simulation(const Block<schema::Simulation>& of) {
  return {static_cast<Integrator>(of->integrator()), of->substeps(), of->tolerance_m()};
}

DeviceMount read_device_mount(const Block<schema::DeviceMount>& of) {
  const int clutch_button = of->clutch_button();
  if (clutch_button < -1 || clutch_button > 31) of.refuse(FIELD(clutch_button), "be from 0 to 31, or -1 for none");
  DeviceMount m;
  m.position_m = vector<3>(of->position_m());
  m.rotation = attitude(of->rotation());
  m.scale = of->scale();
  m.clutch_button = clutch_button;
  m.carried_force_n = vector<3>(of->carried_force_n());
  m.let_go_after_s = of->let_go_after_s();
  m.engage_s = of->engage_s();
  return m;
}

RobotMount read_robot_mount(const Block<schema::RobotMount>& of) {
  if (of->tool_mass_kg() > 0.0 && of.dof() == 1)
    of.refuse(FIELD(tool_mass_kg), "be absent with dof 1, whose axis is not vertical");
  RobotMount m;
  m.tool_mass_kg = of->tool_mass_kg();
  m.tool_center_m = vector<3>(of->tool_center_m());
  for (int i = 0; i < of->force_bias_n_size(); ++i) m.bias[i] = of->force_bias_n(i);
  return m;
}

static_assert(same_number(VelocityEstimate::true_velocity, schema::Device::TRUE_VELOCITY) &&
              same_number(VelocityEstimate::backward_difference, schema::Device::BACKWARD_DIFFERENCE) &&
              same_number(VelocityEstimate::filtered, schema::Device::FILTERED) &&
              same_number(VelocityEstimate::filtered, schema::Device::VelocityEstimate_MAX));

namespace {

/// Three numbers about the handle's axes, or none.
Numbers read_principal(const Block<schema::Device>& of, const auto& field, const auto& for_all) {
  if (of.has(field) && of.has(for_all))
    of.fail(fmt::format("{} and {} are both given; one of them must be absent", of.path_of(field.name),
                        of.path_of(for_all.name)));
  return numbers(field.value(of.message()));
}

/// Axes from 0, each once.
std::vector<int> read_motors(const Block<schema::Device>& of) {
  const std::vector<int> axes{of->motors().begin(), of->motors().end()};
  std::set<int> seen;
  for (const int axis : axes)
    if (axis < 0 || axis >= of.dof() || !seen.insert(axis).second)
      of.refuse(FIELD(motors), fmt::format("name axes from 0 to {}, each once", of.dof() - 1));
  if (!axes.empty() && of->has_arm()) of.refuse(FIELD(motors), "be absent beside an arm, whose joints have motors");
  return axes;
}

}  // namespace

DeviceSpec read_device(const Block<schema::Device>& of) {
  DeviceSpec spec{
      .mass_kg = of->mass_kg(),
      .damping_n_s_per_m = of->damping_n_s_per_m(),
      .position_m = pose(of->position_m()),
      .velocity_m_per_s = numbers(of->velocity_m_per_s()),
      .coulomb_friction_n = of->coulomb_friction_n(),
      .position_resolution_m = of->position_resolution_m(),
      .max_force_n = std::nullopt,
      .velocity_estimate = static_cast<VelocityEstimate>(of->velocity_estimate()),
      .velocity_filter_hz = of->velocity_filter_hz(),
      .inertia_kg_m2 = of->inertia_kg_m2(),
      .rotational_damping_n_m_s_per_rad = of->rotational_damping_n_m_s_per_rad(),
  };
  spec.principal_inertia_kg_m2 = read_principal(of, FIELD(principal_inertia_kg_m2), FIELD(inertia_kg_m2));
  spec.principal_rotational_damping_n_m_s_per_rad =
      read_principal(of, FIELD(principal_rotational_damping_n_m_s_per_rad), FIELD(rotational_damping_n_m_s_per_rad));
  const auto smallest = [](const Numbers& three, double absent) {
    return three.empty() ? absent : *std::min_element(three.begin(), three.end());
  };
  spec.inertia_kg_m2 = smallest(spec.principal_inertia_kg_m2, spec.inertia_kg_m2);
  spec.rotational_damping_n_m_s_per_rad =
      smallest(spec.principal_rotational_damping_n_m_s_per_rad, spec.rotational_damping_n_m_s_per_rad);
  spec.force_latency_s = of->force_latency_ms() * 1e-3;
  if (of->has_max_force_n()) spec.max_force_n = of->max_force_n();
  spec.motors = read_motors(of);
  if (of->has_arm()) {
    refuse_beside_arm(of, FIELD(mass_kg), FIELD(inertia_kg_m2), FIELD(damping_n_s_per_m),
                      FIELD(rotational_damping_n_m_s_per_rad), FIELD(velocity_m_per_s), FIELD(coulomb_friction_n),
                      FIELD(principal_inertia_kg_m2), FIELD(principal_rotational_damping_n_m_s_per_rad));
    spec.arm = read_arm(of.block(FIELD(arm)));
    const EffectiveInertia felt = effective_inertia(*spec.arm);
    spec.mass_kg = felt.mass_kg;
    spec.inertia_kg_m2 = felt.inertia_kg_m2;
    spec.damping_n_s_per_m = felt.damping_n_s_per_m;
    spec.rotational_damping_n_m_s_per_rad = felt.rotational_damping_n_m_s_per_rad;
  }
  return spec;
}

}  // namespace twoport
