#include "tests/support/no_alloc.h"

#include <gtest/gtest.h>

#include "common/link/mailbox.h"
#include "common/scene/load.h"
#include "lab/engine/simulation.h"

namespace twoport::no_alloc_test {
namespace {

// clang-format off
// A world with every block, so that every branch of a step is walked.
std::string world(int dof, const std::string& architecture, const std::string& method) {
  const std::string n = dof == 1 ? "[-1]" : "[-1, 0, 0]", to = dof == 1 ? "[0.03]" : "[0.03, 0, 0]";
  const std::string six = dof == 6 ? " inertia_kg_m2: 1e-3" : "";
  return "dof: " + std::to_string(dof) + R"( duration_s: 1 rate_hz: 1000
    operator { hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 5 )" + six +
         (dof == 6 ? " rotational_stiffness_n_m_per_rad: 1" : "") + R"( }
               path { move_to { position_m: )" + to + R"( duration_s: 0.4 } } path { sine { amplitude_m: 0.02 frequency_hz: 2 duration_s: 0.5 } } }
    device { mass_kg: 0.1 damping_n_s_per_m: 0.1 coulomb_friction_n: 0.02 position_resolution_m: 1e-5 velocity_estimate: FILTERED max_force_n: 8 )" +
         six + R"( }
    control { architecture: )" + architecture + " passivity { method: " + method + R"( } }
    environment { wall { normal: )" + n + R"( offset_m: -0.01 stiffness_n_per_m: 3000 damping_n_s_per_m: 2 friction: 0.2 } }
    environment { spring { stiffness_n_per_m: 10 } }
    )" + (architecture == "RENDER" ? "" : R"(
    to_slave { delay_ms: 10 jitter_ms: 3 loss: 0.05 duplicate: 0.05 reorder: 0.05 burst { p: 0.01 r: 0.3 } }
    to_master { delay_ms: 10 jitter_ms: 3 jitter_distribution: PARETO loss: 0.05 }
    robot { mass_kg: 0.5 damping_n_s_per_m: 2 force_sensor { noise_n: 0.01 latency_ms: 2 } )" +
         std::string{dof == 6 ? "inertia_kg_m2: [1e-3, 2e-3, 2e-3]" : ""} + " }");
}
// clang-format on

template <int N>
void expect_no_allocation(const std::string& architecture, const std::string& method) {
  const auto simulation = lab::make_simulation<N>(parse_scene(world(N, architecture, method), "world"));
  double force = 0.0;
  int seen = 0;
  const typename lab::Simulation<N>::Visit look = [&](const Row<N>& row) {
    force = std::max(force, row.master_f.squared_norm());
    return true;
  };
  {
    NoAlloc guard;
    simulation->run(look);
    seen = guard.seen();
  }
  EXPECT_EQ(seen, 0) << architecture << " " << method << " dof " << N;
  EXPECT_GT(force, 0.0) << "nothing was touched";
}

template <int N>
void expect_no_allocation() {
  for (const char* method : {"NONE", "CLASSIC", "FORCE_PROJECTED"}) {
    for (const char* architecture : {"POSITION_FORCE", "POSITION_MEASURED_FORCE", "POSITION_POSITION"})
      expect_no_allocation<N>(architecture, method);
    expect_no_allocation<N>("RENDER", method);
  }
}

// Both nodes, both plants, both directions of the link, for a thousand cycles.
TEST(NoAllocation, InAnyStepOfOneAxis) {
  expect_no_allocation<1>();
}
TEST(NoAllocation, InAnyStepOfThreeAxes) {
  expect_no_allocation<3>();
}
TEST(NoAllocation, InAnyStepOfSixAxes) {
  expect_no_allocation<6>();
}

}  // namespace
}  // namespace twoport::no_alloc_test
