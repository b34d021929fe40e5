#pragma once

#include <algorithm>
#include <memory>
#include <string>
#include <utility>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/coupling/layers.h"
#include "common/hardware/adjustable_environment.h"
#include "common/hardware/mounted.h"
#include "common/link/zero_requests.h"
#include "common/platform/keys.h"
#include "common/platform/live_gripper.h"
#include "common/platform/live_link.h"
#include "common/platform/live_run.h"
#include "common/platform/log.h"
#include "slave/program.h"
#include "slave/slave_node.h"

namespace twoport {

/// The rows of a slave, and its metrics.
template <int N>
class SlaveRows {
 public:
  static constexpr Side kSide = Side::slave;
  using Clock = SlaveClock;
  using Hardware = Robot<N>;
  using Sample = RobotSample<N>;
  using Output = typename SlaveNode<N>::Output;

  SlaveRows(const Scene& s, Robot<N>& robot, const std::string& choice)
      : scene{s}, hardware{robot}, node{s.control, s.schedule} {
    first_reading<SlaveClock>(robot, Seconds{1.0 / s.slave_rate_hz}, choice);
  }

  [[nodiscard]] Metrics<N> metrics() const {
    return Metrics<N>{{.rate_hz = scene.slave_rate_hz,
                       .duration_s = scene.duration_s,
                       .quiet_from_s = 0.0,
                       .link = true,
                       .of_master = false,
                       .at_robot = true,
                       .motion_scale = scene.control.motion_scale},
                      1.0,
                      {.stability = false, .hand = false},
                      ToolView<N>{scene}};
  }

  Row<N> row(double t_s, const Sample& sample, const Output& out, const PeerState<N>& peer) noexcept {
    const PortReport<N>& master = peer.newest;
    const RobotTruth<N>* truth = hardware.truth();
    const Position<N>* const tool = hardware.tool();
    const bool follows = out.mode == Mode::coupled;
    const Displacement<N> error = tool && follows ? node.position_error() + (*tool - sample.x) : node.position_error();
    if (has_moved_) into_robot_ += dot(f_, sample.x - x_);
    const Energy into_coupling = delivered_ - into_robot_;
    delivered_ = node.delivered();
    f_ = out.command.f;
    x_ = sample.x;
    has_moved_ = true;
    return {.t_s = t_s,
            .master_x = master.x,
            .master_v = master.v,
            .master_f = master.f,
            .master_f_wanted = master.f,
            .slave_x = tool ? *tool : sample.x,
            .slave_v = sample.v,
            .slave_f = out.command.f,
            .env_f = truth ? truth->f_environment : -sample.f_environment,
            .position_error = error,
            .slave_energy_j = node.delivered().si(),
            .dissipated_j = out.dissipated.si(),
            .mode = out.mode,
            .coupling_energy_j = into_coupling.si(),
            .ahead = -error,
            .touching = truth ? truth->touches : senses_contact(sample.f_environment),
            .coupled = follows && master.mode == Mode::coupled,
            .following = follows};
  }
  static void complete(Row<N>&, const Sample&) noexcept {}

  const Scene& scene;
  Robot<N>& hardware;
  SlaveNode<N> node;

 private:
  // Of the last row.
  Energy delivered_, into_robot_;
  Force<N> f_;
  Position<N> x_;
  bool has_moved_ = false;
};

/// The gripper of the robot, for LiveGripper.
template <int One>
struct GripperSlave : SlaveRows<One> {
  GripperSlave(const Scene& s, std::unique_ptr<Robot<One>> robot, const std::string& choice)
      : SlaveRows<One>{s, *robot, choice + ", gripper"}, owned{std::move(robot)} {}

  std::unique_ptr<Robot<One>> owned;
};

/// The slave for run_live.
template <int N>
struct Slave : SlaveRows<N> {
  static constexpr int kSize = N;
  static constexpr const char* kName = "slave";
  using Gripper = GripperOf<GripperSlave<1>, N>;
  using typename SlaveRows<N>::Sample;
  using typename SlaveRows<N>::Output;

  /// `of_gripper`: the scene of the gripper; it and `gripper_robot` are null where there is none.
  Slave(const Scene& s, MountedRobot<N>& robot, const LiveArguments& a, const Scene* of_gripper,
        std::unique_ptr<Robot<1>> gripper_robot)
      : SlaveRows<N>{s, robot, a.hardware},
        mounted{robot},
        environment{robot.environment()},
        zeroed_by_hand{zeroings_by_hand()},
        fixed_environment{a.fixed_environment},
        link{Side::slave, s, a} {
    if constexpr (built_for(1))
      if (of_gripper)
        gripper = std::make_unique<Gripper>(link.mail().transport(), limits_of_master_reports(of_gripper->control),
                                            of_gripper->transmission_to_slave, *of_gripper, std::move(gripper_robot),
                                            a.hardware);
  }

