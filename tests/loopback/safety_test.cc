#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>
#include <functional>
#include <string>
#include <thread>

#include "common/wire/codec.h"
#include "tests/loopback/relay.h"
#include "tests/support/live.h"

// Limits that hold against the other side, whatever it says, and against what happens to the own program (docs/safety.md).
namespace twoport::test {
namespace {

/// Changes reports on their way, as one could who has the session's key.
class Liar {
 public:
  using Lie = std::function<void(Report<1>&)>;
  Datagram operator()(const Datagram& d, const Lie& lie) {
    Envelope<1> envelope;
    const auto bytes = std::as_bytes(std::span{d});
    if (codec_.decode(bytes, envelope) != Decoded::ok || envelope.identity) return d;
    lie(envelope.report);
    const auto out = codec_.encode(envelope);
    const auto* begin = reinterpret_cast<const std::uint8_t*>(out.data());
    return {begin, begin + out.size()};
  }

 private:
  Codec<1> codec_;
};

struct Outcome {
  Exit master, slave;
  schema::Summary m, s;
  std::string master_log, slave_log;
  Trace trace;  ///< of the slave
};

/// A run of which one report in five of one side is changed.
Outcome run_with(const Liar::Lie& to_slave, const Liar::Lie& to_master, const Words& more = {}) {
  const Pair pair;
  Pair through{press()};
  through.port = free_udp_port();
  Liar liar_to_slave, liar_to_master;
  int n = 0;
  Process slave = pair.listening_slave("slave", more);
  Relay relay{through.port, pair.port, [&](Relay& r) {
                if (++n < 300 || n % 5 != 0) return;
                if (to_slave) r.to_slave(liar_to_slave(r.from_master.back(), to_slave));
                if (to_master) r.to_master(liar_to_master(r.from_slave.back(), to_master));
              }};
  Process master = through.master("master", more);
  const Exit m = master.wait(), s = slave.wait();
  relay.stop();
  return {
      m, s, summary_in(through.at("master")), pair.summary("slave"), master.err(), slave.err(), pair.trace("slave")};
}

using V1 = Eigen::Matrix<double, 1, 1>;
void say_motion(Report<1>& r, double v) {
  r.sequence += 3;
  r.v = Velocity<1>{V1{v}};
}

TEST(Safety, OfTheRobotHoldsAgainstAMasterThatClaimsSpeedAndEnergy) {
  const Outcome o = run_with(
      [](Report<1>& r) {
        say_motion(r, 100.0);
        r.energy_in_j = 1e6;
      },
      {});
  EXPECT_LE(o.s.robot_max_force_n(), 150.0 * (1.0 + 1e-9));
  EXPECT_LE(o.s.robot_max_speed_m_per_s(), 4.0) << "3 m/s, and one tick of 150 N";
  EXPECT_GT(o.s.limits().peer().motion(), 50u);
  EXPECT_GT(o.s.limits().peer().energy(), 50u);
  EXPECT_GE(count(o.slave_log, "s: limit reached: peer_motion"), 1) << o.slave_log;
  EXPECT_GE(count(o.slave_log, "s: limit reached: peer_energy"), 1) << o.slave_log;
  std::cout << "largest force " << o.s.robot_max_force_n() << " N, speed " << o.s.robot_max_speed_m_per_s() << " m/s\n";
}

TEST(Safety, OfTheRobotHoldsWhereTheSceneNamesTheLimits) {
  const Outcome o =
      run_with([](Report<1>& r) { say_motion(r, 1e300); }, {},
               {"--set", "control.robot_limits.force_n=20", "--set", "control.robot_limits.speed_m_per_s=0.5"});
  EXPECT_LE(o.s.robot_max_force_n(), 20.0 * (1.0 + 1e-9));
  EXPECT_LE(o.s.robot_max_speed_m_per_s(), 0.6);
}

TEST(Safety, AbsurdFiniteReportsOfTheSlaveEndNothingAndMoveNoVerdict) {
  for (const double absurd : {2000.0, 1e154, 1e308}) {
    const Outcome o = run_with({}, [&](Report<1>& r) {
      say_motion(r, absurd);
      r.f = r.f_coupling = r.f_environment = Force<1>{V1{-absurd}};
      r.x = Position<1>{V1{absurd}};
      r.position_error = Displacement<1>{V1{absurd}};
    });
    EXPECT_EQ(o.master, exited(0)) << absurd << o.master_log;
    EXPECT_EQ(o.m.verdict().find("diverged"), std::string::npos) << o.m.verdict();
    EXPECT_NE(o.m.verdict_kind(), "UNSTABLE") << absurd << ": " << o.m.verdict();
    EXPECT_GT(o.m.steps(), 1900u) << absurd << ": to the end";
    EXPECT_LE(o.m.max_force_n(), 8.5 * (1.0 + 1e-9)) << absurd;
    // A report whose numbers add up to no finite number is refused as a whole.
    EXPECT_GT(o.m.limits().peer().force() + o.m.packets().to_master().rejected(), 50u) << absurd;
    EXPECT_TRUE(std::isfinite(o.m.robot_max_force_n())) << absurd;
  }
}

// ---- the own program stands still

TEST(Safety, AMasterThatWasStoppedBeginsAnewAndSaysSo) {
  const Pair pair;
  Process slave = pair.listening_slave("slave", {"--set", "duration_s=4"}),
          master = pair.master("master", {"--set", "duration_s=4"});
  std::this_thread::sleep_for(1200ms);
  master.send(SIGSTOP);
  std::this_thread::sleep_for(1500ms);
  master.send(SIGCONT);
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  const schema::Summary m = pair.summary("master");
  EXPECT_EQ(m.limits().device().pause(), 1u);
  EXPECT_EQ(count(master.err(), "s: this side stood still; the coupling begins anew"), 1) << master.err();
  EXPECT_EQ(count(slave.err(), "s: the master is silent; holding"), 1) << slave.err();
  EXPECT_EQ(count(slave.err(), "s: released: the master is still silent"), 1) << slave.err();
  EXPECT_GE(count(slave.err(), "s: packets of the master arrive again"), 1) << slave.err();
  // The device's watchdog let go after 0.1 s: what its last force gave the hand until then.
  EXPECT_GT(m.min_port_energy_j(), -8.5 * 0.1 * 0.05) << "8.5 N and a hand at 50 mm/s for a tenth of a second";
  EXPECT_EQ(m.mode(), "coupled");
  std::cout << "least port energy " << m.min_port_energy_j() << " J\n";
}

TEST(Safety, ASlaveThatWasStoppedBeginsAnewAndSaysSo) {
  const Pair pair;
  Process slave = pair.listening_slave("slave", {"--set", "duration_s=4"}),
          master = pair.master("master", {"--set", "duration_s=4"});
  std::this_thread::sleep_for(1200ms);
  slave.send(SIGSTOP);
  std::this_thread::sleep_for(1500ms);
  slave.send(SIGCONT);
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  EXPECT_EQ(pair.summary("slave").limits().robot().pause(), 1u);
  EXPECT_EQ(count(slave.err(), "s: this side stood still; the coupling begins anew"), 1) << slave.err();
  const schema::Summary m = pair.summary("master");
  EXPECT_GT(m.hand_min_energy_j(), -2e-3) << "E(0), and a millijoule of what a busy machine leaves out";
}

// ---- what a run leaves

TEST(Safety, NothingOfAnEarlierRunStaysWhereOneCannotBegin) {
  const Pair pair;
  const Socket taken{pair.port};
  std::filesystem::create_directories(pair.at("slave"));
  for (const char* name : {"/summary.json", "/trace.csv"}) pair.folder.write(std::string{"slave"} + name, "{}");
  Process slave = pair.slave();
  EXPECT_NE(slave.wait(), exited(0));
  EXPECT_FALSE(std::filesystem::exists(pair.at("slave/summary.json")));
  EXPECT_FALSE(std::filesystem::exists(pair.at("slave/trace.csv")));
}

TEST(Safety, WhatNobodyKnowsIsNeitherStableNorUnstable) {
  const Pair pair;
  Process slave = pair.slave("slave", {"--duration", "0.2"});
  EXPECT_EQ(slave.wait(), exited(1)) << slave.err();
  EXPECT_EQ(pair.summary("slave").verdict_kind(), "UNDECIDED");
  EXPECT_FALSE(pair.summary("slave").has_stable());
}

TEST(Safety, StrangersAreSaidWhileNobodyHasCome) {
  const Pair pair;
  Process slave = pair.slave("slave", {"--duration", "2"});
  ASSERT_TRUE(slave.says("listening"));
  const Socket stranger;
  for (int k = 0; k < 50; ++k) {
    stranger.send(Datagram(30, 7), pair.port);
    std::this_thread::sleep_for(5ms);
  }
  slave.wait();
  EXPECT_EQ(count(slave.err(), "s: refused: "), 1) << slave.err();
}

TEST(Safety, ATraceOfEveryTenthTickHasEveryTenthRow) {
  const Pair pair{press(1, "RENDER")};
  Process master = pair.master("master", {"--set", "duration_s=0.5", "--trace-every", "10"});
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  const std::size_t steps = pair.summary("master").steps();
  EXPECT_EQ(pair.trace("master").rows(), (steps + 9) / 10);
  Process lab = finished({TWOPORT_LAB, "run", pair.scene, "--out", pair.at("lab"), "--trace-every", "7"});
  EXPECT_EQ(lab.wait(), exited(0)) << lab.err();
  EXPECT_EQ(pair.trace("lab").rows(), (summary_in(pair.at("lab")).steps() + 6) / 7);
  Process none = pair.master("none", {"--trace-every", "0"});
  EXPECT_EQ(none.wait(), exited(2)) << none.err();
}

}  // namespace
}  // namespace twoport::test
