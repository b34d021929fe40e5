#pragma once

#include "common/method/transparency/position_position/master.h"

namespace twoport {

/// The force that the architecture displays at the master, before any controller acts: the received force of
/// the slave, or the force of the position error.
///
///     POSITION_FORCE, POSITION_MEASURED_FORCE   f_m = s_f f_rx
///     POSITION_POSITION                         f_m = PositionErrorForce
template <int N>
class DisplayedForce {
 public:
  explicit DisplayedForce(const ControlOptions& o)
      : by_position_{o.architecture == Architecture::position_position}, position_error_{o} {}

  void start(const Position<N>& device) noexcept { position_error_.start(device); }
  Force<N> step(const DeviceSample<N>& device, const PeerState<N>& slave, Seconds dt) noexcept {
    return by_position_ ? position_error_.step(device, slave, dt) : slave.newest.f;
  }

 private:
  bool by_position_;
  PositionErrorForce<N> position_error_;
};

}  // namespace twoport
