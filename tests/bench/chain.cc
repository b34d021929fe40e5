// Cost per tick of the whole chain in virtual time, compared with a hand-written loop of the same equations, of the blocks of a scene, and
// of single node steps. Compare times only within one run.

#include <benchmark/benchmark.h>

#include <cstdint>
#include <string>

#include "common/method/passivity/time_domain/time_domain.h"
#include "common/record/metrics.h"
#include "common/scene/load.h"
#include "lab/engine/loops.h"
#include "sim/operator/path.h"
#include "tests/support/hand_written.h"

namespace {

using namespace twoport;

constexpr double kSeconds = 8.0, kRate = 2000.0;

using bench::wall_scene;

template <int N>
struct Loop {
  using Type = bench::HandWritten<N>;
  static typename Type::V position(double x) { return x * Type::V::Unit(0); }
  static double end(const Type& loop) { return loop.slave()[0]; }
};
template <>
struct Loop<6> {
  using Type = bench::HandWritten6;
  static Position<6> position(double x) { return {x * Eigen::Vector3d::UnitX(), Eigen::Quaterniond::Identity()}; }
  static double end(const Type& loop) { return loop.slave().translation()[0]; }
};

template <int N>
void hand_written(benchmark::State& state) {
  const bench::WallParameters p;
  double end = 0.0;
  for (auto _ : state) {
    typename Loop<N>::Type loop{p};
    for (int k = 1; k <= static_cast<int>(kSeconds * kRate); ++k) loop.step(Loop<N>::position(p.intended(k)));
    end = Loop<N>::end(loop);
    benchmark::ClobberMemory();
  }
  state.counters["slave_x_m"] = end;
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(kSeconds * kRate));
}

/// Runs the scene `text` once per iteration; items are ticks.
template <class Simulation, int N, bool kMetrics = false>
void run_scene(benchmark::State& state, const std::string& text) {
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
template <int N, bool kMetrics>
void chain(benchmark::State& s) {
  run_scene<lab::LinkLoop<N, TimeDomainPassivity>, N, kMetrics>(s, wall_scene(N));
}

// An absent block costs nothing: the same device alone in free space, then with all there is.
void free_space(benchmark::State& s) {
  run_scene<lab::RenderLoop<1>, 1>(s, R"(dof: 1 duration_s: 8 rate_hz: 2000
    device { mass_kg: 0.075 velocity_m_per_s: [0.01] } control { architecture: RENDER })");
}
void full_scene(benchmark::State& s) {
  run_scene<lab::LinkLoop<1, TimeDomainPassivity>, 1>(s, R"(dof: 1 duration_s: 8 rate_hz: 2000
    operator { hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 }
               path { move_to { position_m: [0.03] duration_s: 1 } } path { sine { amplitude_m: 0.01 frequency_hz: 1 duration_s: 6 } } }
    device { mass_kg: 0.075 coulomb_friction_n: 0.04 position_resolution_m: 30e-6 velocity_estimate: FILTERED max_force_n: 8.5 }
    control { passivity { method: FORCE_PROJECTED } }
    to_slave { delay_ms: 20 jitter_ms: 3 loss: 0.05 } to_master { delay_ms: 20 jitter_ms: 3 loss: 0.05 }
    robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { noise_n: 0.01 latency_ms: 1 } }
    environment { wall { normal: [-1] offset_m: -0.02 stiffness_n_per_m: 5000 damping_n_s_per_m: 2 } })");
}

template <int N>
void master_step(benchmark::State& state) {
  MasterNode<N, TimeDomainPassivity::Master<N>> node{parse_scene(wall_scene(N), "bench").control};
  DeviceSample<N> device{};
  PeerState<N> known{};
  known.has_report = true;
  known.newest.mode = Mode::coupled;
  known.newest.f = Force<N>{Force<N>::Vector::Ones()};
  known.energy_in_j = 1e9;
  std::int64_t k = 0;
  const Seconds dt{1 / kRate};
  for (auto _ : state) {
    const Duration now = tick_time(++k, kRate);
    known.received_at = known.proven_at = now;
    device.v = Velocity<N>{Velocity<N>::Vector::Constant(k % 2 == 0 ? 0.1 : -0.1)};
    device.x = device.x + device.v * dt;
    benchmark::DoNotOptimize(node.step(Tick<MasterClock>{Instant<MasterClock>{now}, dt}, device, known));
  }
}
template <int N>
void slave_step(benchmark::State& state) {
  SlaveNode<N, TimeDomainPassivity::Slave<N>> node{parse_scene(wall_scene(N), "bench").control};
  RobotSample<N> robot{};
  PeerState<N> known{};
  known.has_report = known.is_new = true;
  known.newest.mode = Mode::coupled;
  known.energy_in_j = 1e9;
  std::int64_t k = 0;
  const Seconds dt{1 / kRate};
  for (auto _ : state) {
    const Duration now = tick_time(++k, kRate);
    known.received_at = known.proven_at = now;
    known.newest.v = Velocity<N>{Velocity<N>::Vector::Constant(k % 2 == 0 ? 0.1 : -0.1)};
    known.newest.x = known.newest.x + known.newest.v * dt;
    benchmark::DoNotOptimize(node.step(Tick<SlaveClock>{Instant<SlaveClock>{now}, dt}, robot, known));
  }
}

template <int N>
void add() {
  const std::string chain_n = "chain" + std::to_string(N), of_n = "<" + std::to_string(N) + ">";
  benchmark::RegisterBenchmark(("hand_written" + of_n).c_str(), hand_written<N>);
  benchmark::RegisterBenchmark(chain_n.c_str(), chain<N, false>);
  benchmark::RegisterBenchmark((chain_n + "_metrics").c_str(), chain<N, true>);
  benchmark::RegisterBenchmark(("master_step" + of_n).c_str(), master_step<N>);
  benchmark::RegisterBenchmark(("slave_step" + of_n).c_str(), slave_step<N>);
}
const bool added = (add<1>(), add<3>(), add<6>(), true);
BENCHMARK(free_space);
BENCHMARK(full_scene);

}  // namespace

BENCHMARK_MAIN();
