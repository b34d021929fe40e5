#pragma once

#include <array>
#include <atomic>

namespace twoport {

/// The newest value of one thread for one other: three slots, of which each has one and the third changes hands. Neither waits.
template <class T>
class Newest {
 public:
  void put(const T& value) noexcept {
    slots_[back_] = value;
    back_ = between_.exchange(back_ | kNew, std::memory_order_acq_rel) & ~kNew;
  }
  /// False, and `value` as it was, where there is no newer one.
  bool take(T& value) noexcept {
    if ((between_.load(std::memory_order_relaxed) & kNew) == 0) return false;
    front_ = between_.exchange(front_, std::memory_order_acq_rel) & ~kNew;
    value = slots_[front_];
    return true;
  }

 private:
  static constexpr unsigned kNew = 4;
  std::array<T, 3> slots_{};
  std::atomic<unsigned> between_{1};
  unsigned back_ = 0, front_ = 2;
};

}  // namespace twoport
