#include "lab/study/map.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <numeric>
#include <sstream>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/method/catalogue.h"
#include "common/record/summary.h"
#include "common/scene/load.h"
#include "lab/plot/pictures.h"
#include "lab/run.h"
#include "lab/study/compare.h"
#include "lab/study/link_advice.h"
#include "tests/support/process.h"

namespace twoport::lab::map_test {
namespace {

MapOptions small(std::vector<std::string> methods) {
  return {.scene = {},
          .set = {},
          .methods = std::move(methods),
          .round_trips_ms = {0, 200},
          .losses = {0, 0.2},
          .bursts_packets = {1, 10},
          .stiffnesses_n_per_m = {2000},
          .seeds = 2,
          .jobs = 2};
}

TEST(Map, RunsALossOfZeroOnceAndEveryOtherForEachBurst) {
  const Map map = make_map(small({"NONE", "INTERNAL_MODEL"}));
  ASSERT_EQ(map.places.size(), 2u * (1u + 2u));
  ASSERT_EQ(map.cells.size(), 2u * map.places.size());
  const std::string csv = to_csv(to_table(map));
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 1 + static_cast<int>(map.cells.size()));
  // Without a delay the loop without control is the reference itself; over 200 ms it is unstable.
  EXPECT_TRUE(map.at(0, 0).holds());
  EXPECT_NEAR(map.at(0, 0).pressed.mean, 1.0, 1e-3);
  EXPECT_EQ(map.at(0, 3).unstable, 2);
  EXPECT_FALSE(map.at(0, 3).holds());
  for (std::size_t p = 0; p < map.places.size(); ++p) EXPECT_TRUE(map.at(1, p).holds()) << p;
}

TEST(Map, StoppedAfterALevelHasCellsOfTheWholeOne) {
  MapOptions options = small({"NONE", "CLASSIC"});
  options.round_trips_ms = {0, 20, 50, 100, 200};
  options.stiffnesses_n_per_m = {300, 1000, 2000, 4000, 8000, 16000};
  options.seeds = 1;
  options.lanes = 2;  // the size of the first round follows the number of lanes
  const Map whole = make_map(options);
  std::atomic<bool> stop{false};
  options.stop = &stop;
  options.coarse = [&](const Map& known) { stop = filled(known).has_value(); };
  const Map some = make_map(options);
  ASSERT_TRUE(some.stopped);
  const std::string all = to_csv(to_table(whole)), csv = to_csv(to_table(some));
  EXPECT_LT(csv.size(), all.size());
  std::istringstream rows{csv};
  for (std::string row; std::getline(rows, row);) EXPECT_NE(all.find(row + "\n"), std::string::npos) << row;

  const Map shown = filled(some).value();
  for (std::size_t i = 0; i < shown.cells.size(); ++i) {
    const MapCell &cell = shown.cells[i], &own = some.cells[i];
    EXPECT_EQ(cell.method, whole.cells[i].method);
    EXPECT_EQ(cell.runs(), 1);
    if (own.runs() > 0) {
      EXPECT_EQ(cell.place.stiffness_n_per_m, own.place.stiffness_n_per_m);
    }
  }
  EXPECT_NE(to_text(some).find(" of 90 places"), std::string::npos) << to_text(some);
}

TEST(Map, ACellIsTheRunOfItsOverrides) {
  const Map map = make_map(small({"INTERNAL_MODEL"}));
  const Scene scene = load_scene(TWOPORT_SCENES "/map.textproto");
  const Summary run_of_cell = run(load_scene(TWOPORT_SCENES "/map.textproto",
                                             map_overrides(scene, "INTERNAL_MODEL", map.places[5], scene.seed + 1)));
  const auto at = static_cast<std::size_t>(
      std::find_if(map_figures().begin(), map_figures().end(),
                   [](const Figure& figure) { return figure.name() == "felt_force_error_rms_n"; }) -
      map_figures().begin());
  const double of_run = run_of_cell.felt_force_error_rms_n();
  const Spread& of_cell = map.at(0, 5).figures[at];
  // Mean and sd of two values are (a + b)/2 and |a - b|/√2.
  EXPECT_NEAR(std::abs(of_run - of_cell.mean), of_cell.sd / std::sqrt(2.0), 1e-12);
}

// The twin is left out where no controller acts; everything but the verdict comes from the same run.
TEST(Map, LeanVerdictIsTheFullOneOnASampleOfPlaces) {
  MapOptions options = small({"NONE", "INTERNAL_MODEL", "FORCE_PROJECTED", "FOUR_CHANNEL"});
  options.seeds = 1;
  const Map lean = make_map(options);
  options.verdict = VerdictFrom::tail;
  const Map full = make_map(options);
  for (std::size_t i = 0; i < lean.cells.size(); ++i) {
    EXPECT_EQ(lean.cells[i].stable, full.cells[i].stable) << i;
    EXPECT_EQ(lean.cells[i].restless, full.cells[i].restless) << i;
    EXPECT_EQ(lean.cells[i].figures[1].mean, full.cells[i].figures[1].mean) << i;
  }
}

// Good is more than holding: what is pressed is felt too. ENERGY_BOUNDING presses at 200 ms, and displays next to nothing.
TEST(Map, AMuteMethodIsNotGood) {
  MapOptions options = small({"INTERNAL_MODEL", "ENERGY_BOUNDING"});
  options.round_trips_ms = {200};
  options.losses = {0.0};
  options.seeds = 1;
  const Map map = make_map(options);
  EXPECT_TRUE(map.at(0, 0).good());
  EXPECT_TRUE(map.at(1, 0).holds());
  EXPECT_FALSE(map.at(1, 0).good());
}

// (p + z²/2n ± z √(p(1-p)/n + z²/4n²))/(1 + z²/n); for p = 0 it ends at z²/(n + z²) = 3.8415/13.8415.
TEST(Map, IntervalIsWilsons) {
  EXPECT_EQ(wilson(0, 10).low, 0.0);
  EXPECT_NEAR(wilson(0, 10).high, 0.2775, 5e-5);
  EXPECT_NEAR(wilson(8, 10).low, 0.4902, 5e-5);
  EXPECT_NEAR(wilson(8, 10).high, 0.9433, 5e-5);
  EXPECT_NEAR(wilson(10, 10).low, 1.0 - 0.2775, 5e-5);
}

/// The map's scene with the printed blocks in place of its own, over the link's file.
std::string with_blocks(std::string blocks, const std::string& link) {
  std::string text = read_whole(TWOPORT_SCENES "/map.textproto", "the scene");
  const std::size_t from = text.find("control {"), to = text.find("robot {");
  text.erase(from, to - from);
  const std::string shared =
      "architecture: POSITION_FORCE virtual_coupling { stiffness_n_per_m: 1000 damping_n_s_per_m: 20 } ";
  blocks.insert(blocks.find("control {") + 9, " " + shared);
  for (const std::string way : {"to_slave", "to_master"}) {
    const std::string file = "trace_file: \"" + link + "\" ";
    const std::size_t at = blocks.find(way + " {");
    if (at == blocks.npos) {
      blocks += way + " { " + file + "}\n";
    } else {
      blocks.insert(at + way.size() + 2, " " + file);
    }
  }
  return text + blocks;
}

TEST(Recommend, PrintsBlocksThatAreReadAndRunOverTheLink) {
  int playouts = 0, layers = 0;
  for (const auto& [name, method] : std::vector<std::pair<std::string, std::string>>{
           {"wifi_roaming", "INTERNAL_MODEL"}, {"satellite", "ENERGY_TANK"}, {"lte", "INTERNAL_MODEL+ENERGY_TANK"}}) {
    SCOPED_TRACE(name + ", " + method);
    const std::string file = TWOPORT_SCENES "/links/" + name + ".csv";
    const LinkAdvice advice =
        recommend(parse_link_trace(read_whole(file, file), file),
                  {.scene = {}, .set = {}, .methods = {method}, .stiffnesses_n_per_m = {1000}, .seeds = 1});
    ASSERT_EQ(advice.method, method);
    const std::string text = to_text(advice);
    const Scene scene = parse_scene(with_blocks(text, file), "blocks", {}, SceneFor::laboratory);
    EXPECT_NEAR(scene.control.hold_after.si(), advice.hold_after_s, 1e-9);
    EXPECT_NEAR(scene.control.release_after.si(), advice.release_after_s, 1e-9);
    EXPECT_NEAR(scene.control.initial_energy.si(), advice.initial_energy_j, 1e-3 * advice.initial_energy_j);
    EXPECT_NEAR(scene.transmission_to_slave.playout_s, 1e-3 * advice.to_slave.playout_ms, 1e-9);
    playouts += advice.to_slave.playout_ms > 0.0 ? 1 : 0;
    layers += text.find("transparency { layer: INTERNAL_MODEL }") != text.npos ? 1 : 0;
    const Summary s = run(scene);
    EXPECT_TRUE(s.stable()) << s.verdict() << "\n" << text;
    EXPECT_GT(s.touching_share(), 0.1);
  }
  EXPECT_GT(playouts, 0) << "no case has a playout buffer";
  EXPECT_EQ(layers, 1);
}

TEST(Map, BurstsLoseTheShareThatIsAsked) {
  const Scene scene = load_scene(TWOPORT_SCENES "/map.textproto");
  const MapPlace place{.round_trip_ms = 100, .loss = 0.3, .burst_packets = 10, .stiffness_n_per_m = 2000};
  const Scene of_place = load_scene(TWOPORT_SCENES "/map.textproto", map_overrides(scene, "NONE", place, 1));
  ASSERT_TRUE(of_place.to_slave.burst);
  const auto& burst = *of_place.to_slave.burst;
  EXPECT_NEAR(burst.p / (burst.p + burst.r), 0.3, 1e-12);
  EXPECT_NEAR(1.0 / burst.r, 10.0, 1e-12);
  EXPECT_DOUBLE_EQ(of_place.duration_s, scene.duration_s + 6 * 0.05);
}

TEST(Map, RefusesWhatItCannotRun) {
  for (const auto& change : std::vector<void (*)(MapOptions&)>{
           [](MapOptions& o) { o.losses = {1.0}; }, [](MapOptions& o) { o.losses = {}; },
           [](MapOptions& o) { o.seeds = 0; }, [](MapOptions& o) { o.methods = {"NO_SUCH"}; },
           [](MapOptions& o) { o.methods = {"FORCE_CONE"}; }, [](MapOptions& o) { o.stiffnesses_n_per_m = {0.0}; },
           [](MapOptions& o) { o.scene = TWOPORT_SCENES "/render_sphere.textproto"; }}) {
    MapOptions options = small({"NONE"});
    change(options);
    EXPECT_THROW(make_map(options), ConfigError);
  }
}

/// NONE errs by the least without a delay, and bounds nothing; a pair of the delayed force presses twice as much as is wanted.
TEST(Recommend, NamesNoMethodThatBoundsNothingOrPressesTooMuch) {
  MapOptions options = small({"NONE", "FOUR_CHANNEL"});
  options.round_trips_ms = {0.0};
  const Map free = make_map(options);
  ASSERT_TRUE(free.at(0, 0).holds());
  EXPECT_EQ(recommend(standings(free, 0)).method, "none");
  const std::string file = TWOPORT_SCENES "/links/lte.csv";
  const LinkAdvice advice = recommend(
      parse_link_trace(read_whole(file, file), file),
      {.scene = {}, .set = {}, .methods = {"DELAYED_FORCE+ENERGY_SPRING"}, .stiffnesses_n_per_m = {1000}, .seeds = 1});
  EXPECT_EQ(advice.method, "none");
  EXPECT_EQ(to_text(advice).find("passivity {"), std::string::npos);
  EXPECT_EQ(to_json(advice).find("\"scene\""), std::string::npos);
}

/// 75 s of packets 20 ms apart, with 10 ms and jitter but for `bad_s` from `at_s` on.
LinkTrace with_bad_part(double at_s, double bad_s, double delay_s, int lost_in_ten) {
  constexpr int kRows = 3750;
  LinkTrace link;
  for (TracedWay* way : {&link.to_slave, &link.to_master})
    for (int i = 0; i < kRows; ++i) {
      const int k = (i - static_cast<int>(std::lround(at_s / 0.02)) + kRows) % kRows;
      double packet_s = 0.01 + 1e-4 * (k * 7 % 10);
      if (0.02 * k < bad_s) packet_s += delay_s + 4e-4 * k;
      if (0.02 * k < bad_s && k % 10 < lost_in_ten) packet_s = std::numeric_limits<double>::quiet_NaN();
      way->push_back({static_cast<std::uint64_t>(i), 0.02 * i, packet_s});
    }
  return link;
}

/// The bad part is played wherever it lies, also across the trace's end.
TEST(Recommend, AnswersAlikeWhereverTheBadPartOfATraceLies) {
  for (const auto& [bad_s, delay_s, lost_in_ten] : {std::tuple{20.0, 0.5, 0}, {3.0, 0.05, 4}, {0.4, 0.0, 10}}) {
    SCOPED_TRACE(bad_s);
    std::string first;
    for (const double at_s : {2.0, 17.36, 40.0, 74.0}) {
      LinkAdvice advice =
          recommend(with_bad_part(at_s, bad_s, delay_s, lost_in_ten), {.scene = {},
                                                                       .set = {},
                                                                       .methods = {"INTERNAL_MODEL", "ENERGY_TANK"},
                                                                       .stiffnesses_n_per_m = {1000},
                                                                       .seeds = 1,
                                                                       .jobs = 2});
      ASSERT_GT(advice.why.size(), 2u);
      EXPECT_NE(advice.why[1].find("played, of 75.0 s, as long as the scene lasts: from "), std::string::npos);
      advice.why.erase(advice.why.begin() + 1);  // the times
      if (first.empty()) first = to_json(advice);
      EXPECT_EQ(to_json(advice), first) << at_s;
    }
  }
}

/// The kinds of bad parts that a link may have, each where it lies.
TEST(WorstParts, AreThoseOfDelayLossGapAndChange) {
  const auto part_around = [](const std::vector<LinkPart>& parts, double s, const std::string& why) {
    return std::any_of(parts.begin(), parts.end(), [&](const LinkPart& p) {
      return p.why.find(why) != p.why.npos && std::abs(p.from_s + 7.0 - s) < 1.5;
    });
  };
  LinkTrace link = with_bad_part(55.0, 14.0, 0.2, 0);  // 0.2 s and more from 55 to 69 s
  for (int i = 0; i < 3750; ++i) {
    TracedPacket& packet = link.to_master[static_cast<std::size_t>(i)];
    if (i >= 500 && i < 600 && i % 3 == 0) packet.delay_s = std::numeric_limits<double>::quiet_NaN();  // 10 to 12 s
    if (i >= 1500 && i < 1525) packet.delay_s = std::numeric_limits<double>::quiet_NaN();              // 30 to 30.5 s
  }
  const std::vector<LinkPart> parts = worst_parts(link, 14.0);
  EXPECT_TRUE(part_around(parts, 62.0, "the longest delays"));
  EXPECT_TRUE(part_around(parts, 11.0, "most lost"));
  EXPECT_TRUE(part_around(parts, 30.2, "the longest gap, 48"));
  EXPECT_TRUE(part_around(parts, 55.0, "the largest change of delay") ||
              part_around(parts, 69.0, "the largest change"));
  EXPECT_EQ(parts.size(), 4u);
  EXPECT_EQ(worst_parts(link, 75.0).size(), 1u);
  EXPECT_EQ(worst_parts(link, 75.0)[0].why, "");
}

/// A row each second of a link with 20 ms each way gives the blocks of a row each millisecond, and says that it knows less.
TEST(Recommend, TakesNoIntervalOfAProbeForAnOutage) {
  for (const double period_s : {1.0, 1e-3}) {
    LinkTrace link;
    for (TracedWay* way : {&link.to_slave, &link.to_master})
      for (std::uint64_t i = 0; i < 40; ++i) way->push_back({i, period_s * static_cast<double>(i), 0.02});
    const LinkAdvice advice = recommend(
        link, {.scene = {}, .set = {}, .methods = {"INTERNAL_MODEL"}, .stiffnesses_n_per_m = {1000}, .seeds = 1});
    EXPECT_EQ(advice.hold_after_s, 0.1);
    EXPECT_EQ(advice.release_after_s, 1.0);
    EXPECT_EQ(to_text(advice).find("rows are 1 s apart") != std::string::npos, period_s == 1.0);
  }
}

/// One scene over one link: the three commands run the same scenes and name the same method, of one, three and six axes.
TEST(Ranking, CompareMapAndRecommendNameTheSame) {
  const std::vector<std::string> methods{"INTERNAL_MODEL", "ENERGY_EXCHANGE", "ENERGY_TANK", "FORCE_PROJECTED"};
  struct Case {
    std::string name;
    double stiffness_n_per_m;
    std::vector<std::string> set;
  };
  for (const auto& [name, stiffness_n_per_m, short_set] :
       std::vector<Case>{{"one_axis_wall", 5000.0, {}},
                         {"demo", 5000.0, {"rate_hz=1000"}},
                         {"six_dof_plate", 3000.0, {"rate_hz=1000"}}}) {
    SCOPED_TRACE(name);
    const std::string file = TWOPORT_SCENES "/" + name + ".textproto";
    std::vector<std::string> set = short_set;
    set.insert(set.end(), {"to_slave={ delay_ms: 40 loss: 0.02 }", "to_master={ delay_ms: 40 loss: 0.02 }"});
    const Comparison beside = compare({.scene = file, .set = set, .methods = methods, .jobs = 2, .out = {}});
    const Recommendation of_compare = recommend(beside.standings);
    const Map map = make_map({.scene = file,
                              .set = set,
                              .methods = methods,
                              .round_trips_ms = {80},
                              .losses = {0.02},
                              .bursts_packets = {1},
                              .stiffnesses_n_per_m = {stiffness_n_per_m},
                              .seeds = 1,
                              .verdict = VerdictFrom::tail,
                              .jobs = 2});
    const Recommendation of_map = recommend(standings(map, 0));
    EXPECT_EQ(of_map.method, of_compare.method);
    EXPECT_NE(of_map.method, "none");
    for (std::size_t m = 0; m < methods.size(); ++m) {
      EXPECT_EQ(map.at(m, 0).stable, beside.standings[m].stable);
      if (beside.standings[m].stable > 0) {
        EXPECT_EQ(map.at(m, 0).error_n.mean, beside.standings[m].error_n.mean);
      }
    }

    // The link's own blocks in the scene: compare finds what recommend --link has found.
    const test::Folder folder;
    LinkTrace link = with_bad_part(0.0, 0.0, 0.0, 0);
    for (TracedWay* way : {&link.to_slave, &link.to_master}) way->resize(200);
    folder.write("link.csv", to_csv(link));
    const LinkAdvice advice = recommend(
        link,
        {.scene = file, .set = short_set, .methods = methods, .stiffnesses_n_per_m = {0.0}, .seeds = 1, .jobs = 2});
    std::vector<std::string> with_link = short_set;
    for (const char* way : {"to_slave", "to_master"})
      with_link.push_back(fmt::format("{}={{ trace_file: \"{}\" }}", way, folder / "link.csv"));
    with_link.insert(with_link.end(), {fmt::format("control.hold_after_s={}", advice.hold_after_s),
                                       fmt::format("control.release_after_s={}", advice.release_after_s),
                                       fmt::format("control.passivity.round_trip_ms={}", advice.round_trip_ms()),
                                       fmt::format("control.passivity.initial_energy_j={}", advice.initial_energy_j)});
    const Comparison over_link = compare({.scene = file, .set = with_link, .methods = methods, .jobs = 2, .out = {}});
    EXPECT_EQ(recommend(over_link.standings).method, advice.method);
    EXPECT_NE(advice.method, "none");
    EXPECT_NE(to_text(over_link).find("best: " + advice.method + ": stable and quiet"), std::string::npos);
  }
}

/// E(0) of the default's rule is made of one round trip, whether a scene names the link or recommend is given it.
TEST(Recommend, TheRoundTripOfALinkIsThatOfASceneOverIt) {
  for (const char* name : {"satellite", "home_uplink_under_load"}) {
    const std::string file = fmt::format(TWOPORT_SCENES "/links/{}.csv", name);
    const LinkTrace link = parse_link_trace(read_whole(file, file), file);
    const LinkAdvice with = advise(figures_of(link.to_slave), figures_of(link.to_master));
    LinkAdvice without = with;
    without.to_slave.playout_ms = without.to_master.playout_ms = 0.0;
    ASSERT_GT(with.to_slave.playout_ms, 0.0);
    for (const LinkAdvice& advice : {with, without}) {
      std::vector<std::string> set;
      for (const auto& [way, of] : {std::pair{"to_slave", &advice.to_slave}, {"to_master", &advice.to_master}})
        set.push_back(fmt::format("{}={{ trace_file: \"{}\" playout_ms: {} }}", way, file, of->playout_ms));
      const Scene scene = load_scene(TWOPORT_SCENES "/one_axis_wall.textproto", set);
      EXPECT_NEAR(1e3 * scene.control.known.round_trip.si(), advice.round_trip_ms(), 1e-3 * advice.round_trip_ms())
          << name << ", " << advice.to_slave.playout_ms;
    }
  }
}

/// Of a trace that outlasts the scene compare plays the beginning, and says so.
TEST(Compare, SaysThatATraceOutlastsTheScene) {
  const test::Folder folder;
  folder.write("link.csv", to_csv(with_bad_part(40.0, 3.0, 0.1, 0)));
  const std::string file = folder / "link.csv";
  const Comparison all = compare({.scene = TWOPORT_SCENES "/one_axis_wall.textproto",
                                  .set = {"duration_s=0.5", "to_slave={ trace_file: \"" + file + "\" }",
                                          "to_master={ trace_file: \"" + file + "\" }"},
                                  .methods = {"NONE"},
                                  .jobs = 1,
                                  .out = {}});
  EXPECT_NE(to_text(all).find("74.5 s of the link's trace come after the scene's end"), std::string::npos);
}

/// Of ports of joints as the summary has them: forces at the arms' tools.
TEST(Compare, DrawsForcesAtTheToolsOfJoints) {
  if (std::system("command -v gnuplot > /dev/null 2>&1") != 0) GTEST_SKIP() << "gnuplot is not installed";
  const test::Folder folder;
  const Comparison all = compare({.scene = TWOPORT_SCENES "/leader_follower.textproto",
                                  .set = {"duration_s=3"},
                                  .methods = {"ENERGY_EXCHANGE"},
                                  .jobs = 1,
                                  .out = folder / "."});
  draw(all, folder / ".");
  std::istringstream rows{read_whole(folder / "compare.dat")};
  std::vector<double> environment_n, felt_n, *into = nullptr;
  for (std::string row; std::getline(rows, row);) {
    double t_s = 0.0, force_n = 0.0;
    if (row == "# environment") into = &environment_n;
    if (row == "# felt by the hand") into = &felt_n;
    if (into != nullptr && std::istringstream{row} >> t_s >> force_n && force_n > 0.0) into->push_back(force_n);
  }
  const Summary& s = all.summaries[0];
  const double pressed_n = s.environment_force_mean_n(), most_felt_n = s.max_force_n();
  EXPECT_GT(pressed_n, 5.0);
  EXPECT_NEAR(
      std::accumulate(environment_n.begin(), environment_n.end(), 0.0) / static_cast<double>(environment_n.size()),
      pressed_n, 0.05 * pressed_n);
  EXPECT_NEAR(*std::max_element(felt_n.begin(), felt_n.end()), most_felt_n, 0.05 * most_felt_n);
}

/// What a press is short of is known beside a reference only.
TEST(Compare, KnowsNoErrorWhereNothingIsPressedWithoutDelay) {
  const auto row_of = [](std::vector<std::string> set) {
    set.emplace_back("duration_s=2");
    const std::string text = to_text(compare({.scene = TWOPORT_SCENES "/one_axis_wall.textproto",
                                              .set = std::move(set),
                                              .methods = {"INTERNAL_MODEL"},
                                              .jobs = 1,
                                              .out = {}}));
    std::istringstream row{text.substr(text.find("\nINTERNAL_MODEL") + 1)};
    std::string method, verdict, error;
    row >> method >> verdict >> error;
    return std::pair{verdict, error};
  };
  EXPECT_NE(row_of({}), (std::pair<std::string, std::string>{"STABLE", "-"}));
  EXPECT_EQ(row_of({"environment[0].wall.offset_m=-1"}), (std::pair<std::string, std::string>{"STABLE", "-"}));
}

/// Where a scene states no E(0), each method has that of the default's rule, whichever the scene names.
TEST(Ranking, GivesEveryMethodTheSameEnergy) {
  const std::string scene = TWOPORT_SCENES "/one_axis_wall.textproto";
  const auto energy_j = [&](const std::vector<std::string>& set) {
    const Scene s = load_scene(scene, set);
    return shared_initial_energy(s, s.control.known.round_trip).si();
  };
  // K (v R)^2/2 over 50 ms.
  EXPECT_NEAR(energy_j({}), 0.5 * 1000.0 * std::pow(0.05 * 0.05, 2), 1e-9);
  EXPECT_EQ(energy_j({"control.passivity.method=INTERNAL_MODEL"}), energy_j({}));
  EXPECT_EQ(energy_j({"control.passivity.initial_energy_j=0.007"}), 0.007);
}

/// A robot that presses goes on doing so for so long after its master has died.
TEST(Recommend, HoldsASecondAtMost) {
  DirectionFigures cut;
  cut.longest_gap_s = 5.0;
  EXPECT_EQ(advise(cut, {}).hold_after_s, 1.0);
  EXPECT_EQ(advise(cut, {}).release_after_s, 2.0);
}

TEST(Recommend, NamesTheMethodThatHoldsWithTheLeastError) {
  MapOptions options = small({"NONE", "FORCE_PROJECTED", "INTERNAL_MODEL"});
  options.round_trips_ms = {200};
  options.losses = {0.2};
  options.bursts_packets = {1};
  const Map map = make_map(options);
  EXPECT_EQ(recommend(standings(map, 0)).method, "INTERNAL_MODEL");
  EXPECT_EQ(best_of(standings(map, 0)), 2u);
  EXPECT_NE(to_text(map).find("best: INTERNAL_MODEL: stable and quiet"), std::string::npos);
  options.methods = {"NONE"};
  EXPECT_EQ(recommend(standings(make_map(options), 0)).method, "none");
}

TEST(Compare, RunsEveryMethodThatTheSceneCanName) {
  const Comparison link = compare({.scene = TWOPORT_SCENES "/one_axis_wall.textproto",
                                   .set = {"duration_s=0.1"},
                                   .methods = {},
                                   .jobs = 2,
                                   .out = {}});
  EXPECT_EQ(link.methods, method_names());
  const Comparison rendered = compare({.scene = TWOPORT_SCENES "/render_spring_orbit.textproto",
                                       .set = {"duration_s=0.1"},
                                       .methods = {},
                                       .jobs = 2,
                                       .out = {}});
  EXPECT_EQ(rendered.methods, rendering_methods());
  EXPECT_NE(to_text(rendered).find("best: none is named where there is no link"), std::string::npos);
  EXPECT_EQ(to_text(rendered).find("nan"), std::string::npos);
  EXPECT_THROW(compare({.scene = TWOPORT_SCENES "/one_axis_wall.textproto",
                        .set = {},
                        .methods = {"NO_SUCH"},
                        .jobs = 1,
                        .out = {}}),
               ConfigError);
}

MatrixOptions pairs(std::vector<std::string> transparencies, std::vector<std::string> passivities) {
  return {.scene = TWOPORT_SCENES "/one_axis_wall.textproto",
          .set = {"duration_s=2"},
          .transparencies = std::move(transparencies),
          .passivities = std::move(passivities),
          .jobs = 2};
}

TEST(Matrix, ACellIsTheRunOfItsLayers) {
  const MatrixOptions options = pairs({"DELAYED_FORCE", "INTERNAL_MODEL"}, {"NONE", "FORCE_PROJECTED"});
  const Matrix m = matrix(options);
  const Scene as_it_is = load_scene(options.scene, options.set);
  ASSERT_EQ(m.cells.size(), 4u);
  const Summary alone = run(load_scene(
      options.scene,
      std::vector<std::string>{
          "duration_s=2", "control.transparency.layer=INTERNAL_MODEL", "control.passivity.layer=FORCE_PROJECTED",
          fmt::format("control.passivity.initial_energy_j={}", as_it_is.control.initial_energy.si())}));
  EXPECT_EQ(m.at(1, 1).summary.felt_force_error_rms_n(), alone.felt_force_error_rms_n());
  EXPECT_EQ(m.at(1, 1).summary.verdict_kind(), alone.verdict_kind());
  const Table table = to_table(m);
  ASSERT_EQ(table.rows.size(), 4u);
  EXPECT_EQ(table.columns.front(), "transparency");
  EXPECT_TRUE(table.find("hand_min_energy_j") && table.find("two_port_min_energy_j") && table.find("verdict_kind"));
  EXPECT_EQ(table.rows[2][0], "INTERNAL_MODEL");
  EXPECT_EQ(table.rows[2][1], "NONE");
}

// A random force takes energy out of the hand's port; a spring that holds the port's energy does not let it.
TEST(Matrix, ARandomForceBreaksNoClaimOfTheLayersThatBoundTheHand) {
  const Matrix m = matrix(pairs({"RANDOM"}, {"NONE", "ENERGY_SPRING", "ENERGY_BOUNDING"}));
  EXPECT_LT(m.at(0, 0).summary.hand_min_energy_j(), -0.01);
  EXPECT_FALSE(m.at(0, 0).broken);  // NONE claims nothing
  EXPECT_FALSE(m.at(0, 1).broken);
  EXPECT_FALSE(m.at(0, 2).broken);
}

TEST(Matrix, PairsThatMakeNoSenseAreRefusedInWords) {
  const Matrix asked = matrix(pairs({"PLUGIN"}, {"NONE"}));
  EXPECT_NE(asked.at(0, 0).refused, "");
  EXPECT_EQ(to_table(asked).rows[0][2], "REFUSED");
  EXPECT_NE(to_text(asked).find("PLUGIN + NONE: "), std::string::npos);
  const std::vector<std::string> all = matrix(pairs({}, {"NONE"})).transparencies;
  EXPECT_EQ(std::find(all.begin(), all.end(), "PLUGIN"), all.end());  // nobody asked for it
  EXPECT_THROW(matrix(pairs({"NO_SUCH"}, {})), ConfigError);
}

TEST(Map, TakesPairsOfLayers) {
  MapOptions options = small({"INTERNAL_MODEL+ENERGY_SPRING", "INTERNAL_MODEL"});
  options.round_trips_ms = {20};
  options.losses = {0.0};
  options.seeds = 1;
  const Map map = make_map(options);
  EXPECT_GT(map.at(0, 0).error_n.mean, 0.0);
  EXPECT_EQ(map.at(0, 0).error_n.mean, map.at(1, 0).error_n.mean);
  options.methods = {"DELAYED_FORCE+NOTHING"};
  EXPECT_THROW(make_map(options), ConfigError);
}

TEST(Gallery, SaysInAWordWhatARunWas) {
  Summary s;
  s.set_verdict_kind("STABLE");
  EXPECT_EQ(in_a_word(s), "stable");
  s.set_muted_share(0.6);
  EXPECT_EQ(in_a_word(s), "mute");
  s.set_verdict_kind("UNSTABLE");
  EXPECT_EQ(in_a_word(s), "UNSTABLE");
  EXPECT_THROW(gallery({.folder = "/nonexistent", .methods = {}, .jobs = 1}), ConfigError);
  EXPECT_THROW(gallery({.folder = TWOPORT_SCENES "/../docs", .methods = {}, .jobs = 1}), ConfigError);
}

// A row of the table is `METHOD` | stable | mute | restless | UNSTABLE |: numbers of scenes, after a colon their names.
TEST(Gallery, IsAsTheDocumentsSay) {
  const Gallery all = gallery({.folder = TWOPORT_SCENES "/edge", .methods = {}, .jobs = 2});
  const std::string page = read_whole(TWOPORT_SCENES "/../docs/reference/methods.md");
  const std::size_t from = page.find("## The failure gallery"), to = page.find("\n## ", from);
  ASSERT_NE(to, page.npos);
  const std::string table = page.substr(from, to - from);
  for (std::size_t m = 0; m < all.methods.size(); ++m) {
    SCOPED_TRACE(all.methods[m]);
    const std::size_t at = table.find("| `" + all.methods[m] + "` |");
    ASSERT_NE(at, table.npos);
    std::istringstream row{table.substr(at, table.find('\n', at) - at)};
    std::string cell;
    std::getline(row, cell, '|');
    std::getline(row, cell, '|');
    for (const char* word : {"stable", "mute", "restless", "UNSTABLE"}) {
      std::vector<std::string> scenes;
      for (const Gallery::Entry& each : all.entries)
        if (in_a_word(each.summaries[m]) == word) scenes.push_back("`" + each.scene + "`");
      ASSERT_TRUE(std::getline(row, cell, '|'));
      const std::string number = std::to_string(scenes.size());
      EXPECT_EQ(cell, cell.find(':') == cell.npos ? " " + number + " "
                                                  : fmt::format(" {}: {} ", number, fmt::join(scenes, ", ")));
    }
  }
}

TEST(RunProgram, DrawsWhatItRan) {
  const test::Folder folder;
  test::Process process{{TWOPORT_LAB, "run", TWOPORT_SCENES "/one_axis_wall.textproto", "--plot", "--trace", "none",
                         "--out", folder / "out"}};
  ASSERT_EQ(process.wait(), test::exited(0)) << process.err();
  EXPECT_NE(process.out().find("run.png"), std::string::npos) << process.out();
  for (const char* name : {"run.png", "run.svg", "summary.json"})
    EXPECT_TRUE(std::filesystem::exists(folder / "out" + "/" + name)) << name;
  EXPECT_FALSE(std::filesystem::exists(folder / "out/trace.csv"));
}

// The program names the option that was typed, in one sentence, and runs nothing.
TEST(MapProgram, RefusesWhatItIsToldWrong) {
  using Words = std::vector<std::string>;
  const std::string scene = TWOPORT_SCENES "/one_axis_wall.textproto";
  const std::vector<std::pair<Words, Words>> cases{
      {{"map", "--methods", ""}, {"--methods", "empty"}},
      {{"map", "--loss", "0:1"}, {"--loss is 0:1", "start:stop:count"}},
      {{"map", "--loss", "a"}, {"--loss has a", "number"}},
      {{"map", "--loss", "1"}, {"--loss has 1", "0.99"}},
      {{"compare", scene, "--methods", "NO_SUCH"}, {"NO_SUCH", "INTERNAL_MODEL"}},
      {{"recommend", "--delay-ms", "-5", "--loss", "0", "--stiffness", "1000"}, {"--delay-ms", "-5"}},
      {{"recommend", "--delay-ms", "nan", "--loss", "0", "--stiffness", "1000"}, {"--delay-ms", "nan"}},
      {{"gallery", "/nonexistent"}, {"/nonexistent", "No such file"}}};
  for (const auto& [arguments, parts] : cases) {
    Words line{TWOPORT_LAB};
    line.insert(line.end(), arguments.begin(), arguments.end());
    test::Process process{line};
    EXPECT_EQ(process.wait(), test::exited(2)) << process.err();
    EXPECT_EQ(process.out(), "");
    for (const std::string& part : parts) EXPECT_NE(process.err().find(part), std::string::npos) << process.err();
  }
}

}  // namespace
}  // namespace twoport::lab::map_test
