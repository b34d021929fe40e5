#pragma once

#include "common/base/time.h"
#include "common/coupling/options.h"
#include "common/link/mailbox.h"

namespace twoport {

/// State of the link at one tick.
struct Health {
  bool heard;   ///< a report of the other side has arrived within hold_after
  bool silent;  ///< none within release_after
};

/// idle -> coupled on the first report; coupled -> holding when the link is silent; holding -> coupled when reports
/// arrive again, -> released when it stays silent; released -> coupled when reports arrive again.
[[nodiscard]] constexpr Mode next_mode(Mode mode, const Health& health) noexcept {
  if (health.heard) return Mode::coupled;
  if (mode == Mode::coupled || mode == Mode::holding) return health.silent ? Mode::released : Mode::holding;
  return mode;
}

/// Does a change from `was` to `mode` begin a coupling? A return from holding continues the existing one.
[[nodiscard]] constexpr bool begins(Mode was, Mode mode) noexcept {
  return mode != was && mode == Mode::coupled && was != Mode::holding;
}

/// The mode of one side from tick to tick.
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
  /// True when a coupling begins.
  template <int N>
  [[gnu::always_inline]] bool step(Duration now, const PeerState<N>& peer) noexcept {
    const Duration silence = now - peer.received_at;
    const Mode was = mode_;
    mode_ = next_mode(mode_, {.heard = peer.has_report && silence < hold_after_, .silent = silence >= release_after_});
    return begins(was, mode_);
  }
  void release() noexcept { mode_ = Mode::released; }
  void reset() noexcept { mode_ = Mode::idle; }

  [[nodiscard]] Mode mode() const noexcept { return mode_; }
  [[nodiscard]] bool coupled() const noexcept { return mode_ == Mode::coupled; }
  [[nodiscard]] bool active() const noexcept { return mode_ == Mode::coupled || mode_ == Mode::holding; }

 private:
  Seconds pause_after_;
  Duration hold_after_, release_after_;
  Mode mode_ = Mode::idle;
};

static_assert(next_mode(Mode::idle, {.heard = false, .silent = true}) == Mode::idle);
static_assert(next_mode(Mode::coupled, {.heard = false, .silent = false}) == Mode::holding);
static_assert(next_mode(Mode::holding, {.heard = false, .silent = true}) == Mode::released);
static_assert(next_mode(Mode::released, {.heard = true, .silent = false}) == Mode::coupled);

}  // namespace twoport
