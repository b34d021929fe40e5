#include <fcntl.h>
#include <gtest/gtest.h>
#include <pty.h>
#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <functional>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "common/base/sanitized.h"
#include "common/wire/codec.h"
#include "tests/loopback/relay.h"
#include "tests/support/live.h"

// Limits that hold against the other side, whatever it says, and against what happens to the own program (docs/reference/safety.md).
namespace twoport::test::safety_test {
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
    envelope.report.sequence += 3;  // the true report has passed: this one is newer
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
  EXPECT_GT(o.s.limits().peer().motion(), 0u);
  EXPECT_GT(o.s.limits().peer().energy(), 0u);
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
    EXPECT_GT(o.m.limits().peer().force() + o.m.packets().to_master().rejected(), 0u) << absurd;
    EXPECT_TRUE(std::isfinite(o.m.robot_max_force_n())) << absurd;
  }
}

// ---- the own program stands still

TEST(Safety, AMasterThatWasStoppedBeginsAnewAndSaysSo) {
  const Pair pair;
  Process slave = pair.listening_slave("slave", {"--set", "duration_s=4"}),
          master = pair.master("master", {"--set", "duration_s=4"});
  for (const char* side : {"master", "slave"}) pair.await(side, 0.8);
  master.send(SIGSTOP);
  std::this_thread::sleep_for(1500ms);
  master.send(SIGCONT);
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  const schema::Summary m = pair.summary("master");
  // Once for this stop; a busy machine may make it stand still at other times.
  EXPECT_GE(m.limits().device().pause(), 1u);
  EXPECT_GE(count(master.err(), "s: this side stood still; the coupling begins anew"), 1) << master.err();
  EXPECT_GE(count(slave.err(), "s: the master is silent; holding"), 1) << slave.err();
  EXPECT_GE(count(slave.err(), "s: released: the master is silent"), 1) << slave.err();
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
  for (const char* side : {"master", "slave"}) pair.await(side, 0.8);
  slave.send(SIGSTOP);
  std::this_thread::sleep_for(1500ms);
  slave.send(SIGCONT);
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  EXPECT_GE(pair.summary("slave").limits().robot().pause(), 1u);
  EXPECT_GE(count(slave.err(), "s: this side stood still; the coupling begins anew"), 1) << slave.err();
  const schema::Summary m = pair.summary("master");
  EXPECT_GT(m.hand_min_energy_j(), -2e-3) << "E(0), and a millijoule of what a busy machine leaves out";
}

// ---- what a run leaves

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

TEST(Safety, ASlaveThatIsInterruptedBeforeAMasterComesSaysSo) {
  const Pair pair;
  Process slave = pair.listening_slave();
  slave.send(SIGUSR1);
  EXPECT_TRUE(slave.says("s: SIGUSR1 does nothing here")) << slave.err();
  slave.send(SIGINT);
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  EXPECT_EQ(count(slave.err(), "ended by a signal; the other side had not come, and nothing is recorded"), 1)
      << slave.err();
}

TEST(Safety, SigusrToAMasterWithoutAScheduleIsSaid) {
  const Pair pair;
  Process slave = pair.listening_slave(), master = pair.master();
  ASSERT_TRUE(master.says("paired with the slave")) << master.err();
  master.send(SIGUSR1);
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(count(master.err(), "s: SIGUSR1 does nothing: the scene has no control.schedule"), 1) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
}

/// A terminal, and a program whose messages go there. Nobody reads until the end.
class UnreadTerminal {
 public:
  UnreadTerminal() {
    if (openpty(&reader_, &writer_, nullptr, nullptr, nullptr) != 0) throw std::runtime_error{"no terminal"};
    for (const int end : {reader_, writer_}) {
      fcntl(end, F_SETFL, O_NONBLOCK);
      fcntl(end, F_SETFD, FD_CLOEXEC);
    }
  }
  ~UnreadTerminal() {
    close(reader_);
    close(writer_);
  }
  UnreadTerminal(const UnreadTerminal&) = delete;
  [[nodiscard]] std::string path() const { return ttyname(writer_); }
  /// Until it takes no more: whoever writes then waits. The kernel moves what is written on to the reader's end a little later, which
  /// makes room again.
  void fill() const {
    for (int k = 0; k < 20; ++k) {
      while (::write(writer_, "x", 1) == 1) k = 0;
      std::this_thread::sleep_for(5ms);
    }
  }
  std::string read_all() {
    char some[4096];
    for (ssize_t n; (n = ::read(reader_, some, sizeof some)) > 0;) text_.append(some, static_cast<std::size_t>(n));
    return text_;
  }

