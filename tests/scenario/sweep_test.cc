#include "lab/study/sweep.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <numeric>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/sanitized.h"
#include "common/record/summary.h"
#include "common/scene/load.h"
#include "lab/plot/picture.h"
#include "lab/plot/pictures.h"
#include "lab/run.h"
#include "lab/study/cells.h"
#include "lab/study/parallel.h"
#include "lab/study/table.h"
#include "tests/support/process.h"
#include "tests/support/svg.h"

namespace twoport::lab::sweep_test {
namespace {

using test::exited;
using test::finished;
using test::Folder;
using test::Process;
using test::read_text;
using Words = std::vector<std::string>;
using namespace std::chrono_literals;

const std::string kHeld = TWOPORT_SCENES "/held_spring.textproto";
const std::string kOneAxis = TWOPORT_SCENES "/one_axis_wall.textproto";
const std::string kWall = TWOPORT_SCENES "/stiff_wall_50ms.textproto";
const std::string kStiffness = "environment[0].spring.stiffness_n_per_m";

Words lab(Words arguments) {
  arguments.insert(arguments.begin(), TWOPORT_LAB);
  return arguments;
}
Words plus(Words all, const Words& more) {
  all.insert(all.end(), more.begin(), more.end());
  return all;
}
bool exists(const std::string& path) {
  return std::filesystem::exists(path);
}

void expect_done(Process p) {
  EXPECT_EQ(p.wait(), exited(0)) << p.out() << p.err();
}

void expect_refused(Process p, const Words& parts) {
  EXPECT_EQ(p.wait(), exited(2)) << p.out() << p.err();
  EXPECT_EQ(p.err().rfind("twoport-lab: ", 0), 0U) << p.err();
  EXPECT_EQ(test::count(p.err(), "\n"), 1) << p.err();
  for (const std::string& part : parts) EXPECT_NE(p.err().find(part), std::string::npos) << p.err();
}

// ---- specs

Words values(const std::string& spec) {
  return parse_axis("a=" + spec).values;
}

TEST(Axis, IsAListOrARange) {
  EXPECT_EQ(values("NONE,CLASSIC"), (Words{"NONE", "CLASSIC"}));
  EXPECT_EQ(values("3"), Words{"3"});
  EXPECT_EQ(values("[1, 2],[3, 4]"), (Words{"[1, 2]", "[3, 4]"}));
  EXPECT_EQ(values("0:1:5"), (Words{"0", "0.25", "0.5", "0.75", "1"}));
  EXPECT_EQ(values("0.1:0.4:4"), (Words{"0.1", "0.2", "0.3", "0.4"}));
  EXPECT_EQ(values("5:-5:3"), (Words{"5", "0", "-5"}));
  EXPECT_EQ(values("1:1000:4:log"), (Words{"1", "10", "100", "1000"}));
  EXPECT_TRUE(parse_axis("a=1:10:2:log").logarithmic);
  EXPECT_FALSE(parse_axis("a=1:10:2").logarithmic);
  EXPECT_EQ(parse_axis("environment[0].wall.friction=1,2").paths, Words{"environment[0].wall.friction"});
}

TEST(Axis, SaysWhatIsWrong) {
  const auto refused = [](const std::string& text, const std::string& part) {
    try {
      static_cast<void>(parse_axis(text));
      ADD_FAILURE() << text << " was taken";
    } catch (const ConfigError& e) {
      EXPECT_NE(std::string{e.what()}.find("--vary " + text), std::string::npos) << e.what();
      EXPECT_NE(std::string{e.what()}.find(part), std::string::npos) << e.what();
    }
  };
  for (const char* text : {"a", "a=", "=1", "a=1:2", "a=1:2:x", "a=1:2:3:lin", "a=x:2:3", "a=1:2:3:log:4", "a=1:inf:3"})
    refused(text, "PATH=a,b,c or PATH=start:stop:count or PATH=start:stop:count:log");
  refused("a=1,,2", "empty");
  refused("a=1:2:1", "count is 1");
  refused("a=0:2:3:log", "both must be > 0");
  refused("a=-1:2:3:log", "both must be > 0");
}

TEST(Axis, MayHavePathsThatMoveTogether) {
  const Axis axis = parse_axis("to_slave.delay_ms,to_master.delay_ms=5,10");
  EXPECT_EQ(axis.paths, (Words{"to_slave.delay_ms", "to_master.delay_ms"}));
  EXPECT_EQ(axis.values, (Words{"5", "10"}));
  EXPECT_EQ(axis.name(), "to_slave.delay_ms,to_master.delay_ms");
  EXPECT_EQ(parse_axis("a,b=[1, 2],[3, 4]").values, (Words{"[1, 2]", "[3, 4]"}));
  EXPECT_EQ(parse_axis("a,b,c={ hold { duration_s: 1 } }").paths.size(), 3U);
  for (const char* text : {"a,=1", ",a=1", "a,,b=1,2", "a,b,a=1,2"})
    EXPECT_THROW(static_cast<void>(parse_axis(text)), ConfigError) << text;
}

TEST(Refinement, HalvesOneAxisAfterTheOther) {
  const Refinement refinement{{{5, true}, {2, false}, {3, true}}};
  // Along the first axis 0; 4; 2; 1, 3. Along the third 0; 2; 1. The second has both values from the first level on.
  const std::vector<std::size_t> first{0, 7, 4, 7, 1}, third{0, 6, 3};
  for (std::size_t cell = 0; cell < 30; ++cell)
    EXPECT_EQ(refinement.level(cell), std::max(first[cell / 6], third[cell % 3])) << cell;
}

// Whatever has run: a cell stands for itself, the first for all, and no neighbour is nearer than half of the distance of what has run.
TEST(Refinement, LetsTheNearestCellOfALevelStandForThoseThatHaveNotRun) {
  constexpr std::size_t kCount = 13;
  const Refinement line{{{kCount, true}}};
  for (std::size_t apart : {16U, 8U, 4U, 2U, 1U}) {
    std::vector<bool> known(kCount);
    for (std::size_t cell = 0; cell < kCount; cell += apart) known[cell] = true;
    const std::vector<std::size_t> shown = line.stand_ins(known);
    for (std::size_t cell = 0; cell < kCount; ++cell) {
      EXPECT_TRUE(known[shown[cell]]);
      const std::size_t away = std::max(shown[cell], cell) - std::min(shown[cell], cell);
      EXPECT_TRUE(away <= apart / 2 || (cell > shown[cell] && shown[cell] + apart >= kCount)) << cell << ", " << apart;
    }
  }
  std::vector<bool> known(12);
  known[0] = known[11] = true;
  const std::vector<std::size_t> shown = Refinement{{{3, false}, {4, true}}}.stand_ins(known);
  EXPECT_EQ(shown[3], 0U);
  EXPECT_EQ(shown[11], 11U);
  EXPECT_EQ(shown[4], Refinement::kNone) << "a value without order stands for no other";
}

TEST(Refinement, FindsTheCellsWhereTheAnswerChanges) {
  // 1 . . . 0 . . . 0: cells 0 to 2 show the first, 3 to 6 the second.
  const std::vector<bool> edge = Refinement{{{9, true}}}.edges({1, -1, -1, -1, 0, -1, -1, -1, 0});
  EXPECT_EQ(edge, (std::vector<bool>{false, false, true, true, false, false, false, false, false}));
}

// 17 values of which the answer changes between the 8th and the 12th: whole levels, those at the edge before all others.
TEST(Cells, RunByLevelsAndFirstWhereTheAnswerChanges) {
  const Refinement line{{{17, true}}};
  Cells cells{.count = 17, .scene = {}};
  for (std::size_t cell = 0; cell < cells.count; ++cell) cells.levels.push_back(line.level(cell));
  const auto stages = [&](std::size_t enough) {
    std::vector<std::size_t> order(cells.count);
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return cells.levels[a] < cells.levels[b]; });
    std::vector<std::set<std::size_t>> all;
    for (std::size_t from = 0, to; from < order.size(); from = to) {
      to = next_end(cells, order, from, enough, 2);
      all.emplace_back(order.begin() + static_cast<std::ptrdiff_t>(from),
                       order.begin() + static_cast<std::ptrdiff_t>(to));
    }
    return all;
  };
  using Stages = std::vector<std::set<std::size_t>>;
  EXPECT_EQ(stages(17), (Stages{{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16}}));
  EXPECT_EQ(stages(4), (Stages{{0, 8, 4, 12, 16}, {2, 6, 10, 14}, {1, 3, 5, 7, 9, 11, 13, 15}}));
  cells.seeds = 2;
  EXPECT_EQ(stages(8), stages(7));
  EXPECT_EQ(stages(8).size(), 3U);
  cells.seeds = 1;
  cells.first = [&] {
    std::vector<bool> first(17);
    for (const std::size_t cell : {9U, 10U, 11U}) first[cell] = true;
    return first;
  };
  EXPECT_EQ(stages(2), (Stages{{0, 16}, {10, 9, 11}, {8, 4, 12}, {2, 6, 14}, {1, 3, 5, 7, 13, 15}}));
}

