#pragma once

#include <cstdint>
#include <limits>
#include <string>

#include "common/base/time.h"
#include "common/base/vector.h"
#include "common/hardware/status.h"

namespace twoport {

/// What a haptic device is, told once when it has been opened.
struct DeviceInfo {
  std::string name;  ///< for the log: maker, model, serial number
  /// Largest translational force that it displays [N]; 0: it displays none.
  double max_force_n = std::numeric_limits<double>::infinity();
  double mass_kg = 0.0, inertia_kg_m2 = 0.0;  ///< apparent, at the handle; 0: not known
};

/// One reading of a haptic device, at the start of a tick.
template <int N>
struct DeviceSample {
  Position<N> x;     ///< handle, as the encoders give it [m], attitude
  Velocity<N> v;     ///< the device's own estimate [m/s], [rad/s]
  Force<N> applied;  ///< force that was really held on the network port since the last tick [N], after every limit
  HardwareStatus status = HardwareStatus::ok;
  std::uint32_t buttons = 0;  ///< bit i is set while button i is pressed
};

/// What no encoder shows, and only simulated hardware knows. Of the moment of the last reading.
template <int N>
struct DeviceTruth {
  Position<N> x;
  Velocity<N> v;
  Energy port_energy;        ///< energy that has gone into the master port since the start, E(0) not included [J]
  double path_ends_s = 0.0;  ///< when the simulated operator's path ends, counted from start() [s]
};

/// A haptic device: the seam for hardware at the master. A driver derives from it (docs/howto/add-a-device.md).
///
/// The constructor opens the device and throws ConfigError with one sentence when it cannot. Then the program calls, from
/// one thread: info(), once; sense() then actuate(), once a period, with a single sense() before the first period;
/// start(), between two periods, when the two sides have met; release(), when the loop has ended, for whatever reason.
/// The destructor may run without release().
/// Real time: sense, actuate, start and release return within a small part of the period. They do not block, allocate or
/// throw. A slow bus is read by a thread of the driver, which leaves the newest reading.
template <int N>
class Device {
 public:
  static constexpr int kSize = N;
  virtual ~Device() = default;

  [[nodiscard]] virtual DeviceInfo info() const = 0;
  /// The newest reading. `tick.now` is counted from the start of the loop; `tick.ended` is how long the interval was that
  /// ends now: several periods where the loop left some out.
  virtual DeviceSample<N> sense(const Tick<MasterClock>& tick) noexcept = 0;
  /// `f` is the force at the master port, power f·v into the network: the hand is pushed with -f [N], [N m].
  virtual void actuate(const Force<N>& f) noexcept = 0;
  /// The scene begins. Simulated hands stand still until then, and recordings do not play.
  virtual void start() noexcept {}
  /// No force, now.
  virtual void release() noexcept = 0;
  /// Null where the truth is not known, as with every real device.
  [[nodiscard]] virtual const DeviceTruth<N>* truth() const noexcept { return nullptr; }
};

}  // namespace twoport
