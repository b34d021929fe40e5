#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

#include "common/base/ring.h"
#include "common/coupling/layers.h"
#include "common/link/environment_message.h"

namespace twoport {

/// What the page shows of one tick. Vectors have three entries, unused ones are 0; attitudes are w, x, y, z.
struct PageSample {
  using Vector = std::array<double, 3>;
  using Quaternion = std::array<double, 4>;

  double t_s = 0.0;  ///< since the program's loop began
  Vector hand_x_m{};
  Quaternion hand_attitude{1.0, 0.0, 0.0, 0.0};
  Vector robot_x_m{};
  Quaternion robot_attitude{1.0, 0.0, 0.0, 0.0};
  Vector hand_v_m_per_s{}, robot_v_m_per_s{};
  Vector behind_m{};                  ///< robot minus the delayed, registered hand
  Vector felt_n{};                    ///< force on the hand
  Vector felt_n_m{};                  ///< torque on the hand
  Vector unlimited_n{};               ///< force on the hand that the method asked for, before the passivity controller
  Vector environment_n{};             ///< force of the robot on the environment, as measured
  Vector environment_n_m{};           ///< its torque
  Vector coupling_n{};                ///< force of the coupling on the robot
  double hand_energy_j = 0.0;         ///< that the hand has put in, as observed
  double robot_energy_j = 0.0;        ///< that has entered the link at the robot's side, as reported
  double robot_port_j = 0.0;          ///< the same without what has left there, in units of the hand
  double dissipated_j = 0.0;          ///< by the master's controller so far
  double deficit_j = 0.0;             ///< not dissipated yet
  LayerFigures layer_figures{};       ///< of kLayerFigures
  double round_trip_ms = -1.0;        ///< of the newest report; negative: not known
  double report_age_ms = -1.0;        ///< since the newest young report of the slave arrived; negative: none has
  double silence_ms = -1.0;           ///< since the newest arrived, whatever its age; negative: none has
  double received = 0.0, lost = 0.0;  ///< packets from the slave
  double stale = 0.0;                 ///< of those received, too old to count
  double limits = 0.0;                ///< those that acted since the sample before: the sum of 2^Limit
  double late_us = 0.0;               ///< largest wake-up latency since the sample before
  double mode = 0.0, slave_mode = 0.0;
  double epoch = 0.0;                ///< switches of the method so far
  double held = 0.0;                 ///< 1 while the pointer holds the handle of --device page
  double clutched = 0.0;             ///< 1: by the clutch the hand moves alone; 2: re-homing
  double locked = 0.0;               ///< axes: the sum of 2^axis
  double motion = 1.0, force = 1.0;  ///< scales, times those of the scene
  Vector handle_x_m{};               ///< of the device, without clutch, locks and scales
  Quaternion handle_attitude{1.0, 0.0, 0.0, 0.0};
  double gripper_hand_m = 0.0, gripper_robot_m = 0.0;  ///< openings of the handle's gripper and of the fingers
  double gripper_felt_n = 0.0;                         ///< force on the hand at the gripper; opens where it is positive
  double gripper_object_n = 0.0;      ///< force of the fingers on the object; squeezes where it is negative
  double gripper_energy_j = 0.0;      ///< that the hand has put in at the gripper, as observed
  double environment_answer = 0.0;    ///< EnvironmentAnswer
  double environment_energy_j = 0.0;  ///< that changes of the environment's stiffness have put in
  std::array<double, kAdjustableSurfaces> surface_stiffness_n_per_m{};
  std::array<double, kAdjustableSurfaces> surface_friction{};  ///< negative: cannot be changed
  std::array<double, kMostJoints> joint_rad{};                 ///< of the robot's arm, where it is one
  double sensor_drift_n = -1.0;                                ///< SensorRest::drift_n of the robot
  double zero_answer = 0.0;                                    ///< ZeroAnswer to the newest request of this side
  double zero_asked = 0.0;                                     ///< 1 while a request waits for its answer
  double dropped = 0.0;                                        ///< samples that the page was too slow for
  // Where the ports are joints, all above is of the tools of leader and follower; besides, zero from the last joint on:
  std::array<double, kMostJoints> leader_rad{};
  std::array<double, kMostJoints> leader_torque{};    ///< that the leader's motors display, against the hand
  std::array<double, kMostJoints> follower_torque{};  ///< of the follower on the environment, as measured
  Vector object_x_m{};                                ///< centre of the box that its fingers may take
};

/// Calls see(name, size, field) for each field in order: the layout of a sample on the wire, doubles of this machine's
/// byte order. Of the joints of two arms only where the ports are `joints`.
template <class Sample, class See>
void for_each_page_field(Sample& s, See&& see, bool joints = false) {
  const auto vector = [&](const char* name, auto& field) { see(name, field.size(), field.data()); };
  const auto number = [&](const char* name, auto& field) { see(name, std::size_t{1}, &field); };
  number("t_s", s.t_s);
  vector("hand_x_m", s.hand_x_m);
  vector("hand_attitude", s.hand_attitude);
  vector("robot_x_m", s.robot_x_m);
  vector("robot_attitude", s.robot_attitude);
  vector("hand_v_m_per_s", s.hand_v_m_per_s);
  vector("robot_v_m_per_s", s.robot_v_m_per_s);
  vector("behind_m", s.behind_m);
  vector("felt_n", s.felt_n);
  vector("felt_n_m", s.felt_n_m);
  vector("unlimited_n", s.unlimited_n);
  vector("environment_n", s.environment_n);
  vector("environment_n_m", s.environment_n_m);
  vector("coupling_n", s.coupling_n);
  number("hand_energy_j", s.hand_energy_j);
  number("robot_energy_j", s.robot_energy_j);
  number("robot_port_j", s.robot_port_j);
  number("dissipated_j", s.dissipated_j);
  number("deficit_j", s.deficit_j);
  for (std::size_t i = 0; i < kLayerFigures.size(); ++i) number(kLayerFigures[i].name.data(), s.layer_figures[i]);
  number("round_trip_ms", s.round_trip_ms);
  number("report_age_ms", s.report_age_ms);
  number("silence_ms", s.silence_ms);
  number("received", s.received);
  number("lost", s.lost);
  number("stale", s.stale);
  number("limits", s.limits);
  number("late_us", s.late_us);
  number("mode", s.mode);
  number("slave_mode", s.slave_mode);
  number("epoch", s.epoch);
  number("held", s.held);
  number("clutched", s.clutched);
  number("locked", s.locked);
  number("motion", s.motion);
  number("force", s.force);
  vector("handle_x_m", s.handle_x_m);
  vector("handle_attitude", s.handle_attitude);
  number("gripper_hand_m", s.gripper_hand_m);
  number("gripper_robot_m", s.gripper_robot_m);
  number("gripper_felt_n", s.gripper_felt_n);
  number("gripper_object_n", s.gripper_object_n);
  number("gripper_energy_j", s.gripper_energy_j);
  number("environment_answer", s.environment_answer);
  number("environment_energy_j", s.environment_energy_j);
  vector("surface_stiffness_n_per_m", s.surface_stiffness_n_per_m);
  vector("surface_friction", s.surface_friction);
  vector("joint_rad", s.joint_rad);
  number("sensor_drift_n", s.sensor_drift_n);
  number("zero_answer", s.zero_answer);
  number("zero_asked", s.zero_asked);
  number("dropped", s.dropped);
  if (!joints) return;
  vector("leader_rad", s.leader_rad);
  vector("leader_torque", s.leader_torque);
  vector("follower_torque", s.follower_torque);
  vector("object_x_m", s.object_x_m);
}

/// A command of the page: finite numbers within their limits.
struct PageCommand {
  enum class Kind : std::uint8_t {
    target,  ///< the pointer holds the handle, or the leader's tool; numbers 0 to 2: where [m], 3 to 5: rotation vector [rad]
    release,  ///< it does not
    grip,     ///< number 0: stiffness of the hand [N/m]
    opening,  ///< number 0: opening that the hand intends at the gripper [m]
    // Those above are of the hand.
    network,  ///< which: 0 to the slave, 1 to the master; numbers: delay [ms], jitter [ms], loss [1]
    zero,     ///< the force sensor of the robot; the slave judges
    surface,  ///< which: of the environment; numbers: stiffness [N/m], friction [1], at least 0
              ///< and not limited further: the slave refuses
    method,   ///< which: index into the methods that the page was told
    clutch,   ///< which: 1 pressed, 0 not
    rehome,   ///< the present pose of the hand becomes that of the robot
    lock,     ///< which: the sum of 2^axis of the locked axes
    scale,    ///< numbers: of motion, of force, times those of the scene
    take,     ///< this page controls the run from now on
    restart,  ///< both programs, where somebody starts them again
  };
  [[nodiscard]] bool is_of_hand() const { return kind <= Kind::opening; }