TEST(Shard, CountsFromOne) {
  EXPECT_EQ(parse_shard("3/8").index, 3U);
  EXPECT_EQ(parse_shard("3/8").count, 8U);
  for (const char* text : {"", "1", "0/2", "3/2", "1/0", "a/2", "1/2/3", "-1/2"})
    EXPECT_THROW(static_cast<void>(parse_shard(text)), ConfigError) << text;
}

// ---- tables

TEST(Sweep, WritesTheVariedPathsThenEveryNumberAndTheWordsOfTheSummary) {
  const Folder folder;
  const Table table = sweep({.scene = kHeld,
                             .set = {"duration_s=0.5"},
                             .axes = {parse_axis("device.mass_kg=0.05,0.1"), parse_axis(kStiffness + "=100,200,300")},
                             .jobs = 2,
                             .shard = {},
                             .out = folder / "out"});
  Words columns{"device.mass_kg", kStiffness};
  for (const auto& [name, value] : numbers(Summary{}))
    if (name != "step_ns") columns.push_back(name);
  columns.insert(columns.end(), {"scene", "architecture", "method", "verdict_kind", "verdict"});
  EXPECT_EQ(table.columns, columns);
  ASSERT_EQ(table.rows.size(), 6U);
  EXPECT_EQ(table.rows[0][0], "0.05");
  EXPECT_EQ(table.rows[0][1], "100");
  EXPECT_EQ(table.rows[1][1], "200");  // the last path varies fastest
  EXPECT_EQ(table.rows[3][0], "0.1");
  EXPECT_EQ(read_text(folder / "out/table.csv"), to_csv(table));
  const auto stable = std::find(columns.begin(), columns.end(), "stable") - columns.begin();
  EXPECT_EQ(table.rows[0][static_cast<std::size_t>(stable)], "1");
  const Values last(table.rows[0].end() - 5, table.rows[0].end());
  EXPECT_EQ(last, (Values{"held spring", "RENDER", "NONE", "STABLE", "bounded and decaying"}));
}

TEST(Sweep, VariesAnyPathOfTheScene) {
  // An enum, a list, a field of a block that is absent, and what the summary has a column of as well.
  for (const char* axis : {"control.passivity.method=NONE,CLASSIC,FORCE_PROJECTED", "device.position_m=[0.001],[0.002]",
                           "operator.hand.stiffness_n_per_m=0:300:4", "rate_hz=1000,2000", "seed=1,2"}) {
    const Table table = sweep(
        {.scene = kHeld, .set = {"duration_s=0.2"}, .axes = {parse_axis(axis)}, .jobs = 1, .shard = {}, .out = ""});
    EXPECT_EQ(table.rows.size(), parse_axis(axis).values.size()) << axis;
  }
}

// The symmetric delay: each row is the run with both overrides, and the table has both columns.
TEST(Sweep, MovesLinkedPathsTogether) {
  const std::string there = "to_slave.delay_ms", back = "to_master.delay_ms";
  const auto table = [&](const Words& set, const Words& axes) {
    SweepOptions o{.scene = kWall, .set = {"duration_s=0.6"}, .axes = {}, .jobs = 2, .shard = {}, .out = ""};
    o.set.insert(o.set.end(), set.begin(), set.end());
    for (const std::string& axis : axes) o.axes.push_back(parse_axis(axis));
    return sweep(o);
  };
  const std::string seeds = "seed=3,4";
  const Table linked = table({}, {there + "," + back + "=10,30", seeds});
  ASSERT_EQ(linked.rows.size(), 4U);
  EXPECT_EQ(Words(linked.columns.begin(), linked.columns.begin() + 3), (Words{there, back, "seed"}));
  for (const std::string delay : {"10", "30"}) {
    const Table apart = table({there + "=" + delay, back + "=" + delay}, {seeds});
    for (std::size_t seed = 0; seed < 2; ++seed) {
      Values expected{delay, delay};
      expected.insert(expected.end(), apart.rows[seed].begin(), apart.rows[seed].end());
      EXPECT_EQ(linked.rows[(delay == "10" ? 0 : 2) + seed], expected);
    }
  }
}

// ---- seeds

