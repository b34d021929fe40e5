#include "common/secure/secure_socket.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <cstring>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "tests/support/memory_network.h"
#include "tests/support/no_alloc.h"

// The filter in virtual time: handshakes run within receive().
namespace twoport {
namespace {

using namespace std::chrono_literals;

constexpr Duration kTick = 1ms;
const Endpoint kServerAt = MemoryNetwork::address(1, 45000);
const Endpoint kClientAt = MemoryNetwork::address(2, 50000);
const Endpoint kElsewhere = MemoryNetwork::address(3, 50000);

Key::Bytes key(std::uint8_t fill = 42) {
  Key::Bytes bytes;
  bytes.fill(fill);
  return bytes;
}

struct Weather {
  double delay_s = 0.0, jitter_s = 0.0, loss = 0.0, duplicate = 0.0, reorder = 0.0, damage = 0.0;
};
constexpr Weather kCalm{.delay_s = 0.002};

/// A filter over a socket of a memory network, which says a number each tick and counts those it hears.
class Side {
 public:
  Side(MemoryNetwork& network, bool server, const Endpoint& at, Duration now, const Key::Bytes& bytes = key())
      : socket_{network.open(at, now)},
        to_{server ? kClientAt : kServerAt},
        secure_{socket_, {.server = server, .peer = server ? std::nullopt : std::optional{kServerAt}}, Key{bytes}} {}

  void tick(Duration now) {
    heard_in_tick = 0;
    while (const auto datagram = secure_.receive(now)) {
      ++heard, ++heard_in_tick;
      to_ = datagram->from;
      std::uint64_t number = 0;
      if (datagram->bytes.size() == sizeof number) std::memcpy(&number, datagram->bytes.data(), sizeof number);
      numbers.push_back(number);
    }
    ++said_;
    secure_.send(std::as_bytes(std::span{&said_, 1}), to_, now);
  }

  SecureSocket& socket() { return secure_; }
  std::uint64_t heard = 0, heard_in_tick = 0;
  std::vector<std::uint64_t> numbers;

 private:
  MemorySocket socket_;
  Endpoint to_;
  std::uint64_t said_ = 0;
  SecureSocket secure_;
};

struct World {
  explicit World(std::uint64_t seed = 1) : network{seed, 8192} { set(kCalm); }
  void set(const Weather& weather) {
    MemoryNetwork::Conditions c;
    c.impairment.delay_s = weather.delay_s;
    c.impairment.jitter_s = weather.jitter_s;
    c.impairment.loss = weather.loss;
    c.impairment.duplicate = weather.duplicate;
    c.impairment.reorder = weather.reorder;
    c.impairment.reorder_s = 0.05;
    c.corruption = weather.damage;
    network.set_conditions(c);
  }
  void start_server(const Key::Bytes& bytes = key()) {
    server.reset();
    server = std::make_unique<Side>(network, true, kServerAt, now, bytes);
  }
  void start_client(const Endpoint& at = kClientAt, const Key::Bytes& bytes = key()) {
    client.reset();
    client = std::make_unique<Side>(network, false, at, now, bytes);
  }
  void tick() {
    now += kTick;
    if (server) server->tick(now);
    if (client) client->tick(now);
  }
  void run(Duration span) {
    for (const Duration end = now + span; now < end;) tick();
  }
  /// Until both hear each other; how long it took, or -1 ns.
  Duration until_both_hear(Duration patience = 30s) {
    const Duration from = now;
    const std::uint64_t s = server->heard, c = client->heard;
    while (now - from < patience) {
      tick();
      if (server->heard > s + 3 && client->heard > c + 3) return now - from;
    }
    return Duration{-1};
  }

