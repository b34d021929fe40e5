#include <limits>
#include <numbers>

#include "common/coupling/layers.h"
#include "common/scene/blocks.h"
#include "common/scene/find.h"
#include "common/scene/scene.h"
#include "common/scene/source.h"

namespace twoport {
namespace {

static_assert(same_number(Architecture::render, schema::Control::RENDER) &&
              same_number(Architecture::position_force, schema::Control::POSITION_FORCE) &&
              same_number(Architecture::position_measured_force, schema::Control::POSITION_MEASURED_FORCE) &&
              same_number(Architecture::position_position, schema::Control::POSITION_POSITION) &&
              same_number(Architecture::uncontrolled, schema::Control::UNCONTROLLED) &&
              same_number(Architecture::uncontrolled, schema::Control::Architecture_MAX - 1));
static_assert(same_number(ObserverRule::exact, schema::Passivity::EXACT) &&
              same_number(ObserverRule::rectangle, schema::Passivity::RECTANGLE) &&
              same_number(ObserverRule::rectangle, schema::Passivity::Observer_MAX));
static_assert(same_number(Accounts::total, schema::Passivity::TOTAL) &&
              same_number(Accounts::normal_tangential, schema::Passivity::NORMAL_TANGENTIAL) &&
              same_number(Accounts::per_contact, schema::Passivity::PER_CONTACT) &&
              same_number(Accounts::translation_rotation, schema::Passivity::TRANSLATION_ROTATION) &&
              same_number(Accounts::translation_rotation, schema::Passivity::Accounts_MAX));
static_assert(same_number(RenderingAlgorithm::penalty, schema::Control::PENALTY) &&
              same_number(RenderingAlgorithm::god_object, schema::Control::GOD_OBJECT) &&
              same_number(RenderingAlgorithm::god_object, schema::Control::Rendering_MAX));

CouplingOptions read_coupling(const Block<schema::VirtualCoupling>& of) {
  return {
      .stiffness_n_per_m = of->stiffness_n_per_m(),
      .damping_n_s_per_m = of->damping_n_s_per_m(),
      .rotational_stiffness_n_m_per_rad = of->rotational_stiffness_n_m_per_rad(),
      .rotational_damping_n_m_s_per_rad = of->rotational_damping_n_m_s_per_rad(),
      .catch_up_m_per_s = of->catch_up_m_per_s(),
      .drift_compensation = of->drift_compensation(),
  };
}

RegistrationOptions read_registration(const Block<schema::Registration>& of) {
  RegistrationOptions options;
  options.absolute = of->mode() == schema::Registration::ABSOLUTE;
  options.rotation = attitude(of->rotation());
  if (!of->position_m().empty()) {
    if (!options.absolute)
      of.fail(fmt::format("{} is given, but {} is OFFSET; it needs ABSOLUTE", of.path_of("position_m"),
                          of.path_of("mode")));
    options.position_m = vector<3>(of->position_m());
  }
  return options;
}

/// The transparency layer that control.architecture names in place of an architecture; null: it names one.
const TransparencyLayerName* named_by_architecture(const schema::Control& of) {
  return find_name(kTransparencyLayers, schema::Control::Architecture_Name(of.architecture()));
}

/// The one-port controllers that exist under RENDER only.
Method rendering_controller(std::string_view name) {
  const ControllerName* found = find_name(kControllers, name);
  return found != nullptr && found->rendering ? found->method : Method::none;
}

/// A layer's options, from its block in `transparency` or `passivity`.
void read_options(auto& options, const schema::Control& of, auto block) {
  if constexpr (requires { block(of.transparency()); }) {
    options.read(block(of.transparency()));
  } else {
    options.read(block(of.passivity()));
  }
}
/// Those of a layer that is not in use are checked all the same.
void read_options_of_layers(const Block<schema::Control>& of, ControlOptions& options) {
#define TWOPORT_LAYER_OPTIONS(BLOCK, Struct) \
  read_options(options.BLOCK, of.message(), [](const auto& in) -> decltype(in.BLOCK()) { return in.BLOCK(); });
#include "common/method/list.h"
#undef TWOPORT_LAYER_OPTIONS
  if (std::string& file = options.plugin.file; !file.empty()) file = file_beside(of.context().file, file);
}

/// Of an architecture that is the transparency layer `named`: the passivity layer that the scene's method has.
std::string passivity_below(const Block<schema::Control>& of, const TransparencyLayerName& named) {
  const Block transparency = of.block(FIELD(transparency));
  const Block passivity = of.block(FIELD(passivity));
  if (transparency->has_layer() && schema::Transparency::Layer_Name(transparency->layer()) != named.name)
    transparency.refuse(FIELD(layer),
                        fmt::format("be absent or {} where control.architecture is {}", named.name, named.name));
  if (!passivity->has_method()) return std::string{kMethods[0].passivity};
  const MethodName* method = find_name(kMethods, schema::Passivity::Method_Name(passivity->method()));
  if (method == nullptr ||
      (method->transparency != named.name && !entry_of(kTransparencyLayers, method->transparency).is_plain))
    passivity.refuse(FIELD(method), fmt::format("be one with the layer {} or {} where control.architecture is {}",
                                                kPlainTransparency, named.name, named.name));
  return std::string{method->passivity};
}

/// The layers that the scene names, each absent one as the default method has it. False: it names none.
bool read_layers(const Block<schema::Control>& of, ControlOptions& options) {
  const Block transparency = of.block(FIELD(transparency));
  const Block passivity = of.block(FIELD(passivity));
  const TransparencyLayerName* named_above = named_by_architecture(of.message());
  if (!transparency->has_layer() && !passivity->has_layer() && named_above == nullptr) return false;
  const std::string named = transparency->has_layer() ? transparency.path_of("layer") : passivity.path_of("layer");
  if (passivity->has_method() && (transparency->has_layer() || passivity->has_layer()))
    of.fail(fmt::format("{} and {} are both given; a method names both layers, so give the one or the other",
                        passivity.path_of("method"), named));
  if (options.architecture == Architecture::render || options.architecture == Architecture::uncontrolled)
    of.fail(fmt::format("{} is given, but control.architecture is {}; layers need a link", named,
                        to_string(options.architecture)));
  const std::string below =
      named_above != nullptr ? passivity_below(of, *named_above) : std::string{kMethods[0].passivity};
  std::string name{named_above != nullptr ? named_above->name : kMethods[0].transparency};
  if (transparency->has_layer()) name = schema::Transparency::Layer_Name(transparency->layer());
  name += '+';
  name += passivity->has_layer() ? schema::PassivityLayer::Name_Name(passivity->layer()) : below;
  if (!choose_method(options, name)) of.fail(fmt::format("no pair of layers of this build is {}", name));
  return true;
}

void read_passivity(const Block<schema::Control>& control, ControlOptions& options) {
  const Block of = control.block(FIELD(passivity));
  const bool rendering = options.architecture == Architecture::render;
  if (!read_layers(control, options)) {
    const bool link = !rendering && options.architecture != Architecture::uncontrolled;
    const std::string method = of->has_method() ? schema::Passivity::Method_Name(of->method())
                                                : std::string{link ? kDefaultMethod : kPlainMethod};
    if (!choose_method(options, method)) {
      options.method_name = method;
      options.controller.method = rendering_controller(method);
    }
  }
  options.controller = {.method = options.controller.method,
                        .max_gain = of->max_gain(),
                        .unilateral = of->unilateral(),
                        .predict = of->predict(),
                        .max_turn_rad = of->max_turn_deg() * std::numbers::pi / 180.0};
  if (const auto ms = GIVEN(of, round_trip_ms)) options.stated_round_trip = Seconds{*ms * 1e-3};
  options.observer = static_cast<ObserverRule>(of->observer());
  options.accounts = static_cast<Accounts>(of->accounts());
  // With several contact points f·v of the sum vanishes while single ones generate energy.
  if (!of->has_accounts() && rendering && options.rendering == RenderingAlgorithm::penalty && of.dof() == 6 &&
      options.controller.method == Method::force_projected)
    options.accounts = Accounts::per_contact;
  options.reference_energy = of->reference_energy();
  // Absent: default_initial_energy, once the system is known.
  if (const auto j = GIVEN(of, initial_energy_j)) options.initial_energy = Energy{*j};

  read_options_of_layers(control, options);
  if (of->internal_model().strict_two_port() && method_entry(options).strict_two_port)
    options.passivity = passivity_layer(options).passes_on;

  if (rendering && options.controller.method == Method::none && !is_plain(options))
    of.refuse(FIELD(method), fmt::format("be one of {} where control.architecture is RENDER: it needs a link",
                                         fmt::join(names_of(kControllers), ", ")));
  if (!rendering && rendering_controller(options.method_name) != Method::none)
    of.refuse(FIELD(method), "be another value over a link: this one needs control.architecture RENDER");
  // Only a rendering knows its contacts and their potential.
  if (!rendering && options.accounts != Accounts::total)
    of.refuse(FIELD(accounts), "be TOTAL over a link; other accounts need control.architecture RENDER");
  if (of.dof() != 6 && options.accounts == Accounts::translation_rotation)
    of.refuse(FIELD(accounts),
              fmt::format("be another value: TRANSLATION_ROTATION needs dof 6, and dof is {}", of.dof()));
}

PortLimits read_limits(const Block<schema::Limits>& of, const PortLimits& absent) {
  return {.force_n = GIVEN(of, force_n).value_or(absent.force_n),
          .torque_n_m = GIVEN(of, torque_n_m).value_or(absent.torque_n_m),
          .force_rate_n_per_s = GIVEN(of, force_rate_n_per_s).value_or(absent.force_rate_n_per_s),
          .power_w = GIVEN(of, power_w).value_or(absent.power_w),
          .speed_m_per_s = GIVEN(of, speed_m_per_s).value_or(absent.speed_m_per_s),
          .angular_speed_rad_per_s = GIVEN(of, angular_speed_rad_per_s).value_or(absent.angular_speed_rad_per_s),
          .set_point_step_m = GIVEN(of, set_point_step_m).value_or(absent.set_point_step_m),
          .workspace_m = GIVEN(of, workspace_m).value_or(absent.workspace_m)};
}

}  // namespace

ControlOptions read_control(const Block<schema::Control>& of, SceneFor use) {
  ControlOptions options;
  options.architecture = named_by_architecture(of.message()) != nullptr ? Architecture::position_force
                                                                        : static_cast<Architecture>(of->architecture());
  options.coupling = read_coupling(of.block(FIELD(virtual_coupling)));
  options.rendering = static_cast<RenderingAlgorithm>(of->rendering());
  options.force_scale = of->force_scale();
  options.motion_scale = of->motion_scale();
  options.registration = read_registration(of.block(FIELD(registration)));
  options.engage = Seconds{of->engage_s()};
  options.hold_after = Seconds{of->hold_after_s()};
  options.release_after = Seconds{of->release_after_s()};
  if (!(options.hold_after < options.release_after))
    of.refuse(FIELD(hold_after_s),
              fmt::format("be < {} ({})", of.path_of("release_after_s"), options.release_after.si()));
  const bool live = use == SceneFor::live;
  const Block device = of.block(FIELD(device_limits)), robot = of.block(FIELD(robot_limits));
  options.device_limits = read_limits(device, live ? kDeviceDefaults : PortLimits{});
  options.robot_limits = read_limits(robot, live ? kRobotDefaults : PortLimits{});
  if (device->has_set_point_step_m())
    device.fail(fmt::format("{} is given, but a device has no set point; it is of control.robot_limits",
                            device.path_of("set_point_step_m")));
  if (options.architecture == Architecture::render && of->has_robot_limits())
    of.fail("control.robot_limits is given, but control.architecture is RENDER: there is no robot");
  options.plugin.waits = use == SceneFor::laboratory;
  read_passivity(of, options);
  return options;
}

std::vector<schema::Control> scheduled(const schema::Control& control) {
  std::vector<schema::Control> all;
  schema::Control now = control;
  now.clear_schedule();
  for (const schema::Switch& each : control.schedule()) {
    if (each.has_architecture()) now.set_architecture(each.architecture());
    // A method takes the place of layers that were named, and the other way round.
    if (each.passivity().has_method()) {
      now.mutable_transparency()->clear_layer();
      now.mutable_passivity()->clear_layer();
    }
    if (each.passivity().has_layer() || each.transparency().has_layer()) now.mutable_passivity()->clear_method();
    now.mutable_passivity()->MergeFrom(each.passivity());
    now.mutable_transparency()->MergeFrom(each.transparency());
    all.push_back(now);
  }
  return all;
}

std::vector<ScheduledControl> read_schedule(const Block<schema::Control>& of, SceneFor use) {
  std::vector<ScheduledControl> entries;
  const std::vector<schema::Control> controls = scheduled(of.message());
  double last_s = 0.0;
  for (const auto& entry : of.blocks(FIELD(schedule))) {
    const double at_s = GIVEN(entry, at_s).value_or(std::numeric_limits<double>::infinity());
    if (!entry->has_architecture() && !entry->has_passivity() && !entry->has_transparency())
      of.fail(fmt::format("{} changes nothing; it must name architecture, passivity or transparency", entry.path()));
    if (entry->has_at_s() && !(at_s > last_s)) entry.refuse(FIELD(at_s), "be > 0 and later than the entry before");
    if (entry->has_at_s()) last_s = at_s;
    entries.push_back({at_s, read_control(Block{of.context(), controls[entries.size()], entry.path()}, use)});
    for (const Architecture a : {entries.back().control.architecture, static_cast<Architecture>(of->architecture())})
      if (a == Architecture::render || a == Architecture::uncontrolled)
        entry.fail(fmt::format("{} is given with {}; a schedule needs a link before and after a switch", entry.path(),
                               to_string(a)));
  }
  return entries;
}

std::string to_string(Architecture architecture) {
  return schema::Control::Architecture_Name(static_cast<schema::Control::Architecture>(architecture));
}

}  // namespace twoport
