#include "tests/network/network.h"

#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <thread>

// Two machines in one: each program has a network of its own, and a cable between them that can be pulled.
namespace twoport::test::network_test {
namespace {

class NetworkTest : public testing::Test {
 protected:
  void SetUp() override {
    static const std::string not_root = become_root();
    if (!not_root.empty()) GTEST_SKIP() << "no networks to test in: " << not_root;
    master_.emplace(), slave_.emplace();
    for (const Network* network : {&*master_, &*slave_})
      if (!network->problem().empty()) GTEST_SKIP() << "no networks to test in: " << network->problem();
    const std::string cable = master_->ip("link add cable-m type veth peer name cable-s netns " + slave_->path());
    if (!cable.empty()) GTEST_SKIP() << "no networks to test in: " << cable;
    for (const std::string& problem :
         {master_->ip("addr add 10.45.0.1/24 dev cable-m"), slave_->ip("addr add 10.45.0.2/24 dev cable-s"),
          master_->ip("addr add fd45::1/64 dev cable-m nodad"), slave_->ip("addr add fd45::2/64 dev cable-s nodad"),
          master_->ip("link set cable-m up"), slave_->ip("link set cable-s up")})
      ASSERT_EQ(problem, "");
  }

  Process start_slave(Pair& pair, const Words& more = {}) {
    if (more.empty() || more.front() != "--insecure") pair.share_key();
    return pair.listening_slave("slave", more, {.terminal = true, .network = slave_->fd()});
  }
  Process start_master(const Pair& pair, const Words& more = {}) {
    return pair.master("master", more, {.terminal = true, .network = master_->fd()});
  }

