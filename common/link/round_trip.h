#pragma once

#include "common/base/low_pass.h"
#include "common/base/time.h"
#include "common/link/mailbox.h"

namespace twoport {

/// Round-trip time of the link from the echoed time stamps, low-passed with 0.5 s; the first measurement is taken unfiltered.
class RoundTrip {
 public:
  template <int N>
  Seconds step(const PeerState<N>& peer, Seconds dt) noexcept {
    if (peer.is_new && peer.round_trip() >= Duration{0}) {
      measured_ = to_seconds(peer.round_trip());
      if (!known_) filtered_ = measured_;
      known_ = true;
    }
    low_pass(filtered_, measured_, dt, kTau_s);
    return filtered_;
  }

 private:
  static constexpr double kTau_s = 0.5;
  Seconds measured_, filtered_;
  bool known_ = false;
};

}  // namespace twoport
