#include "lab/engine/summary_parts.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace twoport::lab {
namespace {

int severity(VerdictKind kind) {
  constexpr int kOf[] = {0, 1, 3, 2};  // in their order: stable, restless, unstable, undecided
  return kOf[static_cast<std::size_t>(kind)];
}

}  // namespace

std::vector<Part> parts(const std::vector<sim::SegmentTimes>& segments, double end_s) {
  constexpr std::size_t kStations = 16;
  std::vector<Part> all;
  double from_s = 0.0;
  const auto add = [&](double until_s, std::vector<double> stations_s) {
    if (!(until_s > from_s)) return;
    const double middle_s = 0.5 * (from_s + until_s), near_s = 1e-6 * (until_s - from_s);
    std::erase_if(stations_s, [&](double t) { return !(t > from_s + near_s && t < until_s - near_s); });
    // An odd step takes both sides of a swing.
    const std::size_t step = (stations_s.size() / kStations) | 1U;
    double at_s = from_s;
    const auto cut = [&](double t, bool ends, bool station) {
      all.push_back(
          {.from_s = at_s, .until_s = t, .late = at_s >= middle_s, .ends_segment = ends, .ends_at_station = station});
      at_s = t;
    };
    bool halved = false;
    for (std::size_t i = 0; i < stations_s.size(); i += step) {
      const bool is_middle = std::abs(stations_s[i] - middle_s) <= near_s;
      if (!halved && !is_middle && stations_s[i] > middle_s) cut(middle_s, false, false);
      halved = halved || stations_s[i] > middle_s - near_s;
      cut(is_middle ? middle_s : stations_s[i], false, true);
    }
    if (!halved) cut(middle_s, false, false);
    cut(until_s, true, false);
    from_s = until_s;
  };
  for (const sim::SegmentTimes& each : segments) add(std::min(each.end_s, end_s), each.stations_s);
  add(end_s, {});
  return all;
}

void keep_worse(Verdict& worst, const Verdict& held, double at_s) {
  if (severity(held.kind) <= severity(worst.kind)) return;
  worst = {held.kind, held.text + fmt::format(" (held in contact at {:.4g} s)", at_s)};
}

void fill_link(Summary& s, const LinkUse& use, const Scene& scene) {
  schema::Directions& packets = *s.mutable_packets();
  *packets.mutable_to_slave() = received_packets(use.slave);
  packets.mutable_to_slave()->set_sent(count(use.master.sent));
  *packets.mutable_to_master() = received_packets(use.master);
  packets.mutable_to_master()->set_sent(count(use.slave.sent));
  say_not_displayed(scene.control, use.not_displayed, s);
  if (!(scene.control.device_limits == PortLimits{} && scene.control.robot_limits == PortLimits{})) {
    *s.mutable_limits()->mutable_device() = limits_of_device(use.device_limits);
    *s.mutable_limits()->mutable_robot() = limits_of_robot(use.robot_limits);
  }
  if (!scene.schedule.empty()) s.set_switches(use.switches);
  if (use.clock) *s.mutable_slave_clock() = clock_estimate(*use.clock);
}

}  // namespace twoport::lab
