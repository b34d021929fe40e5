#include "lab/study/trim.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/record/summary.h"
#include "common/scene/load.h"
#include "lab/run.h"
#include "tests/support/process.h"

namespace twoport::lab::trim_test {
namespace {

using Words = std::vector<std::string>;

std::string file(const std::string& name) {
  return std::string{TWOPORT_SCENES} + "/" + name + ".textproto";
}
/// A sensor whose force nobody uses is noisy, and there is a wall that nothing reaches.
const Words kNoise = {"robot.force_sensor.noise_n=0.1"};
const Words kFarWall = {"environment[1].wall.normal=[1]", "environment[1].wall.offset_m=-1",
                        "environment[1].wall.stiffness_n_per_m=2000"};
Words plus(Words all, const Words& more) {
  all.insert(all.end(), more.begin(), more.end());
  return all;
}

Words names(const Scene& scene) {
  Words all;
  for (const Block& block : blocks(scene)) all.push_back(block.path);
  return all;
}
Scene less(const Scene& scene, const Words& paths) {
  std::vector<Block> left_out;
  for (const Block& block : blocks(scene))
    if (std::find(paths.begin(), paths.end(), block.path) != paths.end()) left_out.push_back(block);
  EXPECT_EQ(left_out.size(), paths.size());
  return without(scene, left_out);
}
const Judged& judged(const Trim& t, const std::string& path) {
  const auto found = std::find_if(t.blocks.begin(), t.blocks.end(), [&](const Judged& j) { return j.path == path; });
  if (found == t.blocks.end()) throw ConfigError{"no block " + path};
  return *found;
}
double largest_change(const Scene& a, const Scene& b) {
  const auto before = numbers(run(a)), after = numbers(run(b));
  double most = 0.0;
  for (std::size_t i = 0; i < before.size(); ++i)
    if (before[i].first != "step_ns")
      most = std::max(most, relative_change(before[i].first, before[i].second, after[i].second));
  return most;
}

TEST(RelativeChange, IsOnTheScaleOfTheNumberAndNotBelowTheFloorOfItsUnit) {
  EXPECT_DOUBLE_EQ(relative_change("max_force_n", 4.0, 3.0), 0.25);
  EXPECT_DOUBLE_EQ(relative_change("max_force_n", 3.0, 4.0), 0.25);
  EXPECT_DOUBLE_EQ(relative_change("min_port_energy_j", 1e-6, -1e-6), 2.0);
  EXPECT_DOUBLE_EQ(relative_change("drift_m", 1e-9, 0.0), 1e-3);
  EXPECT_DOUBLE_EQ(relative_change("energy_owed_j", 1e-9, 0.0), 1e-3);
  EXPECT_DOUBLE_EQ(relative_change("max_force_n", 1e-6, 0.0), 1e-3);
  EXPECT_DOUBLE_EQ(relative_change("force_direction_error_max_deg", 1e-5, 0.0), 1e-3);
  EXPECT_DOUBLE_EQ(relative_change("contact_s", 1e-6, 0.0), 1e-3);
  EXPECT_DOUBLE_EQ(relative_change("packets.to_slave.lost", 0.0, 3.0), 1.0);
  const double inf = std::numeric_limits<double>::infinity(), nan = std::nan("");
  EXPECT_EQ(relative_change("drift_m", nan, nan), 0.0);
  EXPECT_EQ(relative_change("drift_m", inf, inf), 0.0);
  EXPECT_EQ(relative_change("drift_m", nan, 1.0), 1.0);
}

TEST(Blocks, AreWhatTheSceneModelsInTheOrderOfTheDataFlow) {
  EXPECT_EQ(names(load_scene(file("one_axis_wall"), plus(kNoise, kFarWall))),
            (Words{"operator.hand", "operator.hand.mass_kg", "operator.hand.stiffness_n_per_m",
                   "operator.hand.damping_n_s_per_m", "device.mass_kg", "device.damping_n_s_per_m",
                   "device.max_force_n", "to_slave.delay_ms", "to_master.delay_ms", "robot", "robot.damping_n_s_per_m",
                   "robot.force_sensor.noise_n", "environment[0].wall", "environment[1].wall"}));
  // Nobody holds the handle: its mass stays.
  EXPECT_EQ(names(load_scene(file("held_spring"))),
            (Words{"device.damping_n_s_per_m", "device.velocity_estimate", "environment[0].spring"}));
  // Where nobody controls, the robot is all there is, and a summary is silent about it.
  const Scene alone = parse_scene(
      "dof: 1 duration_s: 1 control { architecture: UNCONTROLLED } robot { mass_kg: 1 damping_n_s_per_m: 1 }", "alone");
  EXPECT_EQ(names(alone), Words{"robot.damping_n_s_per_m"});
  EXPECT_THROW(static_cast<void>(trim(alone, 1e-3, 1)), ConfigError);
}

TEST(Blocks, LeftOutGiveTheSceneThatNeverHadThem) {
  const Scene plain = load_scene(file("one_axis_wall"));
  const Scene more = load_scene(file("one_axis_wall"), plus(kNoise, kFarWall));
  EXPECT_EQ(largest_change(less(more, {"robot.force_sensor.noise_n", "environment[1].wall"}), plain), 0.0);
  EXPECT_GT(largest_change(more, plain), 0.0) << "two walls are integrated in another way than one";

  const Scene light = load_scene(file("one_axis_wall"), Words{"device.mass_kg=0", "to_slave.delay_ms=0"});
  const Scene cut = less(plain, {"device.mass_kg", "to_slave.delay_ms"});
  EXPECT_EQ(cut.control.handle_mass_kg, light.control.handle_mass_kg) << "what the controller knows of the handle";
  EXPECT_EQ(largest_change(cut, light), 0.0);

  const Scene limited = load_scene(file("one_axis_wall"), Words{"device.max_force_n=0.5"});
  EXPECT_GT(largest_change(limited, plain), 0.1);
  EXPECT_EQ(largest_change(less(limited, {"device.max_force_n"}), plain), 0.0);
}

// Every kind of block at once: all can go, and coming back one by one they always leave a scene that runs.
TEST(Blocks, OfEverySceneCanBeAddedOneByOne) {
  for (const auto& entry : std::filesystem::recursive_directory_iterator(TWOPORT_SCENES)) {
    if (entry.path().extension() != ".textproto") continue;
    Scene scene = load_scene(entry.path().string());
    scene.duration_s = std::min(scene.duration_s, 0.02);
    const std::vector<BlockCost> costs = block_costs(scene, 1);
    std::string added, all;
    for (const BlockCost& cost : costs) added += cost.path;
    for (const std::string& name : names(scene)) {
      // A hand waits for its mass, unless an arm is the handle.
      const bool by_arm = scene.device && scene.device->arm;
      const bool gives_mass = !by_arm && (name == "operator.hand.mass_kg" || name == "operator.hand.inertia_kg_m2");
      all += (gives_mass ? ", " : "+ ") + name;
    }
    EXPECT_EQ(added, "bare scene" + all) << entry.path();
    EXPECT_EQ(costs.front().ratio, 1.0);
    for (const BlockCost& cost : costs) {
      EXPECT_GT(cost.tick_ns, 0.0) << entry.path() << " " << cost.path;
      EXPECT_GT(cost.ratio, 0.0) << entry.path() << " " << cost.path;
    }
  }
}

TEST(Trim, KeepsWhatMattersAndNamesWhatDoesNot) {
  const Scene scene = load_scene(file("one_axis_wall"), plus(kNoise, kFarWall));
  const Trim t = trim(scene, 1e-3, 1);
  const Words spare = {"device.max_force_n", "robot.force_sensor.noise_n", "environment[1].wall"};
  for (const Judged& block : t.blocks) {
    const bool proposed = std::find(spare.begin(), spare.end(), block.path) != spare.end();
    EXPECT_EQ(block.need, proposed ? Need::spare : Need::needed) << block.path;
    EXPECT_EQ(block.most.change < 1e-3, proposed) << block.path;
  }
  EXPECT_LT(t.scatter.change, 1e-3) << "nothing that is felt is drawn";
  EXPECT_EQ(t.spare.path, "device.max_force_n, robot.force_sensor.noise_n, environment[1].wall");
  EXPECT_EQ(t.spare.need, Need::spare);
  EXPECT_LT(largest_change(scene, less(scene, spare)), 1e-3);
  EXPECT_GT(t.spare.saved, 0.1) << "two walls cost more than one";
}

TEST(Trim, SaysSoWhereThereIsNothingToLeaveOut) {
  const Trim t = trim(load_scene(file("render_wall_none")), 1e-3, 1);
  for (const Judged& block : t.blocks) EXPECT_EQ(block.need, Need::needed) << block.path;
  EXPECT_EQ(t.spare.path, "");
  EXPECT_NE(to_text(t, 1e-3).find("nothing could be left out at a tolerance of 0.001\n"), std::string::npos);
}

TEST(Trim, KeepsWhatTurnsAVerdictOrAPromiseHoweverWideTheTolerance) {
  const Judged damping = judged(trim(load_scene(file("held_spring")), 0.99, 1), "device.damping_n_s_per_m");
  EXPECT_EQ(damping.need, Need::needed);
  EXPECT_EQ(damping.most.key, "stable");

  Scene scene = load_scene(file("one_axis_wall"));
  const std::string path = "device.damping_n_s_per_m";
  EXPECT_EQ(judged(trim(scene, 0.5, 1), path).need, Need::spare);
  const double with = run(scene).position_error_rms_m(), less_damped = run(less(scene, {path})).position_error_rms_m();
  ASSERT_NE(with, less_damped);
  scene.expect.at_most.push_back({"position_error_rms_m", 0.5 * (with + less_damped)});
  const Judged promised = judged(trim(scene, 0.5, 1), path);
  EXPECT_EQ(promised.need, Need::needed);
  EXPECT_EQ(promised.most.key, "position_error_rms_m");
}

// Two dampers of the handle, each just below the tolerance: one of them may go, not both.
TEST(Trim, ProposesOnlyWhatCanGoTogether) {
  const Scene scene =
      load_scene(file("free_motion"), Words{"operator.hand.damping_n_s_per_m=1", "device.damping_n_s_per_m=1"});
  const Words both = {"operator.hand.damping_n_s_per_m", "device.damping_n_s_per_m"};
  const double hand = largest_change(scene, less(scene, {both[0]}));
  const double device = largest_change(scene, less(scene, {both[1]}));
  const double tolerance = 1.01 * std::max(hand, device);
  ASSERT_LT(tolerance, largest_change(scene, less(scene, both)));
  const Trim t = trim(scene, tolerance, 1);
  const Judged first = judged(t, both[0]), second = judged(t, both[1]);
  EXPECT_EQ(first.need, hand <= device ? Need::spare : Need::together);
  EXPECT_EQ(second.need, hand <= device ? Need::together : Need::spare);
  EXPECT_EQ(t.spare.need, Need::spare);
  EXPECT_LT(t.spare.most.change, tolerance);
}

// Packets that are doubled once in a thousand years change what is drawn after them, and by that every number.
// A nanosecond of jitter puts every other packet a tick later, and a chaotic loop elsewhere.
TEST(Trim, TellsAChangeFromTheScatterOfSeeds) {
  Scene scene = load_scene(file("demo"), Words{"to_slave.jitter_ms=1e-6"});
  const Trim t = trim(scene, 1e-3, 1);
  const Judged never = judged(t, "to_slave.jitter_ms");
  EXPECT_EQ(never.need, Need::in_scatter);
  EXPECT_GT(never.most.change, 1e-3);
  EXPECT_GT(t.scatter.change, 1e-3);
  EXPECT_EQ(judged(t, "to_slave.loss").need, Need::needed);
  EXPECT_EQ(judged(t, "environment[0].wall").need, Need::needed);
  EXPECT_EQ(t.spare.path.find("to_slave.jitter_ms"), std::string::npos) << "not proposed";
  EXPECT_NE(t.loose.path.find("to_slave.jitter_ms"), std::string::npos);

  // A promise that one of the runs breaks counts, scatter or not.
  scene.expect.at_most.push_back({never.most.key, 0.5 * (never.most.with + never.most.without)});
  EXPECT_EQ(judged(trim(scene, 1e-3, 1), "to_slave.jitter_ms").need, Need::needed);
}

// Without a mass of its own the handle follows every switch of the controller: rounding alone moves the numbers.
TEST(Trim, TellsAChangeFromRoundingThatGrew) {
  const Trim t =
      trim(load_scene(file("one_axis_wall"),
                      Words{"control.passivity.method=CLASSIC", "device.mass_kg=0.01", "to_slave.delay_ms=0",
                            "environment[1]={ wall { normal: [-1] offset_m: -10 stiffness_n_per_m: 5000 } }"}),
           1e-3, 1);
  const Judged far_wall = judged(t, "environment[1].wall");
  EXPECT_GT(far_wall.most.change, 1e-3);
  EXPECT_NE(far_wall.need, Need::spare);  // within the scatter, or a verdict turns by rounding
  EXPECT_EQ(judged(t, "operator.hand.stiffness_n_per_m").need, Need::needed);
}

test::Process lab(Words arguments) {
  arguments.insert(arguments.begin(), TWOPORT_LAB);
  return test::finished(arguments);
}

TEST(TrimProgram, RefusesATolerance) {
  for (const std::string tolerance : {"0", "1", "-0.1", "nan", "much"}) {
    test::Process p = lab({"trim", file("z_width"), "--tolerance", tolerance});
    EXPECT_EQ(p.wait(), test::exited(2)) << tolerance;
    EXPECT_NE(p.err().find("--tolerance"), std::string::npos) << p.err();
    EXPECT_EQ(p.out(), "");
  }
  EXPECT_EQ(lab({"blocks", file("z_width"), "--repetitions", "0"}).wait(), test::exited(2));
}

TEST(TrimProgram, WritesTablesAndTheChart) {
  const test::Folder folder;
  const std::string out = folder / "new";
  test::Process trims = lab({"trim", file("z_width"), "--repetitions", "1", "--out", out});
  EXPECT_EQ(trims.wait(), test::exited(0)) << trims.err();
  EXPECT_NE(trims.out().find("could be left out together: device.velocity_estimate\n"), std::string::npos)
      << trims.out();
  EXPECT_NE(test::read_text(out + "/trim.csv").find("device.velocity_estimate,could be left out,nothing,0,0,0,"),
            std::string::npos);
  test::Process adds = lab({"blocks", file("z_width"), "--repetitions", "1", "--out", out});
  EXPECT_EQ(adds.wait(), test::exited(0)) << adds.err();
  EXPECT_EQ(test::count(test::read_text(out + "/blocks.csv"), "\n") + 1, test::count(adds.out(), "\n"));
  EXPECT_TRUE(adds.out().find("/blocks.png, ") == std::string::npos || std::filesystem::exists(out + "/blocks.svg"));
}

}  // namespace
}  // namespace twoport::lab::trim_test
