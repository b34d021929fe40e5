#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "common/base/time.h"
#include "common/link/due_queue.h"
#include "common/link/report.h"

namespace twoport {

/// Packets that a playout buffer has room for.
inline constexpr std::size_t kPlayoutRoom = 4096;

/// Receiver's playout buffer: turns jitter into delay. A packet is used at
///
///     sent + least + playout       least: smallest (arrival - sent) of the last 2 s, in which the clocks' offset cancels
///
/// or on arrival if that is later. Packets come out in the order of these times. Bounded; when it is full the oldest is used at
/// once. No allocation after construction.
template <int N>
class Playout {
 public:
  explicit Playout(double playout_s) : playout_{to_duration(playout_s)}, queue_{kPlayoutRoom} { clear(); }

  void put(const Report<N>& r, Duration now) noexcept {
    const Duration transit = now - Duration{r.sent_ns};
    const std::int64_t slot = now / kSlot;
    if (slot != slot_) begin(slot);
    Duration& least_of_slot = least_[static_cast<std::size_t>(slot) % kSlots];
    least_of_slot = std::min(least_of_slot, transit);
    const Duration least = *std::min_element(least_.begin(), least_.end());
    // Readable from `now` on where it is due already.
    const Duration due = Duration{r.sent_ns} + least + playout_;
    if (!queue_.put(r, now - Duration{2}, due)) ++overflowed_;
  }
  /// The next packet to be used, or null. Valid until the next put.
  const Report<N>* take(Duration now) noexcept {
    const auto* entry = queue_.take(now);
    return entry == nullptr ? nullptr : &entry->packet;
  }
  /// Drops what waits: another session begins.
  void clear() noexcept {
    while (queue_.take(Duration::max()) != nullptr) {
    }
    least_.fill(Duration::max());
    slot_ = -1;
  }
  [[nodiscard]] std::uint64_t overflowed() const noexcept { return overflowed_; }

 private:
  static constexpr std::size_t kSlots = 8;
  static constexpr Duration kSlot = std::chrono::milliseconds{250};

  void begin(std::int64_t slot) noexcept {
    const std::int64_t passed = slot_ < 0 ? static_cast<std::int64_t>(kSlots) : slot - slot_;
    for (std::int64_t i = 0; i < std::min(passed, static_cast<std::int64_t>(kSlots)); ++i)
      least_[static_cast<std::size_t>(slot - i) % kSlots] = Duration::max();
    slot_ = slot;
  }

  Duration playout_;
  DueQueue<Report<N>> queue_;
  std::array<Duration, kSlots> least_;
  std::int64_t slot_ = -1;
  std::uint64_t overflowed_ = 0;
};

}  // namespace twoport
