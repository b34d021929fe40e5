// Figures of scripts/bench, one a line: "ratio NAME VALUE" are compared with those on record, "time NAME VALUE UNIT" are for reading.
//
//   bench_speed [--short] [--twice WORD]
//
// A ratio is of two minima of CPU time over rounds that take turns; less is better. --twice does the work of the figures whose name begins with
// WORD twice: a slowdown that scripts/bench has to see.

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <ctime>
#include <string>
#include <utility>
#include <vector>

#include "common/base/normal.h"
#include "common/link/delay_line.h"
#include "common/scene/load.h"
#include "lab/lanes/lanes.h"
#include "lab/study/many_runs.h"

namespace {

using namespace twoport;

struct Options {
  bool is_short = false;
  std::string twice;
};

/// Least of the CPU times [s] of two works that take turns, which are done `rounds` times; of `second` with its slowdown.
template <class First, class Second>
std::pair<double, double> least_times(int rounds, First first, Second second, bool twice) {
  const auto time_of = [](auto& work) {
    const std::clock_t start = std::clock();
    work();
    return static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  };
  std::pair<double, double> least{1e300, 1e300};
  for (int i = 0; i < rounds; ++i) {
    least.first = std::min(least.first, time_of(first));
    double t = time_of(second);
    if (twice) t += time_of(second);
    least.second = std::min(least.second, t);
  }
  return least;
}

bool begins(const std::string& name, const std::string& word) {
  return !word.empty() && name.compare(0, word.size(), word) == 0;
}

Scene wall(int dof, const char* method, std::uint64_t seed) {
  Scene scene = parse_scene(fmt::format(R"(dof: {} duration_s: 4 rate_hz: 2000
    operator {{ hand {{ mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 }}
      path {{ move_to {{ position_m: [{}] duration_s: 1 }} }} path {{ hold {{ duration_s: 1 }} }}
      path {{ move_to {{ position_m: [{}] duration_s: 1 }} }} }}
    device {{ mass_kg: 0.075 damping_n_s_per_m: 0.05 max_force_n: 8.5 }}
    control {{ architecture: POSITION_FORCE virtual_coupling {{ stiffness_n_per_m: 1000 damping_n_s_per_m: 20 }}
      passivity {{ method: {} }} }}
    to_slave {{ delay_ms: 20 loss: 0.05 }} to_master {{ delay_ms: 20 loss: 0.05 }}
    robot {{ mass_kg: 0.5 damping_n_s_per_m: 2 }}
    environment {{ wall {{ normal: [{}] offset_m: -0.02 stiffness_n_per_m: 2000 }} }})",
                                        dof, dof == 1 ? "0.03" : "0.03, 0, 0", dof == 1 ? "0" : "0, 0, 0", method,
                                        dof == 1 ? "-1" : "-1, 0, 0"),
                            "bench");
  scene.seed = seed;
  return scene;
}

/// A cell in lanes over one alone, tails included and without them.
void compare_lanes(const Options& o, int dof, const char* method) {
  const std::size_t count = o.is_short ? 32 : 128;
  std::vector<Scene> scenes;
  for (std::size_t i = 0; i < count; ++i) scenes.push_back(wall(dof, method, i));
  std::vector<const Scene*> all, few;
  for (const Scene& scene : scenes) all.push_back(&scene);
  few.assign(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(count / 8));
  double step_alone = 1e300, step_together = 1e300;
  const auto work = [&](const std::vector<const Scene*>& of, int lanes, double& step) {
    return [&of, lanes, &step] {
      lab::run_many(of, {.lanes = lanes}, [&](std::size_t, const Summary& s) { step = std::min(step, s.step_ns()); });
    };
  };
  const int widest = lab::widest_lanes();
  const std::string name = fmt::format("lanes_{}_of_{}_{}", widest, dof, method);
  const auto [alone, together] = least_times(o.is_short ? 3 : 5, work(few, 1, step_alone),
                                             work(all, widest, step_together), begins(name, o.twice));
  const double alone_s = alone / static_cast<double>(few.size()), together_s = together / static_cast<double>(count);
  fmt::print("time {0}_alone {1:.0f} cells/s\ntime {0} {2:.0f} cells/s\n", name, 1.0 / alone_s, 1.0 / together_s);
  fmt::print("time {0}_tick_alone {1:.1f} ns\ntime {0}_tick {2:.1f} ns\n", name, step_alone, step_together);
  fmt::print("ratio {} {:.4f}\n", name, together_s / alone_s);
}

