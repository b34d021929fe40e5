#pragma once

#include <algorithm>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "common/base/built_for.h"
#include "common/hardware/mounted.h"
#include "common/hardware/virtual_robot.h"
#include "common/link/zero_requests.h"
#include "common/mesh/triangle_mesh.h"
#include "common/method/catalogue.h"
#include "common/platform/keys.h"
#include "common/platform/live_gripper.h"
#include "common/platform/live_link.h"
#include "common/platform/live_run.h"
#include "common/platform/log.h"
#include "master/live_page.h"
#include "master/master_node.h"
#include "master/program.h"
#include "master/with_device.h"

namespace twoport {

inline constexpr int kStartAgain = 4;  ///< exit status: the page asks for a run from the beginning

/// The common part of both masters for run_live.
template <int N>
struct Master {
  static constexpr int kSize = N;
  static constexpr Side kSide = Side::master;
  static constexpr const char* kName = "master";
  using Clock = MasterClock;
  using Hardware = Device<N>;
  using Sample = DeviceSample<N>;

  Master(const Scene& s, Device<N>& device, const std::string& choice, LivePage* live_page)
      : scene{s},
        hardware{device},
        page{live_page},
        first{first_reading<MasterClock>(device, Seconds{1.0 / s.master_rate_hz}, choice)} {}

  [[nodiscard]] double rate_hz() const { return scene.master_rate_hz; }
  [[nodiscard]] static bool serves() { return false; }
  [[nodiscard]] static bool judged() { return true; }
  [[nodiscard]] Metrics<N> metrics(Energy initial, KnownParts known) const {
    const DeviceTruth<N>* truth = hardware.truth();
    // The end of a person's path is not known.
    const double rests_from_s = truth ? truth->path_ends_s : std::numeric_limits<double>::quiet_NaN();
    if (truth) known.rests = rests(scene);
    const bool link = scene.control.architecture != Architecture::render;
    known.account = keeps_account(scene.control, scene.schedule);
    // Of a real device nobody knows the friction; what the slave dissipates is not said here.
    return Metrics<N>{{.rate_hz = scene.master_rate_hz,
                       .duration_s = scene.duration_s,
                       .quiet_from_s = rests_from_s,
                       .initial_energy_j = initial.si(),
                       .controller = has_controller(scene),
                       .unseen = link,
                       .coarse = !truth || is_coarse(scene),
                       .link = link,
                       .noise = truth && link ? noise_motion(scene) : NoiseMotion{},
                       .of_slave = !link},
                      1.0,
                      std::move(known),
                      ToolView<N>{scene}};
  }

  void tell_end(const Summary& s) const {
    if (page) page->end(s);
  }

  /// Values of the device and the node. `observed` is the node's account of the port, without E(0).
  template <class Output>
  [[nodiscard]] Row<N> row_of(double t_s, const Sample& sample, const Output& out, Energy observed) const noexcept {
    const DeviceTruth<N>* truth = hardware.truth();
    return {.t_s = t_s,
            .master_x = truth ? truth->x : sample.x,
            .master_v = truth ? truth->v : sample.v,
            .master_f = out.command,
            .master_f_wanted = out.wanted,
            .env_f = -out.wanted,
            .master_energy_j = (truth ? truth->port_energy : observed).si(),
            .observed_energy_j = observed.si(),
            .undissipated_j = out.undissipated.si(),
            .dissipated_j = out.dissipated.si(),
            .mode = Mode::coupled,
            .reference = out.wanted,
            .coupled = true};
  }
  /// The applied force.
  static void complete(Row<N>& row, const Sample& next) noexcept { row.master_f = next.applied; }

  const Scene& scene;
  Device<N>& hardware;
  LivePage* page;  ///< null: none
  Sample first;
};

/// A reading that indicates no contact shows no force.
template <int N>
Force<N> without_noise_of_free_space(const Force<N>& reading) noexcept {
  typename Force<N>::Vector f = reading.vec();
  if (!senses_contact(reading)) f.template head<kAxes<N>>().setZero();
  return Force<N>{f};
}

/// The values of a master over a link: `row` is of the device and the node, `slave` what is known of the other side.
template <int N>
void add_slave(Row<N>& row, const PeerState<N>& slave, Mode mode, const Registration<N>& registration) noexcept {
  row.slave_x = slave.newest.x;
  row.slave_v = slave.newest.v;
  row.slave_f = slave.newest.f_coupling;
  row.env_f = -slave.newest.f_environment;
  row.position_error = slave.newest.position_error;
  row.mode = mode;
  // Of the robot all is as old as the newest report.
  row.reference = registration.to_master(without_noise_of_free_space(slave.newest.f_environment));
  row.ahead = -slave.newest.position_error;
  row.following = slave.has_report && slave.newest.mode == Mode::coupled;
  row.coupled = row.following && mode == Mode::coupled;
  row.touching = mode == Mode::coupled && senses_contact(slave.newest.f_environment);
}

/// The gripper of the handle, for LiveGripper.
template <int One>
struct GripperMaster : Master<One> {
  using Output = typename MasterNode<One>::Output;
  using typename Master<One>::Sample;

