#include "slave/program.h"

#include <limits>
#include <memory>
#include <string>

#include "common/base/check.h"
#include "common/hardware/mounted.h"
#include "common/method/four_channel/four_channel.h"
#include "common/method/internal_model/internal_model.h"
#include "common/method/model_mediated/model_mediated.h"
#include "common/platform/live_link.h"
#include "common/platform/live_run.h"
#include "common/platform/log.h"
#include "slave/slave_node.h"

namespace twoport {
namespace {

/// The slave for run_live.
template <int N>
struct Slave {
  static constexpr int kSize = N;
  static constexpr Side kSide = Side::slave;
  static constexpr const char* kName = "slave";
  using Clock = SlaveClock;
  using Hardware = Robot<N>;
  using Sample = RobotSample<N>;

  Slave(const Scene& s, Robot<N>& robot, const LiveArguments& a)
      : scene{s}, hardware{robot}, link{Side::slave, s, a}, node{s.control, s.schedule} {
    first_reading<SlaveClock>(robot, Seconds{1.0 / s.slave_rate_hz}, a.hardware);
  }

  [[nodiscard]] double rate_hz() const { return scene.slave_rate_hz; }
  /// Until the master ends.
  [[nodiscard]] bool serves() const { return node.mode() == Mode::coupled; }
  [[nodiscard]] static bool judged() { return false; }
  /// When the hand rests nobody says here.
  [[nodiscard]] Metrics<N> metrics() const {
    return Metrics<N>{{.rate_hz = scene.slave_rate_hz,
                       .duration_s = scene.duration_s,
                       .quiet_from_s = std::numeric_limits<double>::infinity(),
                       .link = true,
                       .of_master = false},
                      1.0,
                      {.stability = false, .hand = false}};
  }

  Row<N> row(std::int64_t, double t_s, const Sample& sample, const typename SlaveNode<N>::Output& out) noexcept {
    const PortReport<N>& master = link.mail().known().newest;
    const RobotTruth<N>* truth = hardware.truth();
    const bool follows = out.mode == Mode::coupled;
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
            .slave_x = sample.x,
            .slave_v = sample.v,
            .slave_f = out.command.f,
            .env_f = truth ? truth->f_environment : -sample.f_environment,
            .position_error = node.position_error(),
            .slave_energy_j = node.delivered().si(),
            .dissipated_j = out.dissipated.si(),
            .mode = out.mode,
            .coupling_energy_j = into_coupling.si(),
            .ahead = -node.position_error(),
            .touching = truth ? truth->touches : senses_contact(sample.f_environment),
            .coupled = follows && master.mode == Mode::coupled,
            .following = follows};
  }
  static void complete(Row<N>&, const Sample&) noexcept {}
  void fill(Summary& s, bool diverged) {
    link.fill(s, node.mode());
    if (!diverged) s.set_verdict("undecided: bounded at the slave; the master judges stability");
    say_if_coupling_feeds(s, scene.control.initial_energy);
  }

  const Scene& scene;
  Robot<N>& hardware;
  LiveLink<N> link;
  SlaveNode<N> node;

 private:
  // Of the last row.
  Energy delivered_, into_robot_;
  Force<N> f_;
  Position<N> x_;
  bool has_moved_ = false;
};

/// What would make the force sensor unnecessary for the method; empty: it needs none.
std::string replaces_force_sensor(const ControlOptions& o) {
  const bool estimates_surface =
      o.method_name == InternalModelControl::kNames[0] || o.method_name == ModelMediated::kNames[0];
  if (estimates_surface && o.architecture != Architecture::position_position)
    return "control.architecture POSITION_POSITION";
  if (o.method_name == FourChannel::kNames[0] && !o.four_channel.reaction_force_observer)
    return "control.passivity.four_channel.reaction_force_observer";
  return {};
}

/// Refuses controllers that need the force sensor which the robot lacks.
void check_without_force_sensor(const ControlOptions& o, const LiveArguments& arguments) {
  if (o.architecture == Architecture::position_measured_force)
    throw ConfigError(arguments.scene + ": control.architecture is POSITION_MEASURED_FORCE, but the robot \"" +
                      arguments.hardware + "\" has no force sensor; POSITION_FORCE needs none");
  if (!replaces_force_sensor(o).empty())
    throw ConfigError(arguments.scene + ": control.passivity.method is " + o.method_name + ", but the robot \"" +
                      arguments.hardware + "\" has no force sensor; with " + replaces_force_sensor(o) +
                      " it needs none");
}

template <int N>
int run(Scene scene, const LiveArguments& arguments, const Registry& hardware) {
  spdlog::logger log = make_log("slave");
  const std::unique_ptr<Robot<N>> robot = std::make_unique<MountedRobot<N>>(
      hardware.robots.open<N>(arguments.hardware, scene, Seconds{1.0 / scene.slave_rate_hz}),
      arguments.is_playback() ? RobotMount{} : scene.robot_mount);
  if (!robot->info().has_force_sensor) {
    check_without_force_sensor(scene.control, arguments);
    for (const ScheduledControl& entry : scene.schedule) check_without_force_sensor(entry.control, arguments);
  }
  scene.control.own_limits = robot->info().limits;
  print_hints(scene, arguments, false);  // the master's device is not seen from here
  Slave<N> side{scene, *robot, arguments};
  return run_live(side, scene, arguments, log);
}

}  // namespace

int slave_program(int argc, char** argv, const Registry& hardware) {
  const auto body = [&](const Scene& scene, const LiveArguments& arguments) {
    if (scene.control.architecture == Architecture::render)
      throw ConfigError(arguments.scene +
                        ": control.architecture is RENDER, which has no slave; run twoport-master alone");
    return dispatch_dof(scene, [&]<int N>() { return run<N>(scene, arguments, hardware); });
  };
  return live_program(argc, argv, Side::slave, hardware.robots.lines(), body);
}

}  // namespace twoport
