// Lanes against the laboratory, bit for bit (lab/lanes/README.md).

#include "lab/lanes/lanes.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/method/catalogue.h"
#include "common/scene/load.h"
#include "common/scene/source.h"
#include "lab/engine/simulation.h"
#include "lab/lanes/cell.h"
#include "lab/run.h"
#include "lab/study/map.h"
#include "lab/study/sweep.h"

namespace twoport::lab::lanes_test {
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

// ---- which fields lanes take: every field of the schema is either refused by its path, or lanes compute with it what a run alone does

namespace pb = google::protobuf;

/// All of them, each with its default's place taken by something else.
const char* const kEveryBlock = R"(
  dof: 3 duration_s: 0.4 rate_hz: 500
  operator {
    hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 }
    path { move_to { position_m: [0.03, 0, 0] duration_s: 0.1 } }
    path { sine { amplitude_m: 0.01 frequency_hz: 20 duration_s: 0.1 } }
    path { screw { axis: [0, 0, 1] travel_m: 0.01 angle_rad: 0.2 point_m: [0.1, 0, 0] frequency_hz: 20 duration_s: 0.1 } }
    path { hold { duration_s: 0.1 } }
    tremor { rms_m: 1e-4 }
  }
  device { mass_kg: 0.075 max_force_n: 8.5 }
  control { passivity { method: FORCE_PROJECTED } virtual_coupling { stiffness_n_per_m: 1000 } }
  to_slave { delay_ms: 5 loss: 0.2 } to_master { delay_ms: 5 loss: 0.2 }
  robot { mass_kg: 0.5 force_sensor { } }
  environment { wall { normal: [-1, 0, 0] offset_m: -0.001 stiffness_n_per_m: 2000 } }
  environment { spring { stiffness_n_per_m: 10 } })";
/// What a block needs besides the field; and what lanes take with a method of its own only, or after another field.
const std::map<std::string, std::string> kNeeds{
    {"to_slave.deadband", "to_slave.deadband.ratio=0.1"},
    {"to_master.deadband", "to_master.deadband.ratio=0.1"},
    {"to_slave.blackout", "to_slave.blackout=[{ start_s: 0.1 duration_s: 0.05 }]"},
    {"to_master.blackout", "to_master.blackout=[{ start_s: 0.1 duration_s: 0.05 }]"},
    {"to_slave.delay_step", "to_slave.delay_step=[{ at_s: 0.1 delay_ms: 9 }]"},
    {"to_master.delay_step", "to_master.delay_step=[{ at_s: 0.1 delay_ms: 9 }]"},
    {"to_slave.burst", "to_slave.burst={ p: 0.1 r: 0.5 }"},
    {"to_master.burst", "to_master.burst={ p: 0.1 r: 0.5 }"},
    {"control.schedule", "control.schedule=[{ at_s: 0.2 passivity { method: NONE } }]"},
};

/// What no override of the scene above sets alone: what it has another word for (method, dof), of another side, what a run is judged by,
/// a file.
constexpr const char* kSetWithOthers =
    "control.device_limits.joint_lower_rad\ncontrol.device_limits.joint_speed_rad_per_s\n"
    "control.device_limits.joint_torque_n_m\ncontrol.device_limits.joint_upper_rad\n"
    "control.device_limits.set_point_step_m\ncontrol.passivity.layer\ncontrol.robot_limits.joint_lower_rad\n"
    "control.robot_limits.joint_speed_rad_per_s\ncontrol.robot_limits.joint_torque_n_m\n"
    "control.robot_limits.joint_upper_rad\ncontrol.schedule.passivity.layer\n"
    "control.schedule.transparency.layer\ncontrol.transparency.layer\ncontrol.virtual_coupling.joint_damping\n"
    "control.virtual_coupling.joint_stiffness\ndof\nexpect.at_least.key\nexpect.at_least.value\n"
    "expect.at_most.key\nexpect.at_most.value\nexpect.of_method.method\nexpect.of_method.verdict\nto_master.trace_"
    "file\n"
    "to_slave.trace_file\n";

