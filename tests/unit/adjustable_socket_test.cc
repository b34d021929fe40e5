#include "common/link/adjustable_socket.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <string>
#include <string_view>

#include "common/link/memory_network.h"
#include "tests/support/no_alloc.h"

namespace twoport {
namespace {

using namespace std::chrono_literals;

const Endpoint kHere = MemoryNetwork::address(1, 1), kThere = MemoryNetwork::address(2, 2);
constexpr AdjustableSocket::Room kRoom{1.0, 1000.0, 1000.0};

std::span<const std::byte> bytes(std::string_view text) {
  return std::as_bytes(std::span{text.data(), text.size()});
}
std::string next(DatagramSocket& socket, Duration now) {
  const auto d = socket.receive(now);
  return d ? std::string{reinterpret_cast<const char*>(d->bytes.data()), d->bytes.size()} : "nothing";
}

TEST(AdjustableSocket, AddsNothingAtFirst) {
  MemoryNetwork network;
  MemorySocket below = network.open(kHere, 0ms), there = network.open(kThere, 0ms);
  AdjustableSocket here{below, kThere, kRoom, 7};
  here.send(bytes("a"), kThere, 1ms);
  EXPECT_EQ(next(there, 2ms), "a");
  there.send(bytes("b"), kHere, 2ms);
  EXPECT_EQ(next(here, 3ms), "b");
  EXPECT_EQ(next(here, 3ms), "nothing");
}

TEST(AdjustableSocket, DelaysEachDirectionByItsOwn) {
  MemoryNetwork network;
  MemorySocket below = network.open(kHere, 0ms), there = network.open(kThere, 0ms);
  AdjustableSocket here{below, kThere, kRoom, 7};
  here.set_outgoing({.delay_s = 0.020});
  here.set_incoming({.delay_s = 0.005});
  here.send(bytes("a"), kThere, 1ms);
  there.send(bytes("b"), kHere, 1ms);
  for (int t = 2; t <= 20; ++t) {
    const std::string got = next(here, t * 1ms);
    EXPECT_EQ(got, t == 6 ? "b" : "nothing") << t;
    EXPECT_EQ(next(there, t * 1ms + 1us), "nothing") << t;
  }
  (void)next(here, 21ms);
  EXPECT_EQ(next(there, 21ms + 1us), "a");
}

TEST(AdjustableSocket, WhatIsOnItsWayIsNotOvertaken) {
  MemoryNetwork network;
  MemorySocket below = network.open(kHere, 0ms), there = network.open(kThere, 0ms);
  AdjustableSocket here{below, kThere, kRoom, 7};
  here.set_outgoing({.delay_s = 0.010});
  here.send(bytes("old"), kThere, 0ms);
  here.set_outgoing({});
  here.send(bytes("new"), kThere, 1ms);  // due at once, with the next receive
  std::string order;
  for (int t = 2; t < 15; ++t) {
    (void)next(here, t * 1ms);
    const std::string got = next(there, t * 1ms + 1us);
    if (got != "nothing") order += got + " ";
  }
  EXPECT_EQ(order, "new old ");  // a shorter delay reorders, as on a network whose route changes
  here.send(bytes("direct"), kThere, 20ms);
  EXPECT_EQ(next(there, 20ms + 1us), "direct") << "once the line is empty datagrams pass at once again";
}

TEST(AdjustableSocket, LosesTheStatedShareAndCountsIt) {
  MemoryNetwork network{1, 4096};
  MemorySocket below = network.open(kHere, 0ms), there = network.open(kThere, 0ms);
  AdjustableSocket here{below, kThere, kRoom, 7};
  here.set_outgoing({.loss = 0.3});
  int arrived = 0;
  constexpr int kSent = 4000;
  for (int t = 1; t <= kSent; ++t) {
    here.send(bytes("x"), kThere, t * 1ms);
    (void)here.receive(t * 1ms + 1us);
    while (there.receive(t * 1ms + 2us)) ++arrived;
  }
  EXPECT_NEAR(arrived, 0.7 * kSent, 4 * std::sqrt(0.21 * kSent));  // four standard deviations
  EXPECT_EQ(here.counts().lost + static_cast<std::uint64_t>(arrived), kSent);
}

// A flood of others: the peer's datagrams arrive as they would without it.
TEST(AdjustableSocket, DropsAndCountsWhatIsNotOfThePeer) {
  MemoryNetwork network{1, 4096};
  MemorySocket below = network.open(kHere, 0ms), there = network.open(kThere, 0ms);
  MemorySocket stranger = network.open(MemoryNetwork::address(3, 3), 0ms);
  AdjustableSocket here{below, kThere, {0.1, 10.0, 10.0}, 7};  // room for 513 datagrams
  here.set_incoming({.delay_s = 0.1});
  for (int k = 0; k < 1000; ++k) {
    stranger.send(bytes("flood"), kHere, k * 50us);
    EXPECT_EQ(next(here, k * 50us + 1us), "nothing");
  }
  there.send(bytes("of the peer"), kHere, 51ms);
  EXPECT_EQ(next(here, 52ms), "nothing");
  EXPECT_EQ(next(here, 150ms), "nothing");
  EXPECT_EQ(next(here, 152ms), "of the peer");
  EXPECT_EQ(here.counts().rejected.foreign_address, 1000u);
  EXPECT_EQ(here.counts().overflowed, 0u);
}

TEST(AdjustableSocket, AllocatesNothing) {
  MemoryNetwork network;
  MemorySocket below = network.open(kHere, 0ms), there = network.open(kThere, 0ms);
  AdjustableSocket here{below, kThere, kRoom, 7};
  const NoAlloc guard;
  for (int t = 1; t < 200; ++t) {
    here.set_outgoing({.delay_s = 1e-3 * (t % 9), .jitter_s = 1e-3 * (t % 3), .loss = 0.1 * (t % 2)});
    here.set_incoming({.delay_s = 1e-3 * (t % 5), .jitter_s = 0.0, .loss = 0.1});
    here.send(bytes("x"), kThere, t * 1ms);
    there.send(bytes("y"), kHere, t * 1ms);
    (void)here.receive(t * 1ms + 1us);
  }
  EXPECT_EQ(guard.seen(), 0);
}

}  // namespace
}  // namespace twoport
