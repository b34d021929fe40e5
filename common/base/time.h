#pragma once

#include <chrono>
#include <cmath>
#include <cstdint>

#include "common/base/scalar.h"

namespace twoport {

using Duration = std::chrono::nanoseconds;

/// A clock without now(): the caller of a step passes the time.
template <class Self>
struct Timeline {
  using duration = Duration;
  using rep = duration::rep;
  using period = duration::period;
  using time_point = std::chrono::time_point<Self, duration>;
  static constexpr bool is_steady = true;
  static time_point now() = delete;
};
struct MasterClock : Timeline<MasterClock> {};
struct SlaveClock : Timeline<SlaveClock> {};

/// A time by one side's clock. Times of the two sides cannot be subtracted: only the round trip can be measured.
template <class Clock>
using Instant = std::chrono::time_point<Clock, Duration>;

/// One control period: its start by this side's clock, its length T, and the length of the interval that ends at its
/// start: T, or several T if ticks were skipped.
template <class Clock>
struct Tick {
  Instant<Clock> now;
  Seconds dt;
  Seconds ended = dt;
};

inline constexpr double kNanosecondsPerSecond = 1e9;

constexpr Seconds to_seconds(Duration d) {
  return Seconds{static_cast<double>(d.count()) / kNanosecondsPerSecond};
}
inline Duration to_duration(double seconds) {
  return Duration{std::llround(seconds * kNanosecondsPerSecond)};
}

/// Starts of the ticks of a loop: rounded once from k/rate, so that errors do not accumulate.
class TickTimes {
 public:
  explicit TickTimes(double rate_hz) : period_ns_{kNanosecondsPerSecond / rate_hz} {}
  Duration operator[](std::int64_t k) const noexcept {
    return Duration{static_cast<std::int64_t>(static_cast<double>(k) * period_ns_ + 0.5)};
  }

 private:
  double period_ns_;
};
/// Start of tick k of a loop at `rate_hz`.
inline Duration tick_time(std::int64_t k, double rate_hz) {
  return TickTimes{rate_hz}[k];
}

}  // namespace twoport
