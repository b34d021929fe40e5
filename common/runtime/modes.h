#pragma once

#include <utility>

#include "common/base/time.h"
#include "common/coupling/options.h"
#include "common/hardware/status.h"
#include "common/link/mailbox.h"

namespace twoport {

/// What one side knows of the other at one tick.
struct Health {
  bool heard;      ///< by a report that is proven young (ReportAge) and no older than hold_after
  bool with_us;    ///< the other side is coupled too, or has had no time to say so
  bool silent;     ///< heard and with us last release_after ago
  bool may_begin;  ///< it waits for a coupling, and has heard that this side does
  bool let_go;     ///< nobody has held the handle for release_after
};

/// idle -> coupled when the other side may begin too; coupled -> holding when it is not heard or not coupled; holding -> coupled when it
/// is again, -> released when it stays so; released -> idle when it is heard. let_go in place of coupled while nobody holds the handle.
[[nodiscard]] constexpr Mode next_mode(Mode mode, const Health& health) noexcept {
  const Mode at_work = health.let_go ? Mode::let_go : Mode::coupled;
  switch (mode) {
    case Mode::coupled:
    case Mode::holding:
      if (health.heard && health.with_us) return at_work;
      return health.silent ? Mode::released : Mode::holding;
    case Mode::let_go:
      return health.heard && health.with_us ? at_work : Mode::released;
    case Mode::released:
      return health.heard ? (health.may_begin ? at_work : Mode::idle) : Mode::released;
    default:
      return health.heard && health.may_begin ? at_work : mode;
  }
}

/// What the mailbox of a side takes for the age of a report.
inline AgeOptions age_of_reports(const ControlOptions& o) {
  return {to_duration(o.hold_after.si()), to_duration(o.known.round_trip.si())};
}

/// Does a change from `was` to `mode` begin a coupling? A return from holding continues the existing one.
[[nodiscard]] constexpr bool begins(Mode was, Mode mode) noexcept {
  return mode != was && mode == Mode::coupled && was != Mode::holding;
}

/// The mode of one side from tick to tick. Both sides are coupled, or neither is:
///
///     with us    the newest young report says coupled, holding or let_go; or it says none of it since the coupling began, and this is no
///                longer than R + hold_after ago (R: round trip)
///     may begin  the other side says idle, coupled or let_go, and
///                  the first of a session:  nothing more, as the handshake has shown that each hears the other
///                  after a silence:         its report echoes a stamp of after this side was ready again
///                  after an own fault:      or it says coupled or holding: it has not noticed
///
/// A side whose partner stops being with it holds, and releases after release_after. When either direction of the link is dead, both
/// sides release within release_after, a round trip and hold_after/2.
class ModeMachine {
 public:
  explicit ModeMachine(const ControlOptions& o)
      : pause_after_{o.hold_after},
        hold_after_{to_duration(o.hold_after.si())},
        release_after_{to_duration(o.release_after.si())} {}