 private:
  int reader_ = -1, writer_ = -1;
  std::string text_;
};

// Its recording thread waits for the terminal; the cycle does not: the master hears the slave to the end.
TEST(Safety, AProgramWhoseMessagesNobodyReadsKeepsItsCycle) {
  const Pair pair;
  UnreadTerminal terminal;
  Process slave{{"/bin/sh", "-c", R"(exec "$0" "$@" 2>)" + terminal.path(), TWOPORT_SLAVE, "--scene", pair.scene,
                 "--listen", pair.address(), "--out", pair.at("slave"), "--no-spin"}};
  for (int k = 0; k < 300 && terminal.read_all().find("listening on") == std::string::npos; ++k)
    std::this_thread::sleep_for(20ms);
  Process master = pair.master();
  ASSERT_TRUE(master.says("paired with the slave")) << master.err();
  terminal.fill();
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(count(master.err(), "the slave is silent"), 0) << master.err();
  EXPECT_EQ(pair.summary("master").mode(), "coupled");
  EXPECT_TRUE(slave.running()) << "it waits for its reader now, with the robot released";
  for (int k = 0; k < 500 && slave.running(); ++k) {
    terminal.read_all();
    std::this_thread::sleep_for(10ms);
  }
  EXPECT_EQ(slave.wait(1s), exited(0)) << terminal.read_all();
  EXPECT_GT(pair.summary("slave").steps(), 1500u);
}

// As after a logout of one who has disowned the program: writing there fails, and nobody sends SIGHUP.
TEST(Safety, ATerminalThatIsGoneEndsNoProgram) {
  const Pair pair;
  auto terminal = std::make_unique<UnreadTerminal>();
  Process slave{{"/bin/sh", "-c", R"(exec "$0" "$@" 2>)" + terminal->path(), TWOPORT_SLAVE, "--scene", pair.scene,
                 "--listen", pair.address(), "--out", pair.at("slave"), "--no-spin"}};
  for (int k = 0; k < 300 && terminal->read_all().find("listening on") == std::string::npos; ++k)
    std::this_thread::sleep_for(20ms);
  Process master = pair.master();
  ASSERT_TRUE(master.says("paired with the slave")) << master.err();
  terminal.reset();
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(10s), exited(0));
  EXPECT_GT(pair.summary("slave").steps(), 1500u);
}

/// Scheduling policies of a program's threads; field 41 of proc(5).
std::vector<int> policies(pid_t pid) {
  std::vector<int> all;
  for (const auto& task : std::filesystem::directory_iterator{"/proc/" + std::to_string(pid) + "/task"}) {
    const std::string stat = read_text(task.path() / "stat");
    std::istringstream rest{stat.substr(stat.rfind(')') + 1)};
    std::string field;
    for (int i = 3; i <= 41; ++i) rest >> field;
    all.push_back(std::stoi(field));
  }
  return all;
}

TEST(Safety, OnlyTheCycleHasRealTimePriorityWhereTheProgramWasStartedWithIt) {
  if (kThreadSanitizer) GTEST_SKIP() << "the sanitizer has a thread of its own";
  Pair pair;
  pair.share_key();
  Process slave{{"chrt", "-f", "5", TWOPORT_SLAVE, "--scene", pair.scene, "--listen", pair.address(), "--no-spin",
                 "--key", pair.scheduling.back()}};
  if (!slave.says("listening on", 5s)) GTEST_SKIP() << "no right to real time, or no chrt: " << slave.err();
  std::this_thread::sleep_for(200ms);
  std::vector<int> all = policies(slave.pid());
  ASSERT_EQ(all.size(), 4u) << "the cycle, the recording, the handshakes and the watchdog";
  EXPECT_EQ(std::count(all.begin(), all.end(), SCHED_FIFO), 1);
  EXPECT_EQ(std::count(all.begin(), all.end(), SCHED_OTHER), 3);
  slave.send(SIGINT);
  slave.wait();
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
}  // namespace twoport::test::safety_test
