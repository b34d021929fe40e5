#pragma once

#include <cstddef>
#include <cstdint>

#include "common/link/due_queue.h"
#include "common/link/impairment.h"

namespace twoport {

/// One direction of a network: packets leave after the delay drawn by the impairment, ordered by due time (first in
/// first out if equal). Bounded: a packet is dropped and counted if the line is full. No allocation after
/// construction.
template <class Packet>
class DelayLine {
 public:
  DelayLine(const ImpairmentOptions& options, std::uint64_t seed, std::size_t capacity = 4096)
      : impairment_{options, seed}, queue_{capacity} {}

  /// `packet` is assigned to a Packet; `now` is the time since the run began.
  template <class Content>
  void put(const Content& packet, Duration now) noexcept {
    put(packet, now, now);
  }

  /// The same with another time origin for blackouts.
  template <class Content>
  void put(const Content& packet, Duration now, Duration since_start) noexcept {
    if (impairment_.certain()) {
      insert(packet, now, now + impairment_.fixed_delay());
    } else {
      draw(packet, now, since_start);
    }
  }

  /// Oldest packet that is due: put in strictly before `now`, and due by then. Null when there is none.
  /// The pointer is good until the next put.
  const Packet* take(Duration now) noexcept {
    const auto* entry = queue_.take(now);
    return entry == nullptr ? nullptr : &entry->packet;
  }

  /// From now on there are no blackouts and no steps of the delay.
  void keep_as_it_is() noexcept { impairment_.keep_as_it_is(); }
  /// Changes delay, jitter and loss of the packets put in from now on.
  void adjust(double delay_s, double jitter_s, double loss) noexcept { impairment_.adjust(delay_s, jitter_s, loss); }
  /// Would every packet pass at once, and is none under way?
  [[nodiscard]] bool passes() const noexcept {
    return impairment_.certain() && impairment_.fixed_delay() == Duration{0} && queue_.empty();
  }

  [[nodiscard]] std::uint64_t lost() const noexcept { return lost_; }
  [[nodiscard]] std::uint64_t overflowed() const noexcept { return overflowed_; }

 private:
  // By value: who puts may keep its packet in registers.
  void draw(Packet packet, Duration now, Duration since_start) noexcept {
    const Impairment::Fate fate = impairment_.draw(since_start);
    if (fate.copies == 0) ++lost_;
    for (int c = 0; c < fate.copies; ++c) insert(packet, now, now + fate.delay[c]);
  }

  template <class Content>
  void insert(const Content& packet, Duration now, Duration due) noexcept {
    if (!queue_.put(packet, now, due)) [[unlikely]]
      ++overflowed_;
  }

  Impairment impairment_;
  DueQueue<Packet> queue_;
  std::uint64_t lost_ = 0, overflowed_ = 0;
};

}  // namespace twoport
