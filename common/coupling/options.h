#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/scalar.h"
#include "common/base/vector.h"
#include "common/passivity/controller_options.h"
#include "common/passivity/observer.h"
#include "common/safety/limits.h"
#define TWOPORT_LAYER_OPTIONS(BLOCK, Struct)
#include "common/method/list.h"
#undef TWOPORT_LAYER_OPTIONS

namespace twoport {

class ArmModel;

enum class Architecture : std::uint8_t {
  render,                   ///< no link: the device against the environment directly
  position_force,           ///< the slave's coupling force is displayed
  position_measured_force,  ///< the force sensor's force is displayed
  position_position,        ///< each side's spring-damper pulls towards the other's position
  uncontrolled,             ///< no controller: the robot alone in its environment
};

enum class Accounts : std::uint8_t { total, normal_tangential, per_contact, translation_rotation };

/// How the force of a rendered environment is computed.
enum class RenderingAlgorithm : std::uint8_t {
  penalty,     ///< the law of contact at the handle
  god_object,  ///< a proxy that never enters the environment, and the virtual coupling between both
};

/// Spring-damper of the virtual coupling, per translational and rotational axis.
struct CouplingOptions {
  double stiffness_n_per_m = 1000.0, damping_n_s_per_m = 20.0;
  double rotational_stiffness_n_m_per_rad = 10.0, rotational_damping_n_m_s_per_rad = 0.2;
  /// Of a port of joints, in its metric; where it is more than damping_n_s_per_m.
  Eigen::Matrix<double, kJointPort, 1> damping_of_joints = Eigen::Matrix<double, kJointPort, 1>::Zero();
  double catch_up_m_per_s = 0.05;
  bool drift_compensation = true;
};

/// Map from the master's world to the robot's.
struct RegistrationOptions {
  bool absolute = false;  ///< false: the robot does not move when a coupling begins, and follows from there
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  ///< turns the master's axes into the robot's
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();          ///< absolute: the master's origin in the robot's world
};

/// What a scene says of the system that is coupled, for the gain rules of methods. Filled by tell_system
/// (common/scene/load.h). 0: not known.
struct KnownSystem {
  Seconds round_trip{};  ///< nominal: control.passivity.round_trip_ms, else the delays of both directions
  Seconds master_tick{}, slave_tick{};
  double device_damping_n_s_per_m = 0.0, device_rotational_damping_n_m_s_per_rad = 0.0;
  double robot_mass_kg = 0.0, robot_inertia_kg_m2 = 0.0;  ///< the smallest principal moment
  bool ideal_robot = false;                               ///< the scene has none: the set point is the robot
};

/// The method and the layers that leave the force as it arrives or is rendered.
inline constexpr std::string_view kPlainMethod = "NONE", kPlainTransparency = "DELAYED_FORCE", kPlainPassivity = "NONE";

/// Defaults as in proto/scene.proto.
struct ControlOptions {
  Architecture architecture = Architecture::position_force;
  CouplingOptions coupling;
  RenderingAlgorithm rendering = RenderingAlgorithm::penalty;
  double force_scale = 1.0, motion_scale = 1.0;
  /// Of a port of joints: s_i of JointMetric [m/rad], prismatic: 1 is a metre. Of axes that the arms have not: 1.
  Eigen::Matrix<double, kJointPort, 1> joint_scale = Eigen::Matrix<double, kJointPort, 1>::Ones();
  std::shared_ptr<const ArmModel> leader{}, follower{};  ///< of ports of joints; null: not known
  RegistrationOptions registration;
  std::string method_name{kPlainMethod};  ///< over a link: a name of kMethods (layers.h), or TRANSPARENCY+PASSIVITY
  std::string transparency{kPlainTransparency}, passivity{kPlainPassivity};  ///< its layers; empty for one of one piece
  ControllerOptions controller;
  ObserverRule observer = ObserverRule::exact;
  Accounts accounts = Accounts::total;
  bool reference_energy = false;
  Energy initial_energy{1e-3};                                   ///< under `render` a scene's default is 0
  double handle_mass_kg = 0.0, handle_inertia_kg_m2 = 0.0;       ///< apparent, at the master; 0: not known
  double max_force_n = std::numeric_limits<double>::infinity();  ///< largest translational force at the device
  std::uint8_t without_motor = 0;                                ///< bit i: axis i of the device displays no force
  Seconds engage{0.1};                                           ///< force ramp after the link is up
  Seconds hold_after{0.1};                                       ///< silent link: coupled -> holding
  Seconds release_after{1.0};                                    ///< silent link: holding -> released
  PortLimits device_limits, robot_limits;                        ///< of the scene: both sides have the same
  PortLimits own_limits;                                         ///< of this side's driver
  KnownSystem known;
  std::optional<Seconds> stated_round_trip;  ///< of the network; absent: known.round_trip is that of the scene's delays
  // The options of each layer and method that has some, under the name of its block; only those in use are read.
#define TWOPORT_LAYER_OPTIONS(BLOCK, Struct) Struct BLOCK;
#include "common/method/list.h"
#undef TWOPORT_LAYER_OPTIONS
};

/// What the master keeps at its device, and the slave at its robot; joints in the node's metric.
inline PortLimits limits_at_device(const ControlOptions& o) {
  PortLimits all = lowest(o.device_limits, o.own_limits);
  all.force_n = std::min(all.force_n, o.max_force_n);
  all.joints = all.joints.scaled(o.joint_scale);
  return all;
}
inline PortLimits limits_at_robot(const ControlOptions& o) {
  PortLimits all = lowest(o.robot_limits, o.own_limits);
  all.joints = all.joints.scaled(o.joint_scale);
  return all;
}

/// What each side believes of the other one's reports, in that one's units. The robot's speed limit counts at the hand too.
inline PortLimits limits_of_master_reports(const ControlOptions& o) {
  PortLimits all = o.device_limits;
  all.speed_m_per_s = std::min(all.speed_m_per_s, o.robot_limits.speed_m_per_s / o.motion_scale);
  all.angular_speed_rad_per_s = std::min(all.angular_speed_rad_per_s, o.robot_limits.angular_speed_rad_per_s);
  return all;
}
inline PortLimits limits_of_slave_reports(const ControlOptions& o) {
  return o.robot_limits;
}
/// An entry of a schedule: the controllers from then on.
struct ScheduledControl {
  double at_s;  ///< since the start of the run; infinity: by hand only
  ControlOptions control;
};

/// The options of a one-port controller at the handle, with what is known of the handle.
inline ControllerOptions controller_at_the_handle(const ControlOptions& o) {
  ControllerOptions c = o.controller;
  c.mass_kg = o.handle_mass_kg;
  if (o.handle_mass_kg > 0.0 && o.handle_inertia_kg_m2 > 0.0)
    c.radius_of_gyration_m = std::sqrt(o.handle_inertia_kg_m2 / o.handle_mass_kg);
  return c;
}

/// Is the force sensor's force displayed at the master, not the coupling's?
inline bool returns_measured_force(const ControlOptions& o) {
  return o.architecture == Architecture::position_measured_force;
}

}  // namespace twoport
