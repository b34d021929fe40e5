#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/link/impaired_socket.h"
#include "tests/support/memory_network.h"
#include "tests/support/no_alloc.h"

namespace twoport::socket_test {
namespace {

using namespace std::chrono_literals;

const Endpoint kA = MemoryNetwork::address(1, 1), kB = MemoryNetwork::address(2, 2), kC = MemoryNetwork::address(3, 3);

std::span<const std::byte> bytes(std::string_view text) {
  return std::as_bytes(std::span{text.data(), text.size()});
}
std::string text(const std::optional<ReceivedDatagram>& d) {
  return d ? std::string{reinterpret_cast<const char*>(d->bytes.data()), d->bytes.size()} : "nothing";
}
std::vector<std::string> all(DatagramSocket& socket, Duration now) {
  std::vector<std::string> out;
  while (const auto d = socket.receive(now)) out.push_back(text(d));
  return out;
}
using Texts = std::vector<std::string>;

template <class Set>
ImpairmentOptions with(Set set) {
  ImpairmentOptions o;
  set(o);
  return o;
}

// ---- the network in memory

TEST(MemoryNetwork, CarriesADatagramAndItsSource) {
  MemoryNetwork network;
  MemorySocket a = network.open(kA, 0ms), b = network.open(kB, 0ms);
  EXPECT_TRUE(a.send(bytes("hello"), kB, 5ms));
  const auto got = b.receive(6ms);
  ASSERT_EQ(text(got), "hello");
  EXPECT_EQ(got->from, kA);
  EXPECT_EQ(got->arrived, 5ms);
  EXPECT_FALSE(b.receive(6ms));
  EXPECT_FALSE(a.receive(6ms));
}

TEST(MemoryNetwork, IsReadableStrictlyLaterThanItWasSent) {
  MemoryNetwork network;
  MemorySocket a = network.open(kA, 0ms), b = network.open(kB, 0ms);
  a.send(bytes("x"), kB, 5ms);
  EXPECT_FALSE(b.receive(5ms));
  EXPECT_TRUE(b.receive(5ms + 1ns));
}

TEST(MemoryNetwork, DelaysLosesAndRepeatsByTheDestination) {
  MemoryNetwork network;
  MemorySocket a = network.open(kA, 0ms), b = network.open(kB, 0ms), c = network.open(kC, 0ms);
  network.set_conditions(kB, {.impairment = with([](auto& o) {
                                o.delay_s = 0.010;
                                o.duplicate = 1.0;
                              })},
                         1);
  network.set_conditions(kC, {.impairment = with([](auto& o) { o.loss = 1.0; })}, 1);
  a.send(bytes("x"), kB, 0ms);
  a.send(bytes("x"), kC, 0ms);
  EXPECT_EQ(all(b, 9ms), Texts{});
  EXPECT_EQ(all(b, 10ms), (Texts{"x", "x"}));
  EXPECT_EQ(all(c, 1s), Texts{});
  EXPECT_EQ(c.counts().lost, 1U);
}

TEST(MemoryNetwork, WhatIsOnItsWayKeepsTheConditionsItWasSentUnder) {
  MemoryNetwork network;
  MemorySocket a = network.open(kA, 0ms), b = network.open(kB, 0ms);
  network.set_conditions({.impairment = with([](auto& o) { o.delay_s = 0.1; })});
  a.send(bytes("slow"), kB, 0ms);
  network.set_conditions({});
  a.send(bytes("fast"), kB, 1ms);
  EXPECT_EQ(all(b, 2ms), Texts{"fast"});
  EXPECT_EQ(all(b, 100ms), Texts{"slow"});
}

TEST(MemoryNetwork, DamagesAsOftenAsItIsTold) {
  MemoryNetwork network{7, 4096};
  MemorySocket a = network.open(kA, 0ms), b = network.open(kB, 0ms);
  network.set_conditions({.corruption = 0.25});
  const std::string whole(200, 'x');
  constexpr int kCount = 2000;
  for (int k = 0; k < kCount; ++k) a.send(bytes(whole), kB, Duration{k});
  int damaged = 0, shorter = 0;
  for (const std::string& got : all(b, 1s)) damaged += got != whole, shorter += got.size() < whole.size();
  // Four standard deviations of a binomial; that a byte is replaced by itself is rare.
  EXPECT_NEAR(damaged, 0.25 * kCount, 4 * std::sqrt(0.25 * 0.75 * kCount));
  EXPECT_NEAR(shorter, 0.05 * kCount, 4 * std::sqrt(0.05 * 0.95 * kCount));
}

TEST(MemoryNetwork, ASocketThatIsOpenedAgainGetsWhatIsStillOnItsWay) {
  MemoryNetwork network;
  network.set_conditions({.impairment = with([](auto& o) { o.delay_s = 0.010; })});
  MemorySocket a = network.open(kA, 0ms);
  {
    const MemorySocket first = network.open(kB, 0ms);
    a.send(bytes("due while nobody is there"), kB, 0ms);
    a.send(bytes("late"), kB, 15ms);
  }
  MemorySocket again = network.open(kB, 20ms);
  EXPECT_EQ(all(again, 30ms), Texts{"late"});
}

TEST(MemoryNetwork, AnAddressHasOneSocket) {
  MemoryNetwork network;
  const MemorySocket a = network.open(kA, 0ms);
  EXPECT_THROW(network.open(kA, 0ms), std::logic_error);
}

TEST(MemoryNetwork, StrangersSendFromAnyAddress) {
  MemoryNetwork network;
  MemorySocket a = network.open(kA, 0ms);
  network.send(bytes("me"), kC, kA, 0ms);
  EXPECT_EQ(a.receive(1ms)->from, kC);
}

TEST(MemoryNetwork, TheSameSeedGivesTheSameRun) {
  const auto run = [](std::uint64_t seed) {
    MemoryNetwork network{seed, 1024};
    MemorySocket a = network.open(kA, 0ms), b = network.open(kB, 0ms);
    network.set_conditions({.impairment = with([](auto& o) {
                              o.delay_s = 0.01;
                              o.jitter_s = 0.005;
                              o.loss = 0.3;
                            }),
                            .corruption = 0.3});
    for (int k = 0; k < 200; ++k) a.send(bytes(std::to_string(k) + " of two hundred"), kB, k * 1ms);
    return all(b, 10s);
  };
  EXPECT_EQ(run(1), run(1));
  EXPECT_NE(run(1), run(2));
}

// ---- the impaired socket

/// A network of the scene in front of a socket in memory, and two that send to it.
struct Impaired {
  explicit Impaired(const ImpairedSocketOptions& o) : filter{socket, o} {}
  void send(const Endpoint& from, const std::string& what, Duration now) { network.send(bytes(what), from, kA, now); }
  MemoryNetwork network{1, 4096};
  MemorySocket socket = network.open(kA, 0ms);
  ImpairedSocket filter;
};

TEST(ImpairedSocket, PassesWhatIsNotImpairedInTheTickInWhichItIsThere) {
  Impaired i{{}};
  i.send(kB, "x", 0ms);
  const auto got = i.filter.receive(1ms);
  ASSERT_EQ(text(got), "x");
  EXPECT_EQ(got->from, kB);
  EXPECT_LT(got->arrived, 1ms);
  EXPECT_EQ(i.filter.local(), kA);
}

TEST(ImpairedSocket, DelaysFromTheArrival) {
  Impaired i{{.incoming = with([](auto& o) { o.delay_s = 0.010; }), .peer = kB}};
  i.send(kB, "x", 0ms);
  for (Duration now = 1ms; now < 10ms; now += 1ms) ASSERT_FALSE(i.filter.receive(now));
  EXPECT_TRUE(i.filter.receive(10ms));
}

TEST(ImpairedSocket, DropsAllOthersWhereThePeerIsGiven) {
  Impaired i{{.peer = kB}};
  for (int k = 0; k < 5; ++k) i.send(kC, "stranger", 0ms);
  i.send(kB, "peer", 0ms);
  EXPECT_EQ(all(i.filter, 1ms), Texts{"peer"});
  EXPECT_EQ(i.filter.counts().rejected.total(), 5U);
}

TEST(ImpairedSocket, NoFloodOfOthersChangesWhatHappensToThePeersDatagrams) {
  const ImpairedSocketOptions rough{.incoming = with([](auto& o) {
                                      o.delay_s = 0.050;
                                      o.jitter_s = 0.010;
                                      o.loss = 0.3;
                                      o.duplicate = 0.1;
                                    }),
                                    .seed = 5,
                                    .peer_rate_hz = 1000};
  const auto run = [&](int flood) {
    Impaired i{rough};
    i.filter.paired(kB, 0ms);
    Texts heard;
    int from_others = 0;
    for (int k = 1; k < 2000; ++k) {
      for (int f = 0; f < flood; ++f) i.send(kC, "flood", k * 1ms);
      i.send(kB, std::to_string(k), k * 1ms);
      while (const auto d = i.filter.receive(k * 1ms + 500us)) {
        if (d->from == kB) heard.push_back(std::to_string(k) + ":" + text(d));
        from_others += d->from != kB;
      }
    }
    EXPECT_EQ(i.filter.counts().overflowed, 0U);
    EXPECT_EQ(from_others > 0, flood > 0);
    if (flood > 128) {
      EXPECT_GT(i.filter.counts().rejected.total(), static_cast<std::uint64_t>(flood - 128) * 1900);
    }
    return heard;
  };
  const Texts quiet = run(0);
  EXPECT_GT(quiet.size(), 1000U);
  EXPECT_EQ(run(200), quiet);
}

TEST(ImpairedSocket, ReadsNoMoreThanABoundedNumberInATick) {
  Impaired i{{}};
  i.filter.paired(kB, 0ms);
  for (int k = 0; k < 1000; ++k) i.send(kB, "x", 0ms);
  EXPECT_EQ(all(i.filter, 1ms).size(), 256U);
  EXPECT_EQ(all(i.filter, 1ms).size(), 0U);
  EXPECT_EQ(all(i.filter, 2ms).size(), 256U);
}

TEST(ImpairedSocket, BlackoutsCountFromTheFirstPairing) {
  Impaired i{{.incoming = with([](auto& o) { o.blackout = {{0.010, 0.005}}; }), .peer = kB}};
  Texts heard;
  for (int k = 0; k < 200; ++k) {
    i.send(kB, std::to_string(k), k * 1ms - 1ns);
    if (k == 100) i.filter.paired(kB, 100ms);
    for (const std::string& t : all(i.filter, k * 1ms)) heard.push_back(t);
    if (k == 150) i.filter.paired(kB, 150ms);  // a new session begins no new run
  }
  Texts expected;
  for (int k = 0; k < 200; ++k)
    if (k < 110 || k >= 115) expected.push_back(std::to_string(k));
  EXPECT_EQ(heard, expected);
  EXPECT_EQ(i.filter.counts().lost, 5U);
}

/// Without impairments datagrams come in the order of their arrival, whoever sends them, as they lie in the socket below.
TEST(ImpairedSocket, PassesWhatIsNotImpairedInOrderAndWithoutACopy) {
  class Below final : public DatagramSocket {
   public:
    bool send(std::span<const std::byte>, const Endpoint&, Duration) noexcept override { return true; }
    std::optional<ReceivedDatagram> receive(Duration now) noexcept override {
      ++asked;
      if (given == 4) return std::nullopt;
      const std::size_t k = given++;
      return ReceivedDatagram{{&all[k], 1}, k % 2 == 0 ? kB : kC, now - 1ns};
    }
    [[nodiscard]] const Endpoint& local() const noexcept override { return kA; }
    [[nodiscard]] SocketCounts counts() const noexcept override { return {}; }
    std::array<std::byte, 4> all{};
    std::size_t given = 0;
    int asked = 0;
  } below;
  ImpairedSocket filter{below, {}};
  filter.paired(kB, 0ms);
  for (std::size_t k = 0; k < 4; ++k) {
    const auto got = filter.receive(1ms);
    ASSERT_TRUE(got);
    EXPECT_EQ(got->bytes.data(), &below.all[k]);
    EXPECT_EQ(got->from, k % 2 == 0 ? kB : kC);
  }
  for (int k = 0; k < 3; ++k) EXPECT_FALSE(filter.receive(1ms));
  EXPECT_EQ(below.asked, 5) << "until it has nothing more";
  EXPECT_FALSE(filter.receive(2ms));
  EXPECT_EQ(below.asked, 6);
}

/// Datagrams without bytes, with and without impairments.
TEST(ImpairedSocket, PassesOnWhatIsEmpty) {
  for (const double delay_s : {0.0, 0.001}) {
    Impaired i{{.incoming = with([&](auto& o) { o.delay_s = delay_s; })}};
    i.send(kB, "", 0ms);
    i.send(kB, "x", 0ms);
    EXPECT_EQ(all(i.filter, 1ms), (Texts{"", "x"}));
  }
}

/// A socket that hands out one datagram of any length.
class Hands final : public DatagramSocket {
 public:
  explicit Hands(std::size_t size) : datagram_(size) {}
  bool send(std::span<const std::byte>, const Endpoint&, Duration) noexcept override { return true; }
  std::optional<ReceivedDatagram> receive(Duration now) noexcept override {
    if (std::exchange(given_, true)) return std::nullopt;
    return ReceivedDatagram{datagram_, kB, now - 1ns};
  }
  [[nodiscard]] const Endpoint& local() const noexcept override { return kA; }
  [[nodiscard]] SocketCounts counts() const noexcept override { return {}; }

