#include "common/platform/live_run.h"

#include "common/wire/mismatch.h"

namespace twoport {

void say(spdlog::logger& log, const LiveFigures& f) {
  if (f.dropped_rows > 0)
    log.warn("{} ticks are in neither summary nor trace: the disk was too slow for them", f.dropped_rows);
  if (f.overflowed_packets > 0)
    log.warn("{} packets found the simulated network full and count as lost", f.overflowed_packets);
  if (f.stale_readings > 0) log.warn("the hardware had no new reading in {} ticks", f.stale_readings);
}

void fill(Summary& s, const LiveFigures& f) {
  *s.mutable_loop_lateness_us() = percentiles(f.loop.lateness(), 1e3);
  s.set_deadline_misses(static_cast<std::uint32_t>(f.loop.deadline_misses()));
  s.set_step_ns(f.clock.mean_ns());
}

Failure why_failed(std::string_view refusal, HardwareStatus last, double ran_s) {
  // Two that were started for different scenes are bad usage; one that is busy with another is not.
  if (!refusal.empty()) return {"refused: " + std::string{refusal}, is_mismatch(refusal) ? 2 : 1};
  if (last == HardwareStatus::fault)
    return {fmt::format("the hardware reports a fault, {:.3f} s after the start, and is released", ran_s), 1};
  return {};
}

}  // namespace twoport