  GripperMaster(const Scene& s, std::unique_ptr<Device<One>> device, const std::string& choice)
      : Master<One>{s, *device, choice + ", gripper", nullptr}, owned{std::move(device)}, node{s.control} {}

  [[nodiscard]] Metrics<One> metrics() const {
    return Master<One>::metrics(this->scene.control.initial_energy, {.robot_energy = false});
  }
  [[nodiscard]] Row<One> row(double t_s, const Sample& sample, const Output& out,
                             const PeerState<One>& slave) const noexcept {
    Row<One> row = this->row_of(t_s, sample, out, node.observed());
    add_slave(row, slave, out.mode, node.worlds());
    return row;
  }

  std::unique_ptr<Device<One>> owned;
  MasterNode<One> node;
};

/// A virtual environment on the device, without a link: run_render.h, compiled in render_N.cc. Returns the exit status.
template <int N>
int run_render(const Scene& scene, MountedDevice<N>& device, const LiveArguments& arguments, LivePage* page,
               spdlog::logger& log);

/// A slave at the other end of a link.
template <int N>
struct LinkMaster : Master<N> {
  using Gripper = GripperOf<GripperMaster<1>, N>;

  /// `of_gripper`: the scene of the gripper, completed from `gripper_device`; both null: there is none.
  LinkMaster(const Scene& s, MountedDevice<N>& device, const LiveArguments& a, LivePage* live_page,
             const Scene* of_gripper, std::unique_ptr<Device<1>> gripper_device)
      : Master<N>{s, device, a.hardware, live_page},
        mounted{device},
        link{Side::master, s, a, live_page != nullptr},
        node{s.control, s.schedule},
        switch_times{s.schedule},
        switched_by_hand{switches_by_hand()},
        zeroed_by_hand{zeroings_by_hand()} {
    if constexpr (built_for(1))
      if (of_gripper)
        gripper = std::make_unique<Gripper>(link.mail().transport(), limits_of_slave_reports(of_gripper->control),
                                            of_gripper->transmission_to_master, *of_gripper, std::move(gripper_device),
                                            a.hardware);
  }
  [[nodiscard]] bool lets_go() const noexcept { return mounted.lets_go(); }

  [[nodiscard]] Metrics<N> metrics() const {
    return Master<N>::metrics(this->scene.control.initial_energy, {.robot_energy = false});
  }
  Row<N> row(std::int64_t, double t_s, const DeviceSample<N>& sample,
             const typename MasterNode<N>::Output& out) noexcept {
    const PeerState<N>& slave = link.mail().known();
    Row<N> row = this->row_of(t_s, sample, out, node.observed());
    row.figures = out.figures;
    add_slave(row, slave, out.mode, node.worlds());
    return row;
  }
  void fill(Summary& s, bool) {
    link.fill(s, node.mode());
    if (!this->scene.schedule.empty()) s.set_switches(node.epoch());
    say_not_displayed(this->scene.control, node.not_displayed(), s);
  }
  /// At its time, and upon SIGUSR1.
  void switch_when_due(double t_s) noexcept {
    while (switch_times.due(t_s, node.epoch())) node.switch_to_next();
    for (const unsigned asked = switches_by_hand(); switched_by_hand != asked; ++switched_by_hand)
      node.switch_to_next();
  }

