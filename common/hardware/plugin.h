#pragma once

#include <cstdint>
#include <limits>

// The interface of plug-ins: drivers in shared libraries that the programs load by `--device PATH.so[:ARGS]` and
// `--robot PATH.so[:ARGS]`. This file needs no other and no library; a plug-in is built as in docs/examples/plugin.
//
// SI units; arrays of six are translation first, then rotation, in world axes. Attitudes are unit quaternions w x y z.
// A device of fewer degrees of freedom leaves the other numbers as they are. An arm that is coupled joint by joint is a JointArm.
//
// All calls come from one thread, in the order: constructor, info(), sense() once, then sense() and actuate() in every period;
// start() between two of them; release() when the loop has ended; destructor. The constructor opens the hardware and throws a
// std::exception whose what() is one sentence. The other calls return within a small part of the period and do not wait. If
// one throws all the same, or if readings stay not finite, the program releases the hardware and ends. gripper() is called once,
// after info().

namespace twoport::plugin {

/// Of Device and Robot. Version 2 has gripper() as the last function of both, version 3 the servo at the end of RobotInfo; nothing else
/// differs. A program loads plug-ins from kOldestVersion to kVersion.
inline constexpr std::uint32_t kVersion = 3;
inline constexpr std::uint32_t kOldestVersion = 1;
/// Of JointArm, which has entry points of its own.
inline constexpr std::uint32_t kArmVersion = 1;

/// What the program asks for.
struct Session {
  const char* arguments;  ///< ARGS, or ""
  int dof;                ///< of the scene: 1, 3 or 6; with space JOINTS the number of joints of its arms
  double period_s;        ///< of the loop
};

enum class Status : std::int32_t {
  ok,
  stale,  ///< no new reading since the last one
  fault,  ///< failure: the program releases the hardware and ends
  stopped,  ///< emergency stop: both sides release their hardware until both programs have ended. Earlier programs: a fault
};

inline constexpr double kUnlimited = std::numeric_limits<double>::infinity();

struct DeviceInfo {
  const char* name = "";    ///< maker, model, serial number; good as long as the device
  int dof = 3;              ///< degrees of freedom: 1, 3 or 6. A scene may use fewer; the others are then left free
  double workspace_m[3]{};  ///< extent along each axis; 0: not known
  double peak_force_n = kUnlimited;  ///< 0: no motors for the translation; where the torque is unlimited, none at all
  double peak_torque_n_m = kUnlimited;                                           ///< 0: no motors for the rotation
  double continuous_force_n = kUnlimited;                                        ///< that it holds for ever
  double resolution_m = 0.0, rate_hz = 0.0, mass_kg = 0.0, inertia_kg_m2 = 0.0;  ///< 0: not known
  double watchdog_s = 0.0;  ///< it lets go by itself after this time without actuate(); 0: it does not
  int buttons = 0;
  bool gripper = false;  ///< has a gripper; gripper() then returns it
};

struct DeviceReading {
  double position_m[3]{}, attitude[4]{1.0, 0.0, 0.0, 0.0};
  double velocity[6]{};  ///< [m/s], [rad/s]
  double applied[6]{};   ///< force held since the last reading, with the sign of actuate()'s argument
  std::uint32_t buttons = 0;
  bool held = true;  ///< by the hand, where the device can tell: the robot is released some time after it is let go
  Status status = Status::ok;
};

class Device {
 public:
  virtual ~Device() = default;
  virtual DeviceInfo info() const = 0;
  /// `now_s` from the start of the loop; `ended_s`: length of the interval that ends now.
  virtual DeviceReading sense(double now_s, double ended_s) = 0;
  /// `force[6]` at the master port, power force·velocity into the network: push the hand with -force [N], [N m].
  virtual void actuate(const double* force) = 0;
  virtual void start() {}
  /// No force, now.
  virtual void release() = 0;
  /// The gripper of the handle as a device of its own with `dof` 1; null: none. It lives as long as this device, which deletes it.
  /// position_m[0] is the opening [m]; a negative force closes. In a scene with a gripper it is called as the handle is, after the
  /// handle in every period. Its own gripper() is not called.
  virtual Device* gripper() { return nullptr; }
};

struct RobotInfo {
  const char* name = "";
  int dof = 3;
  bool has_force_sensor = true;
  double max_force_n = kUnlimited, max_torque_n_m = kUnlimited, max_speed_m_per_s = kUnlimited,
         workspace_m = kUnlimited;
  double watchdog_s = 0.0;
  /// Of a robot that obeys positions only: it takes the newest set point at this rate, servo_delay_s later, with a first-order lag. 0: it
  /// follows forces.
  double servo_rate_hz = 0.0, servo_delay_s = 0.0, servo_lag_s = 0.0;
};

struct RobotReading {
  double position_m[3]{}, attitude[4]{1.0, 0.0, 0.0, 0.0};
  double velocity[6]{};
  double force[6]{};   ///< of the robot on the environment, by the force sensor
  bool ideal = false;  ///< follows the commanded motion exactly
  Status status = Status::ok;
};

struct RobotCommand {
  double force[6]{};                                                       ///< on the robot
  double position_m[3]{}, attitude[4]{1.0, 0.0, 0.0, 0.0}, velocity[6]{};  ///< set point
};

class Robot {
 public:
  virtual ~Robot() = default;
  virtual RobotInfo info() const = 0;
  virtual RobotReading sense(double now_s, double ended_s) = 0;
  virtual void actuate(const RobotCommand& command) = 0;
  virtual void start() {}
  /// No force, now; a position-controlled robot stops.
  virtual void release() = 0;
  /// As Device::gripper(), with one degree of freedom.
  virtual Robot* gripper() { return nullptr; }
};

inline constexpr int kMostJoints = 8;

/// Of one joint.
struct ArmLimits {
  double torque = kUnlimited, speed = kUnlimited, lower = -kUnlimited, upper = kUnlimited;
};

/// Of joints the units are rad, rad/s and N m; of those that slide m, m/s and N.
struct ArmInfo {
  const char* name = "";
  int joints = 0;  ///< 1 to 8, as many as the scene's arms have. Of each array below the first ones count
  ArmLimits limits[kMostJoints]{};  ///< what the arm can do or shall do; the smaller of these and the scene's is kept
  bool has_torque_sensors = true;   ///< of a follower
  double watchdog_s = 0.0;
};

struct ArmReading {
  double position[kMostJoints]{}, velocity[kMostJoints]{};
  double applied[kMostJoints]{};   ///< of a leader: torque of the motors, held since the last reading, as commanded
  double external[kMostJoints]{};  ///< of a follower: torque of the environment on the joints, by sensors
  std::uint32_t buttons = 0;       ///< of a leader, as the next one
  bool held = true;
  bool ideal = false;  ///< of a follower
  Status status = Status::ok;
};

struct ArmCommand {
  double torque[kMostJoints]{};                             ///< on the joints, beside that which carries the weight
  double position[kMostJoints]{}, velocity[kMostJoints]{};  ///< of a follower: set point
};

/// An arm whose port is its joints (space JOINTS), as leader or as follower. Calls as of Device and Robot.
class JointArm {
 public:
  virtual ~JointArm() = default;
  virtual ArmInfo info() const = 0;
  virtual ArmReading sense(double now_s, double ended_s) = 0;
  virtual void actuate(const ArmCommand& command) = 0;
  virtual void start() {}
  /// Carries its weight and no more, now; a position-controlled arm stops.
  virtual void release() = 0;
};

/// What the entry point returns. `version` stays first in every version.
template <class Interface>
struct Entry {
  std::uint32_t version;
  Interface* (*open)(const Session&);
};

}  // namespace twoport::plugin