TEST(Spread, IsMeanSampleDeviationAndTheWorst) {
  const std::vector<double> values{1.0, 4.0, 2.0, 3.0};
  const Spread error = spread("position_error_rms_m", values), energy = spread("min_port_energy_j", values);
  EXPECT_DOUBLE_EQ(error.mean, 2.5);
  EXPECT_DOUBLE_EQ(error.sd, std::sqrt(5.0 / 3.0));
  EXPECT_EQ(error.worst, 4.0);
  EXPECT_EQ(energy.worst, 1.0);
  const std::vector<double> same(7, 0.1), one{0.3};
  EXPECT_EQ(spread("drift_m", same).mean, 0.1);  // to the bit, though seven times 0.1 is not 0.7
  EXPECT_EQ(spread("drift_m", same).sd, 0.0);
  EXPECT_EQ(spread("drift_m", one).mean, 0.3);
  EXPECT_EQ(spread("drift_m", one).sd, 0.0);
  const double inf = std::numeric_limits<double>::infinity(), nan = std::nan("");
  const std::vector<double> grown{1.0, inf}, broken{1.0, nan, 2.0};
  EXPECT_EQ(spread("max_force_n", grown).mean, inf);
  EXPECT_EQ(spread("max_force_n", grown).worst, inf);
  EXPECT_TRUE(std::isnan(spread("max_force_n", broken).mean));
  EXPECT_TRUE(std::isnan(spread("max_force_n", broken).worst));
}

TEST(Spread, KnowsWhichDirectionIsBad) {
  for (const char* key : {"stable", "min_port_energy_j", "min_observed_energy_j", "hand_min_energy_j", "touching_share",
                          "held_force_ratio", "packets.to_slave.received", "duration_s"})
    EXPECT_TRUE(smallest_is_worst(key)) << key;
  for (const char* key : {"energy_owed_j", "drift_m", "chatter_rms_n", "force_direction_error_max_deg", "max_force_n",
                          "muted_share", "packets.to_slave.lost", "rtt_ms.p99"})
    EXPECT_FALSE(smallest_is_worst(key)) << key;
}

TEST(WorstSeed, IsAnUnstableOneThenTheOneWithTheLeastEnergy) {
  const auto summary = [](bool stable, double energy_j) {
    Summary s;
    s.set_stable(stable);
    s.set_min_port_energy_j(energy_j);
    return s;
  };
  EXPECT_EQ(worst_seed({summary(true, -1.0), summary(false, 0.0), summary(false, 0.5)}), 1U);
  EXPECT_EQ(worst_seed({summary(true, 1e-3), summary(true, -1e-3), summary(true, -1e-3)}), 1U);
  EXPECT_EQ(worst_seed({summary(true, 1e-3), summary(true, std::nan(""))}), 1U);
}

std::string at(const Table& table, std::size_t row, const std::string& column) {
  const auto found = std::find(table.columns.begin(), table.columns.end(), column);
  if (found == table.columns.end()) throw ConfigError{"no column " + column};
  return table.rows[row][static_cast<std::size_t>(found - table.columns.begin())].text();
}

// Each cell against runs of its own: near the limit of a link that loses packets, within 0.2 % of the force scale,
// some seeds are stable and some are not.
TEST(Sweep, OverSeedsHasMeanDeviationAndWorstOfEachFigure) {
  constexpr std::size_t kSeeds = 12;
  const std::string path = "to_slave.delay_ms,to_master.delay_ms";
  const Words set{"control.passivity.method=NONE", "control.force_scale=1.0635", "to_slave.loss=0.4",
                  "to_master.loss=0.4"};
  const Table table = sweep({.scene = kOneAxis,
                             .set = set,
                             .axes = {parse_axis(path + "=5.8:6.2:5")},
                             .seeds = kSeeds,
                             .jobs = 2,
                             .shard = {},
                             .out = ""});
  Words columns{"to_slave.delay_ms", "to_master.delay_ms"};
  for (const std::string& name : figures()) columns.insert(columns.end(), {name, name + "_sd", name + "_worst"});
  columns.insert(columns.end(), {"scene", "architecture", "method", "verdict_kind", "verdict", "worst_seed"});
  EXPECT_EQ(table.columns, columns);
  EXPECT_EQ(table.seeds, kSeeds);

  int mixed = 0;
  for (std::size_t row = 0; row < table.rows.size(); ++row) {
    const std::string delay = table.rows[row][0].text();
    std::vector<double> stable, energy;
    Words verdicts;
    const std::uint64_t first = 7;  // the scene's
    for (std::uint64_t seed = first; seed < first + kSeeds; ++seed) {
      const Summary s = run(load_scene(kOneAxis, plus(set, {fmt::format("seed={}", seed), "to_slave.delay_ms=" + delay,
                                                            "to_master.delay_ms=" + delay})));
      stable.push_back(s.stable() ? 1.0 : 0.0);
      energy.push_back(s.min_port_energy_j());
      verdicts.push_back(s.verdict());
    }
    const double share = std::accumulate(stable.begin(), stable.end(), 0.0) / kSeeds;
    EXPECT_NEAR(std::stod(at(table, row, "stable")), share, 1e-15) << delay;  // rounding of a mean of ones and zeros
    EXPECT_EQ(at(table, row, "stable_worst"), share < 1.0 ? "0" : "1") << delay;
    const Spread e = spread("min_port_energy_j", energy);
    EXPECT_EQ(at(table, row, "min_port_energy_j"), fmt::format("{}", e.mean)) << delay;
    EXPECT_EQ(at(table, row, "min_port_energy_j_sd"), fmt::format("{}", e.sd)) << delay;
    EXPECT_EQ(at(table, row, "min_port_energy_j_worst"), fmt::format("{}", e.worst)) << delay;
    const std::size_t worst = std::stoul(at(table, row, "worst_seed")) - first;
    EXPECT_EQ(at(table, row, "verdict"), verdicts[worst]) << delay;
    EXPECT_EQ(stable[worst], share < 1.0 ? 0.0 : 1.0) << delay;
    mixed += share > 0.0 && share < 1.0 ? 1 : 0;
  }
  EXPECT_GT(mixed, 0) << "no cell in which seeds disagree: move the delays to where they do";
}

TEST(Sweep, QuotesWhatHoldsAComma) {
  const Table table{.columns = {"a", "b"}, .rows = {{"[1, 2]", "say \"no\""}}};
  EXPECT_EQ(to_csv(table), "a,b\n\"[1, 2]\",\"say \"\"no\"\"\"\n");
}

const Words kGrid{"sweep",  kWall,
                  "--set",  "duration_s=0.6",
                  "--vary", "to_slave.delay_ms=5:50:4",
                  "--vary", "control.passivity.method=NONE,CLASSIC,FORCE_PROJECTED"};

