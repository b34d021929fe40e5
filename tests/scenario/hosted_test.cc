#include "lab/engine/hosted.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <tuple>
#include <variant>
#include <vector>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/scene/load.h"
#include "drivers/drivers.h"
#include "lab/run.h"
#include "lab/study/boundary.h"
#include "lab/study/chart.h"
#include "lab/study/compare.h"
#include "lab/study/map.h"
#include "lab/study/sweep.h"
#include "tests/support/folder.h"

// A world of MuJoCo in the laboratory.
namespace twoport::lab::hosted_test {
namespace {

constexpr double kMass = 0.5, kDamping = 2.0, kStiffness = 2000.0, kWallDamping = 10.0, kFace = 0.02;

/// A mass on three slides before a wall. With the least impedance d = 1e-4 of solimp MuJoCo's contact is a spring with damper, its mass
/// m/(1 - d): m a = (1 - d) f - m s_1 v - m s_0 x, the direct form of solref being (-s_0, -s_1).
std::string world(double stiffness = kStiffness, const std::string& more = {}) {
  const std::string file = test::own_folder() / "hosted.xml";
  write_whole(file, fmt::format(R"(<mujoco><option timestep="0.00005" gravity="0 0 0"/>
<default><geom solref="{} {}" solimp="0.0001 0.0001 0.001 0.5 2" condim="1"/></default>
<worldbody><geom type="box" pos="{} 0 0" size="0.5 1 1"/><body>
<joint type="slide" axis="1 0 0" damping="{}"/><joint type="slide" axis="0 1 0" damping="{}"/><joint type="slide" axis="0 0 1" damping="{}"/>
<geom type="sphere" size="0.01" mass="{}"/><site name="tip"/></body>{}</worldbody></mujoco>)",
                                -stiffness / kMass, -kWallDamping / kMass, kFace + 0.01 + 0.5, kDamping, kDamping,
                                kDamping, kMass, more));
  return file;
}
/// The same by the scene itself.
std::string scene_text(const std::string& method, double delay_ms) {
  return fmt::format(R"(name: "press" dof: 3 duration_s: 3 rate_hz: 1000
operator {{
  hand {{ mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 }}
  path {{ move_to {{ position_m: [0.035, 0.01, 0] duration_s: 0.8 }} }}
  path {{ move_to {{ position_m: [0.035, -0.01, 0] duration_s: 0.8 }} }}
}}
device {{ mass_kg: 0.1 damping_n_s_per_m: 0.2 }}
control {{
  architecture: POSITION_FORCE virtual_coupling {{ stiffness_n_per_m: 1000 damping_n_s_per_m: 20 }}
  passivity {{ method: {} }}
}}
to_slave {{ delay_ms: {} }} to_master {{ delay_ms: {} }}
robot {{ mass_kg: {} damping_n_s_per_m: {} }}
environment {{ wall {{ normal: [-1, 0, 0] offset_m: {} stiffness_n_per_m: {} damping_n_s_per_m: {} }} }})",
                     method, delay_ms, delay_ms, kMass, kDamping, -kFace, kStiffness, kWallDamping);
}
Scene scene(const std::string& method = "INTERNAL_MODEL", double delay_ms = 20.0) {
  return parse_scene(scene_text(method, delay_ms), "press");
}

template <int N>
HostedRobot open(const std::string& file, double period_s = 1e-3) {
  const Scene any{};
  std::unique_ptr<Robot<N>> robot = all_drivers().robots.open<N>("mujoco:" + file, any, Seconds{period_s});
  auto* const of_its_own = dynamic_cast<VirtualRobot<N>*>(robot.release());
  return {"mujoco:" + file, HostedRobot::Of<N>{of_its_own}};
}
std::vector<Row<3>> rows(Simulation<3>& simulation) {
  std::vector<Row<3>> all;
  simulation.run([&](const Row<3>& row) {
    all.push_back(row);
    return true;
  });
  return all;
}

