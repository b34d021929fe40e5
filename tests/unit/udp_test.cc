#include "common/platform/udp.h"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "tests/support/no_alloc.h"

namespace twoport {
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

// A batch is 16 datagrams. Whoever takes long with them gets no other one in this tick.
TEST(UdpSocket, FetchesNoFurtherBatchWhenItsTimeOfATickIsOver) {
  UdpSocket a = socket_on("127.0.0.1:0"), b = socket_on("127.0.0.1:0");
  const auto received = [&](Duration now, std::chrono::milliseconds each) {
    int n = 0;
    for (; b.receive(now); ++n)
      for (const auto end = Clock::now() + each; Clock::now() < end;) {
      }
    return n;
  };
  const auto flood = [&] {
    for (int k = 0; k < 100; ++k) ASSERT_TRUE(a.send(bytes("x"), b.local(), Duration{0}));
  };
  flood();
  b.limit(std::chrono::milliseconds{5});
  EXPECT_EQ(received(std::chrono::milliseconds{1}, std::chrono::milliseconds{1}), 16);
  EXPECT_EQ(received(std::chrono::milliseconds{1}, std::chrono::milliseconds{0}), 0) << "the same tick";
  EXPECT_EQ(received(std::chrono::milliseconds{2}, std::chrono::milliseconds{1}), 16) << "the next";
  b.limit(std::chrono::hours{1});
  EXPECT_EQ(received(std::chrono::milliseconds{3}, std::chrono::milliseconds{0}), 68) << "nothing is lost";
  flood();
  b.limit(Duration::max());
  EXPECT_EQ(received(std::chrono::milliseconds{4}, std::chrono::milliseconds{1}), 100) << "without a limit";
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
  const NoAlloc guard;
  for (int k = 0; k < 200; ++k) {
    a.send(payload, b.local(), Duration{0});
    for (int i = 0; i < 10; ++i)
      if (b.receive(Duration{0})) ++got;
  }
  EXPECT_EQ(guard.seen(), 0);
  EXPECT_GT(got, 0);
}

}  // namespace
}  // namespace twoport
