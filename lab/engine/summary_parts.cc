#include "lab/engine/summary_parts.h"

#include <fmt/format.h>

#include <algorithm>

namespace twoport::lab {
namespace {

int severity(VerdictKind kind) {
  switch (kind) {
    case VerdictKind::stable:
      return 0;
    case VerdictKind::restless:
      return 1;
    case VerdictKind::undecided:
      return 2;
    case VerdictKind::unstable:
      break;
  }
  return 3;
}

}  // namespace

std::vector<Part> parts(const std::vector<double>& segment_ends_s, double end_s) {
  std::vector<Part> all;
  if (!segment_ends_s.empty()) {
    for (int i = 1; i < 16; ++i) all.push_back({end_s * i / 16, false});
    for (const double t : segment_ends_s) all.push_back({t, true});
    std::erase_if(all, [&](const Part& p) { return !(p.until_s > 0.0 && p.until_s < end_s); });
    // Of two that end at the same time that of the segment stays.
    std::ranges::sort(all, [](const Part& a, const Part& b) {
      return a.until_s != b.until_s ? a.until_s < b.until_s : a.ends_segment && !b.ends_segment;
    });
    const auto twice = std::ranges::unique(all, {}, &Part::until_s);
    all.erase(twice.begin(), twice.end());
  }
  all.push_back({end_s, segment_ends_s.empty() || segment_ends_s.back() <= end_s});
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
  if (!(scene.control.device_limits == PortLimits{} && scene.control.robot_limits == PortLimits{})) {
    *s.mutable_limits()->mutable_device() = limits_of_device(use.device_limits);
    *s.mutable_limits()->mutable_robot() = limits_of_robot(use.robot_limits);
  }
  if (!scene.schedule.empty()) s.set_switches(use.switches);
  if (use.clock) *s.mutable_slave_clock() = clock_estimate(*use.clock);
}

}  // namespace twoport::lab
