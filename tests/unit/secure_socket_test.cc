#include "common/secure/secure_socket.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <cstring>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/support/memory_network.h"
#include "tests/support/no_alloc.h"

// The filter in virtual time: handshakes run within receive().
namespace twoport::secure_socket_test {
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
class Side final : public DatagramSocket {
 public:
  Side(MemoryNetwork& network, bool server, const Endpoint& at, Duration now, std::span<const Key> keys,
       Duration rekey_after)
      : socket_{network.open(at, now)},
        at_{at},
        to_{server ? kClientAt : kServerAt},
        secure_{*this,
                {.server = server,
                 .peer = server ? std::nullopt : std::optional{kServerAt},
                 .rekey_after = rekey_after,
                 .tell =
                     [this](HandshakeFailure failure, const Endpoint& peer, std::size_t which) {
                       if (failure == HandshakeFailure::none) told.emplace_back(peer, which);
                     }},
                keys} {}

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
  std::vector<std::pair<Endpoint, std::size_t>> told;  ///< who has which key

  // Of the filter to the network, past whoever stands there.
  bool send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept override {
    Datagram copy;
    copy.assign(bytes, to);
    if (kept) kept->push_back(copy);
    return (stops && stops(bytes)) || socket_.send(bytes, to, now);
  }
  std::optional<ReceivedDatagram> receive(Duration now) noexcept override {
    const auto datagram = socket_.receive(now);
    if (datagram && copies) copies->push_back(Datagram{*datagram});
    return datagram;
  }
  [[nodiscard]] const Endpoint& local() const noexcept override { return at_; }
  [[nodiscard]] SocketCounts counts() const noexcept override { return socket_.counts(); }
  std::vector<Datagram>* kept = nullptr;                  ///< of what is sent
  std::function<bool(std::span<const std::byte>)> stops;  ///< of what is sent
  std::deque<Datagram>* copies = nullptr;                 ///< of what arrives

