#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "common/base/vector.h"

namespace twoport {

/// Limits of each joint of a port of joints: torque [N m], speed [rad/s], range [rad]; of a prismatic joint [N], [m/s], [m].
struct JointLimits {
  using Axes = Eigen::Array<double, kJointPort, 1>;
  static constexpr double kNone = std::numeric_limits<double>::infinity();

  Axes effort = Axes::Constant(kNone), speed = Axes::Constant(kNone);
  Axes lower = Axes::Constant(-kNone), upper = Axes::Constant(kNone);

  /// In the metric s (JointMetric).
  [[nodiscard]] JointLimits scaled(const Axes& s) const { return {effort / s, speed * s, lower * s, upper * s}; }
  friend JointLimits lowest(const JointLimits& a, const JointLimits& b) {
    return {a.effort.min(b.effort), a.speed.min(b.speed), a.lower.max(b.lower), a.upper.min(b.upper)};
  }
  friend bool operator==(const JointLimits& a, const JointLimits& b) {
    return (a.effort == b.effort).all() && (a.speed == b.speed).all() && (a.lower == b.lower).all() &&
           (a.upper == b.upper).all();
  }
};

/// Limits of one port: of the device at the master, of the robot at the slave. Infinity: no limit.
struct PortLimits {
  static constexpr double kNone = std::numeric_limits<double>::infinity();

  double force_n = kNone;             ///< translational force
  double torque_n_m = kNone;          ///< 6 degrees of freedom only, as the other rotational ones
  double force_rate_n_per_s = kNone;  ///< change of the force; of the torque in the ratio of torque_n_m to force_n
  double power_w = kNone;             ///< into the hand or the robot
  double speed_m_per_s = kNone, angular_speed_rad_per_s = kNone;
  double set_point_step_m = kNone;  ///< change of the robot's set point in one tick
  double workspace_m = kNone;       ///< distance from the origin of the side's world
  JointLimits joints{};             ///< of a port of joints

  /// The smaller of each.
  friend PortLimits lowest(const PortLimits& a, const PortLimits& b) {
    return {std::min(a.force_n, b.force_n),
            std::min(a.torque_n_m, b.torque_n_m),
            std::min(a.force_rate_n_per_s, b.force_rate_n_per_s),
            std::min(a.power_w, b.power_w),
            std::min(a.speed_m_per_s, b.speed_m_per_s),
            std::min(a.angular_speed_rad_per_s, b.angular_speed_rad_per_s),
            std::min(a.set_point_step_m, b.set_point_step_m),
            std::min(a.workspace_m, b.workspace_m),
            lowest(a.joints, b.joints)};
  }
  friend bool operator==(const PortLimits&, const PortLimits&) = default;
};

/// Limits of a live run whose scene names none. The force and power of the robot are those that ISO 10218-1:2006, 5.10.5, allows
/// beside people. The laboratory has no limits unless the scene names them.
inline const PortLimits kDeviceDefaults{.force_n = 50.0,
                                        .torque_n_m = 5.0,
                                        .force_rate_n_per_s = 50e3,
                                        .power_w = 100.0,
                                        .speed_m_per_s = 5.0,
                                        .angular_speed_rad_per_s = 50.0,
                                        .workspace_m = 10.0};
inline const PortLimits kRobotDefaults{.force_n = 150.0,
                                       .torque_n_m = 30.0,
                                       .force_rate_n_per_s = 150e3,
                                       .power_w = 80.0,
                                       .speed_m_per_s = 3.0,
                                       .angular_speed_rad_per_s = 30.0,
                                       .set_point_step_m = 0.02,
                                       .workspace_m = 10.0};

/// What may be limited. The first six are kept at the own hardware, the next three at what the other side claims; `pause` is a gap
/// in the own clock.
enum class Limit : std::uint8_t {
  force,           ///< force or torque at the own hardware
  force_rate,      ///< its change
  power,           ///< into the own hardware
  speed,           ///< the hardware is too fast: no force that accelerates it
  set_point_step,  ///< change of the robot's set point in a tick
  workspace,       ///< the hardware or its set point is beyond: no force that leads further out
  peer_motion,     ///< position or velocity that the other side reports
  peer_force,      ///< force that the other side reports
  peer_energy,     ///< energy that the other side claims to have put in
  pause,           ///< this side has stood still for hold_after or longer: the coupling began anew
};
inline constexpr std::size_t kLimits = 10;
inline constexpr std::array<const char*, kLimits> kLimitNames{
    "force",     "force_rate",  "power",      "speed",       "set_point_step",
    "workspace", "peer_motion", "peer_force", "peer_energy", "pause"};

/// How often each limit has acted: ticks at the own hardware, packets of the other side.
struct LimitCounts {
  std::array<std::uint32_t, kLimits> of{};

  void add(Limit limit) noexcept {
    std::uint32_t& n = of[static_cast<std::size_t>(limit)];
    if (n != std::numeric_limits<std::uint32_t>::max()) ++n;
  }
  [[nodiscard]] std::uint32_t operator[](Limit limit) const noexcept { return of[static_cast<std::size_t>(limit)]; }
  friend LimitCounts operator+(LimitCounts a, const LimitCounts& b) noexcept {
    for (std::size_t i = 0; i < kLimits; ++i) a.of[i] += b.of[i];
    return a;
  }
  friend bool operator==(const LimitCounts&, const LimitCounts&) = default;
};

}  // namespace twoport
