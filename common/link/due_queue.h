#pragma once

#include <bit>
#include <cstddef>
#include <vector>

#include "common/base/time.h"

namespace twoport {

/// Packets by due time, first in first out where due together. Bounded. No allocation after construction.
template <class Packet>
class DueQueue {
 public:
  struct Entry {
    Duration due{}, readable{};
    Packet packet{};
  };

  explicit DueQueue(std::size_t capacity) : entries_(std::bit_ceil(capacity)) {}
  DueQueue(const DueQueue& other)
      : entries_{other.entries_},
        in_{entries_.data() + (other.in_ - other.entries_.data())},
        out_{entries_.data() + (other.out_ - other.entries_.data())},
        size_{other.size_} {}
  DueQueue& operator=(const DueQueue&) = delete;

  /// `packet` is assigned to a Packet. False when the queue is full.
  template <class Content>
  [[gnu::always_inline]] bool put(const Content& packet, Duration now, Duration due) noexcept {
    if (size_ == entries_.size()) [[unlikely]]
      return false;
    Entry* entry = in_;
    // Those that are due later move back.
    for (std::size_t left = size_; left > 0 && before(entry)->due > due; --left) {
      *entry = *before(entry);
      entry = before(entry);
    }
    in_ = after(in_);
    ++size_;
    entry->due = due;
    entry->readable = due > now + kRounding ? due - kRounding : now + kTick;
    entry->packet = packet;
    return true;
  }

  /// Oldest packet that is due: put in strictly before `now`, and due by then. Null when there is none.
  /// The pointer is good until the next put.
  [[gnu::always_inline]] const Entry* take(Duration now) noexcept {
    if (size_ == 0 || out_->readable > now) return nullptr;
    const Entry* entry = out_;
    out_ = after(out_);
    --size_;
    return entry;
  }
  [[nodiscard]] bool empty() const noexcept { return size_ == 0; }

 private:
  /// Moments and delays are each rounded to a nanosecond; without this slack 2 ticks of delay at 3 kHz are sometimes 3.
  static constexpr Duration kRounding{1};
  static constexpr Duration kTick{1};  ///< the next moment that a clock can show

  Entry* after(Entry* entry) noexcept { return entry == &entries_.back() ? entries_.data() : entry + 1; }
  Entry* before(Entry* entry) noexcept { return entry == entries_.data() ? &entries_.back() : entry - 1; }

  std::vector<Entry> entries_;
  Entry *in_ = entries_.data(), *out_ = entries_.data();
  std::size_t size_ = 0;
};

}  // namespace twoport
