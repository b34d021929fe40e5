#include <limits>
#include <numbers>

#include "common/scene/blocks.h"
#include "common/scene/names.h"

namespace twoport {
namespace {

static_assert(same_number(Architecture::render, schema::Control::RENDER) &&
              same_number(Architecture::position_force, schema::Control::POSITION_FORCE) &&
              same_number(Architecture::position_measured_force, schema::Control::POSITION_MEASURED_FORCE) &&
              same_number(Architecture::position_position, schema::Control::POSITION_POSITION) &&
              same_number(Architecture::uncontrolled, schema::Control::UNCONTROLLED) &&
              same_number(Architecture::uncontrolled, schema::Control::Architecture_MAX));
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
static_assert(same_number(WaveReceiverRule::energy_limited, schema::WaveVariables::ENERGY_LIMITED) &&
              same_number(WaveReceiverRule::hold, schema::WaveVariables::HOLD) &&
              same_number(WaveReceiverRule::zero, schema::WaveVariables::ZERO) &&
              same_number(WaveReceiverRule::zero, schema::WaveVariables::Receiver_MAX));

CouplingOptions read_coupling(const Block<schema::VirtualCoupling>& of) {
  of.only_with_rotation(FIELD(rotational_stiffness_n_m_per_rad), FIELD(rotational_damping_n_m_s_per_rad));
  return {
      .stiffness_n_per_m = of.number(FIELD(stiffness_n_per_m), kNotNegative),
      .damping_n_s_per_m = of.number(FIELD(damping_n_s_per_m), kNotNegative),
      .rotational_stiffness_n_m_per_rad = of.number(FIELD(rotational_stiffness_n_m_per_rad), kNotNegative),
      .rotational_damping_n_m_s_per_rad = of.number(FIELD(rotational_damping_n_m_s_per_rad), kNotNegative),
      .catch_up_m_per_s = of.number(FIELD(catch_up_m_per_s), kNotNegative),
      .drift_compensation = of.flag(FIELD(drift_compensation)),
  };
}

RegistrationOptions read_registration(const Block<schema::Registration>& of) {
  RegistrationOptions options;
  options.absolute = of.choice<schema::Registration::Mode>(FIELD(mode)) == schema::Registration::ABSOLUTE;
  if (of.has(FIELD(rotation))) {
    if (of.dof() == 1)
      of.fail(fmt::format("{} is given, but dof is 1; a rotation needs dof 3 or 6", of.path_of("rotation")));
    const Numbers q = of.list(FIELD(rotation), Count{4, 4, ""});
    options.rotation = Eigen::Quaterniond{q[0], q[1], q[2], q[3]};
    if (std::abs(options.rotation.norm() - 1.0) > 1e-3) of.refuse(FIELD(rotation), "be of length 1");
    options.rotation.normalize();
  }
  if (of.has(FIELD(position_m))) {
    if (!options.absolute)
      of.fail(fmt::format("{} is given, but {} is OFFSET; it needs ABSOLUTE", of.path_of("position_m"),
                          of.path_of("mode")));
    options.position_m = vector<3>(of.list(FIELD(position_m), of.context().point()));
  }
  return options;
}

/// The one-port controller of a method's name; none for a method that brings its own.
Method controller_of(schema::Passivity::Method method) {
  if (method == schema::Passivity::CLASSIC) return Method::classic;
  if (method == schema::Passivity::FORCE_PROJECTED) return Method::force_projected;
  if (method == schema::Passivity::METRIC_DAMPING) return Method::metric_damping;
  if (method == schema::Passivity::FORCE_CONE) return Method::force_cone;
  return Method::none;
}

/// The options of single methods. Those of a method that is not in use are checked all the same.
void read_method_options(const Block<schema::Passivity>& of, ControlOptions& options) {
  const Block fixed = of.block(FIELD(fixed_damping));
  fixed.only_with_rotation(FIELD(rotational_damping_n_m_s_per_rad), FIELD(rotational_stiffness_n_m_per_rad));
  options.fixed_damping = {
      .damping_n_s_per_m = fixed.number_if_given(FIELD(damping_n_s_per_m), kNotNegative),
      .stiffness_n_per_m = fixed.number_if_given(FIELD(stiffness_n_per_m), kNotNegative),
      .rotational_damping_n_m_s_per_rad = fixed.number_if_given(FIELD(rotational_damping_n_m_s_per_rad), kNotNegative),
      .rotational_stiffness_n_m_per_rad = fixed.number_if_given(FIELD(rotational_stiffness_n_m_per_rad), kNotNegative),
  };
  const Block wave = of.block(FIELD(wave_variables));
  wave.only_with_rotation(FIELD(rotational_impedance_n_m_s_per_rad));
  options.wave_variables = {
      .impedance_n_s_per_m = wave.number_if_given(FIELD(impedance_n_s_per_m), kPositive),
      .rotational_impedance_n_m_s_per_rad = wave.number_if_given(FIELD(rotational_impedance_n_m_s_per_rad), kPositive),
      .receiver = wave.choice<WaveReceiverRule>(FIELD(receiver)),
      .position_correction_per_s = wave.number(FIELD(position_correction_per_s), kNotNegative),
  };
  const Block set_position = of.block(FIELD(set_position_modulation));
  set_position.only_with_rotation(FIELD(rotational_stiffness_n_m_per_rad), FIELD(rotational_damping_n_m_s_per_rad));
  options.set_position_modulation = {
      .stiffness_n_per_m = set_position.number_if_given(FIELD(stiffness_n_per_m), kNotNegative),
      .damping_n_s_per_m = set_position.number_if_given(FIELD(damping_n_s_per_m), kNotNegative),
      .rotational_stiffness_n_m_per_rad =
          set_position.number_if_given(FIELD(rotational_stiffness_n_m_per_rad), kNotNegative),
      .rotational_damping_n_m_s_per_rad =
          set_position.number_if_given(FIELD(rotational_damping_n_m_s_per_rad), kNotNegative),
      .energy_ceiling_j = set_position.number_if_given(FIELD(energy_ceiling_j), kNotNegative),
  };
  const Block tank = of.block(FIELD(energy_tank));
  options.energy_tank = {
      .desired_level_j = tank.number_if_given(FIELD(desired_level_j), kNotNegative),
      .level_gain_n_s_per_m_per_j = tank.number_if_given(FIELD(level_gain_n_s_per_m_per_j), kNotNegative),
      .transfer_per_s = tank.number_if_given(FIELD(transfer_per_s), kNotNegative),
  };
  const Block bounding = of.block(FIELD(energy_bounding));
  bounding.only_with_rotation(FIELD(rotational_damping_n_m_s_per_rad));
  options.energy_bounding = {
      .damping_n_s_per_m = bounding.number_if_given(FIELD(damping_n_s_per_m), kPositive),
      .rotational_damping_n_m_s_per_rad = bounding.number_if_given(FIELD(rotational_damping_n_m_s_per_rad), kPositive),
  };
  const Block channels = of.block(FIELD(four_channel));
  options.four_channel = {
      .reaction_force_observer = channels.flag(FIELD(reaction_force_observer)),
      .observer_bandwidth_rad_per_s = channels.number_if_given(FIELD(observer_bandwidth_rad_per_s), kPositive),
      .force_gain = channels.number_if_given(FIELD(force_gain), kNotNegative),
      .disturbance_observer = channels.flag(FIELD(disturbance_observer)),
  };
  options.internal_model = {.strict_two_port = of.block(FIELD(internal_model)).flag(FIELD(strict_two_port))};
  const Block fractal = of.block(FIELD(fractal_impedance));
  fractal.only_with_rotation(FIELD(rotational_stiffness_n_m_per_rad));
  options.fractal_impedance = {
      .stiffness_n_per_m = fractal.number_if_given(FIELD(stiffness_n_per_m), kNotNegative),
      .rotational_stiffness_n_m_per_rad =
          fractal.number_if_given(FIELD(rotational_stiffness_n_m_per_rad), kNotNegative),
  };
}

void read_passivity(const Block<schema::Passivity>& of, ControlOptions& options) {
  const bool rendering = options.architecture == Architecture::render;
  schema::Passivity::Method method = schema::Passivity::NONE;
  if (of.has(FIELD(method))) {
    method = of.choice<schema::Passivity::Method>(FIELD(method));
  } else if (!rendering && options.architecture != Architecture::uncontrolled) {
    schema::Passivity::Method_Parse(std::string{kDefaultMethod}, &method);
  }
  options.method_name = schema::Passivity::Method_Name(method);
  options.controller = {.method = controller_of(method),
                        .max_gain = of.number(FIELD(max_gain), kNotNegative),
                        .unilateral = of.flag(FIELD(unilateral)),
                        .predict = of.flag(FIELD(predict)),
                        .max_turn_rad = of.number(FIELD(max_turn_deg), kAcute) * std::numbers::pi / 180.0};
  if (const auto ms = of.number_if_given(FIELD(round_trip_ms), kDelay)) options.stated_round_trip = Seconds{*ms * 1e-3};
  options.observer = of.choice<ObserverRule>(FIELD(observer));
  options.accounts = of.choice<Accounts>(FIELD(accounts));
  // With several contact points f·v of the sum vanishes while single ones generate energy.
  if (!of.has(FIELD(accounts)) && rendering && options.rendering == RenderingAlgorithm::penalty && of.dof() == 6 &&
      method == schema::Passivity::FORCE_PROJECTED)
    options.accounts = Accounts::per_contact;
  options.reference_energy = of.flag(FIELD(reference_energy));
  // Absent: default_initial_energy, once the system is known.
  if (const auto j = of.number_if_given(FIELD(initial_energy_j), kNotNegative)) options.initial_energy = Energy{*j};

  read_method_options(of, options);

  if (rendering && options.controller.method == Method::none && method != schema::Passivity::NONE)
    of.refuse(FIELD(method),
              "be NONE, CLASSIC, FORCE_PROJECTED, METRIC_DAMPING or FORCE_CONE where control.architecture is RENDER: "
              "it needs a link");
  if (!rendering &&
      (options.controller.method == Method::metric_damping || options.controller.method == Method::force_cone))
    of.refuse(FIELD(method), "be another value over a link: this one needs control.architecture RENDER");
  // Only a rendering knows its contacts and their potential.
  if (!rendering && options.accounts != Accounts::total)
    of.refuse(FIELD(accounts), "be TOTAL over a link; other accounts need control.architecture RENDER");
  if (of.dof() != 6 && options.accounts == Accounts::translation_rotation)
    of.refuse(FIELD(accounts),
              fmt::format("be another value: TRANSLATION_ROTATION needs dof 6, and dof is {}", of.dof()));
}

PortLimits read_limits(const Block<schema::Limits>& of, const PortLimits& absent) {
  of.only_with_rotation(FIELD(torque_n_m), FIELD(angular_speed_rad_per_s));
  return {.force_n = of.number_or(FIELD(force_n), kPositive, absent.force_n),
          .torque_n_m = of.number_or(FIELD(torque_n_m), kPositive, absent.torque_n_m),
          .force_rate_n_per_s = of.number_or(FIELD(force_rate_n_per_s), kPositive, absent.force_rate_n_per_s),
          .power_w = of.number_or(FIELD(power_w), kPositive, absent.power_w),
          .speed_m_per_s = of.number_or(FIELD(speed_m_per_s), kPositive, absent.speed_m_per_s),
          .angular_speed_rad_per_s =
              of.number_or(FIELD(angular_speed_rad_per_s), kPositive, absent.angular_speed_rad_per_s),
          .set_point_step_m = of.number_or(FIELD(set_point_step_m), kPositive, absent.set_point_step_m),
          .workspace_m = of.number_or(FIELD(workspace_m), kPositive, absent.workspace_m)};
}

}  // namespace

ControlOptions read_control(const Block<schema::Control>& of, SceneFor use) {
  ControlOptions options;
  options.architecture = of.choice<Architecture>(FIELD(architecture));
  options.coupling = read_coupling(of.block(FIELD(virtual_coupling)));
  options.rendering = of.choice<RenderingAlgorithm>(FIELD(rendering));
  options.force_scale = of.number(FIELD(force_scale), kPositive);
  options.motion_scale = of.number(FIELD(motion_scale), kPositive);
  options.registration = read_registration(of.block(FIELD(registration)));
  options.engage = Seconds{of.number(FIELD(engage_s), kMoment)};
  options.hold_after = Seconds{of.number(FIELD(hold_after_s), kSpan)};
  options.release_after = Seconds{of.number(FIELD(release_after_s), kSpan)};
  if (!(options.hold_after < options.release_after))
    of.refuse(FIELD(hold_after_s),
              fmt::format("be < {} ({})", of.path_of("release_after_s"), options.release_after.si()));
  const bool live = use == SceneFor::live;
  const Block device = of.block(FIELD(device_limits)), robot = of.block(FIELD(robot_limits));
  options.device_limits = read_limits(device, live ? kDeviceDefaults : PortLimits{});
  options.robot_limits = read_limits(robot, live ? kRobotDefaults : PortLimits{});
  if (device.has(FIELD(set_point_step_m)))
    device.fail(fmt::format("{} is given, but a device has no set point; it is of control.robot_limits",
                            device.path_of("set_point_step_m")));
  if (options.architecture == Architecture::render && of.has(FIELD(robot_limits)))
    of.fail("control.robot_limits is given, but control.architecture is RENDER: there is no robot");
  read_passivity(of.block(FIELD(passivity)), options);
  return options;
}

std::vector<ScheduledControl> read_schedule(const Block<schema::Control>& of, SceneFor use) {
  std::vector<ScheduledControl> entries;
  schema::Control control = of.message();
  control.clear_schedule();
  double last_s = 0.0;
  for (const auto& entry : of.blocks(FIELD(schedule))) {
    const double at_s = entry.number_or(FIELD(at_s), kNotNegative, std::numeric_limits<double>::infinity());
    if (!entry.has(FIELD(architecture)) && !entry.has(FIELD(passivity)))
      of.fail(fmt::format("{} changes nothing; it must name architecture or passivity", entry.path()));
    if (entry.has(FIELD(at_s)) && !(at_s > last_s)) entry.refuse(FIELD(at_s), "be > 0 and later than the entry before");
    if (entry.has(FIELD(at_s))) last_s = at_s;
    if (entry.has(FIELD(architecture))) control.set_architecture(entry.message().architecture());
    control.mutable_passivity()->MergeFrom(entry.message().passivity());
    entries.push_back({at_s, read_control(Block{of.context(), control, entry.path()}, use)});
    for (const Architecture a : {entries.back().control.architecture, of.choice<Architecture>(FIELD(architecture))})
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
