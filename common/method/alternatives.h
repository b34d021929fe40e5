#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "common/coupling/options.h"

namespace twoport {

/// The halves between which a node switches: configuration 0 is the first control of the scene, k its entry k - 1 of the
/// schedule. Epoch e has configuration e modulo their number. All are made before the run: a switch does not allocate.
template <class Half>
class Alternatives {
 public:
  Alternatives() = default;
  Alternatives(const ControlOptions& first, std::span<const ScheduledControl> schedule) {
    if (schedule.empty()) return;
    halves_.reserve(schedule.size() + 1);
    halves_.emplace_back(first);  // a place: this half is in use
    for (const ScheduledControl& entry : schedule) halves_.emplace_back(entry.control);
  }

  [[nodiscard]] bool empty() const noexcept { return halves_.empty(); }
  /// The half of an epoch; null where it is the one in use.
  [[nodiscard]] Half* of(std::uint32_t epoch) noexcept {
    const std::size_t wanted = epoch % halves_.size();
    return wanted == used_ ? nullptr : &halves_[wanted];
  }
  /// The half of that epoch is in use now, and the previous one is in its place.
  void used(std::uint32_t epoch) noexcept {
    const std::size_t now = epoch % halves_.size();
    if (now != used_) std::swap(halves_[now], halves_[used_]);
    used_ = now;
  }

 private:
  std::vector<Half> halves_;
  std::size_t used_ = 0;
};

/// When a master switches: each entry of the schedule at its time, unless it has been reached by hand.
class SwitchTimes {
 public:
  explicit SwitchTimes(std::span<const ScheduledControl> schedule) {
    for (const ScheduledControl& entry : schedule) at_s_.push_back(entry.at_s);
  }
  [[nodiscard]] bool any() const noexcept { return !at_s_.empty(); }
  /// Is the switch to the next epoch due? `epoch`: the present one.
  [[nodiscard]] bool due(double t_s, std::uint32_t epoch) const noexcept {
    return epoch < at_s_.size() && t_s >= at_s_[epoch];
  }
  void end() noexcept { at_s_.clear(); }

 private:
  std::vector<double> at_s_;
};

}  // namespace twoport
