#include "common/base/built_for.h"
#include "common/scene/blocks.h"

namespace twoport {
namespace {

/// What has no meaning at a gripper, or no model here.
void check(const Block<schema::Gripper>& of, const Scene& values) {
  const Architecture architecture = values.control.architecture;
  if (architecture == Architecture::render || architecture == Architecture::uncontrolled)
    of.fail("gripper is given, but control.architecture is RENDER or UNCONTROLLED: it needs a link");
  if (!values.schedule.empty()) of.fail("gripper is given with control.schedule: a gripper has one method");
  for (const auto& [path, way] :
       {std::pair{"to_slave", &values.transmission_to_slave}, std::pair{"to_master", &values.transmission_to_master}})
    if (way->deadband)
      of.fail(fmt::format("gripper is given with {}.deadband: both reports of a packet are sent together", path));
  const Block hand = of.block(FIELD(operator_));
  if (hand->has_tremor()) of.fail("gripper.operator has a tremor; it may have hand, and path or recording");
  const Block robot = of.block(FIELD(robot));
  if (robot->has_arm()) of.fail("gripper.robot.arm is given; a gripper has mass_kg and damping_n_s_per_m");
  of.check_fields();
  // Noise is drawn from the seed, and would be that of the main robot.
  const Block sensor = robot.block(FIELD(force_sensor));
  if (sensor->noise_n() > 0.0)
    sensor.refuse(FIELD(noise_n), "be 0: the force sensor of a gripper has no model of noise");
}

schema::Control control_of(const Block<schema::Scene>& scene, const Block<schema::Gripper>& of) {
  const schema::Control& main = scene.message().control();
  const schema::Gripper& gripper = of.message();
  schema::Control control;
  if (main.has_architecture()) control.set_architecture(main.architecture());
  if (main.has_engage_s()) control.set_engage_s(main.engage_s());
  if (main.has_hold_after_s()) control.set_hold_after_s(main.hold_after_s());
  if (main.has_release_after_s()) control.set_release_after_s(main.release_after_s());
  if (gripper.has_virtual_coupling()) *control.mutable_virtual_coupling() = gripper.virtual_coupling();
  if (gripper.has_force_scale()) control.set_force_scale(gripper.force_scale());
  if (gripper.has_motion_scale()) control.set_motion_scale(gripper.motion_scale());
  if (gripper.has_device_limits()) *control.mutable_device_limits() = gripper.device_limits();
  if (gripper.has_robot_limits()) *control.mutable_robot_limits() = gripper.robot_limits();
  if (main.registration().has_mode()) control.mutable_registration()->set_mode(main.registration().mode());
  // The options of single methods stand for the main coupling's stiffness and masses; here they are the defaults.
  schema::Passivity& passivity = *control.mutable_passivity();
  if (main.passivity().has_method()) passivity.set_method(main.passivity().method());
  if (main.passivity().has_layer()) passivity.set_layer(main.passivity().layer());
  if (main.has_transparency()) *control.mutable_transparency() = main.transparency();
  if (main.passivity().has_observer()) passivity.set_observer(main.passivity().observer());
  if (main.passivity().has_round_trip_ms()) passivity.set_round_trip_ms(main.passivity().round_trip_ms());
  if (gripper.has_initial_energy_j()) passivity.set_initial_energy_j(gripper.initial_energy_j());
  return control;
}

Surface object_of(const Block<schema::GrippedObject>& of) {
  return {Wall{.normal = Eigen::Vector3d::UnitX(), .offset_m = of->width_m()},
          Material{.stiffness_n_per_m = of->stiffness_n_per_m(),
                   .damping_n_s_per_m = of->damping_n_s_per_m(),
                   .friction = 0.0,
                   .viscous_friction_n_s_per_m = 0.0}};
}

}  // namespace

Scene read_gripper(const Block<schema::Scene>& scene, const Scene& values, SceneFor use) {
  check_built_for(1, "the gripper's dof");
  const Context context{.file = scene.context().file, .dof = 1};
  const Block of{context, scene.message().gripper(), "gripper"};
  check(of, values);
  const schema::Control control = control_of(scene, of);

  Scene gripper{};
  gripper.name = values.name;
  gripper.dof = 1;
  gripper.duration_s = values.duration_s;
  gripper.rate_hz = values.rate_hz;
  gripper.master_rate_hz = values.master_rate_hz;
  gripper.slave_rate_hz = values.slave_rate_hz;
  gripper.seed = values.seed;
  if (of->has_operator_()) gripper.operator_model = read_operator(of.block(FIELD(operator_)), true);
  if (of->has_device()) gripper.device = read_device(of.block(FIELD(device)));
  gripper.control = read_control(Block{context, control, "gripper"}, use);
  gripper.to_slave = values.to_slave;
  gripper.to_master = values.to_master;
  gripper.transmission_to_slave = values.transmission_to_slave;
  gripper.transmission_to_master = values.transmission_to_master;
  gripper.slave_clock = values.slave_clock;
  if (of->has_robot()) gripper.robot = read_robot(of.block(FIELD(robot)));
  tell_system(gripper);
  if (!of->has_initial_energy_j()) gripper.control.initial_energy = default_initial_energy(gripper.control);
  if (of->has_object()) gripper.environment.push_back(object_of(of.block(FIELD(object))));
  gripper.simulation = values.simulation;

  // The rules of a scene, for a message that has these blocks at the places where a scene has them.
  schema::Scene message;
  if (of->has_operator_()) *message.mutable_operator_() = of.message().operator_();
  if (of->has_device()) *message.mutable_device() = of.message().device();
  if (of->has_robot()) *message.mutable_robot() = of.message().robot();
  *message.mutable_control() = control;
  *message.mutable_to_slave() = scene.message().to_slave();
  *message.mutable_to_master() = scene.message().to_master();
  check_rules(Block{context, message, "gripper"}, gripper, use);
  return gripper;
}

}  // namespace twoport
