#pragma once

#include "common/base/time.h"
#include "common/coupling/options.h"
#include "common/hardware/status.h"
#include "common/link/mailbox.h"

namespace twoport {

/// State of the link at one tick.
struct Health {
  bool heard;   ///< a report of the other side has arrived within hold_after
  bool silent;  ///< none within release_after
  bool let_go;  ///< nobody has held the handle for release_after
};

/// idle -> coupled on the first report; coupled -> holding when the link is silent; holding -> coupled when reports
/// arrive again, -> released when it stays silent; released -> coupled when reports arrive again. While reports arrive and
/// nobody holds the handle: let_go.
[[nodiscard]] constexpr Mode next_mode(Mode mode, const Health& health) noexcept {
  if (health.heard) return health.let_go ? Mode::let_go : Mode::coupled;
  if (mode == Mode::coupled || mode == Mode::holding) return health.silent ? Mode::released : Mode::holding;
  return mode == Mode::let_go ? Mode::released : mode;
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
  /// Has this side's hardware been stopped, or do kTold reports in a row say so of the other side? One may be damaged. For good. Call in
  /// every tick.
  template <int N>
  [[nodiscard]] bool is_stopped(HardwareStatus own, const PeerState<N>& peer) noexcept {
    if (peer.newest.mode != Mode::stopped) [[likely]]
      told_ = 0;
    else if (peer.is_new)
      ++told_;
    if (own == HardwareStatus::stopped || told_ >= kTold) [[unlikely]]
      mode_ = Mode::stopped;
    return mode_ == Mode::stopped;
  }
  /// At the master: has nobody held the handle for release_after? Call in every tick, before step().
  [[nodiscard]] bool has_let_go(Duration now, bool held) noexcept {
    if (held) held_at_ = now;
    return now - held_at_ >= release_after_;
  }
  /// True when a coupling begins.
  template <int N>
  [[gnu::always_inline]] bool step(Duration now, const PeerState<N>& peer, bool let_go) noexcept {
    const Duration silence = now - peer.received_at;
    const Mode was = mode_;
    mode_ = next_mode(
        mode_,
        {.heard = peer.has_report && silence < hold_after_, .silent = silence >= release_after_, .let_go = let_go});
    return begins(was, mode_);
  }
  void release() noexcept { change_to(Mode::released); }
  void reset() noexcept { change_to(Mode::idle); }

  [[nodiscard]] Mode mode() const noexcept { return mode_; }
  [[nodiscard]] bool coupled() const noexcept { return mode_ == Mode::coupled; }
  [[nodiscard]] bool active() const noexcept { return mode_ == Mode::coupled || mode_ == Mode::holding; }

 private:
  static constexpr int kTold = 3;

  /// A stop lasts.
  void change_to(Mode mode) noexcept {
    if (mode_ != Mode::stopped) mode_ = mode;
  }

  Seconds pause_after_;
  Duration hold_after_, release_after_, held_at_{0};
  Mode mode_ = Mode::idle;
  int told_ = 0;  ///< reports in a row that say that the other side is stopped
};

static_assert(next_mode(Mode::idle, {.heard = false, .silent = true, .let_go = false}) == Mode::idle);
static_assert(next_mode(Mode::coupled, {.heard = false, .silent = false, .let_go = false}) == Mode::holding);
static_assert(next_mode(Mode::holding, {.heard = false, .silent = true, .let_go = false}) == Mode::released);
static_assert(next_mode(Mode::released, {.heard = true, .silent = false, .let_go = false}) == Mode::coupled);
static_assert(next_mode(Mode::coupled, {.heard = true, .silent = false, .let_go = true}) == Mode::let_go);

}  // namespace twoport