 private:
  MemorySocket socket_;
  Endpoint at_;
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
    const Key one{bytes};
    start_server(std::span{&one, 1});
  }
  void start_server(std::span<const Key> keys) {
    server = std::make_unique<Side>(network, true, kServerAt, now, keys, rekey_after);
  }
  void start_client(const Endpoint& at = kClientAt, const Key::Bytes& bytes = key()) {
    client.reset();
    client = start(at, bytes);
  }
  std::unique_ptr<Side> start(const Endpoint& at, const Key::Bytes& bytes) {
    const Key one{bytes};
    return std::make_unique<Side>(network, false, at, now, std::span{&one, 1}, rekey_after);
  }
  void tick() {
    now += kTick;
    if (server) server->tick(now);
    if (client) client->tick(now);
    for (const auto& other : others) other->tick(now);
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
  Duration now{0}, rekey_after = 10min;
  std::unique_ptr<Side> server, client;
  std::vector<std::unique_ptr<Side>> others;
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

/// Records that have arrived and were not opened, and what could not be sealed.
std::uint64_t spoiled(Side& side) {
  const SocketCounts c = side.socket().counts();
  return c.unsent + c.rejected.total() - c.rejected.failed_handshake;
}

class NewKeys : public ::testing::TestWithParam<double> {};

TEST_P(NewKeys, AreAgreedOnAgainAndAgainAndEachRecordThatArrivesIsOpenedOnce) {
  World w{11};
  w.rekey_after = 1s;
  w.set({.delay_s = 0.02, .jitter_s = 0.01, .loss = GetParam(), .reorder = 0.1});
  w.start_server();
  w.start_client();
  ASSERT_GE(w.until_both_hear(), 0ns);
  const std::uint64_t of_server = spoiled(*w.server), of_client = spoiled(*w.client);
  w.run(120s);
  std::cout << w.client->socket().associations() << " associations in 120 s\n";
  EXPECT_GT(w.client->socket().associations(), 30U);
  EXPECT_GE(w.server->socket().associations(), w.client->socket().associations()) << "its last flight may be lost";
  EXPECT_EQ(spoiled(*w.server), of_server) << "of 120,000";
  EXPECT_EQ(spoiled(*w.client), of_client) << "of 120,000";
  for (const Side* side : {w.server.get(), w.client.get()}) {
    std::vector<std::uint64_t> once = side->numbers;
    std::sort(once.begin(), once.end());
    EXPECT_EQ(std::adjacent_find(once.begin(), once.end()), once.end()) << "no number twice";
    EXPECT_GT(static_cast<double>(once.size()), 0.98 * (1.0 - GetParam()) * 120'000);
  }
}
INSTANTIATE_TEST_SUITE_P(AtALossOf, NewKeys, ::testing::Values(0.0, 0.2, 0.5));

TEST(OldKeys, OpenRecordsForFiveSecondsMoreAndNoLonger) {
  World w;
  w.rekey_after = 20s;
  w.start_server();
  w.start_client();
  ASSERT_GE(w.until_both_hear(), 0ns);
  // What the client seals in this time is kept from the server.
  std::vector<Datagram> old;
  w.run(19s);
  w.client->kept = &old;
  w.client->stops = [](auto) { return true; };
  w.run(100ms);
  w.client->kept = nullptr;
  w.client->stops = nullptr;
  ASSERT_EQ(old.size(), 100U);
  w.run(10ms);
  const auto say = [&](std::size_t i) {
    const std::uint64_t heard = w.server->heard;
    w.network.send(old[i].bytes(), kClientAt, kServerAt, w.now);
    w.run(5ms);
    return w.server->heard - heard - 5;
  };
  EXPECT_EQ(say(0), 1U);
  w.run(1500ms);
  ASSERT_EQ(w.client->socket().associations(), 2U);
  ASSERT_EQ(w.server->socket().associations(), 2U);
  EXPECT_EQ(w.server->socket().counts().rejected.total(), 0U);
  EXPECT_EQ(say(1), 1U) << "late, and opened";
  EXPECT_EQ(say(1), 0U) << "not twice";
  EXPECT_EQ(w.server->socket().counts().rejected.replayed, 1U);
  w.run(5s);
  const Rejected before = w.server->socket().counts().rejected;
  for (std::size_t i = 0; i < old.size(); ++i) EXPECT_EQ(say(i), 0U);
  EXPECT_EQ(w.server->socket().counts().rejected.not_authentic, before.not_authentic + 100);
  EXPECT_EQ(w.server->socket().associations(), 2U);
}

TEST(OldKeys, GoOnWhileTheLastFlightOfTheServerIsLost) {
  World w;
  w.rekey_after = 2s;
  w.start_server();
  w.start_client();
  ASSERT_GE(w.until_both_hear(), 0ns);
  // The server's last flight never arrives: the client goes on with the old keys, and so does the server.
  w.server->stops = [&](std::span<const std::byte> bytes) {
    return bytes[0] == std::byte{22} && bytes.size() > kProofHeader && bytes[kProofHeader] == std::byte{20};
  };
  const std::uint64_t heard = w.client->heard;
  w.run(4s);
  EXPECT_EQ(w.client->socket().associations(), 1U);
  EXPECT_GE(w.server->socket().associations(), 2U);
  EXPECT_NEAR(static_cast<double>(w.client->heard - heard), 4000, 2);
  w.server->stops = nullptr;
  w.run(3s);
  EXPECT_GE(w.client->socket().associations(), 2U);
  EXPECT_NEAR(static_cast<double>(w.client->heard - heard), 7000, 2);
}

TEST(OldKeys, EndAfterHalfAnHourWhereNoOthersCanBeAgreedOn) {
  World w;
  w.start_server();
  w.start_client();
  ASSERT_GE(w.until_both_hear(), 0ns);
  w.client->stops = [](std::span<const std::byte> bytes) { return bytes[0] == std::byte{22}; };
  const auto run_to = [&](Duration end) {
    const std::uint64_t heard = w.server->heard;
    for (; w.now < end; w.tick()) w.now += 19ms;
    return w.server->heard - heard;
  };
  run_to(29min + 50s);
  EXPECT_EQ(run_to(29min + 59s), 450U) << "one in 20 ms";
  run_to(30min + 1s);
  EXPECT_EQ(run_to(30min + 10s), 0U);
  EXPECT_EQ(w.client->socket().associations(), 1U);
  w.client->stops = nullptr;
  const Duration took = w.until_both_hear();
  ASSERT_GE(took, 0ns);
  EXPECT_LT(took, 1s);
}

// ---- a key for each device

struct Fleet : World {
  Fleet() {
    std::vector<Key> keys;
    for (std::uint8_t i = 0; i < 64; ++i) keys.emplace_back(key(i));
    start_server(keys);
  }
};

TEST(KeyOfADevice, IsKnownByItsPlaceAndOthersStayOut) {
  Fleet w;
  for (const std::uint8_t i : std::array<std::uint8_t, 3>{0, 17, 63}) {
    w.start_client(kClientAt, key(i));
    ASSERT_GE(w.until_both_hear(), 0ns);
    EXPECT_EQ(w.server->told.back(), (std::pair{kClientAt, std::size_t{i}}));
    w.server->socket().paired(kClientAt, w.now);
    EXPECT_EQ(w.server->socket().paired_key(), i);
    w.client.reset();
    w.run(1100ms);
  }
  w.start_client(kClientAt, key(64));
  w.run(1s);
  EXPECT_EQ(w.client->socket().last_failure(), HandshakeFailure::other_key);
  EXPECT_EQ(w.client->heard, 0U);
  EXPECT_EQ(w.server->told.size(), 3U);
}

TEST(KeyOfADevice, GivesNoPlaceAndNoPacketOfAnotherDevice) {
  Fleet w;
  w.start_client(kClientAt, key(1));
  ASSERT_GE(w.until_both_hear(), 0ns);
  w.server->socket().paired(kClientAt, w.now);
  // Twenty others, each with a key, call all the time from other places.
  for (std::uint8_t i = 0; i < 20; ++i)
    w.others.push_back(w.start(MemoryNetwork::address(static_cast<std::uint8_t>(10 + i), 1), key(2 + i)));
  const std::uint64_t spoiled_before = spoiled(*w.client), associations = w.client->socket().associations();
  std::uint64_t silent = 0;
  for (int k = 0; k < 5000; ++k) {
    w.tick();
    // Side::tick() answers whoever it has heard last; its first client is answered in any case.
    const std::uint64_t one = 1;
    EXPECT_TRUE(w.server->socket().send(std::as_bytes(std::span{&one, 1}), kClientAt, w.now));
    silent += w.client->heard_in_tick == 0;
  }
  EXPECT_LT(silent, 5U);
  EXPECT_EQ(spoiled(*w.client), spoiled_before);
  EXPECT_EQ(w.client->socket().associations(), associations) << "it never was deaf";
  EXPECT_GT(w.server->socket().associations(), 20U);
}

/// Somebody on the way of the client who has a key of his own: reads what the server sends there, and sends from its address.
class OnTheWay final : public DatagramSocket {
 public:
  explicit OnTheWay(MemoryNetwork& network) : network_{&network} {}
  bool send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept override {
    return network_->send(bytes, kClientAt, to, now);
  }
  std::optional<ReceivedDatagram> receive(Duration now) noexcept override {
    if (copies.empty()) return std::nullopt;
    last_ = copies.front();
    copies.pop_front();
    return ReceivedDatagram{last_.bytes(), kServerAt, now - 1ns};
  }
  [[nodiscard]] const Endpoint& local() const noexcept override { return kClientAt; }
  [[nodiscard]] SocketCounts counts() const noexcept override { return {}; }
  std::deque<Datagram> copies;

 private:
  MemoryNetwork* network_;
  Datagram last_;
};

TEST(KeyOfADevice, TakesNoOtherDevicesPlaceEvenFromItsAddress) {
  Fleet w;
  w.rekey_after = 2s;
  w.start_client(kClientAt, key(1));
  OnTheWay way{w.network};
  w.client->copies = &way.copies;
  SecureSocket thief{way, {.server = false, .peer = kServerAt}, Key{key(2)}};
  ASSERT_GE(w.until_both_hear(), 0ns);
  const std::uint64_t heard = w.server->heard;
  const std::uint64_t said = 1'000'000;
  int opened = 0;
  for (int k = 0; k < 10'000; ++k) {
    w.tick();
    while (thief.receive(w.now)) ++opened;
    thief.send(std::as_bytes(std::span{&said, 1}), kServerAt, w.now);
  }
  EXPECT_GT(thief.associations(), 1U) << "its key is good";
  EXPECT_EQ(opened, 0);
  EXPECT_EQ(w.server->heard, heard + 10'000);
  EXPECT_EQ(std::count(w.server->numbers.begin(), w.server->numbers.end(), said), 0);
  EXPECT_GT(w.client->socket().associations(), 4U) << "new keys are agreed on meanwhile";
  // The client goes: now the address may be another's.
  w.client->stops = [](auto) { return true; };
  for (int k = 0; k < 3000; ++k) {
    w.tick();
    while (thief.receive(w.now)) ++opened;
    thief.send(std::as_bytes(std::span{&said, 1}), kServerAt, w.now);
  }
  EXPECT_GT(opened, 1000);
}

/// Two filters whose handshakes run in threads of their own, as live.
struct Threads {
  explicit Threads(Duration rekey_after) {
    s.emplace(server, SecureSocketOptions{.server = true, .own_thread = true}, Key{key()});
    c.emplace(client, SecureSocketOptions{.peer = kServerAt, .own_thread = true, .rekey_after = rekey_after},
              Key{key()});
    for (int k = 0; k < 5000 && s->associations() + c->associations() < 2; ++k) {
      tick();
      std::this_thread::sleep_for(1ms);
    }
    EXPECT_EQ(s->associations() + c->associations(), 2U);
    for (int k = 0; k < 10; ++k) tick();
  }
  /// How many are heard in it.
  int tick() {
    w.now += kTick;
    int heard = 0;
    for (SecureSocket* side : {&*s, &*c}) {
      while (side->receive(w.now)) ++heard;
      side->send(std::as_bytes(std::span{"0123456789abcdef", 16}), side == &*s ? kClientAt : kServerAt, w.now);
    }
    return heard;
  }
  World w;
  MemorySocket server = w.network.open(kServerAt, w.now), client = w.network.open(kClientAt, w.now);
  std::optional<SecureSocket> s, c;
};

TEST(SecureSocket, DoesNotAllocateWhileNothingIsAgreedOn) {
  Threads t{10min};
  const NoAlloc guard;
  int heard = 0;
  for (int k = 0; k < 10'000; ++k) heard += t.tick();
  EXPECT_EQ(guard.seen(), 0);
  EXPECT_GT(heard, 19'900);
}

TEST(SecureSocket, DoesNotAllocateNorLoseATickWhileNewKeysAreAgreedOn) {
  Threads t{200ms};
  const auto refused = [&] {
    const Rejected s = t.s->counts().rejected, c = t.c->counts().rejected;
    return s.total() - s.failed_handshake + c.total() - c.failed_handshake;
  };
  const std::uint64_t before = refused();
  const NoAlloc guard;
  int heard = 0;
  for (int k = 0; k < 20'000; ++k) {
    heard += t.tick();
    std::this_thread::sleep_for(50us);
  }
  EXPECT_EQ(guard.seen(), 0);
  EXPECT_EQ(heard, 40'000);
  EXPECT_EQ(refused(), before);
  EXPECT_GT(std::min(t.s->associations(), t.c->associations()), 3U);
}

}  // namespace
}  // namespace twoport::secure_socket_test
