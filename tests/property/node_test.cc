// What the nodes do with readings that are none, with ticks that were left out, and when the other side starts anew.

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <string>
#include <vector>

#include "common/method/transparency/four_channel/four_channel.h"
#include "common/scene/load.h"
#include "master/master_node.h"
#include "master/render_node.h"
#include "slave/slave_node.h"

namespace twoport::node_test {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kT = 1e-3;
constexpr const char* kScene = R"(dof: 3 duration_s: 1 rate_hz: 1000 device { mass_kg: 0.1 }
  control { passivity { method: FORCE_PROJECTED initial_energy_j: 1e-3 } } robot { mass_kg: 1 })";

Force<3> along(double f) {
  return Force<3>{Eigen::Vector3d{f, 0, 0}};
}
Velocity<3> velocity(double v) {
  return Velocity<3>{Eigen::Vector3d{v, 0, 0}};
}
Position<3> at(double x) {
  return Position<3>{Eigen::Vector3d{x, 0, 0}};
}

/// Steps a node at tick k with a peer that is heard all the time.
template <class Clock, class Node, class State>
auto step(Node& node, int k, const State& state, const PeerState<3>& known) {
  return node.step(Tick<Clock>{Instant<Clock>{tick_time(k, 1.0 / kT)}, Seconds{kT}}, state, known);
}
PeerState<3> heard(int k, double f, double energy_j = 1.0) {
  PeerState<3> known;
  known.has_report = known.is_new = true;
  known.received_at = known.proven_at = tick_time(k, 1.0 / kT);
  known.newest.mode = Mode::coupled;
  known.newest.f = along(f);
  known.energy_in_j = energy_j;
  return known;
}

// The force of tick 199 was held until tick 200, whose reading is none: what it has given over the motion until tick 201 counts, what
// it may have taken in does not.
TEST(MasterNode, BooksWhatAHeldForceGaveBeforeAReadingThatIsNone) {
  for (const double moved : {-1e-3, 1e-3}) {
    MasterNode<3> node{parse_scene(kScene, "test").control};
    Force<3> held, before;
    double x = 0.0, observed = 0.0;
    for (int k = 0; k < 203; ++k) {
      DeviceSample<3> device{at(k == 200 ? kNone : x), velocity(0.1), held};
      const auto out = step<MasterClock>(node, k, device, heard(k, 1.0));
      if (k == 199) observed = node.observed().si(), before = out.command;
      held = out.command;
      x += k < 199 ? 1e-4 : (k == 200 ? moved : 0.0);
    }
    ASSERT_GT(before[0], 0.5);
    EXPECT_NEAR(node.observed().si() - observed, std::min(0.0, before[0] * moved), 1e-15) << moved;
  }
}

TEST(MasterNode, LetsGoForAReadingThatIsNoneAndForNoLonger) {
  for (const int part : {0, 1, 2}) {
    MasterNode<3> node{parse_scene(kScene, "test").control};
    Force<3> held;
    for (int k = 0; k < 300; ++k) {
      DeviceSample<3> device{at(1e-4 * k), velocity(0.1), held};
      if (k == 200 && part == 0) device.x = at(kNone);
      if (k == 200 && part == 1) device.v = velocity(kNone);
      if (k == 200 && part == 2) device.applied = along(kNone);
      const auto out = step<MasterClock>(node, k, device, heard(k, 1.0));
      held = out.command;
      ASSERT_TRUE(held.finite()) << part << " at tick " << k;
      EXPECT_TRUE(std::isfinite(node.observed().si()));
      if (k == 200) {
        EXPECT_EQ(out.mode, Mode::released);
        EXPECT_EQ(held.vec().norm(), 0.0);
      }
    }
    EXPECT_NEAR(held.vec()[0], 0.99, 0.02) << "of the ramp";  // 99 of its 100 ticks after it has begun anew
  }
}

// What was displayed before a pause is old: afterwards the ramp begins at zero, it does not fade from one.
TEST(MasterNode, DisplaysNothingAfterAPauseUntilItIsCoupledAnew) {
  MasterNode<3> node{parse_scene(kScene, "test").control};
  Force<3> held;
  for (int k = 0; k < 300; ++k)
    held = step<MasterClock>(node, k, DeviceSample<3>{at(0), velocity(0), held}, heard(k, 1.0)).command;
  ASSERT_GT(held[0], 0.5);
  for (int k = 1800; k < 2000; ++k) {
    PeerState<3> slave = heard(k, 1.0);
    slave.newest.mode = Mode::released;
    Tick<MasterClock> tick{Instant<MasterClock>{tick_time(k, 1.0 / kT)}, Seconds{kT}};
    if (k == 1800) tick.ended = Seconds{1.5};
    held = node.step(tick, DeviceSample<3>{at(0), velocity(0), held}, slave).command;
    EXPECT_EQ(held.vec().norm(), 0.0) << "at tick " << k;
  }
}