TEST(Hosted, AMassBeforeAWallOfMujocoMovesAsOurOwn) {
  const HostedRobot robot = open<3>(world());
  const std::vector<Row<3>> theirs = rows(*make_simulation<3>(scene(), robot)),
                            own = rows(*make_simulation<3>(scene()));
  ASSERT_EQ(theirs.size(), own.size());
  double x = 0.0, felt = 0.0, pressed = 0.0;
  for (std::size_t k = 0; k < own.size(); ++k) {
    x = std::max(x, (theirs[k].slave_x - own[k].slave_x).vec().norm());
    felt = std::max(felt, (theirs[k].master_f - own[k].master_f).vec().norm());
    pressed = std::max(pressed, own[k].env_f.vec().norm());
  }
  EXPECT_GT(pressed, 3.0);
  EXPECT_LT(x, 5e-5);
  EXPECT_LT(felt, 0.02 * pressed);
  EXPECT_NEAR(theirs.back().env_f.vec().x(), own.back().env_f.vec().x(), 0.02);
  EXPECT_LT((theirs.back().slave_x - own.back().slave_x).vec().norm(), 1e-5);
  // At rest, by the closed form: as deep as force over stiffness.
  EXPECT_NEAR(theirs.back().slave_x.translation().x() - kFace, -theirs.back().env_f.vec().x() / kStiffness, 1e-6);
}

TEST(Hosted, RunsAndCopiesAreTheSameToTheBit) {
  const HostedRobot robot = open<3>(world());
  const auto once = make_simulation<3>(scene(), robot), again = make_simulation<3>(scene(), robot);
  const auto nothing = [](const Row<3>&) { return true; };
  once->run_until(to_duration(1.3), nothing);  // in contact
  const auto copy = once->copy();
  const std::vector<Row<3>> rest = rows(*once), whole = rows(*again), of_copy = rows(*copy);
  ASSERT_EQ(rest.size(), of_copy.size());
  for (std::size_t k = 0; k < rest.size(); ++k) {
    const Row<3>& other = whole[whole.size() - rest.size() + k];
    for (const Row<3>* row : {&of_copy[k], &other}) {
      ASSERT_EQ(rest[k].slave_x.translation(), row->slave_x.translation()) << k;
      ASSERT_EQ(rest[k].env_f.vec(), row->env_f.vec()) << k;
      ASSERT_EQ(rest[k].master_f.vec(), row->master_f.vec()) << k;
    }
  }
}

TEST(Hosted, AKickMovesTheToolByItAndNothingElse) {
  const auto robot = open<3>(world());
  const auto one = std::get<HostedRobot::Of<3>>(robot.robot)->copy(),
             other = std::get<HostedRobot::Of<3>>(robot.robot)->copy();
  const Eigen::Vector3d dv{1e-3, -2e-3, 5e-4};
  for (auto* each : {&*one, &*other}) {
    each->sense({Instant<SlaveClock>{}, Seconds{1e-3}});
    each->start();
  }
  one->kick(Velocity<3>{dv});
  const Tick<SlaveClock> next{Instant<SlaveClock>{std::chrono::milliseconds{1}}, Seconds{1e-3}};
  const Eigen::Vector3d moved = (one->sense(next).v - other->sense(next).v).vec();
  EXPECT_LT((moved - std::exp(-kDamping / kMass * 1e-3) * dv).norm(), 1e-6 * dv.norm());
}

TEST(Hosted, HasTheVerdictsOfOurOwnPlant) {
  const HostedRobot robot = open<3>(world());
  for (const auto& [method, delay_ms, kind] : {std::tuple{"INTERNAL_MODEL", 20.0, "STABLE"},
                                               {"INTERNAL_MODEL", 150.0, "STABLE"},
                                               {"NONE", 100.0, "UNSTABLE"}}) {
    const Scene of_method = scene(method, delay_ms);
    EXPECT_EQ(run(of_method).verdict_kind(), kind) << method << delay_ms;
    const Summary s = run(of_method, {.robot = &robot});
    EXPECT_EQ(s.verdict_kind(), kind) << method << delay_ms << ": " << s.verdict();
  }
}

// MuJoCo's weight of a body with one slide joint is that of three, so its solref is a third.
TEST(Hosted, TheExampleOfAWallIsThatOfItsScene) {
  const Scene of_file = load_scene(TWOPORT_SOURCE "/scenes/chart/bilateral.textproto");
  const HostedRobot robot = open<1>(TWOPORT_SOURCE "/docs/examples/mujoco/wall.xml", 1.0 / of_file.slave_rate_hz);
  Row<1> last;
  make_simulation<1>(of_file, robot)->run([&](const Row<1>& row) {
    last = row;
    return true;
  });
  EXPECT_LT(last.env_f.vec()[0], -1.0);
  EXPECT_NEAR(last.slave_x.translation()[0] - 0.02, -last.env_f.vec()[0] / 5000.0, 1e-7);
}

