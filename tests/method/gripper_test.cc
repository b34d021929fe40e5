#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "common/base/file.h"
#include "common/record/summary.h"
#include "common/scene/load.h"
#include "lab/engine/simulation.h"
#include "lab/lanes/lanes.h"
#include "lab/run.h"
#include "lab/study/sweep.h"

// A gripper beside the arm, in virtual time.
namespace twoport::gripper_test {
namespace {

const std::string kScene = TWOPORT_SCENES "/gripper_50ms.textproto";

Scene scene_with(const std::vector<std::string>& set = {}) {
  return load_scene(kScene, set);
}
Scene without_gripper(Scene scene) {
  scene.gripper = nullptr;
  return scene;
}
std::string figures(Summary s) {
  s.clear_gripper();
  s.set_step_ns(0.0);  // wall time
  return s.SerializeAsString();
}

TEST(Gripper, LeavesTheArmAsItIsToTheBit) {
  for (const char* method : {"INTERNAL_MODEL", "FORCE_PROJECTED"}) {
    const Scene scene = scene_with({std::string{"control.passivity.method="} + method});
    const lab::RunOptions plain{.verdict = lab::VerdictFrom::plain};
    const Summary with = lab::run(scene, plain), without = lab::run(without_gripper(scene), plain);
    EXPECT_TRUE(with.has_gripper());
    EXPECT_FALSE(without.has_gripper());
    EXPECT_EQ(figures(with), figures(without)) << method;
  }
}

/// Both couplings travel in one packet: the fate of packet k is that of both.
TEST(Gripper, HearsThePacketsThatTheArmHears) {
  const Scene scene = scene_with();
  std::vector<bool> arm, gripper;
  const auto simulated_arm = lab::make_simulation<3>(scene);
  simulated_arm->run([](const Row<3>&) { return true; });
  const auto simulated_gripper = lab::make_simulation<1>(*scene.gripper);
  simulated_gripper->run([](const Row<1>&) { return true; });
  const lab::LinkUse a = *simulated_arm->link(), g = *simulated_gripper->link();
  EXPECT_GT(a.master.lost, 100U);
  EXPECT_EQ(a.master.lost, g.master.lost);
  EXPECT_EQ(a.slave.lost, g.slave.lost);
  EXPECT_EQ(a.master.received, g.master.received);
  EXPECT_EQ(a.slave.received, g.slave.received);
}

/// The port's energy with its E(0) stays above -1 µJ, whatever packets are lost.
TEST(Gripper, IsPassiveAtItsOwnPort) {
  for (int seed = 1; seed <= 5; ++seed) {
    const Summary s = lab::run(scene_with({"seed=" + std::to_string(seed)}), {.verdict = lab::VerdictFrom::plain});
    EXPECT_GE(s.gripper().min_port_energy_j(), -1e-6) << seed;
    EXPECT_EQ(s.gripper().initial_energy_j(), 2e-3);
    EXPECT_NE(s.gripper().verdict_kind(), "UNSTABLE");
  }
}

/// Fingers around an object begin where they are, and close with the handle from there. The handle is 19 mm wider open.
TEST(Gripper, BeginsAtItsOwnOpening) {
  for (const std::string mode : {"OFFSET", "ABSOLUTE"}) {
    const Scene scene = scene_with({"gripper.robot.position_m=[0.041]", "control.registration.mode=" + mode});
    double widest_m = 0.0, pressed_n = 0.0;
    lab::make_simulation<1>(*scene.gripper)->run([&](const Row<1>& row) {
      if (row.t_s < 1.0) widest_m = std::max(widest_m, row.slave_x.translation()[0]);
      pressed_n = row.env_f[0];
      return row.t_s < 3.0;
    });
    EXPECT_NEAR(widest_m, mode == "OFFSET" ? 0.041 : 0.06, 1e-3) << mode;
    EXPECT_GT(pressed_n, 0.5) << mode;
  }
}

/// At rest the force is that of three springs in series, hand, coupling and object, over the way that they share:
///
///     F = (width - intended opening) / (1/400 + 1/1000 + 1/2000)
///
/// and the object has stored F²/(2 k). Without loss nothing else is left at rest. 1 %: the hand still creeps.
TEST(Gripper, SqueezesAnObjectAsThreeSpringsInSeries) {
  const Scene scene = scene_with({"to_slave.loss=0", "to_master.loss=0"});
  const double width = 0.04, k = 2000.0, expected_n = (width - 0.03) / (1.0 / 400.0 + 1.0 / 1000.0 + 1.0 / k);
  Row<1> at_rest, before;
  double stored_j = 0.0;
  lab::make_simulation<1>(*scene.gripper)->run([&](const Row<1>& row) {
    stored_j +=
        0.5 * (row.env_f[0] + before.env_f[0]) * (before.slave_x.translation()[0] - row.slave_x.translation()[0]);
    before = at_rest = row;
    return row.t_s < 5.9;
  });
  EXPECT_NEAR(at_rest.env_f[0], expected_n, 0.01 * expected_n);
  EXPECT_NEAR(at_rest.env_f[0], k * (width - at_rest.slave_x.translation()[0]), 1e-9);
  EXPECT_NEAR(-at_rest.slave_f[0], at_rest.env_f[0], 0.01 * expected_n);
  EXPECT_NEAR(-at_rest.master_f[0], at_rest.env_f[0], 0.01 * expected_n);
  const double squeezed_m = width - at_rest.slave_x.translation()[0];
  EXPECT_NEAR(stored_j, 0.5 * k * squeezed_m * squeezed_m, 0.01 * stored_j);
}

/// Without control, over 5 ms each way: 4 kN/m between handle and fingers is too much, while the arm's 100 N/m are not.
TEST(Gripper, IsPartOfWhatASweepCallsStable) {
  lab::SweepOptions o;
  o.scene = kScene;
  o.set = {"duration_s=3", "control.passivity.method=NONE", "control.virtual_coupling.stiffness_n_per_m=100",
           "to_slave.delay_ms=5", "to_master.delay_ms=5"};
  o.axes = {lab::parse_axis("gripper.virtual_coupling.stiffness_n_per_m=1000,4000")};
  const lab::Table table = lab::sweep(o);
  const auto at = [&](std::size_t row, const char* name) {
    const auto found = std::find(table.columns.begin(), table.columns.end(), name);
    return table.rows[row][static_cast<std::size_t>(found - table.columns.begin())].text();
  };
  EXPECT_EQ(at(0, "stable"), "1");
  EXPECT_EQ(at(0, "gripper.stable"), "1");
  EXPECT_EQ(at(1, "stable"), "0");
  EXPECT_EQ(at(1, "gripper.stable"), "0");
  EXPECT_EQ(at(1, "verdict").find("gripper: "), 0U) << at(1, "verdict");
}

TEST(Gripper, IsNamedAsWhyThereAreNoLanes) {
  EXPECT_EQ(lab::why_not_in_lanes(scene_with()), "lanes do not take gripper");
}

TEST(Gripper, IsLimitedByItself) {
  const Summary s = lab::run(scene_with({"gripper.device_limits.force_n=1"}), {.verdict = lab::VerdictFrom::plain});
  EXPECT_LE(s.gripper().max_force_n(), 1.0);
  EXPECT_GT(s.max_force_n(), 1.5);
}

}  // namespace
}  // namespace twoport::gripper_test