TEST(MasterNode, HasNoForceThatADoubleDoesNotHold) {
  Scene scene = parse_scene(kScene, "test", std::vector<std::string>{"control.force_scale=1e10"});
  MasterNode<3> node{scene.control};
  for (int k = 0; k < 200; ++k)
    EXPECT_TRUE(step<MasterClock>(node, k, DeviceSample<3>{}, heard(k, 1e300)).command.finite());
}

// Whatever the device would display.
TEST(MasterNode, KeepsTheLimitOfForce) {
  MasterNode<3> node{parse_scene(kScene, "test", std::vector<std::string>{"device.max_force_n=0.5"}).control};
  double most = 0.0;
  for (int k = 0; k < 300; ++k)
    most = std::max(most, step<MasterClock>(node, k, DeviceSample<3>{}, heard(k, 40.0)).command.vec().norm());
  EXPECT_NEAR(most, 0.5, 1e-15);
}

TEST(MasterNode, CarriesOverWhatOfItsAllowanceIsSpent) {
  MasterNode<3> node{parse_scene(kScene, "test").control};
  const auto run = [&](int from, double v, double energy_j) {
    Force<3> held;
    double paid = 0.0, x = 0.0;
    for (int k = from; k < from + 300; ++k) {
      const auto out = step<MasterClock>(node, k, DeviceSample<3>{at(x), velocity(v), held}, heard(k, 1.0, energy_j));
      held = out.command;
      x += kT * v;
      paid -= kT * v * held.vec()[0];
    }
    return paid;
  };
  EXPECT_NEAR(run(0, -0.1, 0.0), 1e-3, 2e-4);  // all of E(0)
  node.on_peer_restart(Energy{0.0});
  EXPECT_LT(run(1000, -0.1, 0.0), 2e-4);  // not again
}

TEST(SlaveNode, LetsGoForAReadingThatIsNoneAndForNoLonger) {
  SlaveNode<3> node{parse_scene(kScene, "test").control};
  for (int k = 0; k < 300; ++k) {
    PeerState<3> master = heard(k, 0.0);
    master.newest.x = at(1e-5 * k);
    RobotSample<3> robot{at(0.0), velocity(k == 200 ? kNone : 0.0), along(0.0)};
    if (k == 100) robot.x = at(kNone);
    const auto out = step<SlaveClock>(node, k, robot, master);
    ASSERT_TRUE(out.command.f.finite() && out.command.x_d.finite() && out.command.v_d.finite()) << "at tick " << k;
    EXPECT_EQ(out.mode == Mode::released, k == 100 || k == 200) << "at tick " << k;
  }
}

TEST(SlaveNode, StaysWhereItWasWhileItsReadingIsNone) {
  SlaveNode<3> node{parse_scene(kScene, "test").control};
  for (int k = 0; k < 10; ++k) {  // nobody is heard
    const RobotSample<3> robot{at(k == 5 ? kNone : 0.01 * k), velocity(0.0), along(0.0)};
    const auto out = step<SlaveClock>(node, k, robot, PeerState<3>{});
    EXPECT_NEAR(out.command.x_d.translation()[0], 0.01 * (k == 5 ? 4 : k), 1e-15) << "at tick " << k;
  }
}

// The hand of a master that is not coupled yet feels nothing: what it does meanwhile is not followed.
TEST(SlaveNode, FollowsAfterAReleaseOnlyWhatACoupledMasterDoes) {
  SlaveNode<3> node{parse_scene(kScene, "test").control};
  const auto robot_at = [&](int k, const PeerState<3>& master) {
    return step<SlaveClock>(node, k, RobotSample<3>{}, master).command;
  };
  for (int k = 0; k < 100; ++k) robot_at(k, heard(k, 0.0));
  for (int k = 100; k < 2000; ++k) robot_at(k, heard(99, 0.0));
  ASSERT_EQ(node.mode(), Mode::released);
  for (int k = 2000; k < 2400; ++k) {
    PeerState<3> master = heard(k, 0.0);
    master.newest.mode = k < 2200 ? Mode::idle : Mode::coupled;
    master.newest.x = at(1e-4 * std::min(k - 2000, 190));
    master.newest.v = velocity(k < 2190 ? 0.1 : 0.0);
    master.newest.echo_ns = tick_time(k, 1.0 / kT).count();
    const RobotCommand<3> command = robot_at(k, master);
    EXPECT_EQ(command.x_d.translation()[0], 0.0) << "at tick " << k;
    EXPECT_EQ(command.f.vec().norm(), 0.0) << "at tick " << k;
  }
  EXPECT_EQ(node.mode(), Mode::coupled);
}