/// Makes the library a plug-in: Class derives from twoport::plugin::Device (Robot, JointArm) and is constructed from a Session. A leader is
/// for --device, a follower for --robot. A library may have several.
#define TWOPORT_DEVICE_PLUGIN(Class) TWOPORT_PLUGIN_ENTRY(twoport_device_plugin, Device, Class, kVersion)
#define TWOPORT_ROBOT_PLUGIN(Class) TWOPORT_PLUGIN_ENTRY(twoport_robot_plugin, Robot, Class, kVersion)
#define TWOPORT_LEADER_PLUGIN(Class) TWOPORT_PLUGIN_ENTRY(twoport_leader_plugin, JointArm, Class, kArmVersion)
#define TWOPORT_FOLLOWER_PLUGIN(Class) TWOPORT_PLUGIN_ENTRY(twoport_follower_plugin, JointArm, Class, kArmVersion)
#define TWOPORT_PLUGIN_ENTRY(symbol, Interface, Class, number)                                                      \
  extern "C" __attribute__((visibility("default"))) const twoport::plugin::Entry<twoport::plugin::Interface>*       \
  symbol() {                                                                                                        \
    static const twoport::plugin::Entry<twoport::plugin::Interface> entry{                                          \
        twoport::plugin::number,                                                                                    \
        [](const twoport::plugin::Session& session) -> twoport::plugin::Interface* { return new Class(session); }}; \
    return &entry;                                                                                                  \
  }
