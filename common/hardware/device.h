#pragma once

#include "common/base/vector.h"

namespace twoport {

/// What a haptic device says at the start of a tick.
template <int N>
struct DeviceState {
  Position<N> x;     ///< handle, as the encoders give it [m], attitude
  Velocity<N> v;     ///< the device's own estimate [m/s], [rad/s]
  Force<N> applied;  ///< force that was really held on the network port since the last tick [N], after every limit
};

/// A haptic device: the seam for hardware at the master. Both calls come once a period, from the cycle thread, and
/// must return well within it without blocking.
template <int N>
class Device {
 public:
  virtual ~Device() = default;
  virtual DeviceState<N> sense() noexcept = 0;
  /// `f` is the force at the master port, power f·v into the network: the hand is pushed with -f [N], [N m].
  virtual void actuate(const Force<N>& f) noexcept = 0;
  /// Let go: no force, now. Called when the loop ends, however it ends.
  virtual void release() noexcept = 0;
};

}  // namespace twoport