TEST(SweepProgram, WritesTheSameTableForAnyNumberOfJobs) {
  const Folder folder;
  expect_done(finished(lab(plus(kGrid, {"--plot", "none", "--jobs", "1", "--out", folder / "one"}))));
  expect_done(finished(lab(plus(kGrid, {"--plot", "none", "--jobs", "2", "--out", folder / "two"}))));
  const std::string table = read_text(folder / "one/table.csv");
  EXPECT_EQ(test::count(table, "\n"), 13);
  EXPECT_EQ(read_text(folder / "two/table.csv"), table);

  const Process to_stdout = finished(lab(plus(kGrid, {"--jobs", "2"})));
  EXPECT_EQ(to_stdout.out(), table);
  EXPECT_EQ(to_stdout.err(), "");
}

TEST(SweepProgram, GoesOnWhereItWasKilled) {
  const Folder folder;
  // One simulation at a time, so that cells do not end together.
  const auto command = [&](const std::string& out) {
    return lab({"sweep", kWall, "--set", "duration_s=3", "--vary", "to_slave.delay_ms=5:50:12", "--jobs", "1",
                "--lanes", "1", "--plot", "none", "--out", folder / out});
  };
  expect_done(finished(command("whole")));
  const std::string cells = folder / "killed/cells.jsonl";
  {
    Process victim{command("killed")};
    while (victim.running() && (!exists(cells) || test::count(read_text(cells), "\n") < 4))
      std::this_thread::sleep_for(1ms);
    victim.send(SIGKILL);
    EXPECT_EQ(victim.wait(), test::killed_by(SIGKILL));
  }
  EXPECT_FALSE(exists(folder / "killed/table.csv"));
  std::string kept = read_text(cells);
  kept.resize(kept.rfind('\n') + 1);
  const int lines = test::count(kept, "\n");
  ASSERT_GE(lines, 4);
  ASSERT_LT(lines, 13);
  std::ofstream{cells, std::ios::app} << R"({"cell": 11, "row": ["5)";  // a line that did not get to its end

  const Process second = finished(command("killed"));
  EXPECT_EQ(read_text(folder / "killed/table.csv"), read_text(folder / "whole/table.csv")) << second.err();
  const std::string after = read_text(cells);
  EXPECT_EQ(after.compare(0, kept.size(), kept), 0) << "cells that were there have not stayed";
  EXPECT_EQ(test::count(after, "\n"), 13);
  for (int cell = 0; cell < 12; ++cell) EXPECT_EQ(test::count(after, fmt::format("\"cell\": {},", cell)), 1) << cell;
}

/// NONE is stable up to 6 ms each way.
SweepOptions many_cells() {
  return {.scene = kOneAxis,
          .set = {"control.passivity.method=NONE"},
          .axes = {parse_axis("to_slave.delay_ms,to_master.delay_ms=0.1:20:32"),
                   parse_axis("environment[0].wall.stiffness_n_per_m=1000:20000:8")},
          .jobs = 2,
          .verdict = VerdictFrom::plain,
          .shard = {},
          .out = ""};
}

TEST(Sweep, StoppedAfterALevelHasRowsOfTheWholeOne) {
  SweepOptions o = many_cells();
  std::vector<std::size_t> told;
  o.coarse = [&](const Table& known) {
    EXPECT_EQ(known.rows.size(), known.cells.size());
    told.push_back(known.rows.size());
  };
  const Table whole = sweep(o);
  EXPECT_FALSE(whole.stopped);
  ASSERT_EQ(whole.rows.size(), 256U);
  ASSERT_GE(told.size(), 1U);
  EXPECT_LT(told.back(), 256U);

  const Folder folder;
  std::atomic<bool> stop{false};
  o.out = folder / "out";
  o.stop = &stop;
  o.coarse = [&](const Table& known) { stop = known.rows.size() >= told[0]; };
  const Table some = sweep(o);
  EXPECT_TRUE(some.stopped);
  ASSERT_EQ(some.rows.size(), told[0]);
  std::set<std::size_t> cells;
  for (std::size_t i = 0; i < some.rows.size(); ++i) {
    EXPECT_EQ(some.rows[i], whole.rows[some.cells[i]]);
    cells.insert(some.cells[i]);
  }
  EXPECT_EQ(cells.size(), some.rows.size());
  EXPECT_EQ(read_text(folder / "out/table.csv"), to_csv(some));

  // The picture's cells are those that have run, and each of those is itself.
  const Table shown = filled(some).value();
  ASSERT_EQ(shown.rows.size(), 256U);
  for (std::size_t cell = 0; cell < 256; ++cell) {
    EXPECT_TRUE(std::find(some.rows.begin(), some.rows.end(), shown.rows[cell]) != some.rows.end()) << cell;
    if (cells.contains(cell)) {
      EXPECT_EQ(shown.rows[cell], whole.rows[cell]);
    }
  }

  stop = false;
  o.coarse = {};
  EXPECT_EQ(to_csv(sweep(o)), to_csv(whole));
  EXPECT_EQ(read_text(folder / "out/table.csv"), to_csv(whole));
}

TEST(SweepProgram, WritesTableAndPictureOfWhatHasRunWhereItIsStopped) {
  const Folder folder;
  const auto command = [&](const std::string& out) {
    return lab({"sweep", kOneAxis, "--set", "control.passivity.method=NONE", "--vary",
                "to_slave.delay_ms,to_master.delay_ms=0.1:20:28", "--vary",
                "environment[0].wall.stiffness_n_per_m=1000:20000:28", "--lanes", "1", "--verdict", "plain", "--out",
                folder / out});
  };
  for (const int signal : {SIGINT, SIGTERM}) {
    const std::string out = fmt::format("stopped by {}", signal), cells = folder / out + "/cells.jsonl",
                      page = folder / out + "/coarse.html", again = "<meta http-equiv=\"refresh\"";
    Process stopped{command(out)};
    while (stopped.running() && (!exists(cells) || test::count(read_text(cells), "\n") < 64))
      std::this_thread::sleep_for(1ms);
    stopped.send(signal);
    EXPECT_EQ(stopped.wait(), exited(130)) << stopped.err();
    if (exists(page)) {  // after half a second
      EXPECT_NE(read_text(page).find("<img src=\"stable.png\">"), std::string::npos);
      EXPECT_EQ(read_text(page).find(again), std::string::npos) << "nothing gets finer any more";
    }
    const std::string table = read_text(folder / out + "/table.csv");
    const int rows = test::count(table, "\n") - 1;
    EXPECT_GE(rows, 63);
    EXPECT_LT(rows, 784);
    EXPECT_NE(stopped.err().find(fmt::format("stopped: {} of 784 cells; the same command goes on from there\n", rows)),
              std::string::npos)
        << stopped.err();
    EXPECT_NE(stopped.out().find(fmt::format("{}/table.csv: {} cells\n", folder / out, rows)), std::string::npos);
    EXPECT_NE(read_text(folder / out + "/stable.gp").find("(coarse)"), std::string::npos);
  }
  expect_done(finished(command("whole")));
  const std::string out = fmt::format("stopped by {}", SIGINT), whole = read_text(folder / "whole/table.csv");
  std::istringstream rows{read_text(folder / out + "/table.csv")};
  for (std::string row; std::getline(rows, row);) EXPECT_NE(whole.find(row + "\n"), std::string::npos) << row;
  expect_done(finished(command(out)));
  for (const char* name : {"/table.csv", "/stable.gp", "/stable.dat"})
    EXPECT_EQ(read_text(folder / out + name), read_text(folder / "whole" + name)) << name;
}