  [[nodiscard]] double rate_hz() const { return this->scene.slave_rate_hz; }
  /// Until the master ends.
  [[nodiscard]] bool serves() const { return this->node.mode() == Mode::coupled; }
  [[nodiscard]] static bool judged() { return false; }
  [[nodiscard]] bool lets_go() const noexcept { return mounted.lets_go(); }
  [[nodiscard]] const SensorRest& sensor() const noexcept { return mounted.sensor(); }
  void begin_tick() noexcept {
    if (const unsigned asked = zeroings_by_hand(); std::exchange(zeroed_by_hand, asked) != asked) mounted.zero_sensor();
    if (link.mail().transport().heard_environment().number > 0) [[unlikely]]
      answer_about_environment();
  }
  Row<N> row(std::int64_t, double t_s, const Sample& sample, const Output& out) noexcept {
    Row<N> row = SlaveRows<N>::row(t_s, sample, out, link.mail().known());
    if constexpr (N == kJointPort)
      if (environment != nullptr) {
        EnvironmentMessage state;
        environment->describe(state);
        std::ranges::copy(state.object_m, row.object.x.begin());
      }
    return row;
  }
  void fill(Summary& s, bool) {
    link.fill(s, this->node.mode());
    say_if_coupling_feeds(s, this->scene.control.initial_energy);
    if (const SensorRest& sensor = mounted.sensor(); sensor.drift_n >= 0.0 || sensor.answered > 0) {
      if (sensor.drift_n >= 0.0) s.set_sensor_drift_n(sensor.drift_n);
      s.set_sensor_zeroed(sensor.zeroed);
      s.set_sensor_zero_refused(sensor.answered - sensor.zeroed);
    }
    if (environment_changes == 0) return;
    EnvironmentMessage state;
    environment->describe(state);
    s.set_environment_changes(environment_changes);
    s.set_environment_changes_j(state.energy_j);
  }

  /// The master asks for the state of the environment, or for a change.
  void answer_about_environment() noexcept {
    auto& transport = link.mail().transport();
    const EnvironmentMessage& request = transport.heard_environment();
    if (session != transport.pairings()) session = transport.pairings(), taken = 0, refused = false;
    EnvironmentMessage state;
    if (environment == nullptr) {
      state.answer = EnvironmentAnswer::real;
    } else {
      if (!fixed_environment && request.number > taken && request.count > 0) {
        refused = !environment->adjust(request);
        environment_changes += refused ? 0 : 1;
      }
      environment->describe(state);
      if (fixed_environment) state.answer = EnvironmentAnswer::fixed, state.count = 0;
      if (refused && state.answer == EnvironmentAnswer::adjustable) state.answer = EnvironmentAnswer::out_of_range;
    }
    state.link_energy_j = -this->node.delivered().si();
    if (zero.hear(request, transport.pairings())) mounted.zero_sensor();
    zero.say(mounted.sensor(), state);
    state.number = taken = request.number;
    transport.say_environment(state);
  }

  MountedRobot<N>& mounted;
  AdjustableEnvironment* environment;
  unsigned zeroed_by_hand;
  ZeroAnswers zero;
  bool fixed_environment;
  std::uint64_t session = 0;
  std::uint32_t taken = 0;  ///< number of the newest request
  bool refused = false;
  std::uint32_t environment_changes = 0;
  LiveLink<N> link;
  std::unique_ptr<Gripper> gripper;
};

/// What would make the force sensor unnecessary for the method; empty: it needs none.
inline std::string replaces_force_sensor(const ControlOptions& o) {
  const auto replaces = transparency_layer(o).replaces_force_sensor;
  return replaces != nullptr ? std::string{replaces(o)} : std::string{};
}

/// Refuses controllers that need the force sensor which the robot lacks.
inline void check_without_force_sensor(const ControlOptions& o, const LiveArguments& arguments) {
  if (o.architecture == Architecture::position_measured_force)
    throw ConfigError(arguments.scene + ": control.architecture is POSITION_MEASURED_FORCE, but the robot \"" +
                      arguments.hardware + "\" has no force sensor; POSITION_FORCE needs none");
  if (!replaces_force_sensor(o).empty())
    throw ConfigError(arguments.scene + ": control.passivity.method is " + o.method_name + ", but the robot \"" +
                      arguments.hardware + "\" has no force sensor; with " + replaces_force_sensor(o) +
                      " it needs none");
}

template <int N>
int run_slave(const Scene& read, const LiveArguments& arguments, const Registry& hardware) {
  Scene scene = read;
  spdlog::logger log = make_log("slave");
  const auto robot = std::make_unique<MountedRobot<N>>(
      hardware.robots.open<N>(arguments.hardware, scene, Seconds{1.0 / scene.slave_rate_hz}),
      arguments.is_playback() ? RobotMount{} : scene.robot_mount);
  if (!robot->info().has_force_sensor) {
    check_without_force_sensor(scene.control, arguments);
    for (const ScheduledControl& entry : scene.schedule) check_without_force_sensor(entry.control, arguments);
  }
  scene.control.own_limits = robot->info().limits;
  if (const std::optional<Servo> servo = robot->info().servo) {
    const AdmittanceBody body{};
    scene.control.known.robot_mass_kg = body.mass_kg;
    scene.control.known.robot_inertia_kg_m2 = body.inertia_kg_m2;
    log.info(
        "the robot obeys positions only, {:.3g} ms late: a body of {:g} kg between coupling and robot yields to the "
        "force "
        "sensor; the energy account is of that body's port",
        1e3 * servo->behind().si(), body.mass_kg);
  }
  std::unique_ptr<Robot<1>> gripper;
  if (scene.gripper) {
    gripper = mounted_gripper(*robot, arguments.hardware);
    Scene of_gripper = *scene.gripper;
    if (!gripper->info().has_force_sensor) check_without_force_sensor(of_gripper.control, arguments);
    of_gripper.control.own_limits = gripper->info().limits;
    scene.gripper = std::make_shared<const Scene>(std::move(of_gripper));
  }
  print_hints(scene, arguments, false);  // the master's device is not seen from here
  Slave<N> side{scene, *robot, arguments, scene.gripper.get(), std::move(gripper)};
  return run_live(side, scene, arguments, log);
}

}  // namespace twoport
