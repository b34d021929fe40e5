#pragma once

#include <spdlog/logger.h>

#include <algorithm>
#include <chrono>
#include <cstdint>

#include "common/platform/program.h"
#include "common/platform/realtime.h"
#include "common/platform/recorder.h"
#include "common/runtime/modes.h"

namespace twoport {

/// Wall time of a node's cycle: read around it, never in it.
class StepClock {
 public:
  template <class F>
  auto time(F&& f) {
    const auto start = std::chrono::steady_clock::now();
    auto out = f();
    spent_ += std::chrono::steady_clock::now() - start;
    ++steps_;
    return out;
  }
  [[nodiscard]] double mean_ns() const { return steps_ > 0 ? spent_.count() / static_cast<double>(steps_) : 0.0; }

 private:
  std::chrono::duration<double, std::nano> spent_{0};
  std::uint64_t steps_ = 0;
};

inline void say_what_is_missing(spdlog::logger& log, const PeriodicLoop& loop) {
  for (const std::string& sentence : loop.not_permitted()) log.warn(sentence);
}

/// What a live summary says of time.
inline void add_times(Summary& s, const PeriodicLoop& loop, const StepClock& clock, bool interrupted) {
  s.loop_lateness_us = percentiles(loop.lateness(), 1e3);
  s.deadline_misses = static_cast<std::uint32_t>(loop.deadline_misses());
  s.step_ns = clock.mean_ns();
  if (interrupted) s.verdict += "; interrupted";
}

/// What a live summary says of the link: `out` is the way to the peer, `in` the way back.
template <class Mail>
void add_link(Summary& s, Packets& out, Packets& in, Mail& mail, Mode mode) {
  out.sent = static_cast<std::uint32_t>(mail.counts().sent - mail.transport().counts().unaddressed);
  in = packets(0, mail.counts(), mail.transport().counts().rejected);
  s.mode = to_string(mode);
  s.reconnects = static_cast<std::uint32_t>(std::max<std::uint64_t>(mail.transport().pairings(), 1) - 1);
}

/// Advances simulated hardware by every tick since the last, those that the loop left out included. Returns how many.
template <class Plant>
std::int64_t advance(Plant& plant, std::int64_t& done, std::int64_t k) noexcept {
  const std::int64_t ticks = k - done;
  for (; done < k; ++done) plant.advance();
  return ticks;
}
/// Tick of a loop after `passed` periods; before the first, one.
template <class Clock>
Tick<Clock> tick_after(std::int64_t passed, Duration now, Seconds dt) noexcept {
  return {Instant<Clock>{now}, dt, static_cast<double>(std::max<std::int64_t>(passed, 1)) * dt};
}

/// Concludes, and puts the trace in place last: a disk that is full costs the trace only.
template <int N>
int conclude(const Scene& scene, const LiveArguments& arguments, const std::string& side, const Summary& summary,
             bool judged, Recorder<N>& recorder) {
  const int status = conclude(scene, arguments, side, summary, judged);
  recorder.close_trace();
  return status;
}

/// What was not recorded, and packets that found no room.
inline void say_what_was_lost(spdlog::logger& log, std::uint64_t rows, std::uint64_t packets) {
  if (rows > 0) log.warn("{} ticks are in neither summary nor trace: the disk was too slow for them", rows);
  if (packets > 0) log.warn("{} packets found the simulated network full and count as lost", packets);
}

}  // namespace twoport
