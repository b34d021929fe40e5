#pragma once

#include <algorithm>
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
      : impairment_{options, seed}, slots_(std::bit_ceil(capacity)) {}
  DelayLine(const DelayLine&) = delete;

  /// `now` is the time since the run began.
  [[gnu::always_inline]] void put(const Packet& packet, Duration now) noexcept {
    if (impairment_.certain()) {
      insert(packet, now, now + impairment_.fixed_delay());
    } else {
      draw(packet, now);
    }
  }

  /// Oldest packet that is due: put in strictly before `now`, and due by then. Null when there is none.
  /// The pointer is good until the next put.
  [[gnu::always_inline]] const Packet* take(Duration now) noexcept {
    if (in_flight_ == 0 || out_->readable > now) return nullptr;
    const Slot* slot = out_;
    out_ = after(out_);
    --in_flight_;
    return &slot->packet;
  }

  [[nodiscard]] std::uint64_t lost() const noexcept { return lost_; }
  [[nodiscard]] std::uint64_t overflowed() const noexcept { return overflowed_; }

 private:
  /// Moments and delays are each rounded to a nanosecond; without this slack 2 ticks of delay at 3 kHz are sometimes 3.
  static constexpr Duration kRounding{1};
  static constexpr Duration kTick{1};  ///< the next moment that a clock can show

  struct Slot {
    Duration due{}, readable{};
    Packet packet{};
  };

  // By value: who puts may keep its packet in registers.
  [[gnu::noinline]] void draw(Packet packet, Duration now) noexcept {
    const Impairment::Fate fate = impairment_.draw(now);
    if (fate.copies == 0) ++lost_;
    for (int c = 0; c < fate.copies; ++c) insert(packet, now, now + fate.delay[c]);
  }

  [[gnu::always_inline]] void insert(const Packet& packet, Duration now, Duration due) noexcept {
    if (in_flight_ == slots_.size()) [[unlikely]] {
      ++overflowed_;
      return;
    }
    Slot* slot = in_;
    if (due < latest_) [[unlikely]] {
      slot = overtake(due);
    } else {
      latest_ = due;
    }
    in_ = after(in_);
    ++in_flight_;
    slot->due = due;
    slot->readable = due > now + kRounding ? due - kRounding : now + kTick;
    slot->packet = packet;
  }

  /// Moves back those that are due later, and returns the place before them.
  [[gnu::noinline]] Slot* overtake(Duration due) noexcept {
    Slot* at = in_;
    for (std::size_t left = in_flight_; left > 0 && before(at)->due > due; --left) {
      *at = *before(at);
      at = before(at);
    }
    return at;
  }
  Slot* after(Slot* slot) noexcept { return slot == &slots_.back() ? slots_.data() : slot + 1; }
  Slot* before(Slot* slot) noexcept { return slot == slots_.data() ? &slots_.back() : slot - 1; }

  Impairment impairment_;
  std::vector<Slot> slots_;
  Slot *in_ = slots_.data(), *out_ = slots_.data();
  std::size_t in_flight_ = 0;
  Duration latest_{0};  ///< due time of the last one put in that overtook nobody
  std::uint64_t lost_ = 0, overflowed_ = 0;
};

}  // namespace twoport
