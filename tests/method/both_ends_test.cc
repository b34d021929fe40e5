// Observers and controllers at both ends: the accounts that exchange energy, and what they keep and let through in scenes.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <random>
#include <string>
#include <vector>

#include "common/method/passivity/energy_exchange/account.h"
#include "common/method/passivity/tick_reach.h"
#include "common/scene/load.h"
#include "lab/run.h"

namespace twoport::both_ends_test {
namespace {

/// Two accounts over a network that delays, loses, repeats and reorders what they tell.
class Exchange {
 public:
  explicit Exchange(unsigned seed) : random_{seed} {}

  ExchangeAccount left{Energy{2e-3}}, right{Energy{1e-3}};

  /// A tick: each hears some of what has been told, and tells. `honest`: nothing is lost or late.
  void tick(bool honest = false) {
    deliver(to_left_, left, left_knows_, honest);
    deliver(to_right_, right, right_knows_, honest);
    left.share();
    right.share();
    to_right_.push_back({left.sent(), left.net(), ++told_});
    to_left_.push_back({right.sent(), right.net(), told_});
  }
  double draw(double from, double to) { return std::uniform_real_distribution<>{from, to}(random_); }
  /// What both ports have put in, less what the accounts show and what is on its way [J]: never above 0 if no energy is made.
  [[nodiscard]] double levels() const { return (left.level() + right.level()).si(); }

 private:
  struct Told {
    Energy sent, net;
    int number = 0;
  };
  struct Known {
    Energy sent, net;
    int number = 0;
  };
  void deliver(std::deque<Told>& way, ExchangeAccount& to, Known& knows, bool honest) {
    while (!way.empty() && (honest || draw(0.0, 1.0) < 0.4)) {
      const std::size_t which =
          honest ? 0 : static_cast<std::size_t>(draw(0.0, static_cast<double>(way.size()) - 1e-9));
      const Told told = way[which];
      if (honest || draw(0.0, 1.0) > 0.1) way.erase(way.begin() + static_cast<std::ptrdiff_t>(which));
      if (!honest && draw(0.0, 1.0) < 0.3) continue;
      knows.sent = std::max(knows.sent, told.sent);
      if (told.number > knows.number) knows.number = told.number, knows.net = told.net;
    }
    to.hear(knows.sent, knows.net);
  }

  std::mt19937 random_;
  std::deque<Told> to_left_, to_right_;
  Known left_knows_, right_knows_;
  int told_ = 0;
};

// Ports that give at most the level of their account: together they give no more than both E(0), whatever packets do.
TEST(ExchangeAccount, MakesNoEnergyWhateverPacketsDo) {
  double least = 0.0;
  for (unsigned seed = 1; seed <= 40; ++seed) {
    Exchange e{seed};
    double given = 0.0;
    for (int k = 0; k < 2000; ++k) {
      e.tick();
      for (ExchangeAccount* side : {&e.left, &e.right}) {
        const double most = std::max(0.0, side->level().si()), by = e.draw(-1.0, 1.0);
        const double out = by > 0.0 ? by * most : 1e-3 * by;
        side->put_in(Energy{-out});
        given += out;
      }
      least = std::min(least, -given);
      ASSERT_LE(given, 3e-3 + 1e-12) << seed << " at " << k;
      ASSERT_LE(e.levels(), 3e-3 - given + 1e-12) << "what is on its way counts once at most";
    }
  }
  EXPECT_LT(least, -2.9e-3) << "E(0) must be used";
}

// Once everything has arrived both sides have the same.
TEST(ExchangeAccount, LevelsBecomeEqual) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    Exchange e{seed};
    for (int k = 0; k < 50; ++k) {
      e.left.put_in(Energy{e.draw(-1e-5, 2e-4)});
      e.right.put_in(Energy{e.draw(-1e-5, 1e-5)});
      e.tick();
    }
    for (int k = 0; k < 200; ++k) e.tick(true);
    EXPECT_NEAR(e.left.level().si(), e.right.level().si(), 1e-9) << seed;
    EXPECT_GT(e.right.level().si(), 1.5e-3) << seed;
  }
}

// A side that is told anything sends no more than it has.
TEST(ExchangeAccount, SendsNoMoreThanItHasWhateverItIsTold) {
  ExchangeAccount a{Energy{1e-3}};
  a.hear(Energy{}, Energy{-1e9});
  a.share();
  EXPECT_EQ(a.level().si(), 0.0);
  EXPECT_EQ(a.sent().si(), 1e-3);
  a.put_in(Energy{-1e-3});
  a.share();
  EXPECT_EQ(a.sent().si(), 1e-3);
}

