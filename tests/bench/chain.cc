// Cost per tick of the whole chain in virtual time, compared with a hand-written loop of the same equations, and
// single node steps. One axis and the blocks of a scene are in chain_1.cc. Compare times only within one run.

#include "tests/bench/chain.h"

#include <benchmark/benchmark.h>

#include <string>

#include "common/method/passivity/time_domain/time_domain.h"
#include "common/scene/load.h"
#include "lab/engine/loops.h"
#include "sim/operator/path.h"
#include "tests/support/hand_written.h"

namespace {

using namespace twoport;

constexpr double kSeconds = 8.0, kRate = 2000.0;

using bench::chain;
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

void chain3(benchmark::State& s) {
  chain<lab::LinkLoop<3, TimeDomainPassivity>, 3>(s, wall_scene(3));
}
void chain6(benchmark::State& s) {
  chain<lab::LinkLoop<6, TimeDomainPassivity>, 6>(s, wall_scene(6));
}
void chain3_metrics(benchmark::State& s) {
  chain<lab::LinkLoop<3, TimeDomainPassivity>, 3, true>(s, wall_scene(3));
}
void chain6_metrics(benchmark::State& s) {
  chain<lab::LinkLoop<6, TimeDomainPassivity>, 6, true>(s, wall_scene(6));
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

BENCHMARK(hand_written<1>);
BENCHMARK(hand_written<3>);
BENCHMARK(chain3);
BENCHMARK(chain3_metrics);
BENCHMARK(hand_written<6>);
BENCHMARK(chain6);
BENCHMARK(chain6_metrics);
BENCHMARK(master_step<1>);
BENCHMARK(slave_step<1>);
BENCHMARK(master_step<3>);
BENCHMARK(slave_step<3>);
BENCHMARK(master_step<6>);
BENCHMARK(slave_step<6>);

}  // namespace

BENCHMARK_MAIN();