  MemoryNetwork network;
  Duration now{0};
  std::unique_ptr<Side> server, client;
};

TEST(SecureSocket, CarriesDatagramsBetweenTwoHoldersOfTheKey) {
  World w;
  w.start_server();
  w.start_client();
  const Duration took = w.until_both_hear();
  ASSERT_GE(took, 0ns);
  EXPECT_LT(took, 50ms) << "three round trips of 4 ms";
  const std::uint64_t before = w.server->heard;
  w.run(1s);
  EXPECT_EQ(w.server->heard, before + 1000);
  EXPECT_EQ(w.server->socket().associations(), 1U);
  EXPECT_EQ(w.client->socket().associations(), 1U);
  EXPECT_EQ(w.server->socket().counts().rejected.total(), 0U);
}

TEST(SecureSocket, HandsNothingDownInPlainText) {
  World w;
  w.start_server();
  MemorySocket spy = w.network.open(kElsewhere, w.now);
  SecureSocket alone{spy, {.server = false, .peer = kServerAt}, Key{key()}};
  const std::string secret = "a secret of sixteen bytes or more";
  EXPECT_FALSE(alone.send(std::as_bytes(std::span{secret}), kServerAt, 0ms));
  EXPECT_EQ(alone.counts().unsent, 1U);
}

TEST(SecureSocket, AnotherKeyDoesNotConnectAndBothSidesSaySo) {
  World w;
  w.set({.delay_s = 0.05});
  w.start_server();
  w.start_client(kClientAt, key(43));
  w.run(1s);
  EXPECT_EQ(w.server->heard + w.client->heard, 0U);
  EXPECT_EQ(w.server->socket().associations() + w.client->socket().associations(), 0U);
  EXPECT_EQ(w.client->socket().last_failure(), HandshakeFailure::other_key);
  EXPECT_EQ(w.server->socket().last_failure(), HandshakeFailure::other_key);
  w.start_client();
  EXPECT_GE(w.until_both_hear(), 0ns);
  EXPECT_EQ(w.client->socket().last_failure(), HandshakeFailure::none);
}

TEST(SecureSocket, ConnectsThroughHeavyLossDelayReorderingAndDamage) {
  Duration worst{0}, sum{0};
  constexpr int kRuns = 100;
  for (std::uint64_t seed = 1; seed <= kRuns; ++seed) {
    World w{seed};
    w.set({.delay_s = 0.02, .jitter_s = 0.01, .loss = 0.3, .duplicate = 0.1, .reorder = 0.1, .damage = 0.05});
    w.start_server();
    w.start_client();
    const Duration took = w.until_both_hear();
    ASSERT_GE(took, 0ns) << "seed " << seed;
    worst = std::max(worst, took), sum += took;
  }
  std::cout << "30 % loss each way: connected after " << to_seconds(sum / kRuns).si() << " s on average, "
            << to_seconds(worst).si() << " s at most\n";
  EXPECT_LT(sum / kRuns, 2s);
  // DTLS repeats a flight after 1, 2, 4, 8 s. Of 600 seeds one in 50 takes more than 6 s.
  EXPECT_LT(worst, 16s);
}

TEST(SecureSocket, ConnectsOverALongWay) {
  World w;
  w.set({.delay_s = 1.5});
  w.start_server();
  w.start_client();
  const Duration took = w.until_both_hear();
  ASSERT_GE(took, 0ns);
  EXPECT_LT(took, 20s);
  // And stays: a handshake that takes seconds is not begun again for a quarter of a second of silence.
  const std::uint64_t before = w.server->socket().associations();
  w.run(60s);
  EXPECT_LE(w.server->socket().associations(), before + 1);
}

class Restart : public ::testing::TestWithParam<double> {};

TEST_P(Restart, OfTheServerIsFound) {
  World w{7};
  w.set({.delay_s = 0.005, .loss = GetParam()});
  w.start_server();
  w.start_client();
  ASSERT_GE(w.until_both_hear(), 0ns);
  w.run(1s);
  w.start_server();
  const Duration took = w.until_both_hear();
  ASSERT_GE(took, 0ns);
  EXPECT_LT(took, GetParam() > 0.0 ? 10s : 400ms);
}

TEST_P(Restart, OfTheClientIsTakenAtItsOldAddressAndAtANewOne) {
  World w{8};
  w.set({.delay_s = 0.005, .loss = GetParam()});
  w.start_server();
  w.start_client();
  ASSERT_GE(w.until_both_hear(), 0ns);
  for (const Endpoint& at : {kClientAt, kElsewhere, kClientAt}) {
    w.start_client(at);
    const Duration took = w.until_both_hear();
    ASSERT_GE(took, 0ns);
    EXPECT_LT(took, GetParam() > 0.0 ? 10s : 100ms);
  }
}
INSTANTIATE_TEST_SUITE_P(At, Restart, ::testing::Values(0.0, 0.3));

TEST(SecureSocket, FindsItsPeerAgainAfterALongSilence) {
  World w;
  w.start_server();
  w.start_client();
  ASSERT_GE(w.until_both_hear(), 0ns);
  w.set({.loss = 1.0});
  w.run(30s);
  const std::uint64_t heard = w.server->heard;
  w.run(1s);
  EXPECT_EQ(w.server->heard, heard);
  w.set(kCalm);
  const Duration took = w.until_both_hear();
  ASSERT_GE(took, 0ns);
  EXPECT_LT(took, 50ms) << "the association has lasted";
}

/// All that passes a place of the network, as an attacker there keeps it.
class Tap final : public DatagramSocket {
 public:
  Tap(DatagramSocket& below, std::vector<Datagram>& kept) : below_{&below}, kept_{&kept} {}
  bool send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept override {
    Datagram copy;
    copy.assign(bytes, to);
    kept_->push_back(copy);
    return below_->send(bytes, to, now);
  }
  std::optional<ReceivedDatagram> receive(Duration now) noexcept override { return below_->receive(now); }
  [[nodiscard]] const Endpoint& local() const noexcept override { return below_->local(); }
  [[nodiscard]] SocketCounts counts() const noexcept override { return below_->counts(); }

