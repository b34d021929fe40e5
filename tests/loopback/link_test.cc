#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <memory>
#include <random>
#include <string>
#include <thread>

#include "common/link/report.h"
#include "tests/loopback/relay.h"
#include "tests/support/live.h"

// What a link does to a run: silence, loss, strangers, and the other side's death.
namespace twoport::test::link_test {
namespace {

/// "coupled holding coupled" from what a program has shown on its terminal. A slave that has just found a master is
/// idle for a moment, seen or not.
std::string modes_shown(const std::string& terminal) {
  std::string modes, last;
  for (std::size_t at = terminal.find(" s   "); at != terminal.npos; at = terminal.find(" s   ", at + 1)) {
    const std::string mode = terminal.substr(at + 5, terminal.find(' ', at + 5) - at - 5);
    if (mode == "idle" || mode == last) continue;
    modes += (modes.empty() ? "" : " ") + mode;
    last = mode;
  }
  return modes;
}

/// Coupled, then holding for the side that is gone, released where that one's program took its time to start, and coupled again.
bool began_anew(const std::string& terminal) {
  const std::string modes = modes_shown(terminal);
  return modes.starts_with("coupled holding coupled") || modes.starts_with("coupled holding released coupled");
}

// ---- the other side dies, and comes back

// The robot stands in contact, and so does the handle: what a real one would do while its program starts anew.
// Registered anew it would follow from where it stands; in absolute registration it presses as before.
const Words kRobotInContact{
    "--set", "duration_s=60", "--set", "robot.position_m=[0.0204]", "--set", "control.registration.mode=ABSOLUTE"};
const Words kHandInContact{"--set", "device.position_m=[0.026]"};

TEST(Restart, OfTheSlaveInContactIsSurvivedByTheMaster) {
  const Pair pair;
  Process first = pair.listening_slave("first", {"--set", "control.registration.mode=ABSOLUTE"});
  Process master = pair.master("master", {"--set", "duration_s=60", "--set", "control.registration.mode=ABSOLUTE"},
                               {.terminal = true});
  pair.await("master", 1.4);
  first.send(SIGKILL);
  first.wait();
  std::this_thread::sleep_for(300ms);
  Process second = pair.slave("second", kRobotInContact);
  pair.await("second", 1.5);
  for (Process* each : {&master, &second}) {
    each->send(SIGINT);
    EXPECT_EQ(each->wait(), exited(0)) << each->err();
  }

  const schema::Summary m = pair.summary("master"), s = pair.summary("second");
  EXPECT_EQ(m.reconnects(), 1u);
  if (kept_time({m, s})) {
    EXPECT_EQ(m.mode(), "coupled");
    EXPECT_TRUE(began_anew(master.err())) << master.err();
  }
  expect_sound({m, s});

  const Trace trace = pair.trace("master");
  const double end_s = trace["t_s"].back();
  EXPECT_GT(trace.peak("master_f_wanted_0", 1.0, 1.3), 0.5) << "in contact before";
  EXPECT_GT(trace.peak("master_f_wanted_0", end_s - 0.5, end_s), 0.5) << "in contact after";
  EXPECT_LE(trace.peak("master_f_0", 0.0, end_s), 8.5) << "what the device can";
  std::cout << "slave restarted: least port energy " << m.min_port_energy_j() << " J, largest force " << m.max_force_n()
            << " N\n";
}

TEST(Restart, OfTheMasterInContactIsSurvivedByTheSlave) {
  const Pair pair;
  Process slave = pair.listening_slave("slave", {"--set", "duration_s=60"}, {.terminal = true});
  Process first = pair.master("first", {"--set", "duration_s=60"});
  pair.await("first", 1.4);
  first.send(SIGKILL);
  first.wait();
  std::this_thread::sleep_for(300ms);
  Process second = pair.master("second", kHandInContact);
  EXPECT_EQ(second.wait(), exited(0)) << second.err();
  slave.send(SIGINT);
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();

  const schema::Summary m = pair.summary("second"), s = pair.summary("slave");
  EXPECT_EQ(s.reconnects(), 1u);
  EXPECT_EQ(m.reconnects(), 0u);
  if (kept_time({m, s})) {
    EXPECT_TRUE(began_anew(slave.err())) << slave.err();
  }
  expect_sound({m, s});
  EXPECT_GT(pair.trace("second").peak("master_f_wanted_0", 1.0, 2.0), 0.5);
  std::cout << "master restarted: least port energy " << m.min_port_energy_j() << " J, largest force "
            << m.max_force_n() << " N\n";
}

TEST(Restart, AfterALongSilenceFindsTheMasterReleased) {
  const Pair pair;
  Process first = pair.listening_slave("first");
  Process master = pair.master("master", {"--set", "duration_s=60"}, {.terminal = true});
  pair.await("master", 0.9);
  first.send(SIGKILL);
  first.wait();
  EXPECT_TRUE(master.says("s: released: the slave")) << master.err();
  std::this_thread::sleep_for(500ms);
  Process second = pair.slave("second", {"--set", "duration_s=60", "--set", "robot.position_m=[0.0204]"});
  pair.await("second", 1.0);
  for (Process* each : {&master, &second}) {
    each->send(SIGINT);
    EXPECT_EQ(each->wait(), exited(0)) << each->err();
  }
  const schema::Summary m = pair.summary("master"), s = pair.summary("second");
  EXPECT_EQ(m.reconnects(), 1u);
  expect_sound({m, s});
  if (kept_time({m, s})) {
    EXPECT_EQ(modes_shown(master.err()), "coupled holding released coupled");
  }
  const std::string log = master.err();
  for (const std::string line :
       {"s: paired with the slave", "s: the slave is silent; holding", "s: released: the slave"})
    EXPECT_GE(count(log, line), 1) << line << "\n" << log;
  EXPECT_EQ(count(log, "s: paired with the slave"), 1) << log;
  EXPECT_EQ(count(log, "s: re-paired with the slave"), 1) << log;
  EXPECT_EQ(count(log, "s: packets of the slave arrive again"), 0) << log;
  const Trace trace = pair.trace("master");
  const std::vector<double>& modes = trace["mode"];
  const auto released = std::find(modes.begin(), modes.end(), static_cast<double>(Mode::released));
  ASSERT_NE(released, modes.end());
  const double released_s = trace["t_s"][static_cast<std::size_t>(released - modes.begin())];
  EXPECT_EQ(trace.peak("master_f_0", released_s + 2e-3, released_s + 0.4), 0.0) << "the force is gone";
}

// ---- silence

TEST(Link, HoldsThroughABlackoutAndCouplesAgain) {
  const Pair pair;
  const Words longer{"--set", "duration_s=2.5",
                     "--set", "to_master.blackout=[{start_s: 1 duration_s: 0.6}]",
                     "--set", "to_slave.blackout=[{start_s: 1 duration_s: 0.6}]"};
  Process slave = pair.listening_slave("slave", longer, {.terminal = true});
  Process master = pair.master("master", longer, {.terminal = true});
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  EXPECT_EQ(count(master.err(), "s: paired with the slave"), 1) << master.err();
  const schema::Summary m = pair.summary("master"), s = pair.summary("slave");
  if (kept_time({m, s})) {
    EXPECT_EQ(modes_shown(master.err()), "coupled holding coupled");
    EXPECT_EQ(count(master.err(), "s: coupled with the slave again"), 1) << master.err();
    EXPECT_EQ(modes_shown(slave.err()).find("coupled holding coupled"), 0u) << slave.err();
  }
  for (const schema::Summary& each : {m, s}) EXPECT_EQ(each.reconnects(), 0u);
  expect_sound({m, s});
  EXPECT_GT(m.packets().to_master().lost(), 300u) << "600 ticks without a packet";
  EXPECT_GT(s.packets().to_slave().lost(), 300u);
  const Trace trace = pair.trace("master");
  EXPECT_LT(trace.peak("master_f_0", 1.35, 1.55), 0.05) << "the force has faded";
  EXPECT_GT(trace.peak("master_f_wanted_0", 2.0, 2.5), 0.5) << "and comes back";
}

// ---- loss

TEST(Link, LosesWhatTheSceneSaysAndIsStable) {
  const Pair pair;
  const Words loss{"--set", "to_slave.loss=0.1", "--set", "to_master.loss=0.25"};
  Process slave = pair.listening_slave("slave", loss), master = pair.master("master", loss);
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  const schema::Summary m = pair.summary("master"), s = pair.summary("slave");
  const auto share = [](const schema::Packets& p) {
    return static_cast<double>(p.lost()) / static_cast<double>(p.lost() + p.received());
  };
  // Five standard deviations of 1500 draws, and what a busy machine's full queue adds.
  EXPECT_NEAR(share(s.packets().to_slave()), 0.1, 0.05);
  EXPECT_NEAR(share(m.packets().to_master()), 0.25, 0.07);
  expect_sound({m, s});
  std::cout << "lost " << share(s.packets().to_slave()) << " of 0.1, " << share(m.packets().to_master())
            << " of 0.25\n";
}

// ---- strangers

/// What came from the wire: noise of every length, the empty datagram and one longer than any buffer among it.
class Noise {
 public:
  Datagram next() {
    static constexpr int kLengths[] = {0, 1, 2, 5, 6, 30, 64, 200, 1024, 1025, 1499, 1500, 4000};
    Datagram d(static_cast<std::size_t>(kLengths[random_() % std::size(kLengths)]));
    for (auto& byte : d) byte = static_cast<std::uint8_t>(random_());
    return d;
  }
  /// A real one, cut somewhere.
  Datagram cut(const Datagram& whole) {
    return {whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(random_() % whole.size())};
  }
  const Datagram& any(const std::vector<Datagram>& of) { return of[random_() % of.size()]; }