/// A tick of the scenes with six axes over one of a wall with three, alone, without tails.
void compare_six_axes(const Options& o) {
  const Scene three = wall(3, "INTERNAL_MODEL", 1);
  const auto ticks = [](const Scene& scene) { return scene.duration_s * scene.rate_hz; };
  const auto run = [](const Scene& scene) {
    return [&scene] {
      const Scene* const one = &scene;
      lab::run_many({&one, 1}, {.lanes = 1, .verdict = lab::VerdictFrom::plain}, [](std::size_t, const Summary&) {});
    };
  };
  for (const char* name : {"assembly", "two_pegs", "box_into_corner", "arm_on_plate"}) {
    const Scene scene = load_scene(fmt::format("{}/{}.textproto", TWOPORT_SCENES, name));
    const auto [wall_s, scene_s] = least_times(5, run(three), run(scene), begins("six_axes", o.twice));
    const double tick_s = scene_s / ticks(scene);
    fmt::print("time six_axes_{0} {1:.2f} us\nratio six_axes_{0} {2:.3f}\n", name, 1e6 * tick_s,
               tick_s * ticks(three) / wall_s);
  }
}

volatile double sink;

void compare_draws(const Options& o) {
  const Random random{1};
  constexpr int kDraws = 200'000;
  const auto uniform = [&] {
    double sum = 0.0;
    for (int i = 0; i < kDraws; ++i) sum += random.uniform(static_cast<std::uint64_t>(i));
    sink = sum;
  };
  const auto normal = [&] {
    double sum = 0.0;
    for (int i = 0; i < kDraws; ++i) sum += twoport::normal(random, static_cast<std::uint64_t>(i));
    sink = sum;
  };
  const auto [one, other] = least_times(o.is_short ? 5 : 20, uniform, normal, begins("normal", o.twice));
  fmt::print("time uniform {:.2f} ns\ntime normal {:.2f} ns\n", 1e9 * one / kDraws, 1e9 * other / kDraws);
  fmt::print("ratio normal {:.3f}\n", other / one);
}

/// A packet through one direction, of the size of a report with three axes.
void compare_lines(const Options& o) {
  struct Packet {
    double words[16];
  };
  constexpr int kPackets = 50'000;
  const auto through = [&](double jitter_s) {
    return [jitter_s] {
      ImpairmentOptions options;
      options.delay_s = 0.02, options.jitter_s = jitter_s;
      DelayLine<Packet> line{options, 1};
      Packet packet{};
      double sum = 0.0;
      for (int k = 0; k < kPackets; ++k) {
        const Duration now{std::int64_t{500'000} * k};
        packet.words[0] = k;
        line.put(packet, now);
        while (const Packet* there = line.take(now)) sum += there->words[0];
      }
      sink = sum;
    };
  };
  const auto [constant, jitter] =
      least_times(o.is_short ? 5 : 20, through(0.0), through(0.003), begins("jitter", o.twice));
  fmt::print("time line {:.1f} ns\ntime line_with_jitter {:.1f} ns\n", 1e9 * constant / kPackets,
             1e9 * jitter / kPackets);
  fmt::print("ratio jitter {:.3f}\n", jitter / constant);
}

}  // namespace

int main(int argc, char** argv) {
  Options o;
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--short") == 0) o.is_short = true;
    if (std::strcmp(argv[i], "--twice") == 0 && i + 1 < argc) o.twice = argv[++i];
  }
  for (const int dof : {1, 3})
    for (const char* method : {"NONE", "FORCE_PROJECTED"}) compare_lanes(o, dof, method);
  compare_draws(o);
  compare_lines(o);
  if (!o.is_short) compare_six_axes(o);
}
