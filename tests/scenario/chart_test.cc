#include "lab/study/chart.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/base/file.h"
#include "lab/study/boundary.h"
#include "tests/support/folder.h"
#include "tests/support/process.h"
#include "tests/theory/oracle.h"

namespace twoport::lab::chart_test {
namespace {

ChartPoint point(const std::string& name, double cost, double error) {
  ChartPoint p;
  p.name = name;
  p.cost = cost;
  p.off = error;
  return p;
}

TEST(Front, HoldsWhatNothingBeats) {
  std::vector<ChartPoint> points{point("cheap", 1, 1e-3), point("same, worse", 1, 2e-3), point("good", 3, 1e-6),
                                 point("dear", 5, 1e-6), point("best", 9, 1e-9)};
  find_front(points);
  EXPECT_EQ(points[0].dominated_by, "");
  EXPECT_EQ(points[1].dominated_by, "cheap");
  EXPECT_EQ(points[2].dominated_by, "");
  EXPECT_EQ(points[3].dominated_by, "good");
  EXPECT_EQ(points[4].dominated_by, "");
  EXPECT_EQ(cheapest(points, 1e-2)->name, "cheap");
  EXPECT_EQ(cheapest(points, 1e-5)->name, "good");
  EXPECT_EQ(cheapest(points, 1e-8)->name, "best");
  EXPECT_EQ(cheapest(points, 1e-10), nullptr);
  // What the reference cannot tell apart is the same, and not promised.
  find_front(points, 1e-5);
  EXPECT_EQ(points[2].dominated_by, "");
  EXPECT_EQ(points[4].dominated_by, "good");
  EXPECT_EQ(cheapest(points, 1e-8, 1e-8)->name, "best");
  EXPECT_EQ(cheapest(points, 1e-8, 2e-8), nullptr);
}

TEST(BesideEngines, TheCheapestOfOursThatIsNoLessAccurateCounts) {
  Chart c;
  c.points = {point("coarse", 1, 1e-3), point("good", 3, 1e-6), point("best", 9, 1e-9),
              point("slow", 8, 9e-4),   point("fast", 2, 1e-5), point("exact", 1, 1e-10)};
  for (std::size_t i = 3; i < c.points.size(); ++i) c.points[i].peer = true;
  const std::vector<EqualError> all = beside_engines(c);
  ASSERT_EQ(all.size(), 3u);
  EXPECT_EQ(all[0].engine->name, "exact");
  EXPECT_EQ(all[0].own, nullptr);
  EXPECT_EQ(all[0].ahead(), 0.0);
  EXPECT_EQ(all[1].own->name, "good");
  EXPECT_NEAR(all[1].ahead(), 2.0 / 3.0, 1e-15);
  EXPECT_EQ(all[2].own->name, "good");
  EXPECT_NEAR(all[2].ahead(), 8.0 / 3.0, 1e-15);
  c.floor_off = 1e-9;  // no chart tells errors below it apart
  EXPECT_EQ(beside_engines(c)[0].own->name, "best");
}

TEST(Answer, IsOffByTheLargestShareAndWrongWithAnotherVerdict) {
  EXPECT_EQ((Answer{"STABLE", true, 0.02, {}}.off()), 0.02);
  EXPECT_EQ((Answer{"STABLE", true, 0.02, 0.3}.off()), 0.3);
  EXPECT_TRUE(std::isinf(Answer{"UNSTABLE", false, 0.0, 0.0}.off()));
}

TEST(Front, HasNoPointWithAWrongAnswer) {
  const double wrong = std::numeric_limits<double>::infinity();
  std::vector<ChartPoint> points{point("cheap", 1, wrong), point("good", 3, 1e-2), point("dear", 5, wrong)};
  find_front(points);
  EXPECT_FALSE(points[0].counts());
  EXPECT_EQ(points[1].dominated_by, "");
  EXPECT_EQ(cheapest(points, 1e9)->name, "good");
  Chart c;
  c.points = points;
  c.points[0].peer = c.points[2].peer = true;
  EXPECT_EQ(beside_engines(c)[0].own->name, "good");  // no less accurate than what is wrong
  c.points[1].from = "plain";
  EXPECT_EQ(beside_engines(c)[0].own, nullptr);  // whose verdict is made in another way
  c.points[1].from = "";
  c.points[1].off = wrong;
  EXPECT_EQ(beside_engines(c)[0].own, nullptr);
  EXPECT_EQ(cheapest(c.points, 1e9), nullptr);
  c.points[0].answer = {"RESTLESS", false, 0.1, {}};
  EXPECT_EQ(told(c, c.points[0]), "cheap, 1000 ms, RESTLESS, wrong");
}

TEST(Difference, IsTakenAtTheMomentsThatBothHave) {
  Course slow, fast;
  for (int k = 0; k < 10; ++k) {
    slow.t_s.push_back(2e-3 * k), fast.t_s.push_back(1e-3 * k);
    for (Course* c : {&slow, &fast}) {
      const double x = c->t_s.back();
      c->master_x.insert(c->master_x.end(), {x, 0, 0});
      c->slave_x.insert(c->slave_x.end(), {0, c == &fast ? 0.5 : 0.0, 0});
      c->force.insert(c->force.end(), {0, 0, c == &fast && k == 2 ? 3.0 : 0.0});
      c->felt.insert(c->felt.end(), {c == &fast ? 2.0 : 0.0, 0, 0});
      c->energy_j.push_back(0.0);
    }
  }
  const Difference d = difference(slow, fast);
  EXPECT_NEAR(d.position_rms_m, 0.5, 1e-15);
  EXPECT_EQ(d.force_max_n, 3.0);
  EXPECT_NEAR(d.felt_rms_n, 2.0, 1e-15);
}

const ChartPoint& named(const Chart& c, const std::string& name) {
  const auto found =
      std::find_if(c.points.begin(), c.points.end(), [&](const ChartPoint& p) { return p.name == name; });
  EXPECT_NE(found, c.points.end()) << name;
  return *found;
}

// Errors of one mass on a wall as measured elsewhere with a reference of 1 us.
TEST(Chart, OfTheWallHasTheKnownErrors) {
  const Chart c = chart({.scene = TWOPORT_SCENES "/chart/wall.textproto",
                         .set = {},
                         .vary = {"simulation.integrator=EXACT,EXACT_PER_TICK,SYMPLECTIC_EULER,TRAPEZOIDAL,RK4"},
                         .boundary = {},
                         .repetitions = 1});
  EXPECT_LT(c.floor.position_rms_m, 1e-11);
  EXPECT_LT(named(c, "EXACT").error.position_rms_m, 1e-11);
  EXPECT_NEAR(named(c, "EXACT_PER_TICK").error.position_rms_m, 4.7e-6, 0.1e-6);
  EXPECT_NEAR(named(c, "SYMPLECTIC_EULER").error.position_rms_m, 4.9e-5, 0.1e-5);
  EXPECT_NEAR(named(c, "TRAPEZOIDAL").error.position_rms_m, 9.3e-6, 0.1e-6);
  EXPECT_NEAR(named(c, "RK4").error.position_rms_m, 4.3e-7, 0.1e-7);
  for (const ChartPoint& p : c.points) EXPECT_GT(p.ns_per_tick, 0.1) << p.name;
}

// A simulator with this error cannot judge a stability method.
TEST(Chart, ShowsThatEulerCallsAWallStableThatIsNot) {
  const double theory = critical_stiffness({.mass_kg = 0.075, .damping_n_s_per_m = 0.5, .period_s = 5e-4});
  const auto found = [](const std::string& integrator) {
    return find_boundary({.scene = TWOPORT_SCENES "/held_spring.textproto",
                          .set = {"duration_s=15", "simulation.integrator=" + integrator},
                          .vary = {{"environment[0].spring.stiffness_n_per_m"}, 500.0, 4e6}})
        .stable;
  };
  EXPECT_NEAR(found("EXACT"), theory, 1e-3 * theory);
  EXPECT_GT(found("SYMPLECTIC_EULER"), 500.0 * theory);  // 1.2 MN/m for 2.0 kN/m
}

// The whole answer of a spring in a device: theory has its boundary, and Euler's steps, as cheap, miss it.
TEST(Chart, OfAnswersHasTheBoundaryOfTheory) {
  const double theory = critical_stiffness({.mass_kg = 0.075, .damping_n_s_per_m = 0.5, .period_s = 5e-4});
  const Chart c = chart({.scene = TWOPORT_SCENES "/held_spring.textproto",
                         .set = {"duration_s=10"},
                         .vary = {"simulation.integrator=EXACT,SYMPLECTIC_EULER", "verdict=plain,tail"},
                         .boundary = "environment[0].spring.stiffness_n_per_m=500:20000",
                         .answer = true,
                         .repetitions = 1,
                         .reference_substeps = 20});
  EXPECT_EQ(c.verdict, "STABLE");
  EXPECT_NEAR(c.boundary.value(), theory, 1e-3 * theory);
  const ChartPoint& exact = named(c, "EXACT, tail verdict");
  EXPECT_NEAR(exact.boundary.value(), theory, 1e-3 * theory);
  EXPECT_EQ(exact.answer->verdict, "STABLE");
  EXPECT_LT(exact.off, 2e-3);
  EXPECT_EQ(exact.off, std::max(exact.answer->felt, exact.answer->beside.value()));
  EXPECT_EQ(c.floor_off, 1e-3);  // as well as a boundary is searched for
  // It is stable up to 20 kN/m and more: no boundary there, so no answer.
  const ChartPoint& euler = named(c, "SYMPLECTIC_EULER, tail verdict");
  EXPECT_GT(euler.answer->felt, 0.1);
  EXPECT_FALSE(euler.counts());
  EXPECT_EQ(cheapest(c.points, 2e-3, c.floor_off)->group, "EXACT");
}

// One step of Euler rattles where the loop comes to rest.
TEST(Chart, OfAnswersNeverPicksAWrongVerdict) {
  const Chart c = chart({.scene = TWOPORT_SCENES "/chart/bilateral.textproto",
                         .set = {},
                         .vary = {"simulation.integrator=SYMPLECTIC_EULER,RK4", "verdict=plain,tail"},
                         .boundary = {},
                         .answer = true,
                         .repetitions = 1,
                         .reference_substeps = 50});
  EXPECT_EQ(c.verdict, "STABLE");
  const ChartPoint &euler = named(c, "SYMPLECTIC_EULER, plain verdict"), &rk4 = named(c, "RK4, plain verdict");
  EXPECT_EQ(euler.answer->verdict, "RESTLESS");
  EXPECT_FALSE(euler.counts());
  EXPECT_NEAR(rk4.off, 4.9e-4, 0.1e-4);
  EXPECT_EQ(cheapest(c.points, 0.1)->name, rk4.name);
  EXPECT_LT(2.0 * rk4.cost, named(c, "RK4, tail verdict").cost);  // all that is run for the verdict counts
  // A share of the force that the hand feels: 1.77 N rms in the trace of run.
  EXPECT_NEAR(rk4.off, rk4.error.felt_rms_n / c.felt_n, 1e-15);
  EXPECT_NEAR(c.felt_n, 1.77, 0.01);
}

// With substeps its error falls as theory says, eigenvalue for eigenvalue.
TEST(Chart, FindsTheStabilityOfEulerSubstepsThatTheoryHas) {
  for (const int substeps : {2, 10}) {
    const double theory =
        critical_stiffness({.mass_kg = 0.075, .damping_n_s_per_m = 0.5, .period_s = 5e-4, .euler_substeps = substeps});
    const double found = find_boundary({.scene = TWOPORT_SCENES "/held_spring.textproto",
                                        .set = {"duration_s=15", "simulation.integrator=SYMPLECTIC_EULER",
                                                "simulation.substeps=" + std::to_string(substeps)},
                                        .vary = {{"environment[0].spring.stiffness_n_per_m"}, 500.0, 2e4}})
                             .stable;
    EXPECT_NEAR(found, theory, 5e-3 * theory) << substeps;
  }
}

// A body alone holds energy, and a contact that meets the wall late makes or loses some.
TEST(Chart, TellsTheEnergyOfABodyAlone) {
  const Chart c = chart({.scene = TWOPORT_SCENES "/chart/impact.textproto",
                         .set = {},
                         .vary = {"simulation.integrator=EXACT,EXACT_PER_TICK"},
                         .boundary = {},
                         .repetitions = 1});
  EXPECT_LT(named(c, "EXACT").error.energy_max_j, 1e-10);
  EXPECT_GT(named(c, "EXACT_PER_TICK").error.energy_max_j, 1e-5);  // of 12.5 mJ
}

TEST(Chart, NamesAPointOfLinkedPathsOnce) {
  const Chart c = chart({.scene = TWOPORT_SCENES "/chart/bilateral.textproto",
                         .set = {"duration_s=0.1"},
                         .vary = {"to_slave.delay_ms,to_master.delay_ms=5,20", "device.mass_kg,robot.mass_kg=0.2"},
                         .boundary = {},
                         .repetitions = 1,
                         .reference_substeps = 2});
  named(c, "5 delay_ms, 0.2 mass_kg");
  named(c, "20 delay_ms, 0.2 mass_kg");
}

TEST(ChartProgram, RecommendsAndRefuses) {
  const std::string wall = TWOPORT_SCENES "/chart/wall.textproto";
  const test::Process p = test::finished({TWOPORT_LAB, "chart", wall, "--repetitions", "1", "--for-error", "1e-8",
                                          "--vary", "simulation.integrator=EXACT,RK4"});
  EXPECT_NE(p.out().find("for 1e-08 m: EXACT"), std::string::npos) << p.out() << p.err();
  test::Process none = test::finished({TWOPORT_LAB, "chart", wall, "--repetitions", "1", "--for-error", "1e-12",
                                       "--vary", "simulation.integrator=RK4"});
  EXPECT_EQ(none.wait(), test::exited(2));
  EXPECT_NE(none.err().find("--for-error"), std::string::npos) << none.err();
  test::Process unknown = test::finished({TWOPORT_LAB, "chart", wall, "--vary", "simulation.integrator=EULER"});
  EXPECT_EQ(unknown.wait(), test::exited(2));
  EXPECT_NE(unknown.err().find("SYMPLECTIC_EULER"), std::string::npos) << unknown.err();
}

TEST(ChartProgram, RecommendsByTheAnswerAndRefuses) {
  const std::string bilateral = TWOPORT_SCENES "/chart/bilateral.textproto", out = test::own_folder() / "answer";
  const std::vector<std::string> words{
      TWOPORT_LAB, "chart", bilateral, "--answer", "--repetitions", "1", "--reference-substeps", "20"};
  const auto run = [&](const std::vector<std::string>& more) {
    std::vector<std::string> all = words;
    all.insert(all.end(), more.begin(), more.end());
    return test::finished(all);
  };
  const test::Process p = run({"--vary", "simulation.integrator=EXACT,SYMPLECTIC_EULER", "--vary", "verdict=plain",
                               "--for-error", "0.01", "--out", out});
  EXPECT_NE(p.out().find("RESTLESS         0.54   wrong"), std::string::npos) << p.out();
  EXPECT_NE(p.out().find("for 0.01: EXACT, plain verdict, "), std::string::npos) << p.out() << p.err();
  const std::string csv = read_whole(out + "/chart.csv");
  EXPECT_NE(csv.find("answer_s,verdict,same_verdict,felt_share,boundary_share,off"), std::string::npos) << csv;
  EXPECT_NE(csv.find(",RESTLESS,0,"), std::string::npos) << csv;
  const std::string wall = "environment[0].wall.stiffness_n_per_m=1:2";
  for (const auto& [options, complaint] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{"--vary", "verdict=quick"}, "--vary verdict=quick: it must be tail, lean or plain"},
           {{"--boundary", "x"}, "--boundary x: it must read PATH=LO:HI"},
           {{"--robot", "sim"}, "--robot sim: does not run in virtual time"},
           {{"--robot", "mujoco:world.xml", "--boundary", wall},
            "--boundary " + wall + ": the world of --robot takes the place of environment"},
           {{"--vary", "simulation.integrator=SYMPLECTIC_EULER", "--for-error", "0.01"},
            "--for-error 0.01: no point"}}) {
    test::Process refused = run(options);
    EXPECT_EQ(refused.wait(), test::exited(2)) << complaint;
    EXPECT_NE(refused.err().find(complaint), std::string::npos) << refused.err();
  }
}

}  // namespace
}  // namespace twoport::lab::chart_test
