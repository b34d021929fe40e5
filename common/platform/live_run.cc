#include "common/platform/live_run.h"

#include "common/scene/scene.h"
#include "common/wire/mismatch.h"

namespace twoport {

void say_where(const FoxgloveServer& server, spdlog::logger& log) {
  log.info("foxglove: {}", server.url());
  if (!server.is_local())
    log.warn("--foxglove {}: whoever reaches this address sees positions and forces of this side, unencrypted",
             server.url());
}

void say(spdlog::logger& log, const LiveFigures& f) {
  if (f.dropped_rows > 0)
    log.warn("{} ticks are missing from summary and trace: the disk was too slow", f.dropped_rows);
  if (f.overflowed_packets > 0)
    log.warn("{} packets are counted as lost: the simulated network was full", f.overflowed_packets);
  if (f.stale_readings > 0) log.warn("the hardware had no new reading in {} ticks", f.stale_readings);
}

void fill(Summary& s, const LiveFigures& f) {
  *s.mutable_loop_lateness_us() = percentiles(f.loop.lateness(), 1e3);
  s.set_deadline_misses(count(f.loop.deadline_misses()));
  s.set_step_ns(f.clock.mean_ns());
}

std::vector<std::string> configurations(const Scene& scene) {
  std::vector<std::string> all;
  if (scene.schedule.empty()) return all;
  const auto words = [](const ControlOptions& c) { return c.method_name + ", " + to_string(c.architecture); };
  all.push_back(words(scene.control));
  for (const ScheduledControl& entry : scene.schedule) all.push_back(words(entry.control));
  return all;
}

Failure why_failed(std::string_view refusal, HardwareStatus last, std::string_view trouble, const char* stopped_by,
                   double ran_s, std::string_view missed) {
  // Different scenes are a usage error; a busy slave is not.
  if (!refusal.empty()) return {"refused: " + std::string{refusal}, is_mismatch(refusal) ? 2 : 1};
  if (last == HardwareStatus::fault)
    return {fmt::format("hardware fault {:.3f} s after the start{}{}; the hardware was released", ran_s,
                        trouble.empty() ? "" : ": ", trouble),
            1};
  if (stopped_by != nullptr) return {fmt::format("stopped by {}; the hardware was released", stopped_by), 1};
  if (!missed.empty()) return {std::string{missed}, 1};
  return {};
}

}  // namespace twoport
