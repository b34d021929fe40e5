#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace twoport::doctor {

/// unseen: cannot be read on this machine, which says nothing about it.
enum class Grade : std::uint8_t { good, notice, bad, unseen };
std::string to_string(Grade grade);

struct Finding {
  std::string name;
  Grade grade;
  std::string says;  ///< one sentence
  std::string cure;  ///< a command, or empty
};

/// The text of a file; empty where it cannot be read.
using ReadFile = std::function<std::optional<std::string>(const std::string& path)>;

/// What files do not say: found by trying.
struct Permissions {
  int rt_priority_limit = 0;           ///< RLIMIT_RTPRIO
  int rt_errno = 0;                    ///< of asking for SCHED_FIFO 80; 0: granted
  std::int64_t memory_lock_bytes = 0;  ///< RLIMIT_MEMLOCK; -1: unlimited
  int lock_errno = 0;                  ///< of locking all memory; 0: granted
  int latency_errno = 0;               ///< of opening /dev/cpu_dma_latency for writing; 0: granted
  int timer_slack_ns = -1;             ///< of this thread by default
  int processors = 0;                  ///< that this program may run on
  std::string kernel;                  ///< uname -v
};

/// Counters at the begin and the end of the measured loop.
struct Counters {
  std::optional<std::int64_t> steal_ticks, total_ticks;
  std::optional<std::int64_t> pressure_us, udp_queue_errors, softnet_dropped, throttled_periods, throttle_events;
  double at_s = 0.0;                                 ///< monotonic
  std::map<std::string, std::int64_t> interrupts{};  ///< of devices, by "NAME on processor N"
};
Counters read_counters(const ReadFile& read, double at_s);

/// Everything that makes a loop late, but the loop itself. Pure: files are read by `read`.
std::vector<Finding> examine(const ReadFile& read, const Permissions& may, const Counters& before,
                             const Counters& after);

}  // namespace twoport::doctor
