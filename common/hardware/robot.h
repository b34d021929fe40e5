#pragma once

#include <optional>
#include <string>

#include "common/base/time.h"
#include "common/base/vector.h"
#include "common/hardware/servo.h"
#include "common/hardware/status.h"
#include "common/safety/limits.h"

namespace twoport {

class AdjustableEnvironment;

/// Properties of a robot, read once after opening.
struct RobotInfo {
  std::string name;              ///< for the log: maker, model, serial number
  bool has_force_sensor = true;  ///< without one POSITION_MEASURED_FORCE is refused
  PortLimits limits{};           ///< what the robot can do or shall do; the slave keeps these and the scene's
  Seconds watchdog{};            ///< the robot stops by itself when no actuate() has come for this long; 0: it does not
  /// It obeys positions only: a body between coupling and robot then yields in its place (Admittance). Nothing: it follows forces.
  std::optional<Servo> servo{};
};

/// One reading of a robot, at the start of a tick.
template <int N>
struct RobotSample {
  Position<N> x;           ///< tool [m], attitude
  Velocity<N> v;           ///< [m/s], [rad/s]
  Force<N> f_environment;  ///< the force sensor: force of the robot on the environment [N], [N m]
  bool ideal = false;      ///< follows the commanded motion exactly; its sensor force is then the coupling force
  HardwareStatus status = HardwareStatus::ok;
};

/// Values that only a simulated robot knows, at the time of the last reading.
template <int N>
struct RobotTruth {
  Force<N> f_environment;  ///< force of the environment on the robot [N], [N m]
  bool touches = false;    ///< the environment
};

/// Command of the slave to its robot for the coming period.
template <int N>
struct RobotCommand {
  Force<N> f;       ///< coupling force on the robot [N], [N m]
  Position<N> x_d;  ///< set point of the coupling, which an ideal robot follows
  Velocity<N> v_d;
  /// What RobotMount has taken from the reading: of a robot that counts the force by itself [N], [N m].
  Force<N> not_of_environment{};
};

/// A robot with a force sensor: the hardware interface of the slave. A driver derives from it (docs/guides/add-a-robot.md).
/// Calls and real time as for Device.
template <int N>
class Robot {
 public:
  static constexpr int kSize = N;
  virtual ~Robot() = default;

  [[nodiscard]] virtual RobotInfo info() const = 0;
  virtual RobotSample<N> sense(const Tick<SlaveClock>& tick) noexcept = 0;
  virtual void actuate(const RobotCommand<N>& command) noexcept = 0;
  virtual void start() noexcept {}
  /// Sets the force to zero immediately; a position-controlled robot stops.
  virtual void release() noexcept = 0;
  [[nodiscard]] virtual std::string trouble() const { return {}; }
  /// The gripper as a robot of its own, with one degree of freedom; as Device::gripper.
  [[nodiscard]] virtual Robot<1>* gripper() noexcept { return nullptr; }
  /// Null: a real robot's environment is what it is.
  [[nodiscard]] virtual AdjustableEnvironment* environment() noexcept { return nullptr; }
  [[nodiscard]] virtual const RobotTruth<N>* truth() const noexcept { return nullptr; }
  /// The tool at the time of the last reading, where RobotSample::x is that of a body in its place. Null: that is the tool.
  [[nodiscard]] virtual const Position<N>* tool() const noexcept { return nullptr; }
};

}  // namespace twoport
