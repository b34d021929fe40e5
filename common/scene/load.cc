#include "common/scene/load.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <limits>
#include <utility>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/base/file.h"
#include "common/coupling/layers.h"
#include "common/link/link_trace.h"
#include "common/scene/blocks.h"
#include "common/scene/joints.h"
#include "common/scene/source.h"
#include "common/scene/text.h"

namespace twoport {
namespace {

double delay_of_way_s(const ImpairmentOptions& o, double playout_s) {
  if (o.recorded_delay_s.empty()) return o.delay_s + playout_s;
  std::vector<double> arrived;
  std::copy_if(o.recorded_delay_s.begin(), o.recorded_delay_s.end(), std::back_inserter(arrived),
               [](double delay_s) { return !std::isnan(delay_s); });
  if (arrived.empty()) return playout_s;
  std::sort(arrived.begin(), arrived.end());
  return nominal_delay_s(arrived.front(), arrived[(arrived.size() - 1) / 2], playout_s);
}

/// Of the blocks of a scene: with joints they describe the tools in space.
int read_dof(const schema::Scene& message, const std::string& file) {
  if (message.space() == schema::Scene::JOINTS) return 6;
  const Context context{.file = file};
  const Block of{context, message};
  of.require(FIELD(dof), "be 1, 3 or 6");
  const int dof = of->dof();
  if (dof != 1 && dof != 3 && dof != 6) of.refuse(FIELD(dof), "be 1, 3 or 6");
  return dof;
}

/// Durations and rates.
void read_time(const Block<schema::Scene>& of, SceneFor use, Scene& scene) {
  const bool endless = use == SceneFor::live && !of->has_duration_s();
  if (!endless) of.require(FIELD(duration_s));
  scene.duration_s = endless ? std::numeric_limits<double>::infinity() : of->duration_s();
  scene.rate_hz = of->rate_hz();
  scene.master_rate_hz = GIVEN(of, master_rate_hz).value_or(scene.rate_hz);
  scene.slave_rate_hz = GIVEN(of, slave_rate_hz).value_or(scene.rate_hz);
  constexpr double kMostTicks = std::numeric_limits<std::uint32_t>::max();  // as a summary counts them
  const double ticks = scene.duration_s * std::max(scene.master_rate_hz, scene.slave_rate_hz);
  if (ticks > kMostTicks && !endless)
    of.refuse(FIELD(duration_s), fmt::format("last at most {:.0f} ticks, and makes {:.9g}", kMostTicks, ticks));
}

/// E(0) where the scene does not state it: of the first controllers by default_initial_energy, of a schedule's as theirs. It is granted
/// once: no switch raises it.
void complete_initial_energy(const Block<schema::Scene>& of, Scene& scene) {
  const schema::Control& message = of->control();
  bool stated = message.passivity().has_initial_energy_j();
  if (!stated) scene.control.initial_energy = default_initial_energy(scene.control);
  for (std::size_t i = 0; i < scene.schedule.size(); ++i) {
    stated = stated || message.schedule(static_cast<int>(i)).passivity().has_initial_energy_j();
    if (!stated) scene.schedule[i].control.initial_energy = scene.control.initial_energy;
    if (scene.schedule[i].control.initial_energy > scene.control.initial_energy)
      of.fail(
          fmt::format("control.schedule[{}].passivity.initial_energy_j is {:g}; it must be at most {:g}, that of the "
                      "start: E(0) is granted once",
                      i, scene.schedule[i].control.initial_energy.si(), scene.control.initial_energy.si()));
  }
}

}  // namespace

Scene read_scene(std::shared_ptr<const SceneSource> source) {
  const auto& [message, file, use] = *source;
  const Context context{
      .file = file, .dof = read_dof(message, file), .joints = message.space() == schema::Scene::JOINTS};
  const Block of{context, message};
  of.check_fields();
  Scene scene{};
  scene.name = of->has_name() ? of->name() : std::filesystem::path{file}.stem().string();
  scene.description = of->description();
  scene.dof = context.joints ? kJointPort : context.dof;
  check_built_for(scene.dof);
  read_time(of, use, scene);
  scene.seed = of->seed();
  if (of->has_operator_()) scene.operator_model = read_operator(of.block(FIELD(operator_)));
  if (of->has_device()) scene.device = read_device(of.block(FIELD(device)));
  scene.control = read_control(of.block(FIELD(control)), use);
  scene.schedule = read_schedule(of.block(FIELD(control)), use);
  scene.to_slave = read_impairment(of.block(FIELD(to_slave)));
  scene.to_master = read_impairment(of.block(FIELD(to_master)));
  scene.to_slave.recorded_delay_s = read_trace_file(of.block(FIELD(to_slave)), scene.master_rate_hz);
  scene.to_master.recorded_delay_s = read_trace_file(of.block(FIELD(to_master)), scene.slave_rate_hz);
  scene.transmission_to_slave = read_transmission(of.block(FIELD(to_slave)));
  scene.transmission_to_master = read_transmission(of.block(FIELD(to_master)));
  scene.slave_clock = read_clock(of.block(FIELD(slave_clock)));
  if (of->has_robot()) scene.robot = read_robot(of.block(FIELD(robot)));
  tell_system(scene);
  read_joints(of, scene);
  complete_initial_energy(of, scene);
  for (const auto& each : of.blocks(FIELD(environment))) scene.environment.push_back(read_environment(each));
  scene.tool = read_tool(of.block(FIELD(tool)));
  scene.simulation = read_simulation(of.block(FIELD(simulation)));
  scene.expect = read_expect(of.block(FIELD(expect)));
  scene.device_mount = read_device_mount(of.block(FIELD(device_mount)));
  if (scene.device && !scene.device->motors.empty() &&
      !scene.device_mount.rotation.isApprox(Eigen::Quaterniond::Identity()))
    of.fail(
        "device_mount.rotation turns the axes of the device, and device.motors names some of them; one of the two must "
        "be absent");
  scene.robot_mount = read_robot_mount(of.block(FIELD(robot_mount)));
  check_rules(of, scene, use);
  if (of->has_gripper()) scene.gripper = std::make_shared<const Scene>(read_gripper(of, scene, use));
  scene.source = std::move(source);
  return scene;
}

namespace {

/// What the nodes must know of the system, for one set of controllers.
void tell_system(const Scene& scene, ControlOptions& control) {
  const HandSpec hand = scene.operator_model && scene.operator_model->hand ? *scene.operator_model->hand : HandSpec{};
  const DeviceSpec device = scene.device.value_or(DeviceSpec{});
  control.handle_mass_kg = device.mass_kg > 0.0 ? device.mass_kg : hand.mass_kg;
  control.handle_inertia_kg_m2 = device.inertia_kg_m2 > 0.0 ? device.inertia_kg_m2 : hand.inertia_kg_m2;
  control.max_force_n = device.max_force_n.value_or(std::numeric_limits<double>::infinity());
  control.without_motor = device.motors.empty() ? 0 : static_cast<std::uint8_t>((1 << scene.dof) - 1);
  for (const int axis : device.motors)
    control.without_motor = static_cast<std::uint8_t>(control.without_motor & ~(1 << axis));

  control.random.seed = scene.seed;
  KnownSystem& known = control.known;
  known.round_trip = control.stated_round_trip.value_or(
      Seconds{delay_of_way_s(scene.to_slave, scene.transmission_to_slave.playout_s) +
              delay_of_way_s(scene.to_master, scene.transmission_to_master.playout_s)});
  known.master_tick = Seconds{1.0 / scene.master_rate_hz};
  known.slave_tick = Seconds{1.0 / scene.slave_rate_hz};
  known.device_damping_n_s_per_m = device.damping_n_s_per_m;
  known.device_rotational_damping_n_m_s_per_rad = device.rotational_damping_n_m_s_per_rad;
  known.robot_mass_kg = scene.robot ? scene.robot->mass_kg : 0.0;
  known.ideal_robot = !scene.robot;
  known.robot_inertia_kg_m2 = 0.0;
  if (scene.robot && !scene.robot->inertia_kg_m2.empty())
    known.robot_inertia_kg_m2 = *std::min_element(scene.robot->inertia_kg_m2.begin(), scene.robot->inertia_kg_m2.end());
}

}  // namespace

Energy default_initial_energy(const ControlOptions& o) {
  if (o.architecture == Architecture::render) return {};
  constexpr double kLeast_j = 1e-3, kMost_j = 20e-3, kApproach_m_per_s = 0.05, kRobot_m_per_s = 0.2;
  if (!transparency_layer(o).initial_energy_by_round_trip) return Energy{kLeast_j};
  const double way_m = kApproach_m_per_s * o.known.round_trip.si();
  const double stiffness_n_per_m = o.force_scale * o.motion_scale * o.coupling.stiffness_n_per_m;
  const double blind_j = 0.5 * stiffness_n_per_m * way_m * way_m;
  const double robot_j = exchanges_energy(o) ? 0.5 * o.force_scale / o.motion_scale * o.known.robot_mass_kg *
                                                   kRobot_m_per_s * kRobot_m_per_s
                                             : 0.0;
  return Energy{std::clamp(std::max(blind_j, robot_j), kLeast_j, kMost_j)};
}

void tell_system(Scene& scene) {
  tell_system(scene, scene.control);
  for (ScheduledControl& entry : scene.schedule) tell_system(scene, entry.control);
}

Scene parse_scene(const std::string& text, const std::string& name, std::span<const std::string> overrides,
                  SceneFor use) {
  return SceneText{text, name, overrides, use}.with();
}

SceneText::SceneText(const std::string& text, std::string name, std::span<const std::string> overrides, SceneFor whom)
    : name_{std::move(name)} {
  const auto source = std::make_shared<SceneSource>(SceneSource{{}, name_, whom});
  if (const auto error = parse_text(text, source->message))
    throw ConfigError{fmt::format("{}:{}: {}", name_, error->place, error->sentence)};
  apply(overrides, source->message, created_);
  source_ = source;
}
Scene SceneText::with(std::span<const std::string> overrides) const {
  if (overrides.empty()) return read(source_, created_);
  const auto source = std::make_shared<SceneSource>(*source_);
  std::vector<Created> created = created_;
  apply(overrides, source->message, created);
  return read(source, created);
}

bool SceneText::keeps(std::span<const std::string> earlier, std::span<const std::string> later) const {
  schema::Scene message = source_->message;
  std::vector<Created> created;
  apply(earlier, message, created);
  apply(later, message, created);
  const std::string before = message.SerializeAsString();
  apply(earlier, message, created);
  return message.SerializeAsString() == before;
}

namespace {
/// An override that names a method takes the place of the layers that the scene names, and the other way round.
void make_room(std::span<const std::string> overrides, schema::Scene& message) {
  const auto names = [&](std::string_view path) {
    return std::any_of(overrides.begin(), overrides.end(), [&](const std::string& o) {
      return o.starts_with(path) && o.size() > path.size() && (o[path.size()] == '=' || o[path.size()] == ' ');
    });
  };
  const bool method = names("control.passivity.method");
  const bool layers = names("control.passivity.layer") || names("control.transparency.layer");
  if (method == layers || !message.control().has_passivity()) return;
  if (layers) {
    message.mutable_control()->mutable_passivity()->clear_method();
  } else {
    if (message.control().has_transparency()) message.mutable_control()->mutable_transparency()->clear_layer();
    message.mutable_control()->mutable_passivity()->clear_layer();
  }
}
}  // namespace

void SceneText::apply(std::span<const std::string> given, schema::Scene& message, std::vector<Created>& created) {
  const std::vector<std::string> overrides = single_overrides(given);
  make_room(overrides, message);
  for (const std::string& assignment : overrides)
    if (std::string block = apply_override(message, assignment); !block.empty())
      created.push_back({std::move(block), assignment});
}

/// Where a field is missing in a block that the text does not have, says so.
Scene SceneText::read(const std::shared_ptr<const SceneSource>& source, const std::vector<Created>& created) const {
  try {
    return read_scene(source);
  } catch (const ConfigError& e) {
    const std::string sentence = e.what();
    for (const Created& each : created)
      if (sentence.starts_with(name_ + ": " + each.block + ".") && sentence.find(" is missing; ") != sentence.npos)
        throw ConfigError{
            fmt::format("{}; {} is not in the file, override {} adds it", sentence, each.block, each.assignment)};
    throw;
  }
}

Scene load_scene(const std::string& path, std::span<const std::string> overrides, SceneFor use) {
  return parse_scene(read_text(path), path, overrides, use);
}

}  // namespace twoport
