#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>

#include "common/coupling/joint_tool.h"
#include "common/coupling/registration.h"
#include "common/hardware/device.h"
#include "common/hardware/mounted.h"
#include "common/link/mailbox.h"
#include "common/page/channel.h"
#include "common/runtime/modes.h"
#include "common/safety/limits.h"
#include "common/scene/scene.h"

namespace twoport {

/// Clutch, locks and scales, from the page; other commands change nothing. Joints have none: M(q) is needed where the leader is.
template <int N>
void change_handle(MountedDevice<N>& device, const PageCommand& c) noexcept {
  if constexpr (N == kJointPort) return;
  HandControls to = device.controls();
  switch (c.kind) {
    case PageCommand::Kind::clutch:
      to.clutched = c.which != 0;
      break;
    case PageCommand::Kind::lock:
      to.locked = static_cast<std::uint32_t>(c.which);
      break;
    case PageCommand::Kind::scale:
      to.motion = c.number[0];
      to.force = c.number[1];
      break;
    case PageCommand::Kind::rehome:
      return device.rehome();
    default:
      return;
  }
  device.control(to);
}

/// What the page is shown of a master's ticks, and the commands of the page to them. Nothing here waits, allocates, locks or logs.
class PageSamples {
 public:
  static constexpr double kSampleHz = 500.0;

  [[nodiscard]] PageChannel* channel() noexcept { return &channel_; }

  /// Before the first tick.
  void begin(const Scene& scene) {
    every_ = std::max<std::int64_t>(1, std::llround(scene.master_rate_hz / kSampleHz));
    if (scene.joints == 0) return;
    tools_.emplace(scene);
    std::ranges::copy(scene.device->arm->joint_position_rad, next_.leader_rad.begin());
    std::ranges::copy(scene.robot->arm->joint_position_rad, next_.joint_rad.begin());
    if (scene.object) std::ranges::copy(scene.object->position_m, next_.object_x_m.begin());
  }

  /// Calls apply(command) for each command that has arrived: network, surface, method.
  template <class Apply>
  void take_commands(Apply apply) noexcept {
    PageCommand command;
    while (channel_.commands.try_pop(command)) apply(command);
  }

  /// Before show(): the gripper, under the force `command`; `observed` by its account.
  void note_gripper(const Position<1>& hand, const PeerState<1>& robot, const Force<1>& command,
                    Energy observed) noexcept {
    next_.gripper_hand_m = hand.translation()[0];
    next_.gripper_robot_m = robot.newest.x.translation()[0];
    next_.gripper_felt_n = -command[0];
    next_.gripper_object_n = robot.newest.f_environment[0];
    next_.gripper_energy_j = observed.si();
  }

  /// Before show(): clutch, locks and scales.
  template <int N>
  void note_handle(const MountedDevice<N>& device, const Position<N>& x) noexcept {
    if constexpr (N == kJointPort) return;
    const ModulatedTransformer<N>* t = device.transformer();
    put(t ? t->hand() : x, next_.handle_x_m, next_.handle_attitude);
    if (t == nullptr) return;
    for (int i = 0; i < N; ++i) felt_share_[static_cast<std::size_t>(i)] = t->felt_share(i);
    next_.clutched = t->rehomes() ? 2.0 : t->closed() ? 1.0 : 0.0;
    next_.locked = static_cast<double>(t->controls().locked);
    next_.motion = t->controls().motion;
    next_.force = t->controls().force;
  }

  /// Before show(): what the slave has said of its environment and robot.
  template <int N>
  void note_environment(const EnvironmentMessage& e, const Registration<N>& registration) noexcept {
    environment_ = e;
    next_.robot_port_j = registration.to_master(Energy{e.link_energy_j}).si();
    if constexpr (N != kJointPort) next_.joint_rad = e.joint_rad;
    if (e.has_object) next_.object_x_m = e.object_m;
  }

  /// Before show(): the robot's force sensor, and the requests to zero it.
  void note_sensor(const SensorRest& sensor) noexcept {
    next_.sensor_drift_n = sensor.drift_n;
    next_.zero_answer = static_cast<double>(sensor.answer);
    next_.zero_asked = sensor.asked ? 1.0 : 0.0;
  }