  std::optional<Network> master_, slave_;
};

void expect_coupled_run(const Pair& pair, Process& master, Process& slave) {
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  const schema::Summary m = pair.summary("master"), s = pair.summary("slave");
  EXPECT_EQ(m.mode(), "coupled");
  for (const schema::Summary& each : {m, s}) {
    EXPECT_EQ(each.reconnects(), 0u);
    if (kept_time({m, s})) {
      EXPECT_GT(each.contact_s(), 0.3);
    }
  }
  expect_sound({m, s});
}

TEST_F(NetworkTest, TwoMachinesAreCoupled) {
  Pair pair;
  pair.host = "10.45.0.2";
  Process slave = start_slave(pair), master = start_master(pair);
  expect_coupled_run(pair, master, slave);
  const schema::Summary m = pair.summary("master"), s = pair.summary("slave");
  EXPECT_GT(s.packets().to_slave().received(), 0.8 * m.steps() - 200);
  EXPECT_LT(s.packets().to_slave().lost() + m.packets().to_master().lost(), 400u);
  EXPECT_GE(m.rtt_ms().p50(), 19.9);
}

TEST_F(NetworkTest, WithoutAKeyOnlyWhoInsistsTalksToAnotherMachine) {
  Pair pair;
  pair.host = "10.45.0.2";
  for (const bool master : {false, true}) {
    const Surroundings where{.network = master ? master_->fd() : slave_->fd()};
    Process refused = master ? pair.master("master", {}, where) : pair.slave("slave", {}, where);
    EXPECT_EQ(refused.wait(), exited(2));
    for (const std::string part : {"10.45.0.2", "without a key only addresses of this machine", "twoport-keygen"})
      EXPECT_NE(refused.err().find(part), std::string::npos) << refused.err();
  }
  const Words insecure{"--insecure", "--set", "duration_s=1"};
  Process slave = start_slave(pair, insecure), master = start_master(pair, insecure);
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  for (const Process* each : {&slave, &master})
    EXPECT_NE(each->err().find("neither encrypted nor authenticated"), std::string::npos) << each->err();
  EXPECT_FALSE(pair.summary("master").encrypted());
}

TEST_F(NetworkTest, ASlaveOnEveryAddressIsReachedByIpv6) {
  Pair pair;
  pair.host = "[::]";
  Process slave = start_slave(pair, {"--set", "duration_s=1"});
  pair.host = "[fd45::2]";
  Process master = start_master(pair, {"--set", "duration_s=1"});
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  EXPECT_EQ(pair.summary("master").mode(), "coupled");
}

TEST_F(NetworkTest, APulledCableInContactIsHeldAndCoupledAgain) {
  Pair pair;
  pair.host = "10.45.0.2";
  const Words longer{"--set", "duration_s=3.5", "--set", "control.release_after_s=2"};
  Process slave = start_slave(pair, longer), master = start_master(pair, longer);
  pair.await("master", 1.1);
  ASSERT_EQ(master_->ip("link set cable-m down"), "");
  std::this_thread::sleep_for(500ms);
  ASSERT_EQ(master_->ip("link set cable-m up"), "");
  expect_coupled_run(pair, master, slave);
  EXPECT_NE(master.err().find("holding"), std::string::npos) << master.err();
  EXPECT_NE(slave.err().find("holding"), std::string::npos) << slave.err();
  EXPECT_EQ(master.err().find("released"), std::string::npos) << master.err();
  const Trace trace = pair.trace("master");
  EXPECT_GT(trace.peak("master_f_wanted_0", 0.7, 1.1), 0.5) << "in contact before";
  EXPECT_GT(trace.peak("master_f_wanted_0", 2.7, 3.5), 0.5) << "and after";
  EXPECT_GT(pair.summary("slave").packets().to_slave().lost(), 200u);
}

// As a computer that roams. Nobody can follow a session to another address but who pairs anew, after 750 ms of silence, and with a key by its
// handshake.
TEST_F(NetworkTest, AMasterWhoseAddressChangesIsCoupledAgain) {
  for (const char* link : {"--key", "--insecure"}) {
    Pair pair;
    pair.host = "10.45.0.2";
    Words longer{"--set", "duration_s=5", "--set", "control.release_after_s=0.5"};
    if (link == std::string{"--insecure"}) longer.insert(longer.begin(), link);
    Process slave = start_slave(pair, longer), master = start_master(pair, longer);
    ASSERT_TRUE(master.says("coupled")) << master.err();
    std::this_thread::sleep_for(500ms);
    ASSERT_EQ(master_->ip("addr del 10.45.0.1/24 dev cable-m"), "");
    ASSERT_EQ(master_->ip("addr add 10.45.0.3/24 dev cable-m"), "");
    EXPECT_EQ(master.wait(), exited(0)) << master.err();
    EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
    EXPECT_EQ(pair.summary("master").mode(), "coupled") << link << "\n" << master.err() << slave.err();
    for (const char* side : {"master", "slave"}) EXPECT_EQ(pair.summary(side).reconnects(), 1u) << link << ": " << side;
    ASSERT_EQ(master_->ip("addr del 10.45.0.3/24 dev cable-m"), "");
    ASSERT_EQ(master_->ip("addr add 10.45.0.1/24 dev cable-m"), "");
  }
}

TEST_F(NetworkTest, TheLargestDatagramPassesTheSmallestMtuWhole) {
  // 576 B is what every IPv4 network must take; six degrees of freedom make the longest datagrams.
  Pair pair{press(6)};
  pair.host = "10.45.0.2";
  ASSERT_EQ(master_->ip("link set cable-m mtu 576"), "");
  ASSERT_EQ(slave_->ip("link set cable-s mtu 576"), "");
  const Words shorter{"--set", "duration_s=1"};
  Process slave = start_slave(pair, shorter), master = start_master(pair, shorter);
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  EXPECT_EQ(pair.summary("master").mode(), "coupled");
  for (const Network* network : {&*master_, &*slave_}) {
    EXPECT_GT(network->counter("Udp", "OutDatagrams"), 500);
    EXPECT_EQ(network->counter("Ip", "FragCreates"), 0);
    EXPECT_EQ(network->counter("Ip", "FragFails"), 0);
  }
}

TEST_F(NetworkTest, AMasterWithoutARouteWaitsUntilThereIsOne) {
  Pair pair;
  pair.host = "10.45.0.2";
  ASSERT_EQ(master_->ip("link set cable-m down"), "");
  Process slave = start_slave(pair, {"--set", "duration_s=1"});
  Process master = start_master(pair, {"--set", "duration_s=1"});
  EXPECT_TRUE(master.says("waiting for a slave"));
  std::this_thread::sleep_for(300ms);
  EXPECT_TRUE(master.running()) << master.err();
  ASSERT_EQ(master_->ip("link set cable-m up"), "");
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  const schema::Summary m = pair.summary("master");
  EXPECT_EQ(m.mode(), "coupled");
  // What had no route was not sent.
  EXPECT_GT(m.packets().to_slave().unsent(), 200u);
  EXPECT_LT(m.packets().to_slave().sent(), m.steps() + 1000u);
  EXPECT_FALSE(m.packets().to_master().has_unsent());
}

TEST_F(NetworkTest, AnAddressOfTheOtherMachineCannotBeListenedOn) {
  Pair pair;
  pair.host = "10.45.0.1";
  pair.share_key();
  Process slave = pair.slave("slave", {}, {.network = slave_->fd()});
  EXPECT_EQ(slave.wait(), exited(2));
  EXPECT_NE(slave.err().find(pair.address()), std::string::npos) << slave.err();
  EXPECT_NE(slave.err().find("no interface of this machine has that address"), std::string::npos) << slave.err();
}

}  // namespace
}  // namespace twoport::test::network_test