TEST(SweepProgram, RefusesToGoOnWithAnotherSweep) {
  const Folder folder;
  const std::string out = folder / "out";
  expect_done(finished(lab(plus(kGrid, {"--plot", "none", "--out", out}))));
  expect_refused(finished(lab(plus(kGrid, {"--out", out, "--set", "seed=8"}))), {out, "another"});
  expect_refused(
      finished(lab({"sweep", kWall, "--set", "duration_s=0.6", "--vary", "to_slave.delay_ms=5,6", "--out", out})),
      {out, "another"});
  Words other_scene = kGrid;
  other_scene[1] = folder.write("scene.textproto", read_text(kWall) + "# changed\n");
  expect_refused(finished(lab(plus(other_scene, {"--out", out}))), {out, "another"});
  expect_refused(finished(lab(plus(kGrid, {"--out", out, "--seeds", "1"}))), {out, "another"});
  expect_refused(finished(lab(plus(kGrid, {"--out", out, "--verdict", "lean"}))), {out, "another"});
  expect_refused(finished(lab(plus(kGrid, {"--out", out, "--verdict", "plain"}))), {out, "another"});
  std::ofstream{out + "/cells.jsonl", std::ios::app} << "nonsense\n";
  expect_refused(finished(lab(plus(kGrid, {"--out", out}))), {out + "/cells.jsonl:14", "not a cell"});
}

TEST(SweepProgram, RefusesCellsThatWereEdited) {
  const Folder folder;
  const std::string out = folder / "out", cells = out + "/cells.jsonl";
  const Words sweep =
      plus({"sweep", kHeld, "--set", "duration_s=0.1", "--vary", "seed=1,2,3", "--plot", "none"}, {"--out", out});
  expect_done(finished(lab(sweep)));
  const std::string whole = read_text(cells);
  const auto expect_edit_refused = [&](const std::string& from, const std::string& to, int line) {
    std::string text = whole;
    const std::size_t place = text.find(from);
    ASSERT_NE(place, text.npos) << from << "\n" << text;
    text.replace(place, from.size(), to);
    std::ofstream{cells} << text;
    const std::string where = fmt::format("{}:{}: is not ", cells, line);
    expect_refused(finished(lab(sweep)), {where});
    expect_refused(finished(lab({"merge", out, "--plot", "none", "--out", folder / "m"})), {where});
  };
  for (int cell = 0; cell < 3; ++cell) {
    const std::string number = fmt::format("\"cell\": {}", cell);
    const int line = test::count(whole.substr(0, whole.find(number)), "\n") + 1;
    expect_edit_refused(number + ",", number + ".5,", line);
    expect_edit_refused(number + ",", "\"cell\": 7,", line);
    expect_edit_refused(number + ",", fmt::format("\"cell\": {},", (cell + 1) % 3), line);
    expect_edit_refused(number + ", \"row\": [\"", number + ", \"row\": [\"1", line);
  }
  expect_edit_refused("held spring", "held sprung", 2);
  expect_edit_refused("\"check\": \"", "\"check\": \"0", 1);
  expect_edit_refused("[\"1\", \"2\", \"3\"]", "[\"1\", \"2\", \"4\"]", 1);

  // A line of another sweep is none of this one's; the same line twice does no harm.
  expect_done(finished(lab({"sweep", kHeld, "--set", "duration_s=0.2", "--vary", "seed=1,2,3", "--plot", "none",
                            "--out", folder / "other"})));
  const std::string other = read_text(folder / "other/cells.jsonl");
  std::ofstream{cells} << whole << other.substr(other.find('\n') + 1);
  expect_refused(finished(lab(sweep)), {cells + ":5: is not a cell of this sweep"});
  std::ofstream{cells} << whole << whole.substr(whole.find('\n') + 1);
  expect_done(finished(lab(sweep)));
}

TEST(SweepProgram, MergesItsPartsIntoTheWhole) {
  const Folder folder;
  const auto part = [&](const std::string& shard, const std::string& out) {
    return finished(lab(plus(kGrid, {"--plot", "none", "--shard", shard, "--out", folder / out})));
  };
  expect_done(finished(lab(plus(kGrid, {"--plot", "none", "--out", folder / "whole"}))));
  expect_done(part("1/3", "a"));
  expect_done(part("2/3", "b"));
  const auto merge = [&](const Words& parts, const std::string& out) {
    Words command{"merge"};
    for (const std::string& each : parts) command.push_back(folder / each);
    return finished(lab(plus(command, {"--plot", "none", "--out", folder / out})));
  };
  expect_refused(merge({"a", "b"}, "m"), {"4 of 12 cells are missing: --shard 3/3 is not there"});
  EXPECT_FALSE(exists(folder / "m/table.csv"));
  expect_done(part("3/3", "c"));
  EXPECT_EQ(test::count(read_text(folder / "c/table.csv"), "\n"), 5);
  expect_refused(merge({"a", "b", "c", "b"}, "m"), {"in two parts", folder / "b"});
  const std::string whole_part = read_text(folder / "c/cells.jsonl");
  std::ofstream{folder / "c/cells.jsonl"} << whole_part.substr(0, whole_part.rfind('\n', whole_part.size() - 2) + 1);
  expect_refused(merge({"a", "b", "c"}, "m"),
                 {"1 of 12 cells are missing", folder / "c", "has 3 of the 4 cells of --shard 3/3"});
  std::ofstream{folder / "c/cells.jsonl"} << whole_part;
  expect_done(merge({"c", "a", "b"}, "m"));
  EXPECT_EQ(read_text(folder / "m/table.csv"), read_text(folder / "whole/table.csv"));
  expect_done(merge({"m"}, "again"));  // what it leaves is a sweep's
  EXPECT_EQ(read_text(folder / "again/table.csv"), read_text(folder / "whole/table.csv"));

  expect_done(finished(lab(
      {"sweep", kHeld, "--set", "duration_s=0.1", "--vary", "seed=1,2", "--plot", "none", "--out", folder / "other"})));
  expect_refused(merge({"a", "other"}, "m"), {folder / "other", "another sweep"});
  expect_refused(merge({"a", "nowhere"}, "m"), {folder / "nowhere", "cannot be read"});
}