  /// Of every tick. `peer`: null without a link. `from_slave`: packets. `epoch`: of the method.
  template <int N, class Output>
  void show(Duration now, Duration late, const DeviceSample<N>& device, const Output& out, Energy observed,
            const PeerState<N>* peer, const PacketCounts& from_slave, const LimitCounts& limits,
            std::uint32_t epoch) noexcept {
    late_ = std::max(late_, late);
    dissipated_j_ += out.dissipated.si();
    if (++tick_ % every_ != 0) return;
    PageSample& s = next_;
    s.t_s = to_seconds(now).si();
    typename Force<N>::Vector felt = -out.command.vec();
    for (int i = 0; i < N; ++i) felt[i] *= felt_share_[static_cast<std::size_t>(i)];
    if constexpr (N == kJointPort) {
      put_tools(device, Force<N>{felt}, -out.wanted, *peer);
    } else {
      put(device.x, s.hand_x_m, s.hand_attitude);
      put(device.v, s.hand_v_m_per_s);
      put(Force<N>{felt}, s.felt_n, &s.felt_n_m);
      put(-out.wanted, s.unlimited_n, nullptr);
    }
    if constexpr (requires { out.mode; }) {
      s.mode = static_cast<double>(out.mode);
    } else {
      s.mode = static_cast<double>(Mode::coupled);
    }
    s.slave_mode = s.mode;
    if (peer != nullptr) {
      if constexpr (N != kJointPort) {
        const PortReport<N>& r = peer->newest;
        put(r.x, s.robot_x_m, s.robot_attitude);
        put(r.v, s.robot_v_m_per_s);
        put(r.f_environment, s.environment_n, &s.environment_n_m);
        put(r.f_coupling, s.coupling_n, nullptr);
        for (int i = 0; i < std::min(N, 3); ++i) s.behind_m[static_cast<std::size_t>(i)] = r.position_error[i];
      }
      s.slave_mode = static_cast<double>(peer->heard.mode);
      s.robot_energy_j = peer->energy_in_j;
      const Duration round_trip = peer->round_trip();
      s.round_trip_ms = round_trip >= Duration{0} ? 1e3 * to_seconds(round_trip).si() : -1.0;
      s.report_age_ms = peer->has_report ? 1e3 * to_seconds(now - peer->received_at).si() : -1.0;
      s.silence_ms = peer->heard.sequence > 0 ? 1e3 * to_seconds(now - peer->heard.at).si() : -1.0;
      s.received = static_cast<double>(from_slave.received);
      s.lost = static_cast<double>(from_slave.lost);
      s.stale = static_cast<double>(from_slave.stale);
    } else {
      // Under RENDER the handle itself touches the environment.
      s.robot_x_m = s.hand_x_m;
      s.robot_attitude = s.hand_attitude;
      put(out.wanted, s.environment_n, &s.environment_n_m);
    }
    s.hand_energy_j = observed.si();
    s.dissipated_j = dissipated_j_;
    s.deficit_j = out.undissipated.si();
    if constexpr (requires { out.figures; }) s.layer_figures = out.figures;
    s.late_us = 1e6 * to_seconds(late_).si();
    s.limits = 0.0;
    for (std::size_t i = 0; i < kLimits; ++i)
      if (limits.of[i] != limits_.of[i]) s.limits += static_cast<double>(1u << i);
    limits_ = limits;
    s.epoch = static_cast<double>(epoch);
    s.held = channel_.pointer.held ? 1.0 : 0.0;
    s.environment_answer = static_cast<double>(environment_.answer);
    s.environment_energy_j = environment_.energy_j;
    for (std::size_t i = 0; i < environment_.surface.size(); ++i) {
      s.surface_stiffness_n_per_m[i] = environment_.surface[i].stiffness_n_per_m;
      s.surface_friction[i] = environment_.surface[i].friction;
    }
    late_ = Duration{0};
    channel_.samples.try_push(s);
  }