  /// To one of the configurations; the slave follows to that of the newest epoch.
  void switch_to(int wanted) noexcept {
    const auto all = static_cast<std::uint32_t>(this->scene.schedule.size() + 1);
    const auto to = static_cast<std::uint32_t>(wanted);
    if (to >= all) return;
    while (node.epoch() % all != to) node.switch_to_next();
  }
  /// Asks the slave for another stiffness and friction of one surface; the others stay as they were asked for last.
  void change_surface(const PageCommand& c) noexcept {
    EnvironmentMessage& r = environment_request;
    const EnvironmentMessage& there = link.mail().transport().heard_environment();
    const auto which = static_cast<std::size_t>(c.which);
    if (which >= there.count) return;
    const bool refused = there.answer == EnvironmentAnswer::out_of_range && there.number == r.number;
    if (r.count != there.count || refused) r.count = there.count, r.surface = there.surface;
    r.surface[which] = {c.number[0], there.surface[which].friction < 0.0 ? -1.0 : c.number[1]};
    ++r.number;
  }
  [[nodiscard]] const SensorRest& sensor() const noexcept { return zero.rest(); }
  void begin_tick() noexcept {
    if (const unsigned asked = zeroings_by_hand(); std::exchange(zeroed_by_hand, asked) != asked) zero.ask();
    if (this->page) take_commands();
    if (!this->page && !zero.is_used()) [[likely]]
      return;
    auto& transport = link.mail().transport();
    zero.step(transport.heard_environment(), environment_request);
    transport.say_environment(environment_request);
  }
  void take_commands() noexcept {
    this->page->take_commands([&](const PageCommand& c) {
      if (c.kind == PageCommand::Kind::network)
        link.adjust(c.which == 0, {1e-3 * c.number[0], 1e-3 * c.number[1], c.number[2]});
      if (c.kind == PageCommand::Kind::method) switch_to(c.which);
      if (c.kind == PageCommand::Kind::surface) change_surface(c);
      if (c.kind == PageCommand::Kind::zero) zero.ask();
      change_handle(mounted, c);
    });
  }
  void end_tick(Duration now, Duration late, const DeviceSample<N>& sample,
                const typename MasterNode<N>::Output& out) noexcept {
    if (!this->page) [[likely]]
      return;
    if constexpr (built_for(1))
      if (gripper)
        this->page->note_gripper(gripper->sample().x, gripper->known(), gripper->out().command,
                                 gripper->node().observed());
    this->page->note_environment(link.mail().transport().heard_environment(), node.worlds());
    this->page->note_sensor(zero.rest());
    this->page->note_handle(mounted, sample.x);
    this->page->show(now, late, sample, out, node.observed(), &link.mail().known(), link.mail().counts(),
                     node.limit_counts() + link.limit_counts(), node.epoch());
  }

  MountedDevice<N>& mounted;
  LiveLink<N> link;
  MasterNode<N> node;
  std::unique_ptr<Gripper> gripper;
  SwitchTimes switch_times;
  unsigned switched_by_hand, zeroed_by_hand;
  ZeroRequests zero;
  EnvironmentMessage environment_request{
      .number = 1};  ///< with a page, and from the first request to zero the force sensor on
};

/// Of --page-world. Throws ConfigError.
template <int N>
std::optional<ShownShapes> world_of_page(const Scene& scene, const LiveArguments& a, const Registry& hardware) {
  if (a.page_world.empty()) return {};
  if (a.page.empty()) throw ConfigError{"--page-world " + a.page_world + ": there is no --page"};
  const auto robot = hardware.robots.open<N>(a.page_world, scene, Seconds{1.0 / scene.slave_rate_hz});
  const auto* const in_world = dynamic_cast<const VirtualRobot<N>*>(robot.get());
  if (in_world == nullptr)
    throw ConfigError{"--page-world " + a.page_world +
                      ": has no world to show; mujoco:FILE.xml[,site=NAME][,key=NAME][,actuators=off] has"};
  const WorldPicture picture = in_world->picture();
  return ShownShapes{.meshes = {decimated(picture.still, kMostShownTriangles)},
                     .tool_parts = {decimated(picture.tool, kMostShownTriangles)}};
}

template <int N>
int run_master(const Scene& read, const LiveArguments& arguments, const Registry& hardware) {
  spdlog::logger log = make_log("master");
  const std::unique_ptr<LivePage> page = LivePage::wanted(arguments);
  const auto device = std::make_unique<MountedDevice<N>>(
      hardware.devices.open<N>(arguments.hardware, read, Seconds{1.0 / read.master_rate_hz},
                               page ? page->channel() : nullptr),
      arguments.is_playback() ? DeviceMount{} : read.device_mount);
  print_hints(read, arguments, device->truth() != nullptr);
  Scene scene = with_device(read, device->info());
  if (const std::string axes = axes_without_motor(scene.control); !axes.empty())
    log.info("the device has no motor along the axes {}: force and torque along them are not displayed", axes);
  std::unique_ptr<Device<1>> gripper;
  if (read.gripper) {
    gripper = mounted_gripper(*device, arguments.hardware);
    // Before the link is made, which compares the scenes of both sides: what a driver completes is none of the shared values.
    scene.gripper = std::make_shared<const Scene>(with_device(*read.gripper, gripper->info()));
  }
  std::optional<ShownShapes> world = world_of_page<N>(scene, arguments, hardware);
  if (page) page->serve(scene, arguments, device->info().name, std::move(world), log);
  const auto status = [&] {
    if constexpr (N != kJointPort)
      if (scene.control.architecture == Architecture::render)
        return run_render(scene, *device, arguments, page.get(), log);
    LinkMaster<N> side{scene, *device, arguments, page.get(), scene.gripper.get(), std::move(gripper)};
    return run_live(side, scene, arguments, log);
  }();
  return page && page->restarts() ? kStartAgain : status;
}

}  // namespace twoport
