#include "lab/peers/peers.h"

#include <gtest/gtest.h>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "common/scene/load.h"

namespace twoport::lab {
namespace {

// An engine pushed by our forces is a semi-implicit Euler step, whoever wrote it.
TEST(Peers, PushedByForcesAreOurEulerStep) {
  for (const char* name : {"wall", "impact"}) {
    const std::string file = fmt::format("{}/chart/{}.textproto", TWOPORT_SCENES, name);
    const std::vector<Peer> peers = peers_for(load_scene(file));
    if (peers.empty()) GTEST_SKIP() << "no engine is installed: " << fmt::format("{}", fmt::join(absent_peers(), ", "));
    const Chart c = chart({.scene = file,
                           .set = {},
                           .vary = {"simulation.integrator=EXACT,SYMPLECTIC_EULER"},
                           .boundary = {},
                           .repetitions = 1},
                          peers);
    const double euler = c.points.at(1).error.position_rms_m;
    int pushed = 0;
    for (const Point& p : c.points) {
      if (p.name.find("pushed") == std::string::npos) continue;
      EXPECT_NEAR(p.error.position_rms_m, euler, 1e-4 * euler) << p.name << " on " << name;
      ++pushed;
    }
    EXPECT_EQ(pushed, static_cast<int>(peers.size() / 2));
    for (const Point& p : c.points) EXPECT_LT(p.error.position_rms_m, 0.1 * 0.02) << p.name;
  }
}

TEST(Peers, PlayOnlyScenesThatTheyCan) {
  for (const char* name : {"demo", "held_spring", "chart/curved_slide", "chart/bilateral"})
    EXPECT_TRUE(peers_for(load_scene(fmt::format("{}/{}.textproto", TWOPORT_SCENES, name))).empty()) << name;
}

}  // namespace
}  // namespace twoport::lab
