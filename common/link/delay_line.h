#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/link/impairment.h"

namespace twoport {

/// One direction of a network: what is put in comes out after the fate that its impairment draws, ordered by due time
/// (first in first out where due together). Bounded: a packet that finds the line full is dropped and counted.
/// No allocation after construction.
template <class Packet>
class DelayLine {
 public:
  DelayLine(const ImpairmentOptions& options, std::uint64_t seed, std::size_t capacity = 4096)
      : impairment_{options, seed}, slots_(std::bit_ceil(capacity)), mask_{slots_.size() - 1} {}

  /// `now` is the time since the run began.
  void put(const Packet& packet, Duration now) noexcept {
    const Impairment::Fate fate = impairment_.draw(now);
    if (fate.copies == 0) ++lost_;
    for (int c = 0; c < fate.copies; ++c) insert(packet, now, now + fate.delay[c]);
  }

  /// Oldest packet that is due: put in strictly before `now`, and due by then. Null when there is none.
  /// The pointer is good until the next put.
  const Packet* take(Duration now) noexcept {
    if (head_ == tail_) return nullptr;
    const Slot& slot = slots_[head_ & mask_];
    if (slot.due > now + kRounding || slot.put >= now) return nullptr;
    ++head_;
    return &slot.packet;
  }

  [[nodiscard]] std::uint64_t lost() const noexcept { return lost_; }
  [[nodiscard]] std::uint64_t overflowed() const noexcept { return overflowed_; }

 private:
  /// Moments and delays are each rounded to a nanosecond; without this slack 2 ticks of delay at 3 kHz are sometimes 3.
  static constexpr Duration kRounding{1};

  struct Slot {
    Duration put{}, due{};
    Packet packet{};
  };

  void insert(const Packet& packet, Duration now, Duration due) noexcept {
    if (tail_ - head_ > mask_) {
      ++overflowed_;
      return;
    }
    std::size_t at = tail_++;
    for (; at != head_ && slots_[(at - 1) & mask_].due > due; --at) slots_[at & mask_] = slots_[(at - 1) & mask_];
    Slot& slot = slots_[at & mask_];
    slot.put = now;
    slot.due = due;
    slot.packet = packet;
  }

  Impairment impairment_;
  std::vector<Slot> slots_;
  std::size_t mask_, head_ = 0, tail_ = 0;
  std::uint64_t lost_ = 0, overflowed_ = 0;
};

}  // namespace twoport