TEST(TickReach, IsTwiceTheLargestMotionOfTheLastHalfSecond) {
  TickReach<1> reach;
  using Vector = Force<1>::Vector;
  reach.observe(Displacement<1>{Vector{-2e-3}}, Seconds{1e-3});
  EXPECT_DOUBLE_EQ(reach.most(Force<1>{Vector{3.0}}).si(), 12e-3);
  EXPECT_DOUBLE_EQ(reach.part(Force<1>{Vector{3.0}}, Energy{6e-3}), 0.5);
  EXPECT_EQ(reach.part(Force<1>{Vector{3.0}}, Energy{-1e-3}), 0.0);
  for (int k = 0; k < 5000; ++k) reach.observe(Displacement<1>{Vector{1e-5}}, Seconds{1e-3});
  EXPECT_NEAR(reach.most(Force<1>{Vector{1.0}}).si(), 2e-5, 1e-5);
}

Summary figures(const std::string& scene, const std::string& transparency, const std::string& passivity,
                double round_trip_ms) {
  const std::string half = std::to_string(0.5 * round_trip_ms);
  return lab::run(load_scene(TWOPORT_SCENES "/" + scene + ".textproto",
                             std::vector<std::string>{"control.transparency.layer=" + transparency,
                                                      "control.passivity.layer=" + passivity,
                                                      "to_slave.delay_ms=" + half, "to_master.delay_ms=" + half}),
                  {.verdict = lab::VerdictFrom::plain});
}

// Peg in hole, wall and corner: what the hand feels at rest is what the robot presses, as under the layer that guards the hand alone, and
// both ports keep to both E(0).
TEST(BothEnds, PressAsTheHandOnlyDefaultDoes) {
  for (const char* scene : {"assembly", "two_pegs", "box_into_corner", "demo"})
    for (const double round_trip_ms : {0.0, 100.0, 200.0}) {
      const Summary both = figures(scene, "INTERNAL_MODEL", "ENERGY_EXCHANGE", round_trip_ms),
                    hand = figures(scene, "INTERNAL_MODEL", "ENERGY_SPRING", round_trip_ms);
      const std::string where = std::string{scene} + " at " + std::to_string(round_trip_ms) + " ms";
      EXPECT_NEAR(both.held_force_ratio(), 1.0, 0.03) << where;
      EXPECT_GE(both.environment_force_mean_n(), 0.97 * hand.environment_force_mean_n()) << where;
      EXPECT_LE(both.felt_force_error_rms_n(), 1.08 * hand.felt_force_error_rms_n()) << where;
      EXPECT_LE(both.free_force_rms_n(), 0.25) << where;
      EXPECT_GE(both.two_port_min_energy_j(), -40e-3) << where;
      EXPECT_GE(both.hand_min_energy_j(), -20e-3) << where;
    }
}

// Equal levels are equal forces: under the delayed force, too, the hand feels what the robot presses, where one-way totals leave the robot
// without energy before it touches.
TEST(BothEnds, ADelayedForceThatPaysPressesInThePegsHole) {
  for (const double round_trip_ms : {50.0, 100.0, 200.0}) {
    const Summary pays = figures("assembly", "DELAYED_FORCE", "ENERGY_EXCHANGE", round_trip_ms),
                  published = figures("assembly", "DELAYED_FORCE", "FORCE_PROJECTED", round_trip_ms);
    EXPECT_NEAR(pays.held_force_ratio(), 1.0, 0.1) << round_trip_ms;
    EXPECT_GT(pays.environment_force_mean_n(), 0.5) << round_trip_ms;
    EXPECT_LT(published.environment_force_mean_n(), 0.3) << round_trip_ms;
  }
}

// An environment that moves gives the hand no more than E(0) alone, and as much as it puts in without that bound.
TEST(BothEnds, AMovingEnvironmentIsFeltWithoutTheHandsOwnBound) {
  const Summary bounded = figures("edge/moving_environment", "INTERNAL_MODEL", "ENERGY_EXCHANGE", 50.0),
                felt = figures("edge/moving_environment", "INTERNAL_MODEL", "ENERGY_SPRING_TWO_PORT", 50.0);
  EXPECT_LT(bounded.held_force_ratio(), 0.5);
  EXPECT_GE(bounded.hand_min_energy_j(), -10e-3 - 1e-9);
  EXPECT_NEAR(felt.held_force_ratio(), 1.0, 0.05);
  EXPECT_LT(felt.hand_min_energy_j(), -12e-3);
  EXPECT_GE(felt.two_port_min_energy_j(), -20e-3);
}

}  // namespace
}  // namespace twoport::both_ends_test