// MuJoCo as the slave's world, by the whole answer: within the two per cent of its steps, and far more than that with another wall.
TEST(Hosted, HasAPlaceInTheChartOfAnswers) {
  const std::string file = test::own_folder() / "press.textproto";
  write_whole(file, scene_text("INTERNAL_MODEL", 20.0));
  std::vector<Peer> worlds;
  for (const double stiffness : {kStiffness, 0.5 * kStiffness})
    worlds.push_back(
        {.name = fmt::format("{} N/m", stiffness), .robot = std::make_shared<HostedRobot>(open<3>(world(stiffness)))});
  const Chart c = chart({.scene = file,
                         .set = {},
                         .vary = {"simulation.integrator=EXACT", "verdict=plain"},
                         .boundary = {},
                         .answer = true,
                         .repetitions = 1,
                         .reference_substeps = 20},
                        worlds);
  ASSERT_EQ(c.points.size(), 3u);
  for (const ChartPoint& p : c.points) EXPECT_EQ(p.answer->verdict, "STABLE") << p.name;
  const ChartPoint &own = c.points[0], &same = c.points[1], &softer = c.points[2];
  EXPECT_EQ(same.name, "2000 N/m, plain verdict");
  EXPECT_TRUE(same.peer);
  EXPECT_LT(same.off, 0.02);
  EXPECT_GT(same.off, 100.0 * own.off);
  EXPECT_GT(softer.off, 3.0 * same.off);
}

// Its boundary is that of the world: of our own plant with the damping that the world has.
TEST(Hosted, HasTheBoundaryOfItsWorldInTheChartOfAnswers) {
  const std::string file = test::own_folder() / "press.textproto", damping = "robot.damping_n_s_per_m=20";
  write_whole(file, scene_text("NONE", 1.0));
  std::string xml = read_whole(world());
  for (std::size_t at; (at = xml.find("damping=\"2\"")) != std::string::npos;) xml.replace(at, 11, "damping=\"20\"");
  write_whole(test::own_folder() / "damped.xml", xml);
  const std::string boundary = "control.virtual_coupling.stiffness_n_per_m=50:20000";
  const Chart c =
      chart({.scene = file,
             .set = {"duration_s=2.5"},
             .vary = {"simulation.integrator=EXACT", "verdict=plain"},
             .boundary = boundary,
             .answer = true,
             .repetitions = 1,
             .reference_substeps = 2},
            {{.name = "damped", .robot = std::make_shared<HostedRobot>(open<3>(test::own_folder() / "damped.xml"))}});
  const double own = find_boundary({.scene = file,
                                    .set = {"duration_s=2.5", damping},
                                    .vary = parse_interval(boundary),
                                    .verdict = VerdictFrom::plain})
                         .stable;
  ASSERT_EQ(c.points.size(), 2u);
  EXPECT_NEAR(c.points[1].boundary.value(), own, 0.01 * own);
  EXPECT_GT(std::abs(c.points[0].boundary.value() - own), 0.05 * own);
}

TEST(Hosted, AWorldThatIsLostHasDiverged) {
  // A joint that gives energy throws the tool away.
  std::string xml = read_whole(world());
  xml.insert(xml.find(" axis=\"1 0 0\""), " stiffness='-1e9'");
  write_whole(test::own_folder() / "lost.xml", xml);
  const HostedRobot robot = open<3>(test::own_folder() / "lost.xml");
  const Summary s = run(scene(), {.robot = &robot});
  EXPECT_EQ(s.verdict_kind(), "UNSTABLE") << s.verdict();
}

TEST(Hosted, SweepsOverDelayTheSameWithAnyNumberOfJobsAndKnowsAnotherWorld) {
  const HostedRobot robot = open<3>(world());
  const std::string file = test::own_folder() / "press.textproto", out = test::own_folder() / "hosted_sweep";
  write_whole(file, scene_text("INTERNAL_MODEL", 20.0));
  SweepOptions o;
  o.scene = file;
  o.axes = {parse_axis("to_slave.delay_ms,to_master.delay_ms=0,50,150")};
  o.robot = &robot;
  o.verdict = VerdictFrom::lean;
  const std::string alone = to_csv(sweep(o));
  o.jobs = 2;
  o.out = out;
  EXPECT_EQ(to_csv(sweep(o)), alone);
  EXPECT_EQ(std::count(alone.begin(), alone.end(), '\n'), 4);
  EXPECT_EQ(sweep(o).use.alone.size(), 0U) << "kept";
  const HostedRobot stiffer = open<3>(world(2.0 * kStiffness));
  o.robot = &stiffer;
  EXPECT_THROW(sweep(o), ConfigError);
}

