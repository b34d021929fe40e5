#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/histogram.h"
#include "tools/doctor/examine.h"

namespace twoport::doctor {

struct LoopRequest {
  double rate_hz = 1000.0, seconds = 2.0;
  bool realtime = true, spin = true;  ///< as the live programs
};

/// What a periodic loop did, and what the system did to it at its late ticks.
struct LoopFigures {
  double rate_hz = 0.0;
  std::uint64_t ticks = 0, skipped = 0;  ///< skipped: more than a period late
  Histogram lateness;
  std::vector<std::string> not_permitted;  ///< settings that were refused, a sentence each
  /// Ticks later than a tenth of a period, and what happened in the interval before: another program took the processor; a page
  /// came from disk; the thread moved to another processor; it waited for a processor; none of these.
  std::uint64_t late = 0, preempted = 0, faulted = 0, moved = 0, waited = 0, unexplained = 0;
};

/// Runs an empty step on a thread of its own. Throws ConfigError for a rate that no loop has.
LoopFigures measure_loop(const LoopRequest& request);

/// Asks for what the live programs ask for, on a thread of its own, and gives it back.
Permissions probe_permissions();

/// A file of this machine.
std::optional<std::string> read_file(const std::string& path);

/// good: nothing skipped and 99 % within a tenth of the period. notice: at most one tick in a thousand skipped and 99 % within a
/// quarter. bad: else.
Grade grade(const LoopFigures& figures);
/// One sentence on the loop; one on its late ticks, or empty.
std::string describe(const LoopFigures& figures);
std::string blame(const LoopFigures& figures);

}  // namespace twoport::doctor
