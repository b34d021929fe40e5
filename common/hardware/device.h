#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <string>

#include "common/base/time.h"
#include "common/base/vector.h"
#include "common/hardware/status.h"
#include "common/safety/limits.h"

namespace twoport {

/// Properties of a haptic device, read once after opening.
struct DeviceInfo {
  std::string name;  ///< for the log: maker, model, serial number
  /// Largest translational force that it displays [N]; 0: it displays none.
  double max_force_n = std::numeric_limits<double>::infinity();
  double mass_kg = 0.0, inertia_kg_m2 = 0.0;  ///< apparent, at the handle; 0: not known
  /// What else the device can do or shall do. The master keeps these, max_force_n, and the scene's limits: the smaller of each.
  PortLimits limits{};
  /// The device lets go by itself when no actuate() has come for this long; 0: it does not.
  Seconds watchdog{};
  int dof = 0;                          ///< degrees of freedom that it senses; 0: those of the scene
  std::array<double, 3> workspace_m{};  ///< extent along each axis; 0: not known
  double continuous_force_n = std::numeric_limits<double>::infinity();  ///< that it holds for ever
  double resolution_m = 0.0, rate_hz = 0.0;                             ///< of its readings; 0: not known
  int buttons = 0;
  bool gripper = false;  ///< has one more axis that opens and closes
};

/// One reading of a haptic device, at the start of a tick.
template <int N>
struct DeviceSample {
  Position<N> x;     ///< handle, from the encoders [m], attitude
  Velocity<N> v;     ///< the device's own estimate [m/s], [rad/s]
  Force<N> applied;  ///< force actually held at the network port since the last tick [N], after all limits
  HardwareStatus status = HardwareStatus::ok;
  std::uint32_t buttons = 0;  ///< bit i is set while button i is pressed
  /// Does the operator hold the handle? Devices that cannot know say true. After control.release_after_s without, both sides
  /// are released until it is held again.
  bool held = true;
  /// r of each axis from now on: motion of the port over that of the hand, force of the hand over that of the port (ModulatedTransformer).
  typename Velocity<N>::Vector ratio = Velocity<N>::Vector::Ones();
};

/// Values that only simulated hardware knows, at the time of the last reading.
template <int N>
struct DeviceTruth {
  Position<N> x;
  Velocity<N> v;
  Energy port_energy;        ///< energy into the master port since the start, E(0) not included [J]
  double path_ends_s = 0.0;  ///< when the simulated operator's path ends, counted from start() [s]
};

/// A haptic device: the hardware interface of the master. A driver derives from it (docs/guides/add-a-device.md).
///
/// The constructor opens the device and throws ConfigError with one sentence on failure. Then the program calls, from
/// one thread: info(), once; sense() then actuate(), once per period, with a single sense() before the first period;
/// start(), between two periods, when the link is up; release(), whenever the loop has ended.
/// The destructor may run without release().
/// Real time: sense, actuate, start and release return within a small part of the period. They do not block, allocate or
/// throw. For a slow bus the driver uses a thread that keeps the newest reading.
template <int N>
class Device {
 public:
  static constexpr int kSize = N;
  virtual ~Device() = default;

  [[nodiscard]] virtual DeviceInfo info() const = 0;
  /// The newest reading. `tick.now` is counted from the start of the loop; `tick.ended` is the length of the
  /// interval that ends now: several periods if the loop skipped some.
  virtual DeviceSample<N> sense(const Tick<MasterClock>& tick) noexcept = 0;
  /// `f` is the force at the master port, power f·v into the network: the hand is pushed with -f [N], [N m].
  virtual void actuate(const Force<N>& f) noexcept = 0;
  /// The session begins. Simulated hands and recordings start now.
  virtual void start() noexcept {}
  /// Sets the force to zero immediately.
  virtual void release() noexcept = 0;
  /// One sentence on the last fault, if the driver knows more; else empty.
  [[nodiscard]] virtual std::string trouble() const { return {}; }
  /// The gripper of the handle as a device of its own, which lives as long as this one; null: none. Its position is the opening
  /// [m], and its force closes where it is negative. It is sensed and actuated after the handle, in every period from the first one
  /// in which the program uses it. release() of the handle need not release it.
  [[nodiscard]] virtual Device<1>* gripper() noexcept { return nullptr; }
  /// Null for real devices.
  [[nodiscard]] virtual const DeviceTruth<N>* truth() const noexcept { return nullptr; }
};

}  // namespace twoport