struct SchemaField {
  std::vector<const pb::FieldDescriptor*> way;  ///< from the scene to it
  std::string path, place;                      ///< place: with indices, where an override sets it
};
/// Fields that hold no blocks, in `block` and within: those of the blocks that are there, or (`absent`) of all. `present` is the block of
/// kEveryBlock, or null. Those found before keep their place.
void find_fields(const pb::Descriptor& block, const pb::Message* present, bool absent, const SchemaField& at,
                 std::map<std::string, SchemaField>& all) {
  for (int i = 0; i < block.field_count(); ++i) {
    const pb::FieldDescriptor& field = *block.field(i);
    SchemaField each{at.way, at.path + field.name(), at.place + field.name()};
    each.way.push_back(&field);
    if (field.message_type() == nullptr) {
      all.emplace(each.path, each);
      continue;
    }
    each.path += '.';
    const auto within = [&](const pb::Message* inner, const std::string& index) {
      SchemaField next = each;
      next.place += index + ".";
      find_fields(*field.message_type(), inner, absent, next, all);
    };
    const pb::Reflection* r = present != nullptr ? present->GetReflection() : nullptr;
    if (absent) {
      within(nullptr, field.is_repeated() ? "[0]" : "");
    } else if (field.is_repeated()) {
      for (int k = 0; k < r->FieldSize(*present, &field); ++k)
        within(&r->GetRepeatedMessage(*present, &field, k), fmt::format("[{}]", k));
    } else if (r->HasField(*present, &field)) {
      within(&r->GetMessage(*present, &field), "");
    }
  }
}
/// Gives the field a value that is not its default, and nothing else.
void give(const SchemaField& field, pb::Message& scene) {
  pb::Message* block = &scene;
  for (const pb::FieldDescriptor* f : field.way) {
    const pb::Reflection& r = *block->GetReflection();
    if (f->message_type() != nullptr) {
      block = f->is_repeated() ? r.AddMessage(block, f) : r.MutableMessage(block, f);
    } else if (f->cpp_type() == pb::FieldDescriptor::CPPTYPE_DOUBLE) {
      f->is_repeated() ? r.AddDouble(block, f, 0.5) : r.SetDouble(block, f, f->default_value_double() + 0.5);
    } else if (f->cpp_type() == pb::FieldDescriptor::CPPTYPE_BOOL) {
      r.SetBool(block, f, !f->default_value_bool());
    } else if (f->cpp_type() == pb::FieldDescriptor::CPPTYPE_INT32) {
      f->is_repeated() ? r.AddInt32(block, f, 1) : r.SetInt32(block, f, f->default_value_int32() + 1);
    } else if (f->cpp_type() == pb::FieldDescriptor::CPPTYPE_UINT64) {
      r.SetUInt64(block, f, f->default_value_uint64() + 1);
    } else if (f->cpp_type() == pb::FieldDescriptor::CPPTYPE_ENUM) {
      r.SetEnum(block, f, f->enum_type()->value(f->enum_type()->value_count() - 1));
    } else {
      r.SetString(block, f, "a");
    }
  }
}
/// Values to try.
std::vector<std::string> values_of(const pb::FieldDescriptor& field) {
  std::vector<std::string> all;
  switch (field.cpp_type()) {
    case pb::FieldDescriptor::CPPTYPE_BOOL:
      return {field.default_value_bool() ? "false" : "true"};
    case pb::FieldDescriptor::CPPTYPE_ENUM:
      for (int i = 0; i < field.enum_type()->value_count(); ++i) all.push_back(field.enum_type()->value(i)->name());
      return all;
    case pb::FieldDescriptor::CPPTYPE_DOUBLE:
      return field.is_repeated() ? std::vector<std::string>{"[0.001, 0.0005, 0]", "[0, 1, 0, 0]"}
                                 : std::vector<std::string>{"0.31", "3.1", "0.0001", "310", "0.2"};
    case pb::FieldDescriptor::CPPTYPE_STRING:
      return {"\"a\""};
    default:
      return {"2", "1"};
  }
}

TEST(Lanes, EveryFieldOfTheSchemaIsTakenOrMakesASceneRunAlone) {
  const SceneText text{kEveryBlock, "every block"};
  const Scene base = text.with();
  ASSERT_EQ(why_not_in_lanes(base), "");
  std::map<std::string, SchemaField> fields;
  find_fields(*schema::Scene::descriptor(), &base.source->message, false, {}, fields);
  find_fields(*schema::Scene::descriptor(), nullptr, true, {}, fields);
  std::vector<std::pair<std::string, Scene>> cells;
  std::size_t alone = 0;
  std::string never_set;
  for (const auto& [path, field] : fields) {
    auto only = std::make_shared<SceneSource>(SceneSource{{}, "", SceneFor::laboratory});
    give(field, only->message);
    Scene scene = base;
    scene.source = only;
    constexpr std::string_view kNotTaken = "lanes do not take ";
    if (const std::string why = why_not_in_lanes(scene); why.starts_with(kNotTaken)) {
      ++alone;
      EXPECT_TRUE((path + ".").starts_with(why.substr(kNotTaken.size()) + ".")) << path << ": " << why;
      continue;
    }
    bool is_set = false;
    for (const char* method : {"FORCE_PROJECTED", "INTERNAL_MODEL"})
      for (const std::string& value : values_of(*field.way.back())) {
        std::vector<std::string> set{std::string{"control.passivity.method="} + method};
        for (const auto& [block, needed] : kNeeds)
          if (path.starts_with(block + ".")) set.push_back(needed);
        set.push_back(field.place + "=" + value);
        try {
          Scene with = text.with(set);
          is_set = true;
          if (!why_not_in_lanes(with).empty()) continue;
          cells.emplace_back(fmt::format("{}", fmt::join(set, " ")), with);
          break;
        } catch (const ConfigError&) {
        }
      }
    if (!is_set && field.way.back()->options().GetExtension(schema::least_dof) < 6) never_set += path + "\n";
  }
  EXPECT_EQ(never_set, kSetWithOthers);
  EXPECT_GT(alone, 200U);
  EXPECT_GT(cells.size(), 100U);
  expect_same(cells, 24);
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

// That of CONTACT_SPRING is 1 while it displays.
TEST(Lanes, SumTheFiguresOfALayerOverTicksInContact) {
  const Scene scene = parse_scene(
      "dof: 3 duration_s: 1 rate_hz: 1000 operator { hand { stiffness_n_per_m: 300 } } device { mass_kg: 0.1 } control "
      "{ transparency { "
      "layer: CONTACT_SPRING } } robot { mass_kg: 0.5 force_sensor { } }",
      "figures");
  lanes::Nodes<3> nodes{scene};
  for (int k = 0; k < 500; ++k) {
    std::array<double, lanes::numbers_of_slave(3)> slave{};
    std::array<double, lanes::numbers_of_master(3)> master{};
    slave[6] = k < 300 ? 0.0 : -1.0;  // the environment's force
    nodes.slave_tick(slave.data(), 1);
    nodes.master_tick(master.data(), 1);
  }
  EXPECT_EQ(nodes.figures()[layer_figure("contact_spring_share")], 200.0);
}

}  // namespace
}  // namespace twoport::lab::lanes_test
