#include "lab/run.h"

#include <chrono>
#include <optional>

#include "common/record/metrics.h"
#include "common/record/trace.h"
#include "lab/simulation.h"

namespace twoport::lab {
namespace {

template <int N, class Simulation>
Summary run_as(Simulation& simulation, const Scene& scene, const std::string& trace_path) {
  const bool alone = scene.control.architecture == Architecture::uncontrolled;
  Metrics<N> metrics{alone ? scene.slave_rate_hz : scene.master_rate_hz, scene.duration_s, simulation.quiet_from_s(),
                     simulation.initial_energy().si()};
  std::optional<Trace<N>> trace;
  if (!trace_path.empty()) trace.emplace(trace_path);

  const auto start = std::chrono::steady_clock::now();
  const std::uint64_t ticks = simulation.run([&](const Row<N>& row) {
    if (trace) trace->add(row);
    return metrics.add(row);
  });
  const std::chrono::duration<double, std::nano> spent = std::chrono::steady_clock::now() - start;
  if (trace) trace->close();

  Summary s;
  metrics.fill(s);
  s.scene = scene.name;
  s.side = "lab";
  s.architecture = to_string(scene.control.architecture);
  s.method = to_string(scene.control.controller.method);
  s.dof = scene.dof;
  s.step_ns = spent.count() / static_cast<double>(std::max<std::uint64_t>(ticks, 1));
  if constexpr (requires { simulation.master_packets(); }) {
    s.to_slave = packets(simulation.master_packets().sent, simulation.slave_packets());
    s.to_master = packets(simulation.slave_packets().sent, simulation.master_packets());
    if (simulation.overflowed() > 0) s.verdict += "; packets in flight exceeded the line's room";
  }
  return s;
}

}  // namespace

Summary run(const Scene& scene, const std::string& trace_path) {
  return with_size(scene, [&]<int N>() {
    return with_simulation<N>(scene, [&](auto simulation) { return run_as<N>(simulation, scene, trace_path); });
  });
}

}  // namespace twoport::lab
