#include "lab/peers/peers.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include "common/scene/load.h"

namespace twoport::lab::peers_test {
namespace {

// An engine pushed by our forces is a semi-implicit Euler step, whoever wrote it.
TEST(Peers, PushedByForcesAreOurEulerStep) {
  for (const char* name : {"wall", "impact", "curved_slide"}) {
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
    for (const ChartPoint& p : c.points) {
      if (p.name.find("pushed") == std::string::npos) continue;
      EXPECT_NEAR(p.error.position_rms_m, euler, 1e-4 * euler) << p.name << " on " << name;
      ++pushed;
    }
    EXPECT_GE(pushed, static_cast<int>(peers.size() / 2));
    for (const ChartPoint& p : c.points) EXPECT_LT(p.error.position_rms_m, 0.1 * 0.02) << p.name;
  }
}

// So are its answers. A wall several times as stiff as 4 m/dt^2, 1.6 MN/m, throws the mass away in such steps.
TEST(Peers, AreJudgedAsOurRuns) {
  const std::string file = fmt::format("{}/chart/wall.textproto", TWOPORT_SCENES);
  for (const double stiffness : {5e3, 1e7}) {
    const std::string wall = fmt::format("environment[0].wall.stiffness_n_per_m={}", stiffness);
    const std::vector<Peer> peers = peers_for(load_scene(file, std::vector{wall}));
    if (peers.empty()) GTEST_SKIP() << "no engine is installed";
    const Chart c = chart({.scene = file,
                           .set = {wall},
                           .vary = {"simulation.integrator=SYMPLECTIC_EULER"},
                           .boundary = {},
                           .answer = true,
                           .repetitions = 1},
                          peers);
    EXPECT_EQ(c.verdict, "STABLE");
    const Answer& euler = c.points[0].answer.value();
    EXPECT_EQ(euler.verdict, stiffness < 1.6e6 ? "STABLE" : "UNSTABLE");
    for (const ChartPoint& p : c.points) {
      if (p.name.find("pushed") == std::string::npos) continue;
      EXPECT_EQ(p.answer->verdict, euler.verdict) << p.name << stiffness;
      if (stiffness < 1.6e6) {
        EXPECT_NEAR(p.answer->felt, euler.felt, 1e-4 * euler.felt) << p.name;
      }
      EXPECT_GT(p.cost, c.points[0].cost) << p.name;
    }
  }
}

/// Where each engine with its own contact ends, coordinate `axis`.
template <class Look>
void at_the_end(const char* name, const std::vector<std::string>& set, std::size_t axis, Look look) {
  for (const Peer& peer : peers_for(load_scene(fmt::format("{}/chart/{}.textproto", TWOPORT_SCENES, name), set))) {
    if (peer.name.find("own contact") == std::string::npos) continue;
    SCOPED_TRACE(peer.name);
    const Course c = peer.course();
    look(c.slave_x.at(c.slave_x.size() - 3 + axis));
  }
}

// An engine is not handicapped: its own contact is as stiff as the scene's, one wall or four corners.
TEST(Peers, OwnContactIsAsStiffAsTheScene) {
  at_the_end("wall", {"duration_s=4"}, 0, [](double x) {
    const double depth = 300.0 * 0.02 / (300.0 + 5000.0);
    EXPECT_NEAR(x, depth, 1e-3 * depth);
  });
  at_the_end("box_on_plane", {"duration_s=4", "robot.position_m=[0, 0, 0.05]"}, 2, [](double z) {
    const double spring = 8 * 2.45, depth = spring * 0.55 / (spring + 4 * 20000.0);  // anchored 0.55 m below the centre
    EXPECT_NEAR(0.05 - z, depth, 1e-3 * depth);
  });
}

TEST(Peers, PlayOnlyScenesThatTheyCan) {
  for (const char* name : {"demo", "held_spring", "chart/bilateral"})
    EXPECT_TRUE(peers_for(load_scene(fmt::format("{}/{}.textproto", TWOPORT_SCENES, name))).empty()) << name;
}

}  // namespace
}  // namespace twoport::lab::peers_test
