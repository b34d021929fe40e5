#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "common/base/time.h"

namespace twoport {

/// Durations counted in buckets that are narrow where durations are short: 1 ns wide below 128 ns, above that 128 to an
/// octave. A percentile is therefore within 0.4 % (and half a nanosecond) of the value itself; the largest is kept
/// exactly. Up to 2^40 ns (18 min), longer ones count as that; below zero counts as zero.
/// 35 KiB, no allocation, no lock; `add` takes a few nanoseconds.
class Histogram {
 public:
  void add(Duration d) noexcept {
    const std::int64_t ns = std::clamp<std::int64_t>(d.count(), 0, kLongest);
    ++buckets_[index(static_cast<std::uint64_t>(ns))];
    ++count_;
    max_ = std::max(max_, Duration{ns});
  }

  [[nodiscard]] std::uint64_t count() const noexcept { return count_; }
  [[nodiscard]] Duration max() const noexcept { return max_; }

  /// Smallest duration that at least the fraction `p` of all do not exceed; p in (0, 1]. Zero when nothing was added.
  [[nodiscard]] Duration percentile(double p) const noexcept {
    const auto rank = static_cast<std::uint64_t>(std::ceil(std::clamp(p, 0.0, 1.0) * static_cast<double>(count_)));
    std::uint64_t seen = 0;
    for (std::size_t i = 0; i < kBuckets; ++i) {
      seen += buckets_[i];
      if (seen >= rank && seen > 0) return std::min(middle(i), max_);
    }
    return max_;
  }

 private:
  static constexpr int kLinearBits = 7;
  static constexpr int kRangeBits = 40;
  static constexpr std::uint64_t kLinear = std::uint64_t{1} << kLinearBits;
  static constexpr std::int64_t kLongest = (std::int64_t{1} << kRangeBits) - 1;
  static constexpr std::size_t kBuckets = (kRangeBits - kLinearBits + 1) << kLinearBits;

  /// Octave of the value, then its seven bits below the leading one.
  static constexpr std::size_t index(std::uint64_t ns) noexcept {
    if (ns < kLinear) return ns;
    const int shift = 63 - std::countl_zero(ns) - kLinearBits;
    return (static_cast<std::size_t>(shift) << kLinearBits) + (ns >> shift);
  }
  static constexpr Duration middle(std::size_t i) noexcept {
    if (i < 2 * kLinear) return Duration{static_cast<std::int64_t>(i)};
    const std::size_t shift = (i >> kLinearBits) - 1;
    const std::uint64_t low = (i - (shift << kLinearBits)) << shift;
    return Duration{static_cast<std::int64_t>(low + (std::uint64_t{1} << shift) / 2)};
  }

  std::array<std::uint64_t, kBuckets> buckets_{};
  std::uint64_t count_ = 0;
  Duration max_{0};
};

}  // namespace twoport