  /// Has this side stood still for hold_after, so that it knows nothing of the present?
  template <class Clock>
  [[nodiscard]] bool has_paused(const Tick<Clock>& tick) const noexcept {
    return tick.ended >= pause_after_ && tick.ended > 1.5 * tick.dt;
  }
  /// Has this side's hardware been stopped, or do kTold reports in a row say so of the other side? One may be damaged. For good. A
  /// goodbye of the other side, as often, ends the coupling until another session. Call in every tick.
  template <int N>
  [[nodiscard]] bool is_stopped(HardwareStatus own, const PeerState<N>& peer) noexcept {
    const bool last_word = peer.heard.mode == Mode::stopped || peer.heard.mode == Mode::ended;
    if (!last_word) [[likely]]
      told_ = 0;
    else if (peer.heard.is_new)
      ++told_;
    if (own == HardwareStatus::stopped || (told_ >= kTold && peer.heard.mode == Mode::stopped)) [[unlikely]]
      mode_ = Mode::stopped;
    if (told_ >= kTold && peer.heard.mode == Mode::ended) [[unlikely]]
      release();
    return mode_ == Mode::stopped;
  }
  /// At the master: has nobody held the handle for release_after? Call in every tick, before step().
  [[nodiscard]] bool has_let_go(Duration now, bool held) noexcept {
    if (held) held_at_ = now;
    return now - held_at_ >= release_after_;
  }
  /// True when a coupling begins.
  template <int N>
  bool step(Duration now, const PeerState<N>& peer, bool let_go) noexcept {
    const Mode other = peer.newest.mode;
    const Duration silence = now - peer.proven_at;
    const bool heard = peer.has_report && silence < hold_after_ && told_ < kTold;
    const Mode was = mode_;
    if (was == Mode::coupled && heard && other == Mode::coupled && !let_go) [[likely]] {
      confirmed_ = true;
      with_us_at_ = now;
      return false;
    }
    const bool at_work = other == Mode::coupled || other == Mode::holding || other == Mode::let_go;
    if (at_work) confirmed_ = true, with_us_at_ = now;
    if (!heard) fault_ = false;
    const Duration alone = now - with_us_at_;
    const bool ready = other == Mode::idle || other == Mode::coupled || other == Mode::let_go;
    mode_ = next_mode(
        mode_, {.heard = heard,
                .with_us = at_work || (!confirmed_ && alone < hold_after_),
                .silent = silence >= release_after_ || alone >= release_after_,
                .may_begin = (ready && (first_ || (was == Mode::idle && Duration{peer.newest.echo_ns} >= ready_at_))) ||
                             (fault_ && at_work),
                .let_go = let_go});
    if (mode_ == was) return false;
    if (mode_ == Mode::idle) ready_at_ = now;
    if (mode_ == Mode::released) first_ = fault_ = false;
    const bool was_at_work = was == Mode::coupled || was == Mode::holding || was == Mode::let_go;
    if (!was_at_work && mode_ != Mode::idle) {
      is_first_ = std::exchange(first_, false);
      fault_ = false;
      confirmed_ = at_work;
      with_us_at_ = at_work ? now : now + peer.known_round_trip;
    }
    return begins(was, mode_);
  }
  /// By a fault of this side; the coupling begins again as soon as the other side is heard.
  void release() noexcept {
    if (mode_ == Mode::stopped) return;  // a stop lasts
    fault_ = mode_ != Mode::released || fault_;
    mode_ = Mode::released;
  }
  /// A new session.
  void reset() noexcept {
    told_ = 0;
    if (mode_ == Mode::stopped) return;
    mode_ = Mode::idle;
    first_ = is_first_ = true;
    fault_ = false;
  }

  /// Are the words of the other side's method of this coupling? Those from before refer to the registration of another one.
  [[nodiscard]] bool shares_coupling() const noexcept { return confirmed_ || is_first_; }

  [[nodiscard]] Mode mode() const noexcept { return mode_; }
  [[nodiscard]] bool coupled() const noexcept { return mode_ == Mode::coupled; }
  [[nodiscard]] bool active() const noexcept { return mode_ == Mode::coupled || mode_ == Mode::holding; }

 private:
  static constexpr int kTold = 3;

  Seconds pause_after_;
  Duration hold_after_, release_after_, held_at_{0};
  Mode mode_ = Mode::idle;
  int told_ = 0;            ///< reports in a row that say that the other side is stopped or ends
  bool first_ = true;       ///< no coupling of this session has begun
  bool fault_ = false;      ///< released by release()
  bool is_first_ = true;    ///< is the present coupling, or the next, the first one
  bool confirmed_ = false;  ///< the other side has said since the coupling began that it is coupled
  Duration ready_at_{0};    ///< since when this side waits for the other one
  Duration with_us_at_{0};  ///< the other side last said that it is coupled; when a coupling begins a round trip later
};

}  // namespace twoport
