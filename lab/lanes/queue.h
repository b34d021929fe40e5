#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "common/scene/scene.h"
#include "lab/lanes/taken.h"

namespace twoport::lab::lanes {

/// Scenes of one shape, by delay: lanes with the same delays read their packets from the same slot. Threads take the next one.
class Queue {
 public:
  explicit Queue(std::span<const Scene* const> scenes) : scenes_{scenes} {
    std::vector<std::pair<std::int64_t, std::int64_t>> lags;
    for (const Scene* scene : scenes) {
      lags.emplace_back(lag_of(scene->to_slave, period_of(*scene)), lag_of(scene->to_master, period_of(*scene)));
      oldest_ = std::max(oldest_, oldest_of(*scene));
      window_ = std::max(window_, window_of(*scene));
      order_.push_back(order_.size());
    }
    std::stable_sort(order_.begin(), order_.end(), [&](std::size_t a, std::size_t b) { return lags[a] < lags[b]; });
  }
  /// The number of a scene that nobody has taken.
  std::optional<std::size_t> take() {
    const std::size_t i = next_.fetch_add(1);
    return i < order_.size() ? std::optional{order_[i]} : std::nullopt;
  }
  [[nodiscard]] const Scene& scene(std::size_t number) const { return *scenes_[number]; }
  [[nodiscard]] std::int64_t oldest() const { return oldest_; }
  [[nodiscard]] std::size_t window() const { return window_; }

 private:
  std::span<const Scene* const> scenes_;
  std::vector<std::size_t> order_;
  std::int64_t oldest_ = 0;
  std::size_t window_ = 0;
  std::atomic<std::size_t> next_{0};
};

}  // namespace twoport::lab::lanes
