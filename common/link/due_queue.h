#pragma once

#include <algorithm>
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

  explicit DueQueue(std::size_t capacity) : entries_(capacity + 1) {}
  DueQueue(const DueQueue& other)
      : entries_{other.entries_},
        in_{entries_.data() + (other.in_ - other.entries_.data())},
        out_{entries_.data() + (other.out_ - other.entries_.data())},
        latest_{other.latest_} {}
  DueQueue& operator=(const DueQueue&) = delete;

  /// `packet` is assigned to a Packet. False when the queue is full.
  template <class Content>
  bool put(const Content& packet, Duration now, Duration due) noexcept {
    Entry* entry = in_;
    Entry* const next = after(in_);
    if (next == out_) [[unlikely]]
      return false;
    // Those that are due later move back.
    for (; latest_ > due && entry != out_ && before(entry)->due > due; entry = before(entry)) *entry = *before(entry);
    latest_ = std::max(latest_, due);
    in_ = next;
    entry->due = due;
    entry->readable = due > now + kRounding ? due - kRounding : now + kTick;
    entry->packet = packet;
    return true;
  }

  /// Oldest packet that is due: put in strictly before `now`, and due by then. Null when there is none.
  /// The pointer is good until the next put.
  const Entry* take(Duration now) noexcept {
    if (empty() || out_->readable > now) return nullptr;
    const Entry* entry = out_;
    out_ = after(out_);
    fetch(out_);
    return entry;
  }
  [[nodiscard]] bool empty() const noexcept { return in_ == out_; }

 private:
  /// Moments and delays are each rounded to a nanosecond; without this slack 2 ticks of delay at 3 kHz are sometimes 3.
  static constexpr Duration kRounding{1};
  static constexpr Duration kTick{1};  ///< the next moment that a clock can show

  /// A tick later it is needed; where many simulations take turns it is no longer in the cache.
  static void fetch(const Entry* entry) noexcept {
    constexpr std::size_t kLine = 64, kMost = 4 * kLine;  // [B]
    for (std::size_t at = 0; at < std::min(sizeof(Entry), kMost); at += kLine)
      __builtin_prefetch(reinterpret_cast<const char*>(entry) + at);
  }

  Entry* after(Entry* entry) noexcept { return ++entry == entries_.data() + entries_.size() ? entries_.data() : entry; }
  Entry* before(Entry* entry) noexcept { return entry == entries_.data() ? &entries_.back() : entry - 1; }

  std::vector<Entry> entries_;  ///< in a circle; one is always free
  Entry *in_ = entries_.data(), *out_ = entries_.data();
  Duration latest_ = Duration::min();  ///< no packet has been due later
};

}  // namespace twoport
