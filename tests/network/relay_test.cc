#include <gtest/gtest.h>
#include <unistd.h>

#include <iostream>
#include <map>
#include <string>
#include <vector>

#include "tests/network/network.h"

// Hand and robot at two sites, each behind a router that lets in what answers only, and a relay of WireGuard between, with the files of
// docs/examples/relay (docs/guides/network.md).
namespace twoport::test::relay_test {
namespace {

class RelayTest : public testing::Test {
 protected:
  void SetUp() override {
    if (geteuid() != 0) GTEST_SKIP() << "no relay to test with: not root";
    for (const Network* each : {&hand_, &home_, &relay_, &office_, &robot_})
      if (!each->problem().empty()) GTEST_SKIP() << "no relay to test with: " << each->problem();
    const bool kernel = hand_.ip("link add wg type wireguard").empty();
    if (!kernel && access("/dev/net/tun", R_OK | W_OK) != 0)
      GTEST_SKIP() << "no relay to test with: neither WireGuard in the kernel nor /dev/net/tun for wireguard-go";
    for (const Words& needed : std::vector<Words>{{"ip", "-V"},
                                                  {"nft", "-v"},
                                                  {"wg", "-v"},
                                                  {"sysctl", "--version"},
                                                  {"chrt", "-r", "1", "true"},
                                                  {kernel ? "wg" : "wireguard-go", "--version"}})
      if (const std::string problem = hand_.run(needed); !problem.empty())
        GTEST_SKIP() << "no relay to test with: " << problem
                     << " (Debian packages iproute2, nftables, wireguard-tools, wireguard-go)";
    cable(hand_, "eth0", "192.168.1.2/24", home_, "lan", "192.168.1.1/24");
    cable(home_, "wan", "10.46.1.2/24", relay_, "home", "10.46.1.1/24");
    cable(office_, "wan", "10.46.2.2/24", relay_, "office", "10.46.2.1/24");
    cable(robot_, "eth0", "192.168.1.2/24", office_, "lan", "192.168.1.1/24");
    for (const Network* each : {&hand_, &robot_}) ok(each->ip("route add default via 192.168.1.1"));
    ok(home_.ip("route add default via 10.46.1.1"));
    ok(office_.ip("route add default via 10.46.2.1"));
    for (const Network* each : {&home_, &office_}) {
      ok(each->run({"sysctl", "-q", "-w", "net.ipv4.ip_forward=1"}));
      ok(each->run({"nft", R"(
        table ip nat {
          chain out { type nat hook postrouting priority srcnat; oifname "wan" masquerade; }
          chain in { type nat hook prerouting priority dstnat; }
        }
        table ip filter {
          chain forward { type filter hook forward priority filter; policy drop; ct state established,related accept; ct status dnat accept; iifname "lan" accept; }
        })"}));
    }
    // The networks between. The relay answers from its one public address: wireguard-go of Debian 13 leaves the choice to the route.
    ok(relay_.run({"sysctl", "-q", "-w", "net.ipv4.ip_forward=1"}));
    ok(relay_.ip("route replace 10.46.2.0/24 dev office src 10.46.1.1"));
  }
  void TearDown() override {
    for (const auto& [network, file] : up_) ok(network->run({"wg-quick", "down", file}));
  }

  static void ok(const std::string& problem) { EXPECT_EQ(problem, ""); }
  static void cable(const Network& a, const std::string& at_a, const std::string& address_a, const Network& b,
                    const std::string& at_b, const std::string& address_b) {
    ok(a.ip("link add " + at_a + " type veth peer name " + at_b + " netns " + b.path()));
    ok(a.ip("addr add " + address_a + " dev " + at_a));
    ok(b.ip("addr add " + address_b + " dev " + at_b));
    for (const auto& [network, name] : {std::pair{&a, at_a}, {&b, at_b}}) {
      ok(network->ip("link set " + name + " up"));
      ok(network->ip("link set lo up"));
    }
  }
  /// wg-quick with the files of the examples and new keys. At a real-time priority, or a busy computer leaves wireguard-go no processor.
  void bring_up() {
    std::map<std::string, std::string> words{{"RELAY_ADDRESS", "10.46.1.1"}};
    for (const std::string who : {"RELAY", "HAND", "ROBOT"}) {
      Process key = finished({"sh", "-c", "wg genkey | tee /dev/stderr | wg pubkey"});
      const auto line = [](std::string text) { return text.substr(0, text.find('\n')); };
      words[who + "_PRIVATE_KEY"] = line(key.err());
      words[who + "_PUBLIC_KEY"] = line(key.out());
    }
    for (const auto& [network, name] : {std::pair{&relay_, "relay"}, {&hand_, "hand"}, {&robot_, "robot"}}) {
      std::string text = read_text(std::string{TWOPORT_EXAMPLES} + "/relay/" + name + ".conf");
      ASSERT_NE(text, "");
      for (const auto& [word, value] : words)
        for (std::size_t at; (at = text.find(word)) != text.npos;) text.replace(at, word.size(), value);
      const std::string file = folder_.write("wg" + std::to_string(getpid()) + "-" + name + ".conf", text);
      ok(network->run({"chmod", "600", file}));
      ok(network->run({"chrt", "-r", "1", "wg-quick", "up", file}));
      up_.emplace_back(network, file);
    }
  }
  Process start(const Pair& pair, bool master, const Words& more = {}) const {
    return master ? pair.master("master", more, {.network = hand_.fd()})
                  : pair.slave("slave", more, {.network = robot_.fd()});
  }

  Folder folder_;
  Network hand_, home_, relay_, office_, robot_;
  std::vector<std::pair<const Network*, std::string>> up_;
};

TEST_F(RelayTest, HandAndRobotBehindRoutersMeetByARelay) {
  Pair pair{press(6)};
  pair.share_key();
  pair.host = "192.168.1.2";
  {
    Process slave = start(pair, false, {"--duration", "1"});
    ASSERT_TRUE(slave.says("listening on"));
    pair.host = "10.46.2.2";
    Process master = start(pair, true, {"--duration", "1"});
    EXPECT_EQ(master.wait(), exited(1)) << "the router of the robot's site lets nobody in";
    slave.wait();
  }
  bring_up();
  pair.host = "10.45.1.3";
  Process slave = start(pair, false);
  ASSERT_TRUE(slave.says("listening on")) << slave.err();
  Process master = start(pair, true);
  ASSERT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  const schema::Summary m = pair.summary("master"), s = pair.summary("slave");
  EXPECT_EQ(m.mode(), "coupled");
  EXPECT_GT(m.coupled_share(), 0.5);
  EXPECT_TRUE(m.encrypted());
  // 10 ms each way are of the scene.
  EXPECT_GE(m.rtt_ms().p50(), 19.9);
  for (const Network* each : {&hand_, &relay_, &robot_}) {
    EXPECT_EQ(each->counter("Ip", "FragCreates"), 0);
    EXPECT_EQ(each->counter("Ip", "FragFails"), 0);
  }
  expect_sound({m, s});
}

// What the relay costs is printed, beside a port that the router has opened; that the doctor is answered is judged.
TEST_F(RelayTest, TheDoctorMeasuresThroughAnOpenedPortAndTheRelay) {
  Pair pair;
  pair.share_key();
  bring_up();
  ok(office_.run({"nft", "add rule ip nat in iifname wan udp dport 45000 dnat to 192.168.1.2"}));
  for (const auto& [name, from, to] : {std::tuple{"an opened port", "192.168.1.2:45000", "10.46.2.2:45000"},
                                       {"the relay", "10.45.1.3:45000", "10.45.1.3:45000"}}) {
    const auto doctor = [&](const char* side, const char* at, const char* seconds, const Network& in) {
      return Process{{TWOPORT_LAB, "doctor", "--no-spin", side, at, "--seconds", seconds, "--key", pair.at("key")},
                     {.network = in.fd()}};
    };
    Process answers = doctor("--answer", from, "6", robot_), asks = doctor("--link", to, "3", hand_);
    EXPECT_NE(asks.wait(), exited(2)) << name << ": " << asks.err();
    const std::string said = asks.out();
    const std::size_t at = said.find("round trip");
    ASSERT_NE(at, said.npos) << name << ": " << said << asks.err();
    std::cout << name << ": " << said.substr(at, said.find('\n', at) - at) << '\n';
  }
}

}  // namespace
}  // namespace twoport::test::relay_test
