#include "common/platform/udp.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <string>
#include <thread>
#include <vector>

#include "common/base/check.h"
#include "tests/support/no_alloc.h"

namespace twoport::udp_test {
namespace {

using Clock = std::chrono::steady_clock;

std::span<const std::byte> bytes(std::string_view text) {
  return std::as_bytes(std::span{text.data(), text.size()});
}
std::string text(const ReceivedDatagram& d) {
  return {reinterpret_cast<const char*>(d.bytes.data()), d.bytes.size()};
}

UdpSocket socket_on(std::string_view where) {
  return UdpSocket{parse_endpoint(where, "--listen")};
}

std::optional<ReceivedDatagram> wait_for(UdpSocket& socket) {
  const auto end = Clock::now() + std::chrono::seconds{5};
  while (Clock::now() < end)
    if (auto d = socket.receive(Duration{0})) return d;
  return std::nullopt;
}

template <class F>
std::string sentence(F&& f) {
  try {
    f();
  } catch (const ConfigError& e) {
    return e.what();
  }
  return "nothing was thrown";
}

TEST(Endpoint, ReadsAndWritesBothFamilies) {
  for (const char* s : {"127.0.0.1:45001", "0.0.0.0:0", "[::1]:45001", "[fe80::1:2]:65535"})
    EXPECT_EQ(to_string(parse_endpoint(s, "--peer")), s);
}

TEST(Endpoint, ComparesAddressAndPort) {
  const Endpoint e = parse_endpoint("127.0.0.1:1", "--peer");
  EXPECT_EQ(e, parse_endpoint("127.0.0.1:1", "--peer"));
  EXPECT_NE(e, parse_endpoint("127.0.0.1:2", "--peer"));
  EXPECT_NE(e, parse_endpoint("127.0.0.2:1", "--peer"));
  EXPECT_NE(e, parse_endpoint("[::1]:1", "--peer"));
}

TEST(Endpoint, LooksUpAHostName) {
  EXPECT_EQ(to_string(parse_endpoint("localhost:45001", "--peer")), "127.0.0.1:45001");
  EXPECT_NE(sentence([] { parse_endpoint("no-such-host.invalid:1", "--peer"); }).find("cannot be looked up"),
            std::string::npos);
}

TEST(Endpoint, RefusesTheRestInASentence) {
  for (const char* s : {"", ":", "127.0.0.1", "127.0.0.1:", ":45001", "127.0.0.1:65536", "127.0.0.1:-1", "127.0.0.1:1x",
                        "local host:45001", "[localhost]:45001", "256.0.0.1:45001", "::1:45001", "[127.0.0.1]:45001",
                        "[::1]45001", "127.0.0.1: 1"}) {
    const std::string said = sentence([&] { parse_endpoint(s, "--peer"); });
    EXPECT_EQ(said.rfind("--peer: '" + std::string{s} + "' is not ADDR:PORT", 0), 0U) << said;
  }
}

/// They were taken, and nobody ever came.
TEST(Endpoint, RefusesGroupsAndALinkLocalAddressWithoutItsInterface) {
  for (const std::string s : {"224.0.0.1:45001", "255.255.255.255:45001", "[ff02::1]:45001"})
    EXPECT_EQ(sentence([&] { parse_allowed_endpoint(s, "--peer", false, true); }),
              "--peer: '" + s + "' is the address of a group; give that of one machine");
  for (const std::string s : {"[fe80::1]:45001", "[fe80::1%no-such]:45001"})
    EXPECT_EQ(sentence([&] { parse_allowed_endpoint(s, "--listen", true, false); }),
              "--listen: '" + s +
                  "' is valid on one interface only, which is missing; give it too, as in [fe80::1%eth0]:45001");
  EXPECT_EQ(parse_allowed_endpoint("[fe80::1%lo]:45001", "--peer", true, false).port, 45001);
}

TEST(UdpSocket, CarriesADatagramAndItsSource) {
  for (const char* where : {"127.0.0.1:0", "[::1]:0"}) {
    UdpSocket a = socket_on(where), b = socket_on(where);
    EXPECT_NE(a.local().port, 0);
    EXPECT_FALSE(b.receive(Duration{0}));
    ASSERT_TRUE(a.send(bytes("hello"), b.local(), Duration{0}));
    const auto got = wait_for(b);
    ASSERT_TRUE(got) << where;
    EXPECT_EQ(text(*got), "hello");
    EXPECT_EQ(got->from, a.local());
    EXPECT_FALSE(b.receive(Duration{0}));
  }
}

TEST(UdpSocket, SaysWhichPortIsInUseAndWhatToDo) {
  const UdpSocket first = socket_on("127.0.0.1:0");
  const std::string said = sentence([&] { UdpSocket second{first.local()}; });
  EXPECT_EQ(said.rfind("cannot listen on " + to_string(first.local()) + ": the port is in use", 0), 0U) << said;
  EXPECT_NE(said.find("choose another port"), std::string::npos) << said;
}

TEST(UdpSocket, SaysThatAnAddressIsNotHere) {
  const std::string said = sentence([] { socket_on("192.0.2.1:0"); });
  EXPECT_NE(said.find("no interface of this machine has that address"), std::string::npos) << said;
}

TEST(UdpSocket, OutlivesAPeerThatIsGone) {
  UdpSocket a = socket_on("127.0.0.1:0");
  Endpoint gone;
  {
    const UdpSocket b = socket_on("127.0.0.1:0");
    gone = b.local();
  }
  for (int k = 0; k < 20; ++k) {
    a.send(bytes("anyone?"), gone, Duration{0});
    EXPECT_FALSE(a.receive(Duration{0}));
  }
  UdpSocket c = socket_on("127.0.0.1:0");
  ASSERT_TRUE(a.send(bytes("you?"), c.local(), Duration{0}));
  EXPECT_TRUE(wait_for(c));
}

TEST(UdpSocket, KeepsToOnePeer) {
  UdpSocket b = socket_on("127.0.0.1:0"), stranger = socket_on("127.0.0.1:0");
  UdpSocket a{parse_endpoint("127.0.0.1:0", "--listen"), b.local()};
  ASSERT_TRUE(stranger.send(bytes("me too"), a.local(), Duration{0}));
  ASSERT_TRUE(b.send(bytes("mine"), a.local(), Duration{0}));
  const auto got = wait_for(a);
  ASSERT_TRUE(got);
  EXPECT_EQ(text(*got), "mine");
  ASSERT_TRUE(a.send(bytes("back"), b.local(), Duration{0}));
  EXPECT_TRUE(wait_for(b));
}

TEST(UdpSocket, KeepsToAPeerThatIsNotThereYet) {
  Endpoint later;
  {
    const UdpSocket b = socket_on("127.0.0.1:0");
    later = b.local();
  }
  UdpSocket a{parse_endpoint("127.0.0.1:0", "--listen"), later};
  // Each of these brings an error back, which the next meets.
  for (int k = 0; k < 20; ++k) EXPECT_TRUE(a.send(bytes("there?"), later, Duration{0}));
  for (int k = 0; k < 20; ++k) {
    EXPECT_TRUE(a.send(bytes("there?"), later, Duration{0}));
    EXPECT_FALSE(a.receive(Duration{0}));
  }
  EXPECT_EQ(a.counts().unsent, 0U);
  UdpSocket b{later};
  ASSERT_TRUE(a.send(bytes("now?"), later, Duration{0}));
  ASSERT_TRUE(wait_for(b));
  ASSERT_TRUE(b.send(bytes("yes"), a.local(), Duration{0}));
  EXPECT_TRUE(wait_for(a));
}

TEST(UdpSocket, RefusesAPeerThatIsNobody) {
  const Endpoint here = parse_endpoint("127.0.0.1:0", "--listen");
  EXPECT_THROW((UdpSocket{here, here}), ConfigError);
  EXPECT_THROW((UdpSocket{here, parse_endpoint("0.0.0.0:45001", "--peer")}), ConfigError);
}

TEST(UdpSocket, SaysThatADatagramArrivedBeforeItWasReceived) {
  UdpSocket a = socket_on("127.0.0.1:0"), b = socket_on("127.0.0.1:0");
  ASSERT_TRUE(a.send(bytes("hello"), b.local(), Duration{0}));
  const auto got = wait_for(b);
  ASSERT_TRUE(got);
  EXPECT_LT(got->arrived, Duration{0});
}

TEST(UdpSocket, KeepsTheOrderOfMoreThanABatch) {
  UdpSocket a = socket_on("127.0.0.1:0"), b = socket_on("127.0.0.1:0");
  for (char k = 0; k < 100; ++k) ASSERT_TRUE(a.send(bytes({&k, 1}), b.local(), Duration{0}));
  for (char k = 0; k < 100; ++k) {
    const auto got = wait_for(b);
    ASSERT_TRUE(got);
    EXPECT_EQ(text(*got), std::string(1, k));
    EXPECT_EQ(got->from, a.local());
  }
  EXPECT_FALSE(b.receive(Duration{0}));
}

// Two datagrams are fetched by themselves, then batches of 16. Whoever takes long with them gets no other one in this tick.
TEST(UdpSocket, FetchesNoFurtherBatchWhenItsTimeOfATickIsOver) {
  UdpSocket a = socket_on("127.0.0.1:0"), b = socket_on("127.0.0.1:0");
  // The limit is half a second, whatever a busy machine does meanwhile; it passes within the first batch.
  constexpr std::chrono::milliseconds kLimit{500};
  const auto received = [&](Duration now, bool takes_long) {
    int n = 0;
    for (; b.receive(now); ++n)
      if (takes_long && n == 10) std::this_thread::sleep_for(kLimit);
    return n;
  };
  const auto flood = [&] {
    for (int k = 0; k < 100; ++k) ASSERT_TRUE(a.send(bytes("x"), b.local(), Duration{0}));
  };
  flood();
  b.limit(kLimit);
  EXPECT_EQ(received(std::chrono::milliseconds{1}, true), 18);
  EXPECT_EQ(received(std::chrono::milliseconds{1}, false), 0) << "the same tick";
  EXPECT_EQ(received(std::chrono::milliseconds{2}, true), 16) << "the next";
  b.limit(std::chrono::hours{1});
  EXPECT_EQ(received(std::chrono::milliseconds{3}, false), 66) << "nothing is lost";
  flood();
  b.limit(Duration::max());
  EXPECT_EQ(received(std::chrono::milliseconds{4}, true), 100) << "without a limit";
}

// Zero bytes are a datagram, not the end of the queue; neither is one that is too long.
TEST(UdpSocket, PassesOnAnyLengthWithoutStopping) {
  for (const std::size_t before : {0U, 1U, 2U, 17U, 18U}) {
    UdpSocket a = socket_on("127.0.0.1:0"), b = socket_on("127.0.0.1:0");
    const std::vector<std::byte> lengths[] = {std::vector<std::byte>(0), std::vector<std::byte>(9000),
                                              std::vector<std::byte>(1), std::vector<std::byte>(1472)};
    for (std::size_t k = 0; k < before; ++k) ASSERT_TRUE(a.send(bytes("x"), b.local(), Duration{0}));
    for (const auto& each : lengths) ASSERT_TRUE(a.send(each, b.local(), Duration{0}));
    for (std::size_t k = 0; k < before; ++k) ASSERT_EQ(text(*wait_for(b)), "x");
    for (const auto& each : lengths) {
      const auto got = wait_for(b);
      ASSERT_TRUE(got) << before;
      EXPECT_EQ(got->bytes.size(), std::min<std::size_t>(each.size(), 1500)) << before;
      EXPECT_EQ(got->from, a.local());
    }
    EXPECT_FALSE(b.receive(Duration{0}));
  }
}

// Every number of datagrams around the limits of what one call fetches; a poll that finds none changes nothing.
TEST(UdpSocket, FindsAllOfABurst) {
  UdpSocket a = socket_on("127.0.0.1:0"), b = socket_on("127.0.0.1:0");
  for (char burst = 1; burst < 60; ++burst) {
    for (char k = 0; k < burst; ++k) ASSERT_TRUE(a.send(bytes({&k, 1}), b.local(), Duration{0}));
    char got = 0;
    for (; const auto d = b.receive(Duration{burst}); ++got) EXPECT_EQ(text(*d), std::string(1, got));
    EXPECT_EQ(got, burst) << "in one poll";
    for (int k = 0; k < 3; ++k) EXPECT_FALSE(b.receive(Duration{burst}));
  }
}

// Once it is paired the peer has a socket of its own on the same port. Both are heard, by their own addresses.
TEST(UdpSocket, HearsTheOthersBesideItsPeer) {
  for (const char* where : {"127.0.0.1:0", "[::1]:0"}) {
    UdpSocket slave = socket_on(where);
    UdpSocket master{parse_endpoint(where, "--listen"), slave.local()};
    UdpSocket stranger = socket_on(where), next{parse_endpoint(where, "--listen"), slave.local()};
    ASSERT_TRUE(master.send(bytes("before"), slave.local(), Duration{0}));
    ASSERT_TRUE(wait_for(slave));
    Duration now{0};
    const auto hears = [&](UdpSocket& from, int n) {
      for (int k = 0; k < n; ++k) ASSERT_TRUE(from.send(bytes("x"), slave.local(), now));
      now += std::chrono::milliseconds{1};
      int got = 0;
      for (; const auto d = slave.receive(now); ++got) EXPECT_EQ(d->from, from.local());
      EXPECT_EQ(got, n) << where;
    };
    for (UdpSocket* const peer : {&master, &next, &master}) {
      slave.paired(peer->local(), now);
      for (const int n : {1, 0, 2, 3, 40})
        hears(*peer, n), hears(stranger, n), hears(peer == &master ? next : master, n);
      ASSERT_TRUE(slave.send(bytes("answer"), peer->local(), now));
      const auto answer = wait_for(*peer);
      ASSERT_TRUE(answer);
      EXPECT_EQ(answer->from, slave.local()) << "the port that the peer knows";
      ASSERT_TRUE(slave.send(bytes("answer"), stranger.local(), now));
      ASSERT_TRUE(wait_for(stranger));
    }
    EXPECT_EQ(slave.counts().unsent, 0U);
  }
}

// A machine has several addresses: the answer comes from the one that was called, before and after pairing, since a caller drops what
// comes from another.
TEST(UdpSocket, AnswersFromTheAddressThatWasCalled) {
  for (const char* all : {"0.0.0.0:0", "[::]:0"}) {
    UdpSocket slave = socket_on(all);
    Endpoint first = parse_endpoint("127.0.0.1:0", "--peer"), second = parse_endpoint("127.0.0.2:0", "--peer");
    first.port = second.port = slave.local().port;
    UdpSocket near{parse_endpoint("127.0.0.1:0", "--listen"), first};
    UdpSocket master{parse_endpoint("127.0.0.1:0", "--listen"), second};
    Duration now{0};
    for (int k = 0; k < 3; ++k) {
      for (UdpSocket* const caller : {&near, &master}) {
        now += std::chrono::milliseconds{1};
        ASSERT_TRUE(caller->send(bytes("call"), caller == &near ? first : second, now));
        const auto call = slave.receive(now);
        ASSERT_TRUE(call) << all << ", call " << k;
        ASSERT_TRUE(slave.send(bytes("answer"), call->from, now));
        ASSERT_TRUE(caller->receive(now)) << all << ", call " << k;
        if (caller == &master) slave.paired(call->from, now);
      }
    }
    EXPECT_EQ(slave.counts().unsent, 0U);
  }
}

// What the peer sent before it was paired comes before what it sends after.
TEST(UdpSocket, PairingKeepsTheOrderOfThePeersDatagrams) {
  UdpSocket slave = socket_on("127.0.0.1:0");
  UdpSocket first{parse_endpoint("127.0.0.1:0", "--listen"), slave.local()};
  UdpSocket second{parse_endpoint("127.0.0.1:0", "--listen"), slave.local()};
  Duration now{0};
  for (UdpSocket* const master : {&first, &second, &first}) {
    for (const char* each : {"0", "1", "2"}) ASSERT_TRUE(master->send(bytes(each), slave.local(), now));
    const auto before = slave.receive(now += std::chrono::milliseconds{1});
    ASSERT_TRUE(before);
    EXPECT_EQ(text(*before), "0");
    slave.paired(master->local(), now);
    for (const char* each : {"3", "4"}) ASSERT_TRUE(master->send(bytes(each), slave.local(), now));
    now += std::chrono::microseconds{100};
    for (const char* each : {"1", "2", "3", "4"}) {
      auto got = slave.receive(now);
      if (!got) got = slave.receive(now += std::chrono::microseconds{100});
      ASSERT_TRUE(got) << each;
      EXPECT_EQ(text(*got), each);
      EXPECT_EQ(got->from, master->local());
    }
    EXPECT_FALSE(slave.receive(now));
  }
}

// What strangers send does not push out what the peer sends.
TEST(UdpSocket, OthersDoNotFillTheQueueOfThePeer) {
  UdpSocket slave = socket_on("127.0.0.1:0"), stranger = socket_on("127.0.0.1:0");
  UdpSocket master{parse_endpoint("127.0.0.1:0", "--listen"), slave.local()};
  slave.paired(master.local(), Duration{0});
  ASSERT_FALSE(slave.receive(Duration{0}));
  for (int k = 0; k < 5000; ++k) stranger.send(bytes("flood"), slave.local(), Duration{0});
  ASSERT_TRUE(master.send(bytes("mine"), slave.local(), Duration{0}));
  const auto got = slave.receive(Duration{0});
  ASSERT_TRUE(got);
  EXPECT_EQ(text(*got), "mine");
}

// Nor does it keep the receiver from the peer: each tick begins with the peer, however much the others have left.
TEST(UdpSocket, HearsItsPeerFirstWhileAQueueOfOthersNeverEnds) {
  UdpSocket slave = socket_on("127.0.0.1:0"), stranger = socket_on("127.0.0.1:0");
  UdpSocket master{parse_endpoint("127.0.0.1:0", "--listen"), slave.local()};
  slave.paired(master.local(), Duration{0});
  ASSERT_FALSE(slave.receive(Duration{0}));
  for (int k = 1; k <= 50; ++k) {
    const Duration now = k * std::chrono::milliseconds{1};
    for (int i = 0; i < 100; ++i) stranger.send(bytes("flood"), slave.local(), now);
    ASSERT_TRUE(master.send(bytes("mine"), slave.local(), now));
    bool heard = false;
    for (int i = 0; i < 40; ++i) {  // no tick takes all
      const auto got = slave.receive(now);
      heard = heard || (got && text(*got) == "mine");
    }
    EXPECT_TRUE(heard) << "in tick " << k;
  }
}

// Another user's program that tries to bind all the time finds no moment in which it may.
TEST(UdpSocket, SharesItsPortWithNoOtherUserWhilePairing) {
  if (::geteuid() != 0) GTEST_SKIP() << "only root can become another user";
  UdpSocket slave = socket_on("127.0.0.1:0");
  UdpSocket a{parse_endpoint("127.0.0.1:0", "--listen"), slave.local()};
  UdpSocket b{parse_endpoint("127.0.0.1:0", "--listen"), slave.local()};
  const pid_t thief = ::fork();
  if (thief == 0) {
    constexpr uid_t kNobody = 65534;
    if (::setresuid(kNobody, kNobody, kNobody) != 0) ::_exit(2);
    sockaddr_in there{};
    there.sin_family = AF_INET;
    there.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    there.sin_port = htons(slave.local().port);
    const int other = ::socket(AF_INET, SOCK_DGRAM, 0), yes = 1;
    for (const int option : {SO_REUSEADDR, SO_REUSEPORT}) ::setsockopt(other, SOL_SOCKET, option, &yes, sizeof yes);
    while (::bind(other, reinterpret_cast<const sockaddr*>(&there), sizeof there) != 0) {
    }
    ::_exit(1);
  }
  ASSERT_GT(thief, 0);
  const auto end = Clock::now() + std::chrono::seconds{1};
  while (Clock::now() < end)
    for (const UdpSocket* const master : {&a, &b}) slave.paired(master->local(), Duration{0});
  int status = 0;
  EXPECT_EQ(::waitpid(thief, &status, WNOHANG), 0) << "it has bound the port";
  ::kill(thief, SIGKILL);
  ::waitpid(thief, &status, 0);
}

TEST(UdpSocket, SharesItsPortWithNobodyAfterPairing) {
  UdpSocket slave = socket_on("127.0.0.1:0");
  UdpSocket master{parse_endpoint("127.0.0.1:0", "--listen"), slave.local()};
  slave.paired(master.local(), Duration{0});
  const int other = ::socket(AF_INET, SOCK_DGRAM, 0), yes = 1;
  for (const int option : {SO_REUSEADDR, SO_REUSEPORT})
    ASSERT_EQ(::setsockopt(other, SOL_SOCKET, option, &yes, sizeof yes), 0);
  sockaddr_in there{};
  there.sin_family = AF_INET;
  there.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  there.sin_port = htons(slave.local().port);
  EXPECT_NE(::bind(other, reinterpret_cast<sockaddr*>(&there), sizeof there), 0);
  ::close(other);
}

// A paired peer that has gone answers with ICMP errors; the others are still heard, and it is when it is back.
TEST(UdpSocket, OutlivesAPairedPeerThatIsGone) {
  UdpSocket slave = socket_on("127.0.0.1:0"), stranger = socket_on("127.0.0.1:0");
  Endpoint gone;
  {
    const UdpSocket master = socket_on("127.0.0.1:0");
    gone = master.local();
    slave.paired(gone, Duration{0});
  }
  Duration now{0};
  for (int k = 0; k < 20; ++k) {
    now += std::chrono::milliseconds{1};
    EXPECT_TRUE(slave.send(bytes("there?"), gone, now));
    ASSERT_TRUE(stranger.send(bytes("me"), slave.local(), now));
    const auto got = slave.receive(now);
    ASSERT_TRUE(got);
    EXPECT_EQ(got->from, stranger.local());
    EXPECT_FALSE(slave.receive(now));
  }
  UdpSocket master{gone};
  ASSERT_TRUE(master.send(bytes("back"), slave.local(), now));
  const auto got = wait_for(slave);
  ASSERT_TRUE(got);
  EXPECT_EQ(got->from, gone);
}

// At most as long as it is told, and no longer than until something is there: of the peer, of others, or fetched before.
// From the listening socket, from that of a peer, and from one that is connected.
TEST(UdpSocket, MarksWhatItSends) {
  for (const bool v6 : {false, true}) {
    const int receiver = ::socket(v6 ? AF_INET6 : AF_INET, SOCK_DGRAM, 0), yes = 1;
    const timeval at_most{.tv_sec = 5, .tv_usec = 0};
    ASSERT_EQ(::setsockopt(receiver, SOL_SOCKET, SO_RCVTIMEO, &at_most, sizeof at_most), 0);
    ASSERT_EQ(v6 ? ::setsockopt(receiver, IPPROTO_IPV6, IPV6_RECVTCLASS, &yes, sizeof yes)
                 : ::setsockopt(receiver, IPPROTO_IP, IP_RECVTOS, &yes, sizeof yes),
              0);
    sockaddr_storage name{};
    socklen_t size = v6 ? sizeof(sockaddr_in6) : sizeof(sockaddr_in);
    name.ss_family = v6 ? AF_INET6 : AF_INET;
    (v6 ? reinterpret_cast<sockaddr_in6*>(&name)->sin6_addr.s6_addr[15]
        : reinterpret_cast<unsigned char*>(&reinterpret_cast<sockaddr_in*>(&name)->sin_addr)[3]) = 1;
    if (!v6) reinterpret_cast<unsigned char*>(&reinterpret_cast<sockaddr_in*>(&name)->sin_addr)[0] = 127;
    ASSERT_EQ(::bind(receiver, reinterpret_cast<sockaddr*>(&name), size), 0);
    ASSERT_EQ(::getsockname(receiver, reinterpret_cast<sockaddr*>(&name), &size), 0);
    const auto port =
        ntohs(v6 ? reinterpret_cast<sockaddr_in6*>(&name)->sin6_port : reinterpret_cast<sockaddr_in*>(&name)->sin_port);
    const Endpoint there = parse_endpoint((v6 ? "[::1]:" : "127.0.0.1:") + std::to_string(port), "--peer");
    const auto octet = [&] {
      std::array<char, 64> text{};
      alignas(cmsghdr) std::array<char, 64> control{};
      iovec data{text.data(), text.size()};
      msghdr message{};
      message.msg_iov = &data;
      message.msg_iovlen = 1;
      message.msg_control = control.data();
      message.msg_controllen = control.size();
      if (::recvmsg(receiver, &message, 0) < 0 || CMSG_FIRSTHDR(&message) == nullptr) return -1;
      return static_cast<int>(*CMSG_DATA(CMSG_FIRSTHDR(&message)));
    };
    const char* any = v6 ? "[::1]:0" : "127.0.0.1:0";
    UdpSocket listener = socket_on(any), caller{parse_endpoint(any, "--listen"), there};
    for (UdpSocket* each : {&listener, &caller}) {
      ASSERT_TRUE(each->send(bytes("plain"), there, Duration{0}));
      EXPECT_EQ(octet(), 0);
      each->mark(46);
      ASSERT_TRUE(each->send(bytes("marked"), there, Duration{0}));
      EXPECT_EQ(octet(), 46 << 2);
    }
    listener.paired(there, Duration{0});
    ASSERT_TRUE(listener.send(bytes("to the peer"), there, Duration{0}));
    EXPECT_EQ(octet(), 46 << 2);
    ::close(receiver);
  }
}

TEST(UdpSocket, SleepsUntilADatagramIsThere) {
  UdpSocket slave = socket_on("127.0.0.1:0"), stranger = socket_on("127.0.0.1:0");
  UdpSocket master{parse_endpoint("127.0.0.1:0", "--listen"), slave.local()};
  const auto slept = [&](std::chrono::milliseconds at_most) {
    const auto began = Clock::now();
    slave.wait(at_most);
    return Clock::now() - began;
  };
  constexpr std::chrono::seconds kLong{20};
  Duration now{0};
  for (const bool paired : {false, true}) {
    if (paired) slave.paired(master.local(), now);
    EXPECT_GE(slept(std::chrono::milliseconds{20}), std::chrono::milliseconds{20});
    for (UdpSocket* const from : {&master, &stranger}) {
      for (int k = 0; k < 4; ++k) ASSERT_TRUE(from->send(bytes("x"), slave.local(), now));
      now += std::chrono::milliseconds{1};
      for (int k = 0; k < 4; ++k) {
        EXPECT_LT(slept(kLong), kLong / 2) << "as " << k << " have been taken";
        EXPECT_TRUE(slave.receive(now));
      }
      EXPECT_FALSE(slave.receive(now));
    }
  }
}

TEST(UdpSocket, CountsWhatCannotBeSent) {
  UdpSocket a = socket_on("127.0.0.1:0");
  const std::vector<std::byte> too_long(70'000);
  EXPECT_FALSE(a.send(too_long, a.local(), Duration{0}));
  EXPECT_EQ(a.counts().unsent, 1U);
}

TEST(UdpSocket, CutsWhatIsTooLongToALengthThatShows) {
  UdpSocket a = socket_on("127.0.0.1:0"), b = socket_on("127.0.0.1:0");
  const std::vector<std::byte> long_one(9000);
  ASSERT_TRUE(a.send(long_one, b.local(), Duration{0}));
  const auto got = wait_for(b);
  ASSERT_TRUE(got);
  EXPECT_GT(got->bytes.size(), 1024U);
  EXPECT_LT(got->bytes.size(), 9000U);
}

TEST(UdpSocket, DoesNotAllocate) {
  UdpSocket a = socket_on("127.0.0.1:0"), b = socket_on("127.0.0.1:0");
  const std::array<std::byte, 300> payload{};
  int got = 0;
  UdpSocket everywhere = socket_on("0.0.0.0:0");
  const Endpoint called = [&] {
    Endpoint e = parse_endpoint("127.0.0.2:0", "--peer");
    e.port = everywhere.local().port;
    return e;
  }();
  const NoAlloc guard;
  for (int k = 0; k < 20; ++k) {
    a.send(payload, called, Duration{k});
    while (const auto call = everywhere.receive(Duration{k})) everywhere.send(payload, call->from, Duration{k});
  }
  b.paired(a.local(), Duration{0});
  for (int k = 0; k < 200; ++k) {
    a.send(payload, b.local(), Duration{0});
    for (int i = 0; i < 10; ++i)
      if (b.receive(Duration{0})) ++got;
  }
  EXPECT_EQ(guard.seen(), 0);
  EXPECT_GT(got, 0);
}

}  // namespace
}  // namespace twoport::udp_test
