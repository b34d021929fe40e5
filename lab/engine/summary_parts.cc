#include "lab/engine/summary_parts.h"

#include <fmt/format.h>

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

std::vector<double> parts(std::vector<double> segment_ends_s, double end_s) {
  if (segment_ends_s.empty()) return {end_s};
  std::erase_if(segment_ends_s, [&](double t) { return !(t > 0.0 && t < end_s); });
  if (segment_ends_s.empty())
    for (int i = 1; i < 16; ++i) segment_ends_s.push_back(end_s * i / 16);
  segment_ends_s.push_back(end_s);
  return segment_ends_s;
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