TEST(Hosted, MapsMethodsOverRoundTrips) {
  const HostedRobot robot = open<3>(world());
  const std::string file = test::own_folder() / "press.textproto";
  write_whole(file, scene_text("INTERNAL_MODEL", 20.0));
  MapOptions o;
  o.scene = file;
  o.methods = {"NONE", "INTERNAL_MODEL"};
  o.round_trips_ms = {200};
  o.losses = {0.0};
  o.seeds = 1;
  o.robot = &robot;
  EXPECT_THROW(make_map(o), ConfigError) << "its stiffness is its own";
  o.stiffnesses_n_per_m = {0.0};
  const Map map = make_map(o);
  EXPECT_FALSE(map.cells[0].holds());
  EXPECT_TRUE(map.cells[1].holds());
}

/// What compare and matrix say of a world is what a run of it says; without it they run the scene's own plant.
TEST(Hosted, IsComparedAndPairedAsItRuns) {
  const HostedRobot robot = open<3>(world(2.0 * kStiffness));
  const std::string file = test::own_folder() / "press.textproto";
  write_whole(file, scene_text("INTERNAL_MODEL", 20.0));
  const double initial_energy_j = load_scene(file).control.initial_energy.si();
  const auto pressed_n = [&](const std::vector<std::string>& set, const HostedRobot* in) {
    std::vector<std::string> all = set;
    all.push_back(fmt::format("control.passivity.initial_energy_j={}", initial_energy_j));
    return run(load_scene(file, all), {.robot = in}).environment_force_mean_n();
  };
  const std::string method = "control.passivity.method=INTERNAL_MODEL";
  CompareOptions c{.scene = file, .set = {}, .methods = {"INTERNAL_MODEL"}, .robot = &robot, .jobs = 1, .out = {}};
  const Comparison comparison = compare(c);
  EXPECT_EQ(comparison.summaries[0].environment_force_mean_n(), pressed_n({method}, &robot));
  EXPECT_NE(comparison.summaries[0].environment_force_mean_n(), pressed_n({method}, nullptr));
  EXPECT_TRUE(comparison.standings[0].holds());
  const MatrixOptions m{.scene = file,
                        .set = {},
                        .transparencies = {"DELAYED_FORCE"},
                        .passivities = {"ENERGY_SPRING"},
                        .robot = &robot,
                        .jobs = 1,
                        .lanes = 0};
  EXPECT_EQ(matrix(m).at(0, 0).summary.environment_force_mean_n(),
            pressed_n({"control.transparency.layer=DELAYED_FORCE", "control.passivity.layer=ENERGY_SPRING"}, &robot));
}

TEST(Hosted, RefusesScenesInWords) {
  const HostedRobot robot = open<3>(world());
  const auto why_not = [&](const std::string& text) -> std::string {
    try {
      run(parse_scene("name: 'it' duration_s: 1 rate_hz: 1000 device { mass_kg: 1 } " + text, "it"), {.robot = &robot});
    } catch (const ConfigError& e) {
      return e.what();
    }
    return "ran";
  };
  const auto expect = [&](const std::string& text, const std::string& words) {
    const std::string error = why_not(text);
    EXPECT_NE(error.find(words), std::string::npos) << error;
    EXPECT_EQ(error.find("--robot mujoco:"), 0U) << error;
  };
  const std::string link = "control { architecture: POSITION_FORCE virtual_coupling { stiffness_n_per_m: 1000 } } ";
  expect("dof: 3 control { architecture: RENDER }", "control.architecture has no link to a robot");
  expect("dof: 1 robot { mass_kg: 1 } " + link, "was opened for another dof; the scene has 1");
  expect(
      "dof: 3 robot { mass_kg: 1 } gripper { object { width_m: 0.04 stiffness_n_per_m: 2000 } virtual_coupling { "
      "stiffness_n_per_m: 1000 } } " +
          link,
      "the scene has a gripper");
}

}  // namespace
}  // namespace twoport::lab::hosted_test
