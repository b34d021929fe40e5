#include <gtest/gtest.h>
#include <openssl/ssl.h>

#include <array>
#include <cstring>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/secure/dtls_handshake.h"
#include "tests/support/memory_network.h"

// Against OpenSSL's own DTLS as the other side: what leaves here are records of DTLS 1.2 as anybody reads them.
namespace twoport::dtls_test {
namespace {

using namespace std::chrono_literals;

const Endpoint kThere = MemoryNetwork::address(1, 1), kHere = MemoryNetwork::address(2, 2);

Key::Bytes key() {
  Key::Bytes bytes;
  bytes.fill(42);
  return bytes;
}

/// A client or server of OpenSSL that does all itself, datagrams in memory.
class Reference {
 public:
  explicit Reference(bool server) : context_{SSL_CTX_new(server ? DTLS_server_method() : DTLS_client_method())} {
    SSL_CTX_set_cipher_list(context_, "PSK");
    SSL_CTX_set_options(context_, SSL_OP_NO_QUERY_MTU);
    SSL_CTX_set_psk_client_callback(
        context_, [](SSL*, const char*, char* name, unsigned, unsigned char* to, unsigned) -> unsigned {
          std::strcpy(name, "twoport");
          std::memset(to, 42, Key::kSize);
          return Key::kSize;
        });
    SSL_CTX_set_psk_server_callback(context_, [](SSL*, const char*, unsigned char* to, unsigned) -> unsigned {
      std::memset(to, 42, Key::kSize);
      return Key::kSize;
    });
    method_ = BIO_meth_new(BIO_TYPE_SOURCE_SINK | BIO_get_new_index(), "test");
    BIO_meth_set_create(method_, [](BIO* b) {
      BIO_set_init(b, 1);
      return 1;
    });
    BIO_meth_set_write(method_, [](BIO* b, const char* from, int n) {
      const auto* bytes = reinterpret_cast<const std::byte*>(from);
      static_cast<Reference*>(BIO_get_data(b))->out.emplace_back(bytes, bytes + n);
      return n;
    });
    BIO_meth_set_read(method_, [](BIO* b, char* to, int room) {
      auto& arrived = static_cast<Reference*>(BIO_get_data(b))->in;
      BIO_clear_retry_flags(b);
      if (arrived.empty()) {
        BIO_set_retry_read(b);
        return -1;
      }
      const int n = std::min(room, static_cast<int>(arrived.front().size()));
      std::memcpy(to, arrived.front().data(), static_cast<std::size_t>(n));
      arrived.pop_front();
      return n;
    });
    BIO_meth_set_ctrl(method_,
                      [](BIO*, int command, long, void*) -> long { return command == BIO_CTRL_FLUSH ? 1 : 0; });
    ssl = SSL_new(context_);
    BIO* const bio = BIO_new(method_);
    BIO_set_data(bio, this);
    SSL_set_bio(ssl, bio, bio);
    DTLS_set_link_mtu(ssl, 1400);
    server ? SSL_set_accept_state(ssl) : SSL_set_connect_state(ssl);
  }
  ~Reference() {
    SSL_free(ssl);
    SSL_CTX_free(context_);
    BIO_meth_free(method_);
  }
  Reference(const Reference&) = delete;

  std::deque<std::vector<std::byte>> in, out;
  SSL* ssl = nullptr;

 private:
  SSL_CTX* context_;
  BIO_METHOD* method_ = nullptr;
};

class WithOpenSsl : public ::testing::TestWithParam<bool> {};

/// What stands before the records of a reference.
class Header {
 public:
  Datagram before(std::span<const std::byte> records, HandshakeKind kind) {
    Datagram d;
    std::array<std::byte, kMaxDatagramBytes> bytes;
    d.assign({bytes.data(),
              proof_.write(0, {.kind = kind, .attempt = attempt, .cookie = cookie, .records = records}, bytes)},
             kThere);
    return d;
  }
  Bits128 attempt{std::byte{1}}, cookie{};