 private:
  std::vector<std::byte> datagram_;
  bool given_ = false;
};

TEST(ImpairedSocket, RejectsWhatIsTooLong) {
  Hands longest{kMaxDatagramBytes}, too_long{kMaxDatagramBytes + 1};
  ImpairedSocket takes{longest, {}}, rejects{too_long, {}};
  EXPECT_TRUE(takes.receive(1ms));
  EXPECT_FALSE(rejects.receive(1ms));
  EXPECT_EQ(rejects.counts().rejected.total(), 1U);
}

TEST(ImpairedSocket, DoesNotAllocate) {
  Impaired i{{.incoming = with([](auto& o) {
                o.delay_s = 0.01;
                o.jitter_s = 0.01;
                o.loss = 0.1;
                o.duplicate = 0.2;
                o.reorder = 0.1;
              })}};
  const std::string what(300, 'x');
  std::size_t heard = 0;
  i.filter.paired(kB, 0ms);
  const NoAlloc guard;
  for (int k = 0; k < 1000; ++k) {
    i.network.send(bytes(what), kB, kA, k * 1ms);
    i.network.send(bytes(what), kC, kA, k * 1ms);
    i.filter.send(bytes(what), kB, k * 1ms);
    while (i.filter.receive(k * 1ms)) ++heard;
  }
  EXPECT_EQ(guard.seen(), 0);
  EXPECT_GT(heard, 1000U);
}

// ---- the same, changed while it runs

ImpairedSocketOptions adjustable(const Endpoint& peer, double longest_s = 1.0, double rate_hz = 1000.0) {
  return {.seed = 7, .peer_rate_hz = rate_hz, .peer = peer, .rate_hz = rate_hz, .longest_set_s = longest_s};
}

TEST(AdjustedSocket, AddsNothingAtFirst) {
  MemoryNetwork network;
  MemorySocket below = network.open(kA, 0ms), there = network.open(kB, 0ms);
  ImpairedSocket here{below, adjustable(kB)};
  here.send(bytes("a"), kB, 1ms);
  EXPECT_EQ(text(there.receive(2ms)), "a");
  there.send(bytes("b"), kA, 2ms);
  EXPECT_EQ(text(here.receive(3ms)), "b");
  EXPECT_EQ(text(here.receive(3ms)), "nothing");
}

TEST(AdjustedSocket, DelaysEachDirectionByItsOwn) {
  MemoryNetwork network;
  MemorySocket below = network.open(kA, 0ms), there = network.open(kB, 0ms);
  ImpairedSocket here{below, adjustable(kB)};
  here.set_outgoing({.delay_s = 0.020});
  here.set_incoming({.delay_s = 0.005});
  here.send(bytes("a"), kB, 1ms);
  there.send(bytes("b"), kA, 1ms);
  for (int t = 2; t <= 20; ++t) {
    const std::string got = text(here.receive(t * 1ms));
    EXPECT_EQ(got, t == 6 ? "b" : "nothing") << t;
    EXPECT_EQ(text(there.receive(t * 1ms + 1us)), "nothing") << t;
  }
  (void)text(here.receive(21ms));
  EXPECT_EQ(text(there.receive(21ms + 1us)), "a");
}

TEST(AdjustedSocket, WhatIsOnItsWayIsNotOvertaken) {
  MemoryNetwork network;
  MemorySocket below = network.open(kA, 0ms), there = network.open(kB, 0ms);
  ImpairedSocket here{below, adjustable(kB)};
  here.set_outgoing({.delay_s = 0.010});
  here.send(bytes("old"), kB, 0ms);
  here.set_outgoing({});
  here.send(bytes("new"), kB, 1ms);  // due at once, with the next receive
  std::string order;
  for (int t = 2; t < 15; ++t) {
    (void)text(here.receive(t * 1ms));
    const std::string got = text(there.receive(t * 1ms + 1us));
    if (got != "nothing") order += got + " ";
  }
  EXPECT_EQ(order, "new old ");  // a shorter delay reorders, as on a network whose route changes
  here.send(bytes("direct"), kB, 20ms);
  EXPECT_EQ(text(there.receive(20ms + 1us)), "direct") << "once the line is empty datagrams pass at once again";
}

TEST(AdjustedSocket, LosesTheStatedShareAndCountsIt) {
  MemoryNetwork network{1, 4096};
  MemorySocket below = network.open(kA, 0ms), there = network.open(kB, 0ms);
  ImpairedSocket here{below, adjustable(kB)};
  here.set_outgoing({.loss = 0.3});
  int arrived = 0;
  constexpr int kSent = 4000;
  for (int t = 1; t <= kSent; ++t) {
    here.send(bytes("x"), kB, t * 1ms);
    (void)here.receive(t * 1ms + 1us);
    while (there.receive(t * 1ms + 2us)) ++arrived;
  }
  EXPECT_NEAR(arrived, 0.7 * kSent, 4 * std::sqrt(0.21 * kSent));  // four standard deviations
  EXPECT_EQ(here.counts().lost + static_cast<std::uint64_t>(arrived), kSent);
}

// A flood of others: the peer's datagrams arrive as they would without it.
TEST(AdjustedSocket, DropsAndCountsWhatIsNotOfThePeer) {
  MemoryNetwork network{1, 4096};
  MemorySocket below = network.open(kA, 0ms), there = network.open(kB, 0ms);
  MemorySocket stranger = network.open(kC, 0ms);
  ImpairedSocket here{below, adjustable(kB, 0.1, 10.0)};  // room for 512 datagrams and few more
  here.set_incoming({.delay_s = 0.1});
  for (int k = 0; k < 1000; ++k) {
    stranger.send(bytes("flood"), kA, k * 50us);
    EXPECT_EQ(text(here.receive(k * 50us + 1us)), "nothing");
  }
  there.send(bytes("of the peer"), kA, 51ms);
  EXPECT_EQ(text(here.receive(52ms)), "nothing");
  EXPECT_EQ(text(here.receive(150ms)), "nothing");
  EXPECT_EQ(text(here.receive(152ms)), "of the peer");
  EXPECT_EQ(here.counts().rejected.foreign_address, 1000u);
  EXPECT_EQ(here.counts().overflowed, 0u);
}

TEST(AdjustedSocket, AllocatesNothing) {
  MemoryNetwork network;
  MemorySocket below = network.open(kA, 0ms), there = network.open(kB, 0ms);
  ImpairedSocket here{below, adjustable(kB)};
  const NoAlloc guard;
  for (int t = 1; t < 200; ++t) {
    here.set_outgoing({.delay_s = 1e-3 * (t % 9), .jitter_s = 1e-3 * (t % 3), .loss = 0.1 * (t % 2)});
    here.set_incoming({.delay_s = 1e-3 * (t % 5), .jitter_s = 0.0, .loss = 0.1});
    here.send(bytes("x"), kB, t * 1ms);
    there.send(bytes("y"), kA, t * 1ms);
    (void)here.receive(t * 1ms + 1us);
  }
  EXPECT_EQ(guard.seen(), 0);
}

}  // namespace
}  // namespace twoport::socket_test
