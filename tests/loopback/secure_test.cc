#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>
#include <random>
#include <string>
#include <thread>

#include "common/base/sanitized.h"
#include "common/wire/codec.h"
#include "tests/loopback/relay.h"
#include "tests/support/live.h"

// Two programs with a key, and what those without can do.
namespace twoport::test::secure_test {
namespace {

struct KeyedPair : Pair {
  KeyedPair() { share_key(); }
};

void expect_coupled(const Pair& pair, const std::vector<std::string>& sides) {
  std::vector<schema::Summary> all;
  for (const std::string& side : sides) all.push_back(pair.summary(side));
  if (kept_time(all)) {
    EXPECT_EQ(all.front().mode(), "coupled");
  }
  EXPECT_GT(all.front().coupled_share(), 0.0);
  EXPECT_EQ(all.front().reconnects(), 0u);
  for (const schema::Summary& each : all) EXPECT_TRUE(each.encrypted());
  expect_sound(all);
}

TEST(Key, MadeByKeygenCouplesTwoPrograms) {
  Pair pair;
  const std::string key = pair.at("made");
  EXPECT_EQ(finished({TWOPORT_KEYGEN, key}).wait(), exited(0));
  Process again = finished({TWOPORT_KEYGEN, key});
  EXPECT_EQ(again.wait(), exited(2));
  EXPECT_NE(again.err().find("exists already"), std::string::npos) << again.err();
  for (const std::string flag : {"--help", "--version"}) EXPECT_EQ(finished({TWOPORT_KEYGEN, flag}).wait(), exited(0));
  EXPECT_EQ(finished({TWOPORT_KEYGEN}).wait(), exited(2));
  const std::string lost = pair.at("lost");
  Process limited = finished({"/bin/sh", "-c", "ulimit -f 0; exec " + std::string{TWOPORT_KEYGEN} + " \"$0\"", lost});
  const Exit ended = limited.wait();
  if (!kThreadSanitizer) {  // which writes before main() begins
    EXPECT_EQ(ended, exited(1));
  }
  EXPECT_FALSE(std::filesystem::exists(lost));

  pair.scheduling.insert(pair.scheduling.end(), {"--key", key});
  Process slave = pair.listening_slave(), master = pair.master();
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  EXPECT_NE(master.err().find("encrypted and authenticated"), std::string::npos) << master.err();
  EXPECT_EQ(count(slave.err(), " has the key"), 1) << slave.err();
  expect_coupled(pair, {"master", "slave"});
  EXPECT_EQ(pair.summary("master").packets().to_master().rejected(), 0u);
}

TEST(Key, LetsNothingOnTheWireInPlainText) {
  const KeyedPair pair;
  KeyedPair through;
  through.port = free_udp_port();
  Relay relay{through.port, pair.port};
  Process slave = pair.listening_slave(), master = through.master("master", {"--set", "duration_s=0.5"});
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  slave.send(SIGTERM);
  slave.wait();
  relay.stop();
  EXPECT_GT(relay.from_master.size(), 300u);
  // The version of the wire begins every datagram without a key. In encrypted bytes it stands near the front by chance,
  // in about one record of ten thousand: 6 places of 2^-16.
  static constexpr std::uint8_t kMark[] = {0x50, 0x54};
  std::size_t marked = 0;
  for (const auto* all : {&relay.from_master, &relay.from_slave})
    for (const Datagram& d : *all) {
      ASSERT_GT(d.size(), 20u);
      EXPECT_TRUE((d[0] == 22 || d[0] == 23) && d[1] == 0xfe) << "of a handshake, or a record of DTLS";
      if (d[0] == 23) marked += std::search(d.begin() + 13, d.begin() + 20, kMark, kMark + 2) != d.begin() + 20;
    }
  EXPECT_LT(marked, relay.from_master.size() / 50);
}

TEST(Key, ThatDiffersOrIsMissingIsSaidOnBothSides) {
  const Pair plain;
  const KeyedPair pair;
  const std::string other =
      plain.folder.write("other", "a7c300005e19d20b48f611117b83e4a6c05f92d1386b4fe7a0c5d2983b61f04d");
  std::filesystem::permissions(other, std::filesystem::perms::owner_read);
  struct Case {
    Words slave, master;
    std::string slave_says, master_says;
  };
  const std::string key = pair.at("key");
  const Case cases[] = {
      {{"--key", key},
       {"--key", other},
       "a program called, but the handshake did not succeed",
       "answered, but the handshake"},
      {{"--key", key}, {}, "packets without encryption arrived", "no slave answered"},
      {{}, {"--key", key}, "encrypted packets arrived, and this program has no key", "no slave answered"}};
  for (const Case& c : cases) {
    Words of_slave = c.slave, of_master = c.master;
    of_slave.insert(of_slave.end(), {"--duration", "4"});
    of_master.insert(of_master.end(), {"--duration", "3"});
    Process slave = plain.listening_slave("slave", of_slave), master = plain.master("master", of_master);
    EXPECT_EQ(master.wait(), exited(1));
    EXPECT_EQ(slave.wait(), exited(1));
    EXPECT_NE(slave.err().find(c.slave_says), std::string::npos) << slave.err();
    EXPECT_NE(master.err().find(c.master_says), std::string::npos) << master.err();
    if (c.slave == c.master || c.slave.empty() || c.master.empty()) continue;
    for (Process* side : {&slave, &master})
      EXPECT_EQ(count(side->err(), "has failed: it has another key"), 1) << side->err();
  }
}

TEST(Key, IsAgreedOnAnewEverySecondAndNoPacketIsRefused) {
  const KeyedPair pair;
  const Words longer{"--set", "duration_s=6"};
  Words often = longer;
  often.insert(often.end(), {"--rekey-after", "1"});
  Process slave = pair.listening_slave("slave", longer), master = pair.master("master", often);
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  for (Process* side : {&master, &slave}) EXPECT_GE(count(side->err(), " has the key key"), 4) << side->err();
  expect_coupled(pair, {"master", "slave"});
  for (const char* side : {"master", "slave"}) {
    const schema::Summary summary = pair.summary(side);
    const auto& packets = summary.packets();
    const auto& in = side == std::string{"master"} ? packets.to_master() : packets.to_slave();
    // A flight that was said twice counts as of a handshake.
    for (const auto& [reason, times] : in.rejected_by()) EXPECT_EQ(reason, "failed_handshake") << times;
  }
  for (const char* wrong : {"0.5", "601", "nan", "soon"})
    EXPECT_EQ(pair.master("out", {"--rekey-after", wrong}).wait(), exited(2)) << wrong;
}

TEST(Key, OfEachDeviceIsSaidAndLocksNobodyElseInOrOut) {
  const Pair pair;
  const std::string keys = pair.at("keys"), left = keys + "/left", right = keys + "/right";
  std::filesystem::create_directory(keys);
  std::filesystem::permissions(keys, std::filesystem::perms::owner_all);
  for (const std::string& file : {left, right}) ASSERT_EQ(finished({TWOPORT_KEYGEN, file}).wait(), exited(0));
  const Words slave_words{"--key", keys, "--set", "duration_s=4"};
  {
    Process slave = pair.listening_slave("slave", slave_words);
    Process first = pair.master("first", {"--key", left, "--set", "duration_s=4"});
    ASSERT_TRUE(slave.says("paired with the master")) << slave.err();
    Process second = pair.master("second", {"--key", right, "--set", "duration_s=4"});
    EXPECT_EQ(second.wait(), exited(1));
    EXPECT_NE(second.err().find("the slave is busy"), std::string::npos) << second.err();
    EXPECT_EQ(first.wait(), exited(0)) << first.err();
    EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
    EXPECT_NE(slave.err().find("with 2 keys in"), std::string::npos) << slave.err();
    EXPECT_EQ(count(slave.err(), " has the key left"), 1) << "it never was deaf: " << slave.err();
    EXPECT_GE(count(slave.err(), " has the key right"), 1) << slave.err();
    EXPECT_EQ(pair.summary("slave").peer_key(), "left");
    EXPECT_EQ(pair.summary("first").peer_key(), "left");
    EXPECT_EQ(pair.summary("slave").reconnects(), 0u);
    std::filesystem::rename(pair.at("first"), pair.at("master"));
    expect_coupled(pair, {"master", "slave"});
  }
  const std::string mine = pair.at("right");
  std::filesystem::rename(right, mine);
  Process slave = pair.listening_slave("slave", slave_words);
  Process shut_out = pair.master("shut-out", {"--key", mine, "--duration", "1"});
  EXPECT_EQ(shut_out.wait(), exited(1));
  EXPECT_NE(shut_out.err().find("it has another key"), std::string::npos) << shut_out.err();
  Process first = pair.master("first", {"--key", left, "--set", "duration_s=1"});
  EXPECT_EQ(first.wait(), exited(0)) << first.err();
  slave.send(SIGTERM);
  slave.wait();
  EXPECT_EQ(pair.master("out", {"--key", keys}).wait(), exited(2));
}

/// Two datagrams a millisecond from 10,000 addresses of this machine: a genuine ClientHello, and one that proves no key.
class Strangers {
 public:
  Strangers(Datagram hello, std::uint16_t port) : hello_{std::move(hello)}, port_{port}, thread_{[this] { run(); }} {}
  ~Strangers() {
    stop_ = true;
    thread_.join();
    close(fd_);
  }
  Strangers(const Strangers&) = delete;

