#pragma once

#include <utility>

#include "common/base/time.h"
#include "common/link/report.h"
#include "common/safety/peer_guard.h"

namespace twoport {

/// A transport of a Mailbox whose reports keep the limits of the other side.
template <int N, class Transport>
class GuardedTransport : public Transport {
 public:
  template <class... Arguments>
  explicit GuardedTransport(const PortLimits& of_the_other_side, Arguments&&... arguments)
      : Transport{std::forward<Arguments>(arguments)...}, guard_{of_the_other_side} {}

  template <class Use>
  void poll(Duration now, Use use) noexcept {
    Transport::poll(now, [&](const Report<N>& report) { guard_.pass(report, now, use); });
  }
  /// As Transport::take_new_session.
  [[nodiscard]] bool take_new_session() noexcept {
    if (!Transport::take_new_session()) return false;
    guard_.reset();
    return true;
  }
  [[nodiscard]] const LimitCounts& limit_counts() const noexcept { return guard_.counts(); }

 private:
  PeerGuard<N> guard_;
};

}  // namespace twoport