TEST(SweepProgram, ShardsMergesAndGoesOnWithLinkedPaths) {
  const Folder folder;
  const Words grid{"sweep", kWall,    "--set",    "duration_s=0.3", "--plot",
                   "none",  "--vary", "seed=1,2", "--vary",         "to_slave.delay_ms,to_master.delay_ms=5:50:4"};
  const auto sweep = [&](const Words& more, const std::string& out) {
    expect_done(finished(lab(plus(plus(grid, more), {"--out", folder / out}))));
    return read_text(folder / out + "/table.csv");
  };
  const std::string whole = sweep({"--jobs", "1"}, "whole");
  EXPECT_EQ(whole.rfind("seed,to_slave.delay_ms,to_master.delay_ms,dof,", 0), 0U) << whole.substr(0, 200);
  EXPECT_NE(whole.find("\n2,35,35,"), std::string::npos) << whole;
  EXPECT_EQ(sweep({"--jobs", "2"}, "two"), whole);

  sweep({"--shard", "1/2"}, "a");
  sweep({"--shard", "2/2"}, "b");
  expect_done(finished(lab({"merge", folder / "a", folder / "b", "--plot", "none", "--out", folder / "m"})));
  EXPECT_EQ(read_text(folder / "m/table.csv"), whole);

  // Half of its cells are there.
  const std::string kept = read_text(folder / "a/cells.jsonl");
  EXPECT_EQ(sweep({}, "a"), whole);
  EXPECT_EQ(read_text(folder / "a/cells.jsonl").rfind(kept, 0), 0U);
  Words apart = grid;
  apart.back() = "to_slave.delay_ms=5:50:4";
  expect_refused(finished(lab(plus(apart, {"--out", folder / "a"}))), {folder / "a", "another"});
}

TEST(SweepProgram, OverSeedsIsTheSameForAnyJobsShardsAndStops) {
  const Folder folder;
  const Words grid{"sweep", kWall,     "--set", "duration_s=0.3", "--plot",
                   "none",  "--seeds", "3",     "--vary",         "to_slave.delay_ms=5:50:4"};
  const auto sweep = [&](const Words& more, const std::string& out) {
    expect_done(finished(lab(plus(plus(grid, more), {"--out", folder / out}))));
    return read_text(folder / out + "/table.csv");
  };
  const std::string whole = sweep({"--jobs", "1"}, "whole");
  EXPECT_EQ(test::count(whole, "\n"), 5);
  EXPECT_EQ(sweep({"--jobs", "5"}, "five"), whole);
  sweep({"--shard", "1/2"}, "a");
  sweep({"--shard", "2/2"}, "b");
  expect_done(
      finished(lab({"merge", folder / "a", folder / "b", "--plot", "chatter_rms_n_worst", "--out", folder / "m"})));
  EXPECT_EQ(read_text(folder / "m/table.csv"), whole);
  EXPECT_EQ(sweep({}, "a"), whole);  // half of its cells are there
  Words other = grid;
  other[7] = "4";
  expect_refused(finished(lab(plus(other, {"--out", folder / "a"}))), {folder / "a", "another", "seeds"});
}

TEST(SweepProgram, WarnsOfASetThatHasNoEffect) {
  const Folder folder;
  const auto warned = [&](const Words& more) {
    Process p = finished(
        lab(plus({"sweep", kHeld, "--set", "duration_s=0.1", "--out", folder / "out", "--plot", "none"}, more)));
    EXPECT_EQ(p.wait(), exited(0)) << p.err();
    std::filesystem::remove_all(folder / "out");
    return p.err();
  };
  EXPECT_EQ(warned({"--vary", "duration_s=0.1,0.2"}),
            "warning: --set duration_s=0.1 has no effect: duration_s is varied\n");
  EXPECT_EQ(warned({"--set", " device.mass_kg =0.1", "--vary", "device={mass_kg: 0.1},{mass_kg: 0.2}"}),
            "warning: --set  device.mass_kg =0.1 has no effect: device is varied\n");
  EXPECT_EQ(warned({"--vary", "device.mass_kg=0.1,0.2"}), "");
}

TEST(SweepProgram, TakesItsFolderForItself) {
  const Folder folder;
  const FolderLock taken{folder / "", "--out"};
  const Words part{"sweep", kHeld, "--set", "duration_s=0.1", "--vary", "device.mass_kg=1,2", "--shard", "1/2"};
  expect_refused(finished(lab(plus(part, {"--out", folder / ""}))), {"--out ", "another program writes there now"});
}

TEST(SweepProgram, SaysWhyACellCannotBeKept) {
  const Folder folder;
  const std::string out = folder / "out";
  Process sweep =
      finished({"/bin/sh", "-c",
                std::string{"trap '' XFSZ; ulimit -f 40; "} + TWOPORT_LAB +
                    " sweep \"$0\" --set duration_s=0.1 --vary device.mass_kg=1:2:40 --plot none --out \"$1\"",
                kHeld, out});
  EXPECT_EQ(sweep.wait(), exited(1)) << sweep.err();
  EXPECT_NE(sweep.err().find("/cells.jsonl: cannot be written: File too large"), std::string::npos) << sweep.err();
}