 private:
  KeyProof proof_{Key{key()}};
};

RecordKeys half_of(std::span<const std::uint8_t> block, bool of_server) {
  RecordKeys keys;
  std::copy_n(block.data() + (of_server ? 32 : 0), 32, keys.key.data());
  std::copy_n(block.data() + (of_server ? 76 : 64), 12, keys.iv.data());
  return keys;
}

TEST_P(WithOpenSsl, AgreesAndEachOpensWhatTheOtherSeals) {
  const bool server = GetParam();
  DtlsHandshake ours{{.server = server, .peer = server ? std::nullopt : std::optional{kThere}}, Key{key()}};
  Reference theirs{!server};
  Header header;
  std::vector<std::byte> hello;
  std::unique_ptr<Association> association;
  Duration now{0};
  Datagram datagram;
  for (int k = 0; k < 20 && !(association && SSL_is_init_finished(theirs.ssl)); ++k, now += 1ms) {
    ours.advance(now, association == nullptr);
    while (ours.take_outgoing(datagram)) {
      const HandshakeParts parts = read_handshake(datagram.bytes()).value();
      header.attempt = parts.attempt;
      if (parts.kind == HandshakeKind::cookie) {
        header.cookie = parts.cookie;
        theirs.out.push_front(hello);
      } else {
        theirs.in.emplace_back(parts.records.begin(), parts.records.end());
      }
    }
    do SSL_do_handshake(theirs.ssl);
    while (!theirs.in.empty() && !SSL_is_init_finished(theirs.ssl));
    for (; !theirs.out.empty(); theirs.out.pop_front()) {
      if (hello.empty()) hello = theirs.out.front();
      ours.on(header.before(theirs.out.front(), server ? HandshakeKind::of_client : HandshakeKind::of_server).bytes(),
              kThere, now);
    }
    if (auto made = ours.take_association()) association = std::move(made);
  }
  ASSERT_TRUE(association);
  ASSERT_TRUE(SSL_is_init_finished(theirs.ssl));
  EXPECT_STREQ(SSL_get_cipher(theirs.ssl), "ECDHE-PSK-CHACHA20-POLY1305");
  EXPECT_EQ(association->peer, kThere);

  std::array<std::uint8_t, 88> block{};
  const std::string label = "EXPERIMENTAL twoport records";
  ASSERT_EQ(
      SSL_export_keying_material(theirs.ssl, block.data(), block.size(), label.data(), label.size(), nullptr, 0, 0), 1);
  Sealer seals{half_of(block, !server)};
  Opener opens{half_of(block, server)};
  for (int k = 0; k < 5; ++k) {
    const std::string said = "message " + std::to_string(k);
    std::span<const std::byte> plain;
    ASSERT_EQ(opens.open(association->sealer.seal(std::as_bytes(std::span{said})), plain), Opened::ok);
    EXPECT_TRUE(std::ranges::equal(plain, std::as_bytes(std::span{said})));
    ASSERT_EQ(association->opener.open(seals.seal(std::as_bytes(std::span{said})), plain), Opened::ok);
    EXPECT_TRUE(std::ranges::equal(plain, std::as_bytes(std::span{said})));
  }
  // OpenSSL's own records of this handshake have other keys.
  ASSERT_GT(SSL_write(theirs.ssl, "other", 5), 0);
  std::span<const std::byte> plain;
  EXPECT_EQ(Opener{half_of(block, !server)}.open(theirs.out.front(), plain), Opened::not_authentic);
}
INSTANTIATE_TEST_SUITE_P(AsServer, WithOpenSsl, ::testing::Bool());

struct ServerAndClient {
  DtlsHandshake server{{.server = true}, Key{key()}};
  DtlsHandshake client{{.server = false, .peer = kThere}, Key{key()}};
  /// The client's next datagram.
  Datagram hello(Duration now = 0ms) {
    client.advance(now, true);
    Datagram d;
    EXPECT_TRUE(client.take_outgoing(d));
    return d;
  }
  /// The server's only answer to it: a cookie, or the first records (nothing: none).
  std::optional<HandshakeKind> answer(const Datagram& d, const Endpoint& from, Duration now) {
    server.on(d.bytes(), from, now);
    if (!server.take_outgoing(answered)) return std::nullopt;
    Datagram more;
    while (server.take_outgoing(more)) {
    }
    return read_handshake(answered.bytes()).value().kind;
  }
  /// The client's ClientHello with a cookie.
  Datagram second_hello() {
    EXPECT_EQ(answer(hello(), kHere, 0ms), HandshakeKind::cookie);
    client.on(answered.bytes(), kThere, 0ms);
    return hello();
  }
  Datagram answered;
};

TEST(DtlsServer, KeepsNothingForASenderThatHasReturnedNoCookie) {
  ServerAndClient w;
  const Datagram hello = w.hello();
  for (std::uint16_t port = 1; port < 1000; ++port) {
    Endpoint from = kHere;
    from.port = port;
    ASSERT_EQ(w.answer(hello, from, 0ms), HandshakeKind::cookie);
    EXPECT_EQ(w.answered.from, from);
    EXPECT_LT(w.answered.bytes().size(), hello.bytes().size()) << "a forged source is sent less than was received";
  }
  EXPECT_EQ(w.server.counts().cookies_sent, 999U);
  // No flight is repeated: there are no attempts.
  w.server.advance(1s, false);
  EXPECT_FALSE(w.server.take_outgoing(w.answered));
}

TEST(DtlsServer, AnswersNobodyWhoDoesNotProveTheKeyButToSayThat) {
  DtlsHandshake stranger{{.server = false, .peer = kThere}, Key{Key::Bytes{1, 2, 3}}};
  stranger.advance(0ms, true);
  ServerAndClient w;
  Datagram hello;
  ASSERT_TRUE(stranger.take_outgoing(hello));
  std::size_t answers = 0;
  for (std::uint16_t port = 1; port < 1000; ++port) {
    Endpoint from = kHere;
    from.port = port;
    answers += w.answer(hello, from, 0ms) == HandshakeKind::other_key;
  }
  EXPECT_EQ(answers, 1U) << "one to a network";
  EXPECT_EQ(w.server.counts().cookies_sent, 0U);
  EXPECT_EQ(w.server.last_failure(), HandshakeFailure::other_key);
  for (int k = 0; k < 3; ++k) stranger.on(w.answered.bytes(), kThere, 0ms);
  EXPECT_EQ(stranger.last_failure(), HandshakeFailure::other_key);
  // Any bit of a genuine one changed: no better.
  Datagram genuine = w.hello();
  for (std::byte& b : genuine.bytes()) {
    b ^= std::byte{4};
    EXPECT_NE(w.answer(genuine, kHere, 1s), HandshakeKind::cookie);
    b ^= std::byte{4};
  }
  EXPECT_EQ(w.answer(genuine, kHere, 1s), HandshakeKind::cookie);
}

TEST(DtlsServer, ACookieIsGoodForItsAddressAndAttemptAndForTwoMinutesAndLessThanFour) {
  for (const auto& [at, begins] : {std::pair{0s, true}, {119s, true}, {230s, true}, {241s, false}, {3600s, false}}) {
    ServerAndClient w;
    const Datagram hello = w.second_hello();
    Endpoint elsewhere = kHere;
    elsewhere.port = 99;
    EXPECT_EQ(w.answer(hello, elsewhere, at), HandshakeKind::cookie) << "one more cookie, no attempt";
    EXPECT_EQ(w.answer(hello, kHere, at), begins ? HandshakeKind::of_server : HandshakeKind::cookie) << at.count();
  }
}

// Also where repeats are on their way when the first answer arrives.
TEST(DtlsHandshakes, MeetInThreeRoundTripsHoweverLongTheyAre) {
  for (const Duration one_way : {20ms, 500ms, 850ms, 1000ms, 1700ms, 2000ms}) {
    ServerAndClient w;
    struct Underway {
      Duration at;
      Datagram datagram;
    };
    std::deque<Underway> there, back;
    std::unique_ptr<Association> at_server, at_client;
    Duration now{0};
    for (; now < 10 * one_way && !(at_server && at_client); now += 5ms) {
      for (; !there.empty() && there.front().at <= now; there.pop_front())
        w.server.on(there.front().datagram.bytes(), kHere, now);
      for (; !back.empty() && back.front().at <= now; back.pop_front())
        w.client.on(back.front().datagram.bytes(), kThere, now);
      w.server.advance(now, false);
      w.client.advance(now, at_client == nullptr);
      Datagram d;
      while (w.server.take_outgoing(d)) back.push_back({now + one_way, d});
      while (w.client.take_outgoing(d)) there.push_back({now + one_way, d});
      if (auto a = w.server.take_association()) at_server = std::move(a);
      if (auto a = w.client.take_association()) at_client = std::move(a);
    }
    EXPECT_TRUE(at_server && at_client);
    EXPECT_LT(now, 6 * one_way + 100ms) << one_way.count();
    EXPECT_EQ(w.client.counts().failed, 0U) << one_way.count();
  }
}

TEST(DtlsServer, AnAttemptBeginsOnceHoweverOftenItsHelloIsRepeated) {
  ServerAndClient w;
  const Datagram hello = w.second_hello();
  EXPECT_EQ(w.answer(hello, kHere, 0s), HandshakeKind::of_server);
  EXPECT_EQ(w.answer(hello, kHere, 1s), std::nullopt) << "the flight is repeated by time";
  w.server.advance(20s, false);  // it is given up
  while (w.server.take_outgoing(w.answered)) {
  }
  EXPECT_EQ(w.server.last_failure(), HandshakeFailure::packets_lost);
  EXPECT_EQ(w.answer(hello, kHere, 20s), std::nullopt);
}

TEST(DtlsServer, AnAttemptIsOfTheKeyThatItBeganWith) {
  std::vector<Key> keys;
  for (std::uint8_t fill = 41; fill <= 43; ++fill) {
    Key::Bytes bytes;
    bytes.fill(fill);
    keys.emplace_back(bytes);
  }
  DtlsHandshake server{{.server = true}, keys}, client{{.server = false, .peer = kThere}, keys[1]};
  KeyProof others{keys[2]};
  Datagram d;
  std::unique_ptr<Association> association;
  for (Duration now{0}; now < 100ms && !association; now += 1ms) {
    client.advance(now, true);
    while (client.take_outgoing(d)) {
      // Before each of its datagrams whoever has another key, and stands on the way, sends the same attempt's, cookie and all.
      HandshakeParts parts = read_handshake(d.bytes()).value();
      std::vector<std::byte> records{parts.records.begin(), parts.records.end()};
      std::array<std::byte, kMaxDatagramBytes> bytes;
      for (const std::size_t at : {records.size(), std::size_t{0}, std::size_t{13}, records.size() - 1}) {
        if (at < records.size()) records[at] ^= std::byte{1};
        parts.records = records;
        server.on({bytes.data(), others.write(0, parts, bytes)}, kHere, now);
      }
      server.on(d.bytes(), kHere, now);
    }
    while (server.take_outgoing(d)) client.on(d.bytes(), kThere, now);
    association = client.take_association();
  }
  ASSERT_TRUE(association);
  const auto made = server.take_association();
  ASSERT_TRUE(made);
  EXPECT_EQ(made->key, 1U);
  EXPECT_EQ(server.take_association(), nullptr);
  std::span<const std::byte> plain;
  EXPECT_EQ(made->opener.open(association->sealer.seal(std::as_bytes(std::span{"word", 4})), plain), Opened::ok);
}

TEST(DtlsServer, AKeyHasFourAttemptsAndTakesThePlacesOfItsOwnOnly) {
  std::vector<Key> keys;
  for (std::uint8_t fill = 1; fill <= 6; ++fill) keys.emplace_back(Key::Bytes{fill, fill});
  DtlsHandshake server{{.server = true}, keys};
  const auto begins = [&](std::size_t key) {
    DtlsHandshake client{{.server = false, .peer = kThere}, keys[key]};
    Datagram d;
    client.advance(0ms, true);
    EXPECT_TRUE(client.take_outgoing(d));
    server.on(d.bytes(), kHere, 0ms);
    EXPECT_TRUE(server.take_outgoing(d));
    client.on(d.bytes(), kThere, 0ms);
    EXPECT_TRUE(client.take_outgoing(d));
    server.on(d.bytes(), kHere, 0ms);
    bool answered = false;
    while (server.take_outgoing(d)) answered = true;
    return answered;
  };
  for (int k = 0; k < 100; ++k) EXPECT_TRUE(begins(0)) << "in place of its own";
  for (const std::size_t key : {1U, 2U, 3U})
    for (int k = 0; k < 4; ++k) EXPECT_TRUE(begins(key));
  EXPECT_FALSE(begins(4)) << "sixteen are under way";
  EXPECT_TRUE(begins(3));
}

TEST(DtlsServer, SaysThatAProgramIsOfAnEarlierVersion) {
  ServerAndClient w;
  Reference earlier{false};
  SSL_do_handshake(earlier.ssl);
  for (int k = 0; k < 3; ++k) w.server.on(earlier.out.front(), kHere, 0ms);
  EXPECT_EQ(w.server.last_failure(), HandshakeFailure::earlier_version);
  EXPECT_FALSE(w.server.take_outgoing(w.answered));
}

}  // namespace
}  // namespace twoport::dtls_test
