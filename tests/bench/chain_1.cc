// The chain with one axis, and the cost of the blocks of a scene; compiled with the options of lab/engine/dof_1.cc.

#include "common/method/passivity/time_domain/time_domain.h"
#include "lab/engine/loops.h"
#include "tests/bench/chain.h"
#include "tests/support/hand_written.h"

namespace {

using namespace twoport;
using bench::chain;
using bench::wall_scene;

void chain1(benchmark::State& s) {
  chain<lab::LinkLoop<1, TimeDomainPassivity>, 1>(s, wall_scene(1));
}
void chain1_metrics(benchmark::State& s) {
  chain<lab::LinkLoop<1, TimeDomainPassivity>, 1, true>(s, wall_scene(1));
}

// An absent block costs nothing: the same device alone in free space, then with all there is.
constexpr const char* kFree = R"(dof: 1 duration_s: 8 rate_hz: 2000 device { mass_kg: 0.075 velocity_m_per_s: [0.01] }
  control { architecture: RENDER })";
constexpr const char* kFull = R"(dof: 1 duration_s: 8 rate_hz: 2000
  operator { hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 }
             path { move_to { position_m: [0.03] duration_s: 1 } } path { sine { amplitude_m: 0.01 frequency_hz: 1 duration_s: 6 } } }
  device { mass_kg: 0.075 coulomb_friction_n: 0.04 position_resolution_m: 30e-6 velocity_estimate: FILTERED max_force_n: 8.5 }
  control { passivity { method: FORCE_PROJECTED } }
  to_slave { delay_ms: 20 jitter_ms: 3 loss: 0.05 } to_master { delay_ms: 20 jitter_ms: 3 loss: 0.05 }
  robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { noise_n: 0.01 latency_ms: 1 } }
  environment { wall { normal: [-1] offset_m: -0.02 stiffness_n_per_m: 5000 damping_n_s_per_m: 2 } })";
void free_space(benchmark::State& s) {
  chain<lab::RenderLoop<1>, 1>(s, kFree);
}
void full_scene(benchmark::State& s) {
  chain<lab::LinkLoop<1, TimeDomainPassivity>, 1>(s, kFull);
}

BENCHMARK(chain1);
BENCHMARK(chain1_metrics);
BENCHMARK(free_space);
BENCHMARK(full_scene);

}  // namespace
