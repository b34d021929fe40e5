#pragma once

#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace twoport {

/// Rows from one thread to another, in order, without waiting: a row is dropped and counted if the ring is full. One
/// thread calls `try_push`, one other `try_pop`; anyone may read `dropped`. No allocation after construction, no
/// lock.
template <class Row>
class Ring {
 public:
  /// Holds `capacity` rows, rounded up to a power of two.
  explicit Ring(std::size_t capacity) : rows_(std::bit_ceil(capacity)), mask_{rows_.size() - 1} {}
  Ring(const Ring&) = delete;
  Ring& operator=(const Ring&) = delete;

  [[nodiscard]] std::size_t capacity() const noexcept { return rows_.size(); }

  /// False, and one more dropped, when the ring is full.
  bool try_push(const Row& row) noexcept {
    const std::uint64_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - head_seen_ > mask_) {
      head_seen_ = head_.load(std::memory_order_acquire);
      if (tail - head_seen_ > mask_) {
        dropped_.store(dropped_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
        return false;
      }
    }
    rows_[tail & mask_] = row;
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }

  /// The oldest row, into `row`. False when there is none.
  bool try_pop(Row& row) noexcept {
    const std::uint64_t head = head_.load(std::memory_order_relaxed);
    if (head == tail_seen_) {
      tail_seen_ = tail_.load(std::memory_order_acquire);
      if (head == tail_seen_) return false;
    }
    row = rows_[head & mask_];
    head_.store(head + 1, std::memory_order_release);
    return true;
  }

  [[nodiscard]] std::uint64_t dropped() const noexcept { return dropped_.load(std::memory_order_relaxed); }

 private:
  static constexpr std::size_t kCacheLine = 64;

  std::vector<Row> rows_;
  std::size_t mask_;
  // Each thread writes one line only, and keeps there what it last saw of the other.
  alignas(kCacheLine) std::atomic<std::uint64_t> tail_{0};
  std::uint64_t head_seen_ = 0;
  std::atomic<std::uint64_t> dropped_{0};
  alignas(kCacheLine) std::atomic<std::uint64_t> head_{0};
  std::uint64_t tail_seen_ = 0;
};

}  // namespace twoport
