#include <gtest/gtest.h>
#include <openssl/ssl.h>

#include <array>
#include <cstring>
#include <deque>
#include <string>
#include <vector>

#include "common/link/memory_network.h"
#include "common/secure/dtls_handshake.h"

// Against OpenSSL's own DTLS as the other side: what leaves here are records of DTLS 1.2 as anybody reads them.
namespace twoport {
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

TEST_P(WithOpenSsl, AgreesAndEachOpensWhatTheOtherSeals) {
  const bool server = GetParam();
  DtlsHandshake ours{{.server = server, .peer = server ? std::nullopt : std::optional{kThere}}, Key{key()}};
  Reference theirs{!server};
  std::unique_ptr<Association> association;
  Duration now{0};
  Datagram datagram;
  for (int k = 0; k < 20 && !(association && SSL_is_init_finished(theirs.ssl)); ++k, now += 1ms) {
    ours.advance(now, association == nullptr);
    while (ours.take_outgoing(datagram)) theirs.in.emplace_back(datagram.bytes().begin(), datagram.bytes().end());
    do SSL_do_handshake(theirs.ssl);
    while (!theirs.in.empty() && !SSL_is_init_finished(theirs.ssl));
    for (; !theirs.out.empty(); theirs.out.pop_front()) ours.on(theirs.out.front(), kThere, now);
    if (auto made = ours.take_association()) association = std::move(made);
  }
  ASSERT_TRUE(association);
  ASSERT_TRUE(SSL_is_init_finished(theirs.ssl));
  EXPECT_STREQ(SSL_get_cipher(theirs.ssl), "ECDHE-PSK-CHACHA20-POLY1305");
  EXPECT_EQ(association->peer, kThere);

  for (int k = 0; k < 5; ++k) {
    const std::string said = "message " + std::to_string(k);
    const auto record = association->sealer.seal(std::as_bytes(std::span{said}));
    theirs.in.emplace_back(record.begin(), record.end());
    std::array<char, 100> heard{};
    ASSERT_EQ(SSL_read(theirs.ssl, heard.data(), heard.size()), static_cast<int>(said.size()));
    EXPECT_EQ(std::string(heard.data(), said.size()), said);

    ASSERT_GT(SSL_write(theirs.ssl, said.data(), static_cast<int>(said.size())), 0);
    std::span<const std::byte> plain;
    ASSERT_EQ(association->opener.open(theirs.out.front(), plain), Opened::ok);
    EXPECT_TRUE(std::ranges::equal(plain, std::as_bytes(std::span{said})));
    theirs.out.pop_front();
  }
}
INSTANTIATE_TEST_SUITE_P(AsServer, WithOpenSsl, ::testing::Bool());

TEST(DtlsServer, KeepsNothingForASenderThatHasReturnedNoCookie) {
  DtlsHandshake server{{.server = true}, Key{key()}};
  DtlsHandshake client{{.server = false, .peer = kThere}, Key{key()}};
  client.advance(0ms, true);
  Datagram hello, answer;
  ASSERT_TRUE(client.take_outgoing(hello));
  std::size_t sent = 0, answered = 0;
  for (std::uint16_t port = 1; port < 1000; ++port) {
    Endpoint from = kHere;
    from.port = port;
    server.on(hello.bytes(), from, 0ms);
    sent += hello.bytes().size();
    while (server.take_outgoing(answer)) {
      answered += answer.bytes().size();
      EXPECT_EQ(answer.from, from);
    }
  }
  EXPECT_EQ(server.counts().cookies_sent, 999U);
  EXPECT_LT(answered, sent) << "a forged source is sent less than was received";
  // No flight is repeated: there are no attempts.
  server.advance(1s, false);
  EXPECT_FALSE(server.take_outgoing(answer));
}

TEST(DtlsServer, ACookieIsGoodForItsAddressOnly) {
  DtlsHandshake server{{.server = true}, Key{key()}};
  DtlsHandshake client{{.server = false, .peer = kThere}, Key{key()}};
  Datagram d;
  client.advance(0ms, true);
  ASSERT_TRUE(client.take_outgoing(d));
  server.on(d.bytes(), kHere, 0ms);
  ASSERT_TRUE(server.take_outgoing(d));
  client.on(d.bytes(), kThere, 0ms);
  ASSERT_TRUE(client.take_outgoing(d));
  Datagram answer;
  Endpoint elsewhere = kHere;
  elsewhere.port = 99;
  server.on(d.bytes(), elsewhere, 0ms);
  ASSERT_TRUE(server.take_outgoing(answer));
  EXPECT_EQ(server.counts().cookies_sent, 2U) << "one more cookie, no attempt";
  server.on(d.bytes(), kHere, 0ms);
  EXPECT_EQ(server.counts().cookies_sent, 2U);
  EXPECT_TRUE(server.take_outgoing(answer));
}

}  // namespace
}  // namespace twoport
