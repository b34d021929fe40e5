#pragma once

#include <cstddef>
#include <cstdint>

#include "common/base/ring.h"
#include "common/recording/tick.h"

namespace twoport {

/// Ticks and received reports of a node, from its cycle to the recording thread, without waiting: if the ring is full a tick
/// is left out, and the numbers of the ticks show it.
template <int N>
class TickFeed final : public ReportTap<N> {
 public:
  struct Entry {
    bool is_tick = false;
    TickRecord<N> tick;  ///< of a received report: `sent` only
  };

  TickFeed() : ring_{kEntries} {}

  // From the cycle.
  void received(const Report<N>& report) noexcept override {
    received_.tick.sent = report;
    complete_ = ring_.try_push(received_) && complete_;
  }
  void sent(const Report<N>& report) noexcept override {
    entry_.tick.sends = true;
    entry_.tick.sent = report;
  }
  /// What has happened before the step.
  void begin(double t_s, std::uint32_t epoch_before, bool peer_restarted, std::uint32_t epoch,
             Duration session_since) noexcept {
    entry_.tick.t_s = t_s;
    entry_.tick.epoch_before = epoch_before;
    entry_.tick.peer_restarted = peer_restarted;
    entry_.tick.epoch = epoch;
    entry_.tick.session_since = session_since;
    entry_.tick.sends = false;
  }
  template <class Clock, class Sample, class Output>
  void end(const Tick<Clock>& tick, const Sample& sample, const Output& out) noexcept {
    TickRecord<N>& t = entry_.tick;
    entry_.is_tick = true;
    t.now = tick.now.time_since_epoch();
    t.dt = tick.dt, t.ended = tick.ended;
    t.take(sample);
    t.take_output(out);
    // Without all of its reports a tick cannot be replayed.
    if (!complete_ || !ring_.try_push(entry_)) ++missing_;
    complete_ = true;
    ++t.number;
  }
  /// Ticks left out. After the last tick.
  [[nodiscard]] std::uint64_t missing() const noexcept { return missing_; }

  /// From the recording thread.
  bool try_pop(Entry& entry) noexcept { return ring_.try_pop(entry); }

 private:
  static constexpr std::size_t kEntries = 16384;  ///< four seconds at 2 kHz both ways

  Ring<Entry> ring_;
  Entry entry_, received_;
  bool complete_ = true;
  std::uint64_t missing_ = 0;
};

}  // namespace twoport