// In memory, 20,000 more rows take 200 MB.
TEST(SweepProgram, KeepsItsRowsOnDisk) {
  if (kAddressSanitizer) GTEST_SKIP() << "freed memory is kept by the sanitizer";
  const Folder folder;
  const auto largest_kb = [&](const std::string& values, const std::string& out) {
    expect_done(finished(lab({"sweep", kHeld, "--set", "duration_s=0.01", "--verdict", "plain", "--plot", "none",
                              "--jobs", "2", "--vary", "device.mass_kg=1:2:" + values, "--out", folder / out})));
    rusage of_children{};
    getrusage(RUSAGE_CHILDREN, &of_children);
    return of_children.ru_maxrss;
  };
  const long few = largest_kb("5000", "few");
  EXPECT_LT(largest_kb("25000", "many"), few + 40'000);
  EXPECT_EQ(test::count(read_text(folder / "many/table.csv"), "\n"), 25'001);
}

TEST(CellFile, GivesBackWhatItWasGiven) {
  const Folder folder;
  const Plan plan{.digest = "d",
                  .grid = {{{.paths = {"a", "b"}, .values = {"1", "x\"y"}}}},
                  .seeds = 0,
                  .columns = {"a", "b", "c"}};
  const std::vector<Values> rows{{"1", "1", "plain"}, {"x\"y", "x\"y", "\\ \" \n \t \x01 µ , [] {} \\u0041"}};
  folder.write("cells.jsonl", "{");  // a first line that did not get to its end
  {
    CellFile file{folder / "", plan};
    EXPECT_FALSE(file.holds(0));
    file.append(1, rows[1]);
    EXPECT_FALSE(file.holds(0));
    EXPECT_EQ(file.row(1), rows[1]);
    file.append(0, rows[0]);
    EXPECT_EQ(file.row(0), rows[0]);
    EXPECT_EQ(file.row(1), rows[1]);
  }
  CellFile again{folder / "", plan};
  ASSERT_TRUE(again.holds(0) && again.holds(1));
  EXPECT_EQ(again.row(0), rows[0]);
  EXPECT_EQ(again.row(1), rows[1]);
  EXPECT_EQ(again.line(0) + again.line(1), CellFile{folder / ""}.line(0) + CellFile{folder / ""}.line(1));

  // Cut while the program runs.
  std::filesystem::resize_file(again.path(), std::filesystem::file_size(again.path()) - 3);
  EXPECT_THROW(again.row(0), IoError);
}

TEST(SweepProgram, ATableThatStdoutDoesNotTakeIsAFailure) {
  Process sweep = finished({"/bin/sh", "-c",
                            TWOPORT_LAB + std::string{" sweep \"$0\" --set duration_s=0.1 --vary device.mass_kg=1:2:20 "
                                                      "--plot none >/dev/full"},
                            kHeld});
  EXPECT_EQ(sweep.wait(), exited(1)) << sweep.err();
  EXPECT_NE(sweep.err().find("standard output: "), std::string::npos) << sweep.err();
}

TEST(SweepProgram, SaysWhatIsWrong) {
  const auto sweep = [](const Words& more) {
    return finished(lab(plus({"sweep", kHeld, "--set", "duration_s=0.1"}, more)));
  };
  expect_refused(sweep({"--vary", "device.mass_kg"}), {"--vary device.mass_kg", "PATH=a,b,c"});
  expect_refused(sweep({"--vary", "device.mass_kg=1:2"}), {"device.mass_kg=1:2", "start:stop:count"});
  expect_refused(sweep({"--vary", "device.colour=1,2"}), {"device.colour=1", "colour", "mass_kg"});
  expect_refused(sweep({"--vary", "device.mass_kg=0.1,-1"}), {"device.mass_kg", "-1", ">= 0"});
  expect_refused(sweep({"--vary", "device.mass_kg=1,2", "--vary", "device.mass_kg=3,4"}), {"device.mass_kg", "twice"});
  expect_refused(sweep({"--vary", "device.mass_kg,seed=1,2", "--vary", "seed=3,4"}), {"seed is varied twice"});
  expect_refused(sweep({"--vary", " device.mass_kg=1,2", "--vary", "device.mass_kg=1,3"}),
                 {"--vary  device.mass_kg: what it sets, --vary device.mass_kg sets anew"});
  expect_refused(sweep({"--vary", "environment[0].wall.stiffness_n_per_m=1,2", "--vary", "device.mass_kg=1,2", "--vary",
                        "environment[0].spring.stiffness_n_per_m=1,2"}),
                 {"--vary environment[0].wall.stiffness_n_per_m: what it sets, --vary environment[0].spring."});
  for (const bool block_first : {true, false}) {
    const Words block{"--vary", "device={mass_kg: 3},{mass_kg: 4}"}, part{"--vary", "device.mass_kg=1,2"};
    expect_refused(sweep(block_first ? plus(block, part) : plus(part, block)),
                   {"device.mass_kg is a part of device, which is varied too"});
  }
  expect_refused(sweep({"--vary", "device.mass_kg=1,2", "--vary", "seed=1,2", "--seeds", "2"}),
                 {"--seeds 2", "--vary seed"});
  expect_refused(sweep({"--vary", "device.mass_kg,device.mass_kg=1,2"}), {"device.mass_kg is named twice"});
  expect_refused(sweep({"--vary", "device.mass_kg,=1,2"}), {"device.mass_kg,=1,2", "a path is empty"});
  expect_refused(sweep({"--vary", "device.mass_kg,device.colour=1,2"}), {"device.colour=1", "colour", "mass_kg"});
  expect_refused(sweep({"--vary", "seed=1:1000:1000", "--vary", "device.mass_kg=1:2:1001"}),
                 {"1001000 cells", "at most"});
  expect_refused(sweep({"--vary", "seed=1,2", "--shard", "3/2"}), {"--shard 3/2", "I/N"});
  expect_refused(sweep({"--vary", "seed=1,2", "--jobs", "0"}), {"--jobs", "0", "at least 1"});
  expect_refused(sweep({"--vary", "seed=1,2", "--seeds", "0"}), {"--seeds", "0", "1"});
  expect_refused(sweep({"--vary", "seed=1,2", "--verdict", "full"}), {"--verdict", "full", "tail,lean,plain"});
  expect_refused(sweep({"--vary", "seed=1,2", "--seeds", "2.5"}), {"--seeds", "2.5"});
  expect_refused(sweep({"--vary", "device.mass_kg=1:2:1000000", "--seeds", "1001"}), {"1001000000 runs", "at most"});
  for (const auto& [typed, meant] : {std::pair{"stabel", "stable"}, std::pair{"drfit_m", "drift_m"},
                                     std::pair{"chatter", "chatter_rms_n"}, std::pair{"drift_m_sd", "drift_m"}})
    expect_refused(sweep({"--vary", "seed=1,2", "--plot", typed}),
                   {fmt::format("--plot {}: no such figure; the nearest are {}, ", typed, meant), "--list-figures"});
  expect_refused(sweep({"--vary", "seed=1,2", "--seeds", "2", "--plot", "drift_m_s"}), {"nearest are drift_m_sd, "});
  expect_refused(sweep({"--vary", "seed=1,2", "--out", "/dev/null/x"}), {"--out /dev/null/x"});
  // Each value is good, one pair is not: the cell is named.
  expect_refused(sweep({"--vary", "control.hold_after_s=0.1,2", "--vary", "control.release_after_s=3,1"}),
                 {"cell 3 (control.hold_after_s=2, control.release_after_s=1)", "hold_after_s"});
}

TEST(SweepProgram, ListsItsFigures) {
  Process p = finished(lab({"sweep", "--list-figures"}));
  EXPECT_EQ(p.wait(), exited(0)) << p.err();
  std::string expected;
  for (const std::string& name : figures()) expected += name + "\n";
  EXPECT_EQ(p.out(), expected);
}

// The address space has room for the stacks of a few threads more.
TEST(Parallel, TakesTheThreadsThatItGets) {
  if (kSanitized) GTEST_SKIP() << "sanitizers take address space of their own";
  std::ifstream pages{"/proc/self/statm"};
  rlim_t used = 0;
  pages >> used;
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_AS, &before), 0);
  const rlimit tight{.rlim_cur = used * static_cast<rlim_t>(sysconf(_SC_PAGESIZE)) + (rlim_t{100} << 20),
                     .rlim_max = before.rlim_max};
  std::vector<std::atomic<int>> calls(5000);
  std::atomic<int> threads{0};
  thread_local bool counted = false;
  ASSERT_EQ(setrlimit(RLIMIT_AS, &tight), 0);
  for_each_parallel(calls.size(), 1000, [&](std::size_t i) {
    ++calls[i];
    if (!std::exchange(counted, true)) ++threads;
    std::this_thread::sleep_for(100us);
  });
  ASSERT_EQ(setrlimit(RLIMIT_AS, &before), 0);
  for (const std::atomic<int>& each : calls) EXPECT_EQ(each, 1);
  EXPECT_GT(threads, 1);
  EXPECT_LT(threads, 1000);
}

