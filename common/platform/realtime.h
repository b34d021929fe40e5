#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/histogram.h"
#include "common/base/time.h"

namespace twoport {

/// Set by SIGINT, SIGTERM and SIGHUP, also repeated, from the first call on: the program ends only after it has
/// released its hardware and written its files. SIGQUIT (Ctrl-\) and SIGKILL still end it at once, without either.
const std::atomic<bool>& stop_on_signals();

/// Number of SIGUSR1 received since the first call. For a master: each switches to the next entry of the schedule.
unsigned switches_by_hand() noexcept;

struct LoopOptions {
  double rate_hz = 1000.0;
  bool realtime = true;  ///< ask for locked memory, SCHED_FIFO, no idle states, and the finest timer
  int priority = 80;     ///< of SCHED_FIFO, 1 to 99
  bool spin = true;      ///< spin the last 50 us before each tick
};

/// Runs a step at tick k = start + k/rate of CLOCK_MONOTONIC, with the permitted real-time settings. Construct
/// it in the thread that runs it: the destructor restores that thread's scheduling.
/// The loop itself does not allocate.
class PeriodicLoop {
 public:
  /// Throws ConfigError when an option is out of its range. What is not permitted is not an error.
  explicit PeriodicLoop(const LoopOptions& options);
  ~PeriodicLoop();
  PeriodicLoop(const PeriodicLoop&) = delete;
  PeriodicLoop& operator=(const PeriodicLoop&) = delete;

  /// Settings that were not permitted, and the remedy: a sentence each.
  [[nodiscard]] const std::vector<std::string>& not_permitted() const noexcept { return not_permitted_; }

  /// Calls `bool step(std::int64_t k, Duration now)` every tick until it returns false or `stop` is set. `now` is the
  /// nominal time of tick k since the start, tick_time(k, rate). When a whole period was missed, k jumps:
  /// late ticks are skipped, not executed later.
  template <class Step>
  void run(const std::atomic<bool>& stop, Step&& step) {
    begin();
    for (std::int64_t k = next(stop); k >= 0; k = next(stop))
      if (!step(k, tick_time(k, options_.rate_hz))) break;
  }

  /// Wake-up latency of each tick.
  [[nodiscard]] const Histogram& lateness() const noexcept { return lateness_; }
  /// The same of this tick, from within the step.
  [[nodiscard]] Duration late() const noexcept { return late_; }
  /// Skipped ticks, for which the loop was more than a period late.
  [[nodiscard]] std::uint64_t deadline_misses() const noexcept { return deadline_misses_; }

 private:
  void begin();
  std::int64_t next(const std::atomic<bool>& stop) noexcept;
  [[nodiscard]] Duration deadline(std::int64_t k) const noexcept { return start_ + tick_time(k, options_.rate_hz); }

  void lock_memory();
  void take_priority();
  void stay_awake();
  void sharpen_timer();

  LoopOptions options_;
  std::vector<std::string> not_permitted_;
  bool locked_ = false;
  int latency_fd_ = -1;
  int previous_policy_ = -1, previous_priority_ = 0;
  int previous_slack_ns_ = -1;
  Duration start_{0}, late_{0};
  std::int64_t last_ = -1;
  Histogram lateness_;
  std::uint64_t deadline_misses_ = 0;
};

}  // namespace twoport
