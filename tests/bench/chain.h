#pragma once

#include <benchmark/benchmark.h>

#include <cstdint>
#include <string>

#include "common/record/metrics.h"
#include "common/scene/load.h"

namespace twoport::bench {

/// Runs the scene `text` once per iteration; items are ticks.
template <class Simulation, int N, bool kMetrics = false>
void chain(benchmark::State& state, const std::string& text) {
  const Scene scene = parse_scene(text, "bench");
  double end = 0.0;
  std::int64_t ticks = 0;
  for (auto _ : state) {
    state.PauseTiming();
    Simulation simulation{scene};
    Metrics<N> metrics{{.rate_hz = scene.master_rate_hz, .duration_s = scene.duration_s, .quiet_from_s = 1.0}};
    state.ResumeTiming();
    ticks += static_cast<std::int64_t>(simulation.run_until(simulation.end(), [&](const Row<N>& row) {
      end = row.slave_x.translation()[0];
      if constexpr (kMetrics) return metrics.add(row);
      return true;
    }));
    benchmark::ClobberMemory();
  }
  state.counters["slave_x_m"] = end;
  state.SetItemsProcessed(ticks);
}

}  // namespace twoport::bench