 private:
  template <int N>
  static void put(const Position<N>& x, PageSample::Vector& p, PageSample::Quaternion& q) noexcept {
    for (int i = 0; i < std::min(N, 3); ++i) p[static_cast<std::size_t>(i)] = x.translation()[i];
    if constexpr (N == 6) q = {x.attitude().w(), x.attitude().x(), x.attitude().y(), x.attitude().z()};
  }
  template <int N>
  static void put(const Velocity<N>& v, PageSample::Vector& to) noexcept {
    for (int i = 0; i < std::min(N, 3); ++i) to[static_cast<std::size_t>(i)] = v.vec()[i];
  }
  template <int N>
  static void put(const Force<N>& f, PageSample::Vector& force, PageSample::Vector* torque) noexcept {
    for (int i = 0; i < std::min(N, 3); ++i) force[static_cast<std::size_t>(i)] = f[i];
    if constexpr (N == 6) {
      if (torque != nullptr) *torque = {f[3], f[4], f[5]};
    }
  }

  /// The tools of two arms that are coupled joint by joint, against where they begin.
  struct Tools {
    struct Tool {
      Tool(const ArmSpec& arm, const std::shared_ptr<const ArmModel>& model, const JointTool::Axes& scale)
          : of{model, scale} {
        JointTool::Axes q = JointTool::Axes::Zero();
        std::ranges::copy(arm.joint_position_rad, q.begin());
        const JointTool::At at = of.at(Position<kJointPort>{q});
        start = at.tool;
        turned_back = at.attitude.transpose();
      }
      [[nodiscard]] Position<6> place(const JointTool::At& at) const noexcept {
        return {at.tool - start, Eigen::Quaterniond{at.attitude * turned_back}};
      }
      JointTool of;
      Eigen::Vector3d start;
      Eigen::Matrix3d turned_back;
    };
    explicit Tools(const Scene& s)
        : leader{*s.device->arm, s.control.leader, s.control.joint_scale},
          follower{*s.robot->arm, s.control.follower, s.control.joint_scale} {}
    Tool leader, follower;
  };

  static void put(const Force<kJointPort>& torque, std::array<double, kMostJoints>& to) noexcept {
    std::ranges::copy(torque.vec(), to.begin());
  }
  /// Of joints: the tools of both arms, and the joints.
  void put_tools(const DeviceSample<kJointPort>& leader, const Force<kJointPort>& felt,
                 const Force<kJointPort>& unlimited, const PeerState<kJointPort>& peer) noexcept {
    PageSample& s = next_;
    const JointTool::At hand = tools_->leader.of.at(leader.x);
    put(tools_->leader.place(hand), s.hand_x_m, s.hand_attitude);
    put(Velocity<3>{hand.moved(leader.v.vec())}, s.hand_v_m_per_s);
    put(hand.force(felt), s.felt_n, nullptr);
    put(hand.force(unlimited), s.unlimited_n, nullptr);
    s.handle_x_m = s.hand_x_m;
    s.handle_attitude = s.hand_attitude;
    std::ranges::copy(leader.x.translation(), s.leader_rad.begin());
    put(-felt, s.leader_torque);
    if (!peer.has_report) return;
    const PortReport<kJointPort>& r = peer.newest;
    const JointTool::At robot = tools_->follower.of.at(r.x);
    put(tools_->follower.place(robot), s.robot_x_m, s.robot_attitude);
    put(Velocity<3>{robot.moved(r.v.vec())}, s.robot_v_m_per_s);
    put(robot.force(r.f_environment), s.environment_n, nullptr);
    put(robot.force(r.f_coupling), s.coupling_n, nullptr);
    put(Velocity<3>{robot.moved(r.position_error.vec())}, s.behind_m);
    std::ranges::copy(r.x.translation(), s.joint_rad.begin());
    put(r.f_environment, s.follower_torque);
  }

  PageChannel channel_;
  std::int64_t tick_ = 0, every_ = 1;
  Duration late_{0};
  double dissipated_j_ = 0.0;
  PageSample next_;
  std::array<double, kJointPort> felt_share_{1.0, 1.0, 1.0, 1.0,
                                             1.0, 1.0, 1.0, 1.0};  ///< of the node's force, on each axis
  std::optional<Tools> tools_;                                     ///< where the ports are joints
  EnvironmentMessage environment_;
  LimitCounts limits_;
};

}  // namespace twoport
