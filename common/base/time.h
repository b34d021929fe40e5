#pragma once

#include <chrono>
#include <cmath>
#include <cstdint>

#include "common/base/scalar.h"

namespace twoport {

using Duration = std::chrono::nanoseconds;

/// A clock nobody can ask for the time: whoever runs the loop hands it in.
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

/// A moment by one side's clock. Moments of the two sides do not subtract: only a round trip is a measurement.
template <class Clock>
using Instant = std::chrono::time_point<Clock, Duration>;

/// One control period: when it starts, by this side's clock, how long it lasts (T), and how long the interval was that
/// ends with it: T, or several where ticks were left out.
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

/// Start of tick k of a loop at `rate_hz`: rounded once from k/rate, so that no error adds up.
inline Duration tick_time(std::int64_t k, double rate_hz) {
  return Duration{static_cast<std::int64_t>(static_cast<double>(k) * (kNanosecondsPerSecond / rate_hz) + 0.5)};
}

}  // namespace twoport
