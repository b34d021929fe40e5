// Cost per tick of each method, both nodes, link and plants in virtual time: ns, and the ratio to NONE in the same round.
//
//   bench_methods [ROUNDS]      9 unless given; the methods of a size take turns, the least of the rounds counts

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <limits>
#include <string>
#include <vector>

#include "common/method/catalogue.h"
#include "common/scene/load.h"
#include "lab/engine/simulation.h"
#include "lab/study/map.h"
#include "tests/support/hand_written.h"

namespace {

using namespace twoport;

template <int N>
std::vector<double> ns_per_tick(const std::vector<std::string>& methods, int rounds) {
  std::vector<double> least(methods.size(), std::numeric_limits<double>::infinity());
  for (int r = 0; r < rounds; ++r)
    for (std::size_t m = 0; m < methods.size(); ++m) {
      const Scene scene =
          parse_scene(bench::wall_scene(N), "bench",
                      std::vector<std::string>{"robot.force_sensor={}", "control.passivity.method=" + methods[m]});
      const auto simulation = lab::make_simulation<N>(scene);
      const auto start = std::chrono::steady_clock::now();
      const std::uint64_t ticks = simulation->run_silently();
      const std::chrono::duration<double, std::nano> spent = std::chrono::steady_clock::now() - start;
      least[m] = std::min(least[m], spent.count() / static_cast<double>(ticks));
    }
  return least;
}

}  // namespace

int main(int argc, char** argv) {
  const int rounds = argc > 1 ? std::max(1, std::atoi(argv[1])) : 9;
  const std::vector<std::string> methods = method_names();
  const auto none = static_cast<std::size_t>(std::find(methods.begin(), methods.end(), "NONE") - methods.begin());
  const std::vector<double> of[] = {ns_per_tick<1>(methods, rounds), ns_per_tick<3>(methods, rounds),
                                    ns_per_tick<6>(methods, rounds)};
  fmt::print("{:<24} {:>16} {:>16} {:>16}\n", "ns per tick, of NONE", "dof 1", "dof 3", "dof 6");
  for (std::size_t m = 0; m < methods.size(); ++m) {
    fmt::print("{:<24}", methods[m]);
    for (const auto& each : of) fmt::print(" {:>8.0f} {:>7.2f}", each[m], each[m] / each[none]);
    fmt::print("\n");
  }
  return 0;
}