TEST(SweepProgram, ShowsItsProgressToWhomWatches) {
  const Folder folder;
  const Words command = lab(plus(kGrid, {"--plot", "none", "--lanes", "1", "--out", folder / "out"}));
  Process watched{command, {.terminal = true, .unprivileged = false, .network = -1}};
  EXPECT_EQ(watched.wait(), exited(0)) << watched.err();
  EXPECT_NE(watched.err().find("12 of 12 cells"), std::string::npos) << watched.err();
  EXPECT_NE(watched.err().find("s left"), std::string::npos) << watched.err();
  EXPECT_EQ(finished(command).err(), "");
}

// ---- pictures

Table some_table(std::size_t axes) {
  Table table{.grid = {{parse_axis("device.mass_kg=0.01:1:3:log"), parse_axis("control.passivity.method=NONE,CLASSIC"),
                        parse_axis("to_slave.delay_ms=5,1,3")}}};
  table.grid.axes.resize(axes);
  for (const Axis& axis : table.grid.axes) table.columns.push_back(axis.name());
  table.columns.insert(table.columns.end(), {"stable", "drift_m"});
  for (std::size_t cell = 0; cell < table.grid.cells(); ++cell) {
    const Words varied = table.grid.values(cell);
    table.rows.emplace_back(varied.begin(), varied.end());
    table.rows.back().emplace_back(cell % 3 == 0 ? 0 : 1);
    table.rows.back().emplace_back(1e-3 * static_cast<double>(cell + 1));
  }
  return table;
}

TEST(Picture, IsDrawnOfOneTwoOrThreeAxes) {
  if (std::system("command -v gnuplot > /dev/null 2>&1") != 0) GTEST_SKIP() << "gnuplot is not installed";
  for (const std::size_t axes : {1U, 2U, 3U})
    for (const char* key : {"stable", "drift_m"}) {
      const Folder folder;
      std::filesystem::create_directories(folder / "it's here");
      const std::string out = folder / "it's here";
      EXPECT_EQ(draw(some_table(axes), key, out), fmt::format("{0}/{1}.png, {0}/{1}.svg", out, key));
      EXPECT_EQ(read_text(out + "/" + key + ".png").rfind("\x89PNG", 0), 0U);
      EXPECT_NE(read_text(out + "/" + key + ".svg").find("device mass [kg]"), std::string::npos);
      EXPECT_NE(read_text(out + "/" + key + ".svg").find("unstable"), std::string::npos);
      EXPECT_FALSE(exists(out + "/" + key + ".log"));
    }
}

TEST(Picture, BandOfASpreadLiesAroundTheMeanWithinTheAxes) {
  Table table = some_table(1);
  table.grid.axes = {parse_axis("device.mass_kg=0.01:1:4:log")};
  table.seeds = 3;
  table.columns = {"device.mass_kg", "stable_worst", "drift_m", "drift_m_sd", "drift_m_worst"};
  table.rows.clear();
  for (std::size_t cell = 0; cell < 4; ++cell) {
    const double mean = 1e-3 * static_cast<double>(cell + 2);
    table.rows.push_back({table.grid.values(cell)[0], 1, mean, 0.3 * mean, 1.5 * mean});
  }
  if (std::system("command -v gnuplot > /dev/null 2>&1") != 0) GTEST_SKIP() << "gnuplot is not installed";
  const Folder folder;
  table.seeds = 1;  // has no spread
  draw(table, "drift_m", folder / ".");
  for (const char* words : {"worst", "deviation", "seeds"})
    EXPECT_EQ(read_text(folder / "drift_m.svg").find(words), std::string::npos) << words;
  table.seeds = 3;
  EXPECT_EQ(draw(table, "drift_m", folder / "."), fmt::format("{0}/drift_m.png, {0}/drift_m.svg", folder / "."));
  EXPECT_NE(read_text(folder / "drift_m.svg").find("worst seed"), std::string::npos);
  const std::vector<test::DrawnShape> drawn = test::shapes_of(read_text(folder / "drift_m.svg"));
  const std::vector<test::Box> axes = test::axes_in(drawn);
  ASSERT_EQ(axes.size(), 1U);
  test::Points mean, band;
  for (const test::DrawnShape& s : drawn) {
    if (!axes[0].contains(s.points.front(), 0.2)) continue;  // of the legend
    if (s.kind == test::DrawnShape::Kind::polygon && s.colour == test::colour_in_svg("#cbdfe3")) band = s.points;
    if (s.kind == test::DrawnShape::Kind::mark && s.colour == test::colour_in_svg(kStableColour))
      mean.push_back(s.points[0]);
  }
  ASSERT_EQ(mean.size(), 4U);
  ASSERT_EQ(band.size(), 8U);
  for (std::size_t i = 0; i < 4; ++i) {
    const Eigen::Vector2d &low = band[i], &high = band[7 - i];
    EXPECT_TRUE(axes[0].contains(low, 0.2) && axes[0].contains(high, 0.2)) << i;
    EXPECT_LT((0.5 * (low + high) - mean[i]).norm(), 0.2) << i;
    EXPECT_NEAR(low.y() - mean[i].y(), 0.3 * (axes[0].high.y() - mean[i].y()), 0.2) << i;  // from 0 on, at the bottom
  }
}

TEST(Picture, IsNotDrawnOfMoreOrWithoutGnuplot) {
  const Folder folder;
  Table table = some_table(3);
  table.grid.axes.push_back(parse_axis("seed=1,2"));
  EXPECT_NE(draw(table, "stable", folder / ".").find("no picture: 4 axes"), std::string::npos);

  Words command = lab(plus(kGrid, {"--out", folder / "out"}));
  command.insert(command.begin(), {"/usr/bin/env", "PATH=/nonexistent"});
  Process p = finished(command);
  EXPECT_EQ(p.wait(), exited(0)) << p.err();
  EXPECT_NE(p.out().find("gnuplot is not installed"), std::string::npos) << p.out();
  EXPECT_TRUE(exists(folder / "out/table.csv"));
  EXPECT_TRUE(exists(folder / "out/stable.gp"));
}

}  // namespace
}  // namespace twoport::lab::sweep_test