 private:
  DatagramSocket* below_;
  std::vector<Datagram>* kept_;
};

TEST(SecureSocket, ARecordedSessionSaidAgainChangesNothing) {
  World w;
  std::vector<Datagram> kept;
  w.start_server();
  {
    MemorySocket socket = w.network.open(kClientAt, w.now);
    Tap tap{socket, kept};
    SecureSocket client{tap, {.server = false, .peer = kServerAt}, Key{key()}};
    for (int k = 0; k < 500; ++k) {
      w.tick();
      while (client.receive(w.now)) {
      }
      client.send(std::as_bytes(std::span{"recorded", 8}), kServerAt, w.now);
    }
    ASSERT_GT(w.server->heard, 400U);
  }
  w.start_client();
  ASSERT_GE(w.until_both_hear(), 0ns);
  const std::uint64_t associations = w.server->socket().associations(), heard = w.server->heard;
  // All of it at once, from its own address and from another, three times, while the session goes on.
  std::uint64_t ticks = 0;
  for (int round = 0; round < 3; ++round)
    for (const Datagram& d : kept) {
      w.network.send(d.bytes(), kClientAt, kServerAt, w.now);
      w.network.send(d.bytes(), kElsewhere, kServerAt, w.now);
      w.tick(), ++ticks;
    }
  EXPECT_EQ(w.server->socket().associations(), associations);
  EXPECT_NEAR(static_cast<double>(w.server->heard - heard), static_cast<double>(ticks), 3.0)
      << "each of the session once";
  const Rejected r = w.server->socket().counts().rejected;
  EXPECT_GT(r.not_authentic + r.replayed, 1000U);
  EXPECT_GT(r.foreign_address, 1000U);
}

TEST(SecureSocket, WhatWasChangedOrSentTwiceIsDroppedAndCounted) {
  World w;
  w.start_server();
  w.start_client();
  ASSERT_GE(w.until_both_hear(), 0ns);
  w.set({.delay_s = 0.002, .duplicate = 0.5, .damage = 0.2});
  w.run(5s);
  w.set(kCalm);
  w.run(100ms);
  for (const Side* side : {w.server.get(), w.client.get()}) {
    std::vector<std::uint64_t> once = side->numbers;
    std::sort(once.begin(), once.end());
    EXPECT_EQ(std::adjacent_find(once.begin(), once.end()), once.end()) << "no number twice";
    EXPECT_LE(once.back(), 6000U) << "no other number";
  }
  const Rejected r = w.server->socket().counts().rejected;
  EXPECT_GT(r.not_authentic + r.malformed + r.not_encrypted, 500U);
  EXPECT_GT(r.replayed, 1000U);
  EXPECT_EQ(w.server->socket().associations(), 1U);
}

/// Whoever has no key, at the address of the client or elsewhere, says all it can: noise, plain text, records of every type,
/// alerts, ClientHellos with and without cookies.
void attack(World& w, std::mt19937_64& random, const Endpoint& from, const Endpoint& to,
            std::span<const Datagram> hellos) {
  std::array<std::byte, 200> noise;
  for (std::byte& b : noise) b = static_cast<std::byte>(random());
  const std::size_t size = 1 + random() % noise.size();
  switch (random() % 6) {
    case 0:
      break;
    case 1:
      noise[0] = std::byte{0x0d}, noise[3] = std::byte{0x50}, noise[4] = std::byte{0x54};
      break;
    case 2: {
      static constexpr unsigned char kFatal[] = {21, 0xfe, 0xfd, 0, 0, 0, 0, 0, 0, 0, 9, 0, 2, 2, 40};
      w.network.send(std::as_bytes(std::span{kFatal}), from, to, w.now);
      return;
    }
    case 3: {
      if (hellos.empty()) break;
      const Datagram& hello = hellos[random() % hellos.size()];
      Datagram changed = hello;
      if (random() % 2 == 0) changed.bytes()[27 + random() % 32] ^= std::byte{1};  // another random number
      w.network.send(changed.bytes(), from, to, w.now);
      return;
    }
    default:
      noise[0] = static_cast<std::byte>(20 + random() % 4), noise[1] = std::byte{0xfe}, noise[2] = std::byte{0xfd};
      noise[3] = std::byte{0}, noise[4] = static_cast<std::byte>(random() % 2);
      if (size > 13) noise[11] = std::byte{0}, noise[12] = static_cast<std::byte>(size - 13);
  }
  w.network.send({noise.data(), size}, from, to, w.now);
}

/// The first datagrams of a client with the key, of another session.
std::vector<Datagram> recorded_hellos() {
  World w;
  std::vector<Datagram> kept;
  w.start_server();
  MemorySocket socket = w.network.open(kElsewhere, w.now);
  Tap tap{socket, kept};
  SecureSocket client{tap, {.server = false, .peer = kServerAt}, Key{key()}};
  for (int k = 0; k < 100; ++k) {
    w.tick();
    while (client.receive(w.now)) {
    }
  }
  return kept;
}

TEST(SecureSocket, WhoHasNoKeyEndsNoAssociationFromAnyAddress) {
  const std::vector<Datagram> hellos = recorded_hellos();
  ASSERT_GE(hellos.size(), 3U);
  World w;
  w.start_server();
  w.start_client();
  ASSERT_GE(w.until_both_hear(), 0ns);
  std::mt19937_64 random{5};
  const std::uint64_t server = w.server->heard, client = w.client->heard;
  for (int k = 0; k < 5000; ++k) {
    for (int i = 0; i < 10; ++i) {
      attack(w, random, i % 2 == 0 ? kClientAt : kElsewhere, kServerAt, hellos);
      attack(w, random, i % 2 == 0 ? kServerAt : kElsewhere, kClientAt, hellos);
    }
    w.tick();
  }
  // The queue of the memory network drops under this flood; no association has been replaced.
  EXPECT_EQ(w.server->socket().associations(), 1U);
  EXPECT_EQ(w.client->socket().associations(), 1U);
  EXPECT_GT(w.server->heard, server + 4900);
  EXPECT_GT(w.client->heard, client + 4900);
}

TEST(SecureSocket, WhoHasNoKeyDoesNotKeepTwoThatHaveItApart) {
  const std::vector<Datagram> hellos = recorded_hellos();
  Duration worst{0};
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    World w{seed};
    w.set({.delay_s = 0.002, .loss = 0.1});
    w.start_server();
    w.start_client();
    std::mt19937_64 random{seed};
    const Duration from = w.now;
    while (w.server->heard < 5 || w.client->heard < 5) {
      // From elsewhere all of it; from the peer's address all but what only somebody can know who reads the handshake, and
      // who can keep two apart anyway.
      for (int i = 0; i < 2; ++i) {
        attack(w, random, kElsewhere, kServerAt, hellos);
        attack(w, random, kElsewhere, kClientAt, hellos);
        attack(w, random, kClientAt, kServerAt, {});
        attack(w, random, kServerAt, kClientAt, {});
      }
      w.tick();
      ASSERT_LT(w.now - from, 20s) << "seed " << seed;
    }
    worst = std::max(worst, w.now - from);
  }
  std::cout << "connected under attack after " << to_seconds(worst).si() << " s at most\n";
}

TEST(SecureSocket, ManyHalfOpenHandshakesKeepNobodyOut) {
  World w;
  w.start_server();
  std::vector<std::unique_ptr<MemorySocket>> sockets;
  std::vector<std::unique_ptr<SecureSocket>> strangers;
  for (std::uint16_t i = 0; i < 40; ++i) {
    const Endpoint at = MemoryNetwork::address(9, static_cast<std::uint16_t>(1000 + i));
    sockets.emplace_back(new MemorySocket{w.network.open(at, w.now)});
    strangers.push_back(std::make_unique<SecureSocket>(
        *sockets.back(), SecureSocketOptions{.server = false, .peer = kServerAt}, Key{key(7)}));
  }
  for (int k = 0; k < 200; ++k) {
    w.tick();
    for (auto& s : strangers)
      while (s->receive(w.now)) {
      }
  }
  w.start_client();
  const Duration from = w.now;
  while (w.server->heard < 5 || w.client->heard < 5) {
    w.tick();
    for (auto& s : strangers)
      while (s->receive(w.now)) {
      }
    ASSERT_LT(w.now - from, 5s);
  }
}

/// What strangers send: made without the key; the first or the second datagram of a session that they have recorded.
enum class Flood { forged, first, second };
class UnderAFlood : public ::testing::TestWithParam<Flood> {
 protected:
  /// Two datagrams a millisecond, each from another of 10,000 addresses.
  void strangers_send(World& w) {
    for (int i = 0; i < 2; ++i) {
      const unsigned who = next_++ % 10'000;
      const Datagram& d = kept_[GetParam() == Flood::second ? 1 : 0];
      Datagram sent = d;
      if (GetParam() == Flood::forged)
        sent.bytes()[4] = static_cast<std::byte>(next_), sent.bytes()[60] ^= std::byte{1};
      Endpoint from = kElsewhere;
      from.address[1] = static_cast<std::uint8_t>(1 + who / 250),
      from.address[2] = static_cast<std::uint8_t>(who % 250);
      w.network.send(sent.bytes(), from, kServerAt, w.now);
    }
  }
  void record(World& w) {
    w.start_server();
    MemorySocket socket = w.network.open(kClientAt, w.now);
    Tap tap{socket, kept_};
    SecureSocket client{tap, {.server = false, .peer = kServerAt}, Key{key()}};
    for (int k = 0; k < 100; ++k) {
      w.tick();
      while (client.receive(w.now)) {
      }
    }
    ASSERT_EQ(client.associations(), 1U);
  }
  std::vector<Datagram> kept_;
  unsigned next_ = 0;
};

TEST_P(UnderAFlood, TwoThatHaveTheKeyMeetAndMeetAgainWithinASecond) {
  World w;
  record(w);
  w.set({.delay_s = 0.05});
  const auto meet = [&](Duration patience) {
    const std::uint64_t s = w.server->heard, c = w.client->heard;
    for (const Duration from = w.now; w.now - from < patience;) {
      strangers_send(w);
      w.tick();
      if (w.server->heard > s + 3 && w.client->heard > c + 3) return w.now - from;
    }
    return Duration{-1};
  };
  const auto flood = [&](int ms) {
    while (ms-- > 0) {
      strangers_send(w);
      w.tick();
    }
  };
  flood(6000);
  w.start_client();
  Duration took = meet(5s);
  EXPECT_TRUE(took > 0ns && took < 800ms) << took.count();
  flood(2000);
  for (const Endpoint& at : {kClientAt, kElsewhere}) {
    w.start_client(at);
    took = meet(5s);
    EXPECT_TRUE(took > 0ns && took < 800ms) << took.count();
    flood(500);
  }
  w.start_server();
  took = meet(5s);
  EXPECT_TRUE(took > 0ns && took < 800ms) << took.count();
  EXPECT_LE(w.server->socket().associations(), 1U);
}
INSTANTIATE_TEST_SUITE_P(Of, UnderAFlood, ::testing::Values(Flood::forged, Flood::first, Flood::second));

TEST(SecureSocket, DoesNotAllocateWhileNothingIsAgreedOn) {
  World w;
  // The handshake in its own thread, as live: what this thread does in a tick allocates nothing.
  MemorySocket server = w.network.open(kServerAt, w.now), client = w.network.open(kClientAt, w.now);
  SecureSocket s{server, {.server = true, .peer = std::nullopt, .own_thread = true}, Key{key()}};
  SecureSocket c{client, {.server = false, .peer = kServerAt, .own_thread = true}, Key{key()}};
  const auto tick = [&] {
    w.now += kTick;
    int heard = 0;
    for (SecureSocket* side : {&s, &c}) {
      while (side->receive(w.now)) ++heard;
      side->send(std::as_bytes(std::span{"0123456789abcdef", 16}), side == &s ? kClientAt : kServerAt, w.now);
    }
    return heard;
  };
  for (int k = 0; k < 5000 && s.associations() + c.associations() < 2; ++k) {
    tick();
    std::this_thread::sleep_for(1ms);
  }
  ASSERT_EQ(s.associations() + c.associations(), 2U);
  for (int k = 0; k < 10; ++k) tick();
  const NoAlloc guard;
  int heard = 0;
  for (int k = 0; k < 10'000; ++k) heard += tick();
  EXPECT_EQ(guard.seen(), 0);
  EXPECT_GT(heard, 19'900);
}

}  // namespace
}  // namespace twoport