 private:
  std::mt19937 random_{20240611};
};

/// A run was not touched by what else came in.
void expect_unaffected(const Pair& pair, Process& master, Process& slave) {
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  const schema::Summary m = pair.summary("master"), s = pair.summary("slave");
  for (const schema::Summary& each : {m, s}) EXPECT_EQ(each.reconnects(), 0u) << each.side();
  expect_sound({m, s});
  if (kept_time({m, s})) {
    for (const schema::Summary& each : {m, s}) EXPECT_GT(each.contact_s(), 0.5) << each.side();
    EXPECT_LT(m.packets().to_master().lost(), 400u);
    EXPECT_LT(s.packets().to_slave().lost(), 400u);
    EXPECT_EQ(modes_shown(master.err()), "coupled");
  }
  std::cout << "rejected at the master " << m.packets().to_master().rejected() << ", at the slave "
            << s.packets().to_slave().rejected() << "; position error " << m.position_error_rms_m() << " m rms\n";
}

/// A side that kept its ticks has read and counted what was sent; the queue of one that did not was full.
void expect_counted(const schema::Summary& side, const schema::Packets& way, int sent) {
  EXPECT_GT(way.rejected(), 0u);
  if (kept_time({side})) {
    EXPECT_GT(way.rejected(), 0.5 * sent);
  }
}

/// All the datagrams of a run that is over, as the two have sent them.
struct Recording {
  std::vector<Datagram> from_master, from_slave;
};
Recording record(const Pair& pair, std::uint16_t relay_port) {
  Relay relay{relay_port, pair.port};
  Pair through{press()};
  through.port = relay_port;
  Process slave = pair.listening_slave("old"), master = through.master("old", {"--set", "duration_s=0.4"});
  master.wait();
  slave.send(SIGTERM);
  slave.wait();
  // The relay rests now: nobody is there to send.
  std::this_thread::sleep_for(50ms);
  relay.stop();
  return {relay.from_master, relay.from_slave};
}

TEST(Strangers, OnTheWayAreCountedAndDropped) {
  const Pair pair;
  Pair through{press()};
  through.port = free_udp_port();
  const Recording old = record(pair, through.port);
  ASSERT_FALSE(old.from_master.empty());
  ASSERT_FALSE(old.from_slave.empty());

  std::atomic<int> sent = 0;
  Noise noise;
  std::unique_ptr<Process> slave = std::make_unique<Process>(pair.listening_slave("slave", {}, {.terminal = true}));
  const Relay relay{through.port, pair.port, [&](Relay& r) {
                      // From the very address of the other side, which is the worst that can be.
                      r.to_slave(noise.next());
                      r.to_master(noise.next());
                      r.to_slave(noise.cut(noise.any(r.from_master)));
                      r.to_master(noise.cut(noise.any(r.from_slave)));
                      // Past the greetings, which are another matter.
                      r.to_slave(old.from_master.back());
                      r.to_master(old.from_slave.back());
                      sent += 3;
                    }};
  Process master = through.master("master", {}, {.terminal = true});
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  std::filesystem::rename(through.at("master"), pair.at("master"));
  expect_unaffected(pair, master, *slave);
  std::cout << "strange datagrams sent to each: " << sent << "\n";
  expect_counted(pair.summary("slave"), pair.summary("slave").packets().to_slave(), sent);
  expect_counted(pair.summary("master"), pair.summary("master").packets().to_master(), sent);
}

TEST(Strangers, FromElsewhereAreDroppedEvenWithGreetingsOfAnOldSession) {
  const Pair pair;
  Pair through{press()};
  through.port = free_udp_port();
  const Recording old = record(pair, through.port);

  std::atomic<int> sent = 0;
  Noise noise;
  const Socket elsewhere;
  Process slave = pair.listening_slave("slave", {}, {.terminal = true});
  const Relay relay{
      through.port, pair.port, [&](Relay& r) {
        for (const Datagram& d : {noise.next(), noise.cut(noise.any(r.from_master)), noise.any(r.from_master),
                                  noise.any(old.from_master), old.from_master.front()}) {
          elsewhere.send(d, pair.port);
          elsewhere.send(d, r.master_port);
        }
        sent += 5;
      }};
  Process master = through.master("master", {}, {.terminal = true});
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  std::filesystem::rename(through.at("master"), pair.at("master"));
  expect_unaffected(pair, master, slave);
  // The master's socket takes from its slave only: the system drops the rest before it is seen.
  expect_counted(pair.summary("slave"), pair.summary("slave").packets().to_slave(), sent);
}

TEST(Strangers, OnTheWayDoNotPassForTheOtherSideWithGreetingsOfAnOldSession) {
  const Pair pair;
  Pair through{press()};
  through.port = free_udp_port();
  const Recording old = record(pair, through.port);

  int ticks = 0;
  Process slave = pair.listening_slave("slave", {}, {.terminal = true});
  const Relay relay{through.port, pair.port, [&](Relay& r) {
                      if (++ticks % 400 != 0) return;
                      r.to_master(old.from_slave.front());
                      r.to_slave(old.from_master.front());
                    }};
  Process master = through.master("master", {}, {.terminal = true});
  EXPECT_EQ(master.wait(15s), exited(0)) << master.err();
  std::filesystem::rename(through.at("master"), pair.at("master"));
  expect_unaffected(pair, master, slave);
}

}  // namespace
}  // namespace twoport::test::link_test
