// Lanes against the laboratory, bit for bit (lab/lanes/README.md).

#include "lab/lanes/lanes.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <filesystem>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/method/catalogue.h"
#include "common/scene/load.h"
#include "lab/engine/stoppable.h"
#include "lab/run.h"
#include "lab/study/map.h"
#include "lab/study/sweep.h"

namespace twoport::lab {
namespace {

const std::string kScenes = TWOPORT_SCENES;

/// Names of the figures and texts in which two summaries differ. No tolerance: the bits are compared.
std::string differences(const Summary& a, const Summary& b) {
  std::string all;
  const auto of_a = numbers(a), of_b = numbers(b);
  for (std::size_t i = 0; i < of_a.size(); ++i)
    if (of_a[i].first != "step_ns" &&
        std::bit_cast<std::uint64_t>(of_a[i].second) != std::bit_cast<std::uint64_t>(of_b[i].second) &&
        !(std::isnan(of_a[i].second) && std::isnan(of_b[i].second)))
      all += fmt::format(" {} {} {}", of_a[i].first, of_a[i].second, of_b[i].second);
  if (a.verdict() != b.verdict()) all += fmt::format(" verdict '{}' '{}'", a.verdict(), b.verdict());
  if (a.verdict_kind() != b.verdict_kind()) all += " verdict_kind";
  return all;
}

std::vector<int> widths() {
  std::vector<int> all;
  for (int lanes = 2; lanes <= widest_lanes(); lanes *= 2) all.push_back(lanes);
  return all;
}

/// Runs scenes alone, and by shapes in lanes of every width; expects no difference.
void expect_same(const std::vector<std::pair<std::string, Scene>>& scenes, std::size_t in_a_batch,
                 VerdictFrom verdict = VerdictFrom::tail) {
  std::map<std::string, std::vector<std::size_t>> shapes;
  std::vector<Summary> alone;
  for (std::size_t i = 0; i < scenes.size(); ++i) {
    shapes[shape_of_lanes(scenes[i].second)].push_back(i);
    alone.push_back(run(scenes[i].second, {.verdict = verdict}));
  }
  for (const int lanes : widths())
    for (const auto& [shape, all] : shapes)
      for (std::size_t from = 0; from < all.size(); from += in_a_batch) {
        std::vector<const Scene*> batch;
        for (std::size_t i = from; i < std::min(from + in_a_batch, all.size()); ++i)
          batch.push_back(&scenes[all[i]].second);
        std::vector<std::optional<Summary>> together(batch.size());
        run_in_lanes(batch, {.lanes = lanes, .verdict = verdict},
                     [&](std::size_t i, const Summary& summary) { together.at(i) = summary; });
        for (std::size_t i = 0; i < batch.size(); ++i) {
          ASSERT_TRUE(together[i]);
          EXPECT_EQ(differences(alone[all[from + i]], *together[i]), "")
              << lanes << " lanes, " << scenes[all[from + i]].first;
        }
      }
}

TEST(Lanes, EveryScene) {
  std::vector<std::pair<std::string, Scene>> taken;
  for (const auto& entry : std::filesystem::recursive_directory_iterator{kScenes}) {
    if (entry.path().extension() != ".textproto") continue;
    Scene scene = load_scene(entry.path().string());
    if (!why_not_in_lanes(scene).empty()) continue;
    for (int i = 0; i < 3; ++i, ++scene.seed) taken.emplace_back(entry.path().string(), scene);
  }
  EXPECT_GE(taken.size(), 3U * 10U);
  expect_same(taken, 64);
  expect_same(taken, 64, VerdictFrom::plain);
}

/// Overrides that make a scene of the laboratory another one at random.
std::vector<std::string> random_overrides(std::mt19937_64& random, int dof) {
  const auto between = [&](double low, double high) {
    return low * std::pow(high / low, static_cast<double>(random() >> 11) * 0x1.0p-53);
  };
  const auto one_of = [&](const std::vector<std::string>& of) { return of[random() % of.size()]; };
  const double rate_hz = dof == 1 ? 1000.0 : 500.0;
  std::vector<std::string> all{
      "duration_s=1.6",
      fmt::format("rate_hz={}", rate_hz),
      fmt::format("seed={}", random() % 1000),
      "control.passivity.method=" + one_of({"NONE", "CLASSIC", "FORCE_PROJECTED"}),
      "control.architecture=" + one_of({"POSITION_FORCE", "POSITION_MEASURED_FORCE"}),
      fmt::format("control.virtual_coupling.stiffness_n_per_m={:.6g}", between(100, 5000)),
      fmt::format("control.virtual_coupling.damping_n_s_per_m={:.6g}", between(1, 60)),
      fmt::format("environment[0].wall.stiffness_n_per_m={:.6g}", between(100, 100'000)),
      fmt::format("environment[0].wall.damping_n_s_per_m={:.6g}", random() % 2 == 0 ? 0.0 : between(0.1, 30)),
      fmt::format("robot.mass_kg={:.6g}", between(0.05, 2)),
      fmt::format("operator.hand.stiffness_n_per_m={:.6g}", between(30, 1000)),
      fmt::format("operator.hand.damping_n_s_per_m={:.6g}", between(0.1, 20)),
  };
  for (const char* way : {"to_slave", "to_master"}) {
    all.push_back(fmt::format("{}.delay_ms={:.6g}", way, random() % 8 == 0 ? 0.0 : between(0.3, 300)));
    switch (random() % 4) {
      case 0:
        all.push_back(fmt::format("{}.loss={:.6g}", way, between(0.01, 0.95)));
        break;
      case 1:
        all.push_back(fmt::format("{}.burst={{ p: {:.6g} r: {:.6g} }}", way, between(0.001, 0.3), between(0.001, 0.3)));
        break;
      case 2:
        all.push_back(fmt::format("{}.blackout=[{{ start_s: {:.6g} duration_s: {:.6g} }}]", way, between(0.1, 1.5),
                                  between(0.01, 2)));
        break;
      default:
        break;
    }
  }
  if (random() % 4 == 0) all.push_back("control.virtual_coupling.drift_compensation=false");
  if (random() % 4 == 0) all.push_back("control.passivity.predict=false");
  if (random() % 4 == 0) all.push_back(fmt::format("control.force_scale={:.6g}", between(0.3, 3)));
  if (random() % 4 == 0) all.push_back(fmt::format("control.motion_scale={:.6g}", between(0.3, 3)));
  if (random() % 4 == 0) all.push_back(fmt::format("control.passivity.initial_energy_j={:.6g}", between(1e-6, 1)));
  return all;
}

TEST(Lanes, RandomCells) {
  std::mt19937_64 random{1};
  std::vector<std::pair<std::string, Scene>> cells;
  for (int i = 0; i < 300; ++i) {
    const int dof = i % 3 == 0 ? 3 : 1;
    const std::vector<std::string> set = random_overrides(random, dof);
    std::string name = fmt::format("dof {}: {}", dof, fmt::join(set, " "));
    Scene scene = load_scene(kScenes + (dof == 1 ? "/one_axis_wall.textproto" : "/stiff_wall_50ms.textproto"), set);
    EXPECT_EQ(why_not_in_lanes(scene), "") << name;
    cells.emplace_back(std::move(name), std::move(scene));
  }
  expect_same(cells, 24);
  // Without a twin where no controller acts, which is what `map` uses.
  cells.resize(120);
  expect_same(cells, 120, VerdictFrom::lean);
}

// Methods whose halves are stepped lane by lane, both nodes with what lanes do not know: jitter, limits, playout. Methods share a
// batch; the plants are exact, or in Runge-Kutta steps with friction.
std::vector<std::pair<std::string, Scene>> cells_of_every_method(int count) {
  std::mt19937_64 random{3};
  std::vector<std::pair<std::string, Scene>> cells;
  const std::vector<std::string> methods = method_names();
  for (int i = 0; i < count; ++i) {
    const int dof = i % 3 == 0 ? 1 : 3;
    std::vector<std::string> set = random_overrides(random, dof);
    set.push_back("control.passivity.method=" + methods[static_cast<std::size_t>(i) % methods.size()]);
    if (random() % 2 == 0) {
      set.push_back(fmt::format("simulation={{ integrator: RK4 substeps: {} }}", 1 + random() % 2));
      set.push_back(fmt::format("environment[0].wall.stiffness_n_per_m={}", 500 + random() % 5000));
      if (dof == 3)
        set.push_back(fmt::format("environment[0].wall.friction={}", 0.1 * static_cast<double>(random() % 5)));
    }
    switch (random() % 6) {
      case 0:
        set.emplace_back("to_slave.jitter_ms=3");
        break;
      case 1:
        set.emplace_back("to_master.playout_ms=20");
        break;
      case 2:
        set.emplace_back("control.passivity.observer=RECTANGLE");
        break;
      case 3:
        set.emplace_back("to_slave.duplicate=0.1");
        set.emplace_back("to_master.reorder=0.1");
        break;
      default:
        break;
    }
    std::string name = fmt::format("dof {}: {}", dof, fmt::join(set, " "));
    try {
      Scene scene = load_scene(kScenes + (dof == 1 ? "/one_axis_wall.textproto" : "/stiff_wall_50ms.textproto"), set);
      EXPECT_EQ(why_not_in_lanes(scene), "") << name;
      cells.emplace_back(std::move(name), std::move(scene));
    } catch (const ConfigError&) {  // not every method has every architecture
    }
  }
  EXPECT_GT(cells.size(), static_cast<std::size_t>(count) / 2);
  return cells;
}
TEST(Lanes, RandomCellsOfEveryMethod) {
  expect_same(cells_of_every_method(160), 24);
}
TEST(Lanes, RandomCellsOfEveryMethodWithPlainAndLeanVerdicts) {
  const auto cells = cells_of_every_method(80);
  expect_same(cells, 80, VerdictFrom::plain);
  expect_same(cells, 80, VerdictFrom::lean);
}

// INTERNAL_MODEL with its halves and link in lanes; every fourth scene has something that leaves its nodes to the laboratory.
TEST(Lanes, RandomCellsOfTheInternalModel) {
  std::mt19937_64 random{4};
  std::vector<std::pair<std::string, Scene>> cells;
  for (int i = 0; i < 120; ++i) {
    const int dof = i % 3 == 0 ? 1 : 3;
    std::vector<std::string> set = random_overrides(random, dof);
    set.emplace_back("control.passivity.method=INTERNAL_MODEL");
    if (random() % 2 == 0) {
      set.emplace_back("simulation={ integrator: RK4 substeps: 1 }");
      set.push_back(fmt::format("environment[0].wall.stiffness_n_per_m={}", 500 + random() % 5000));
      if (dof == 3)
        set.push_back(fmt::format("environment[0].wall.friction={}", 0.1 * static_cast<double>(random() % 8)));
    }
    if (random() % 4 == 0)
      set.push_back(fmt::format("robot.force_sensor.bias_n=[{}]", dof == 1 ? "0.1" : "0.1, -0.05, 0.2"));
    if (random() % 4 == 0) set.emplace_back("to_master.jitter_ms=3");
    std::string name = fmt::format("dof {}: {}", dof, fmt::join(set, " "));
    Scene scene = load_scene(kScenes + (dof == 1 ? "/one_axis_wall.textproto" : "/stiff_wall_50ms.textproto"), set);
    EXPECT_EQ(why_not_in_lanes(scene), "") << name;
    cells.emplace_back(std::move(name), std::move(scene));
  }
  expect_same(cells, 24);
  expect_same(cells, 120, VerdictFrom::plain);
  expect_same(cells, 120, VerdictFrom::lean);
}

// The map's own scene: Runge-Kutta steps, a rough wall, every method in one batch.
TEST(Lanes, TheMapOfItsOwnSceneIsTheSame) {
  MapOptions o{.scene = {},
               .set = {"duration_s=3", "rate_hz=500"},
               .methods = {},
               .round_trips_ms = {20, 100},
               .losses = {0.1},
               .bursts_packets = {1, 10},
               .stiffnesses_n_per_m = {2000},
               .seeds = 1,
               .jobs = 2,
               .lanes = 1};
  const Map alone = make_map(o);
  o.lanes = 0;
  const Map together = make_map(o);
  EXPECT_EQ(to_csv(to_table(alone)), to_csv(to_table(together)));
  EXPECT_TRUE(together.use.alone.empty());
}

// A plain verdict: from the run's own ticks after the path's end, which here comes early, late, between two ticks or never.
TEST(Lanes, RandomCellsWithPlainVerdicts) {
  std::mt19937_64 random{2};
  std::vector<std::pair<std::string, Scene>> cells;
  for (int i = 0; i < 150; ++i) {
    const int dof = i % 3 == 0 ? 3 : 1;
    std::vector<std::string> set = random_overrides(random, dof);
    const double path_s = std::array{0.05, 0.3, 0.7123456, 1.1, 5.0}[random() % 5];
    set.push_back(fmt::format(
        "operator.path=[{{ sine {{ axis: 0 amplitude_m: 0.04 frequency_hz: 1.3 duration_s: {} }} }}]", path_s));
    if (random() % 8 == 0) set.emplace_back("operator.tremor={ rms_m: 1e-4 low_hz: 6 high_hz: 12 }");
    std::string name = fmt::format("dof {}: {}", dof, fmt::join(set, " "));
    Scene scene = load_scene(kScenes + (dof == 1 ? "/one_axis_wall.textproto" : "/stiff_wall_50ms.textproto"), set);
    EXPECT_EQ(why_not_in_lanes(scene), "") << name;
    cells.emplace_back(std::move(name), std::move(scene));
  }
  expect_same(cells, 24, VerdictFrom::plain);
}

// A cell is there as soon as its own tails have ended: of a hundred no more than two batches are missing at any time.
TEST(Lanes, CellsFinishOneAfterTheOther) {
  const std::vector<std::string> set{"duration_s=2", "rate_hz=1000"};
  const Scene scene = load_scene(kScenes + "/one_axis_wall.textproto", set);
  std::vector<Scene> all(100, scene);
  std::vector<const Scene*> scenes;
  for (std::size_t i = 0; i < all.size(); ++i) {
    all[i].to_slave.loss = 0.3, all[i].seed = i;
    scenes.push_back(&all[i]);
  }
  std::size_t finished = 0;
  std::atomic<bool> stop{false};
  const auto count = [&](std::size_t, const Summary&) { stop = ++finished == 10; };
  EXPECT_THROW(run_in_lanes(scenes, {.lanes = 2, .stop = &stop}, count), Stopped);
  // The tenth is followed by those that end in the same tick.
  EXPECT_LE(finished, 12U);
}

TEST(Lanes, AMapIsTheSame) {
  MapOptions o{.scene = kScenes + "/stiff_wall_50ms.textproto",
               .set = {"duration_s=3", "rate_hz=1000"},
               .methods = {"NONE", "FORCE_PROJECTED", "FIXED_DAMPING"},
               .round_trips_ms = {0, 40},
               .losses = {0, 0.2},
               .bursts_packets = {1},
               .stiffnesses_n_per_m = {300, 3000},
               .seeds = 2,
               .jobs = 2,
               .lanes = 1};
  const Map alone = make_map(o);
  EXPECT_EQ(alone.use.together, 0U);
  o.lanes = 0;
  const Map together = make_map(o);
  EXPECT_EQ(to_csv(to_table(alone)), to_csv(to_table(together)));
  EXPECT_EQ(together.use.together, 3U * 8U * 2U);
}

TEST(Lanes, TheTableOfASweepIsTheSame) {
  SweepOptions o{.scene = kScenes + "/one_axis_wall.textproto",
                 .set = {"duration_s=3"},
                 .axes = {parse_axis("to_slave.delay_ms,to_master.delay_ms=0:60:4"), parse_axis("to_slave.loss=0,0.1"),
                          parse_axis("control.passivity.method=NONE,FORCE_PROJECTED,INTERNAL_MODEL")},
                 .seeds = 2,
                 .jobs = 2,
                 .lanes = 1,
                 .shard = {},
                 .out = {}};
  const Table alone = sweep(o);
  EXPECT_EQ(alone.use.together, 0U);
  o.lanes = 0;
  const Table together = sweep(o);
  EXPECT_EQ(to_csv(alone), to_csv(together));
  EXPECT_EQ(together.use.lanes, widest_lanes());
  EXPECT_EQ(together.use.together, 4U * 2U * 3U * 2U);

  o.verdict = VerdictFrom::plain;
  const std::string plain = to_csv(sweep(o));
  o.lanes = 1;
  EXPECT_EQ(plain, to_csv(sweep(o)));
  EXPECT_NE(plain, to_csv(alone));
}

TEST(Lanes, AnImpossibleNumberIsRefused) {
  EXPECT_THROW(checked_lanes(3), ConfigError);
  EXPECT_THROW(checked_lanes(16), ConfigError);
  EXPECT_EQ(checked_lanes(1), 1);
  EXPECT_EQ(checked_lanes(0), widest_lanes());
}

}  // namespace
}  // namespace twoport::lab