 private:
  void run() {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    to.sin_port = htons(port_);
    Datagram forged = hello_;
    forged.back() ^= 1;
    for (unsigned k = 0; !stop_; ++k) {
      for (Datagram* bytes : {&hello_, &forged}) {
        iovec piece{bytes->data(), bytes->size()};
        alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(in_pktinfo))> control{};
        msghdr message{};
        message.msg_name = &to, message.msg_namelen = sizeof to;
        message.msg_iov = &piece, message.msg_iovlen = 1;
        message.msg_control = control.data(), message.msg_controllen = control.size();
        cmsghdr* const header = CMSG_FIRSTHDR(&message);
        header->cmsg_level = IPPROTO_IP, header->cmsg_type = IP_PKTINFO;
        header->cmsg_len = CMSG_LEN(sizeof(in_pktinfo));
        in_pktinfo from{};
        from.ipi_spec_dst.s_addr = htonl(0x7f010101u + (k % 10'000) * 257u);
        std::memcpy(CMSG_DATA(header), &from, sizeof from);
        sendmsg(fd_, &message, MSG_DONTWAIT);
      }
      std::this_thread::sleep_for(1ms);
    }
  }
  Datagram hello_;
  std::uint16_t port_;
  int fd_ = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

TEST(Key, AFloodOfStrangersKeepsNobodyOutNorARestartInContact) {
  const KeyedPair pair;
  Datagram hello;
  {
    KeyedPair elsewhere;
    std::filesystem::remove(elsewhere.at("key"));
    std::filesystem::copy_file(pair.at("key"), elsewhere.at("key"));
    const Socket heard{elsewhere.port};
    Process master = elsewhere.master("master", {"--duration", "5"});
    for (int k = 0; k < 2000 && hello.empty(); ++k) {
      if (const auto d = heard.receive()) hello = d->first;
      std::this_thread::sleep_for(5ms);
    }
    master.send(SIGKILL);
    master.wait();
  }
  ASSERT_GT(hello.size(), 100u);
  const Words far{"--set", "to_slave.delay_ms=50", "--set", "to_master.delay_ms=50", "--set", "duration_s=60"};
  Process slave = pair.listening_slave("slave", far);
  const Strangers strangers{hello, pair.port};
  std::this_thread::sleep_for(500ms);
  const auto paired_after = [](Process& program, const char* words) {
    const auto from = std::chrono::steady_clock::now();
    EXPECT_TRUE(program.says(words)) << program.err();
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - from;
    std::printf("%s after %.2f s, the start of the program included\n", words, took.count());
    EXPECT_LT(took.count(), 10.0);
  };
  Process first = pair.master("first", far);
  paired_after(first, "paired with the slave");
  pair.await("first", 1.5);  // in contact
  first.send(SIGKILL);
  first.wait();
  Process second = pair.master("second", far);
  paired_after(second, "paired with the slave");
  EXPECT_TRUE(slave.says("re-paired with the master")) << slave.err();
  second.send(SIGTERM);
  second.wait();
  slave.send(SIGTERM);
  slave.wait();
  EXPECT_EQ(pair.summary("slave").reconnects(), 1u);
}

TEST(Key, SurvivesARestartOfEachSide) {
  const KeyedPair pair;
  const Words absolute{"--set", "duration_s=6", "--set", "control.registration.mode=ABSOLUTE"};
  Process first = pair.listening_slave("first", absolute);
  Process master = pair.master("master", absolute);
  ASSERT_TRUE(master.says("paired with the slave")) << master.err();
  std::this_thread::sleep_for(700ms);
  first.send(SIGKILL);
  first.wait();
  Process second = pair.slave("second", {"--set", "duration_s=4", "--set", "robot.position_m=[0.0204]", "--set",
                                         "control.registration.mode=ABSOLUTE"});
  EXPECT_TRUE(second.says("paired with the master")) << second.err();
  std::this_thread::sleep_for(500ms);
  master.send(SIGKILL);
  master.wait();
  Process third =
      pair.master("third", {"--set", "device.position_m=[0.026]", "--set", "control.registration.mode=ABSOLUTE"});
  EXPECT_EQ(third.wait(), exited(0)) << third.err();
  EXPECT_EQ(second.wait(), exited(0)) << second.err();
  EXPECT_GE(count(second.err(), " has the key"), 2) << second.err();  // again where nobody answers within 250 ms
  EXPECT_EQ(pair.summary("second").reconnects(), 1u);
  expect_coupled(pair, {"third", "second"});
}

TEST(Key, IsNotNeededByWhoRecordsAndRepeatsButHelpsNobody) {
  const KeyedPair pair;
  KeyedPair through;
  through.port = free_udp_port();
  std::vector<Datagram> old_master, old_slave;
  {
    Relay relay{through.port, pair.port};
    Process slave = pair.listening_slave("old"), master = through.master("old", {"--set", "duration_s=0.4"});
    master.wait();
    slave.send(SIGTERM);
    slave.wait();
    relay.stop();
    old_master = relay.from_master, old_slave = relay.from_slave;
  }
  std::mt19937 random{20};
  std::size_t next = 0;
  const Socket elsewhere;
  std::atomic<std::size_t> rounds = 0;
  const Words longer{"--set", "duration_s=60"};
  Process slave = pair.listening_slave("slave", longer);
  const Relay relay{through.port, pair.port, [&](Relay& r) {
                      ++rounds;
                      // Of the session before and of this one, whole, changed and cut, from the peer's address and another.
                      const std::size_t i = next++;
                      Datagram d = i % 2 ? r.from_master[i % r.from_master.size()] : old_master[i % old_master.size()];
                      Datagram e = i % 2 ? r.from_slave[i % r.from_slave.size()] : old_slave[i % old_slave.size()];
                      // Handshakes from the peer's own address are the business of who reads them and stops them.
                      if (d[0] == 23) r.to_slave(d);
                      if (e[0] == 23) r.to_master(e);
                      elsewhere.send(d, pair.port);
                      elsewhere.send(e, pair.port);
                      for (Datagram* x : {&d, &e})
                        (*x)[random() % x->size()] ^= static_cast<std::uint8_t>(1 + random() % 255);
                      if (d[0] == 23) r.to_slave(d);
                      if (e[0] == 23) r.to_master(e);
                    }};
  Process master = through.master("master", longer);
  through.await("master", 1.0);
  const std::size_t until = rounds + 500;
  EXPECT_TRUE(comes_true([&] { return rounds > until; }));
  for (Process* each : {&master, &slave}) {
    each->send(SIGINT);
    EXPECT_EQ(each->wait(), exited(0)) << each->err();
  }
  std::filesystem::rename(through.at("master"), pair.at("master"));
  expect_coupled(pair, {"master", "slave"});
  const schema::Summary summary = pair.summary("slave");
  const auto& by = summary.packets().to_slave().rejected_by();
  // How many arrive is up to how often the relay and this side get a processor.
  for (const char* reason : {"replayed", "not_authentic", "foreign_address"})
    EXPECT_TRUE(by.contains(reason)) << reason;
}

// ---- without a key

/// A mismatching introduction, as short as it can be: of another version.
Datagram other_version() {
  Datagram d{0x0d, 0x63, 0x00, 0x50, 0x54, 0x11};
  for (int i = 0; i < 8; ++i) d.push_back(1);
  return d;
}

TEST(Attack, NoDatagramOfOneWhoDoesNotListenEndsAProgram) {
  const Pair pair;
  const Socket stranger;
  Process slave = pair.listening_slave("slave", {}, {.terminal = true});
  for (int k = 0; k < 200; ++k) {
    stranger.send(other_version(), pair.port);
    std::this_thread::sleep_for(2ms);
  }
  std::this_thread::sleep_for(700ms);  // half a second was the time after which a refusing side ended
  EXPECT_TRUE(slave.running()) << slave.err();
  int answers = 0;
  while (const auto answer = stranger.receive()) {
    ++answers;
    Codec<1> codec;
    Envelope<1> refusal;
    ASSERT_EQ(codec.decode(std::as_bytes(std::span{answer->first}), refusal), Decoded::ok);
    EXPECT_FALSE(refusal.identity);
    EXPECT_EQ(refusal.refusal.find_first_of("0123456789"), refusal.refusal.npos) << refusal.refusal;
  }
  EXPECT_GT(answers, 3);
  Process master = pair.master();
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  EXPECT_GT(pair.summary("slave").packets().to_slave().rejected_by().at("refused"), 3u);
}

TEST(Attack, AWaitingMasterDoesNotTakeARobotInContactInAShortSilence) {
  const Pair pair;
  Process slave = pair.listening_slave("slave", {"--set", "duration_s=4"}, {.terminal = true});
  Process master = pair.master("master", {"--set", "duration_s=4"});
  ASSERT_TRUE(slave.says("paired with the master")) << slave.err();
  std::this_thread::sleep_for(900ms);
  Process rival = pair.master("rival", {"--set", "duration_s=4"});
  std::this_thread::sleep_for(200ms);
  const auto stopped = std::chrono::steady_clock::now();
  master.send(SIGSTOP);
  std::this_thread::sleep_for(300ms);
  master.send(SIGCONT);
  const bool short_silence = std::chrono::steady_clock::now() - stopped < 600ms;  // a robot is free after 750 ms
  const Exit ended = rival.wait();
  master.wait();
  slave.wait();
  if (!short_silence) GTEST_SKIP() << "not judged: this test itself was without a processor for 0.3 s";
  EXPECT_EQ(ended, exited(1)) << rival.err();
  EXPECT_NE(rival.err().find("busy"), std::string::npos) << rival.err();
  EXPECT_EQ(pair.summary("slave").reconnects(), 0u);
}

}  // namespace
}  // namespace twoport::test::secure_test