// The master has switched while nothing was coupled. Its words are of the new method: as an offset of the old one, 5 N would be 5 m.
TEST(SlaveNode, BeginsACouplingByTheMethodOfTheMastersEpoch) {
  const Scene scene = parse_scene(
      "dof: 6 duration_s: 1 rate_hz: 1000 device { mass_kg: 0.1 inertia_kg_m2: 1e-4 } control { passivity { method: "
      "INTERNAL_MODEL } schedule { at_s: 0.1 passivity { method: FOUR_CHANNEL } } } robot { mass_kg: 1 inertia_kg_m2: "
      "1e-3 }",
      "test");
  SlaveNode<6> node{scene.control, scene.schedule};
  PeerState<6> master;
  master.has_report = master.is_new = true;
  master.newest.mode = Mode::coupled;
  master.epoch = 1;
  HandForce<6> push;
  push.f.value = Force<6>{Force<6>::Vector::Constant(5.0)};
  write(push, master.words);
  const auto out = node.step({Instant<SlaveClock>{Duration{0}}, Seconds{kT}}, RobotSample<6>{}, master);
  EXPECT_EQ(out.mode, Mode::coupled);
  EXPECT_EQ(node.epoch(), 1U);
  EXPECT_LT(node.target().translation().norm(), 1e-12);
}

TEST(SlaveNode, HasNoForceThatADoubleDoesNotHold) {
  const std::vector<std::string> stiff{"control.virtual_coupling.stiffness_n_per_m=1e18"};
  SlaveNode<3> node{parse_scene(kScene, "test", stiff).control};
  for (int k = 0; k < 200; ++k) {
    PeerState<3> master = heard(k, 0.0);
    master.newest.v = velocity(1e300);
    const auto out = step<SlaveClock>(node, k, RobotSample<3>{}, master);
    EXPECT_TRUE(out.command.f.finite() && out.command.x_d.finite() && out.command.v_d.finite()) << "at tick " << k;
  }
}

TEST(SlaveNode, CarriesOverWhatOfItsAllowanceIsSpent) {
  SlaveNode<3> node{parse_scene(kScene, "test").control};
  // The robot is held fast, and the master goes on and on: the coupling's spring is loaded with what it is allowed.
  const auto paid = [&](int from) {
    double energy = 0.0;
    for (int k = from; k < from + 300; ++k) {
      PeerState<3> master = heard(k, 0.0, 0.0);
      master.newest.x = at(1e-4 * (k - from));
      const auto out = step<SlaveClock>(node, k, RobotSample<3>{}, master);
      energy += kT * out.command.f.vec().dot(out.command.v_d.vec());
    }
    return energy;
  };
  EXPECT_NEAR(paid(0), 1e-3, 1e-5);  // all of E(0)
  node.on_peer_restart(Energy{0.0});
  EXPECT_LT(paid(1000), 1e-5);  // not again
}

TEST(RenderNode, LetsGoForAReadingThatIsNone) {
  const Scene scene = parse_scene(R"(dof: 3 duration_s: 1 rate_hz: 1000 device { mass_kg: 0.1 }
    control { architecture: RENDER passivity { method: CLASSIC } } environment { spring { stiffness_n_per_m: 100 } })",
                                  "test");
  RenderNode<3> node{scene.control, Environment<3>{scene.environment}};
  Force<3> held;
  for (int k = 0; k < 10; ++k) {
    const double x = k == 5 ? kNone : 0.01 * k;
    const auto out = node.step(Tick<MasterClock>{Instant<MasterClock>{tick_time(k, 1.0 / kT)}, Seconds{kT}},
                               DeviceSample<3>{at(x), velocity(0.01 / kT), held}, NoReport{});
    held = out.command;
    ASSERT_TRUE(held.finite()) << "at tick " << k;
    EXPECT_EQ(held.vec().norm() == 0.0, k == 0 || k == 5);
  }
  EXPECT_TRUE(std::isfinite(node.observed().si()));
}

/// The command of a rendered spring that is stretched by `x`.
Force<3> rendered(double stiffness_n_per_m, double x) {
  const std::vector<std::string> set{"environment[0].spring.stiffness_n_per_m=" + std::to_string(stiffness_n_per_m)};
  const Scene scene = parse_scene(
      "dof: 3 duration_s: 1 device { mass_kg: 0.1 max_force_n: 0.5 } control { architecture: RENDER }", "test", set);
  RenderNode<3> node{scene.control, Environment<3>{scene.environment}};
  return node
      .step(Tick<MasterClock>{Instant<MasterClock>{Duration{0}}, Seconds{kT}}, DeviceSample<3>{at(x), {}, {}},
            NoReport{})
      .command;
}
TEST(RenderNode, KeepsTheLimitOfForce) {
  EXPECT_NEAR(rendered(100.0, 0.004).vec().norm(), 0.4, 1e-15);
  EXPECT_NEAR(rendered(100.0, 4.0).vec().norm(), 0.5, 1e-15);
}
TEST(RenderNode, HasNoForceThatADoubleDoesNotHold) {
  EXPECT_EQ(rendered(1e15, 1e300).vec().norm(), 0.0);
}

}  // namespace
}  // namespace twoport::node_test
