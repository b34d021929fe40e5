#include "lab/run.h"

#include <chrono>
#include <optional>

#include "common/record/metrics.h"
#include "common/record/trace.h"
#include "lab/engine/simulation.h"

namespace twoport::lab {
namespace {

template <int N>
Summary run_as(Simulation<N>& simulation, const Scene& scene, WholeFile* file) {
  const bool alone = scene.control.architecture == Architecture::uncontrolled;
  Metrics<N> metrics{alone ? scene.slave_rate_hz : scene.master_rate_hz, scene.duration_s, simulation.quiet_from_s(),
                     simulation.initial_energy().si()};
  std::optional<Trace<N>> trace;
  if (file != nullptr) trace.emplace(*file);

  const auto start = std::chrono::steady_clock::now();
  const std::uint64_t ticks = simulation.run([&](const Row<N>& row) {
    if (trace) trace->add(row);
    return metrics.add(row);
  });
  const std::chrono::duration<double, std::nano> spent = std::chrono::steady_clock::now() - start;

  Summary s;
  metrics.fill(s);
  describe_run(scene, "lab", s);
  s.set_step_ns(spent.count() / static_cast<double>(std::max<std::uint64_t>(ticks, 1)));
  if (const std::optional<LinkUse> link = simulation.link()) {
    *s.mutable_packets()->mutable_to_slave() = packets(link->master.sent, link->slave);
    *s.mutable_packets()->mutable_to_master() = packets(link->slave.sent, link->master);
    if (link->overflowed > 0) s.mutable_verdict()->append("; packets in flight exceeded the line's room");
  }
  return s;
}

}  // namespace

Summary run(const Scene& scene, WholeFile* trace) {
  return dispatch_dof(scene, [&]<int N>() { return run_as(*make_simulation<N>(scene), scene, trace); });
}

}  // namespace twoport::lab