  Kind kind = Kind::release;
  int which = 0;
  std::array<double, 6> number{};
};

/// Limits of a command's numbers; a number beyond is set to the limit.
inline constexpr double kPageReach = 0.5, kPageTurn = 3.0;              // [m], [rad]
inline constexpr double kPageGripLeast = 20.0, kPageGripMost = 2000.0;  // [N/m]
inline constexpr double kPageScaleLeast = 0.05;                         // of motion; of force it is 0
inline constexpr double kPageDelayMs = 500.0, kPageJitterMs = 50.0, kPageLoss = 0.9;

/// Reads a command as text, words separated by single spaces:
///
///     target X Y Z RX RY RZ      [m], [rad]
///     release
///     grip N_PER_M
///     opening M
///     network to_slave|to_master DELAY_MS JITTER_MS LOSS
///     surface INDEX N_PER_M FRICTION
///     zero
///     method INDEX
///     clutch 0|1
///     rehome
///     lock SUM                   of 2^axis
///     scale MOTION FORCE         at most 1
///     take
///     restart
///
/// Nothing where it is malformed or a number is not finite.
std::optional<PageCommand> parse_page_command(std::string_view text);

/// State of the pointer, written and read by the cycle's thread.
struct PagePointer {
  bool held = false;
  double grip_n_per_m = 0.0;  ///< initial stiffness of the hand
};

/// Between the cycle and the page's server. Each ring has one producer and one consumer; neither side waits.
struct PageChannel {
  Ring<PageSample> samples{4096};   ///< cycle to server
  Ring<PageCommand> commands{256};  ///< server to cycle: all others
  Ring<PageCommand> hand{256};      ///< server to the device, in the cycle's thread: target, release, grip, opening
  PagePointer pointer;
};

}  // namespace twoport
