#include "common/secure/dtls_handshake.h"

#include <openssl/core_names.h>
#include <openssl/crypto.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>
#include <openssl/kdf.h>
#include <openssl/params.h>
#include <openssl/rand.h>
#include <openssl/ssl.h>

#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <string>
#include <utility>

namespace twoport {
namespace {

using namespace std::chrono_literals;

constexpr char kCipherSuite[] = "ECDHE-PSK-CHACHA20-POLY1305";
constexpr char kGroups[] = "X25519:P-256";
constexpr char kIdentity[] = "twoport";
constexpr char kKeyExpansion[] = "key expansion";
constexpr long kMtu = kMaxDatagramBytes;

constexpr Duration kRepeatAfter = 50ms, kRepeatAtMost = 800ms;
// Without progress. A client knows the round trip from the first answer; before that its ClientHello costs nobody anything.
constexpr Duration kServerGivesUpAfter = 8s, kClientGivesUpAfter = 1500ms;
constexpr int kRoundTrips = 4;       // that a client waits besides
constexpr Duration kRemember = 60s;  // a finished attempt, which may have to repeat its last flight
constexpr std::size_t kMostAttempts = 16, kMostPerHost = 4;
constexpr std::size_t kMostOutgoing = 256, kMostPerFlight = 8;  // [datagrams]

constexpr std::size_t kRandomAt = kRecordHeader + 12 + 2, kRandom = 32;  // of a ClientHello [B]
constexpr std::size_t kCookie = 32;

[[noreturn]] void fail(const char* what) {
  char reason[160];
  ERR_error_string_n(ERR_peek_last_error(), reason, sizeof reason);
  throw std::runtime_error(std::string{"this OpenSSL cannot be used: "} + what + ": " + reason);
}

constexpr std::byte as_byte(RecordType type) {
  return static_cast<std::byte>(type);
}

/// Address and port, for a cookie.
std::array<std::uint8_t, 23> bytes_of(const Endpoint& e) noexcept {
  std::array<std::uint8_t, 23> out{};
  std::copy(e.address.begin(), e.address.end(), out.begin());
  for (std::size_t i = 0; i < 4; ++i) out[16 + i] = static_cast<std::uint8_t>(e.scope >> (8 * i));
  out[20] = static_cast<std::uint8_t>(e.port >> 8), out[21] = static_cast<std::uint8_t>(e.port), out[22] = e.v6;
  return out;
}
bool same_host(const Endpoint& a, const Endpoint& b) noexcept {
  return a.address == b.address && a.v6 == b.v6;
}

/// The keys that the handshake has agreed on (RFC 5246, 6.3), for records of application data. OpenSSL's own record layer
/// keeps the numbers below Sealer::kFirst, so that no number is used twice.
bool derive_keys(const SSL* ssl, RecordKeys& of_client, RecordKeys& of_server) {
  std::array<std::uint8_t, 48> master;
  constexpr std::size_t kLabel = sizeof kKeyExpansion - 1;
  std::array<std::uint8_t, kLabel + 2 * kRandom> seed;
  std::memcpy(seed.data(), kKeyExpansion, kLabel);
  std::uint8_t* const randoms = seed.data() + kLabel;
  std::array<std::uint8_t, 2 * (32 + 12)> block;
  const bool known = SSL_SESSION_get_master_key(SSL_get_session(ssl), master.data(), master.size()) == master.size() &&
                     SSL_get_server_random(ssl, randoms, kRandom) == kRandom &&
                     SSL_get_client_random(ssl, randoms + kRandom, kRandom) == kRandom;
  bool derived = false;
  EVP_KDF* const kdf = EVP_KDF_fetch(nullptr, OSSL_KDF_NAME_TLS1_PRF, nullptr);
  EVP_KDF_CTX* const context = kdf != nullptr ? EVP_KDF_CTX_new(kdf) : nullptr;
  if (known && context != nullptr) {
    char digest[] = "SHA256";
    const OSSL_PARAM parameters[] = {
        OSSL_PARAM_construct_utf8_string(OSSL_KDF_PARAM_DIGEST, digest, 0),
        OSSL_PARAM_construct_octet_string(OSSL_KDF_PARAM_SECRET, master.data(), master.size()),
        OSSL_PARAM_construct_octet_string(OSSL_KDF_PARAM_SEED, seed.data(), seed.size()), OSSL_PARAM_construct_end()};
    derived = EVP_KDF_derive(context, block.data(), block.size(), parameters) == 1;
  }
  EVP_KDF_CTX_free(context);
  EVP_KDF_free(kdf);
  std::copy_n(block.data(), 32, of_client.key.data());
  std::copy_n(block.data() + 32, 32, of_server.key.data());
  std::copy_n(block.data() + 64, 12, of_client.iv.data());
  std::copy_n(block.data() + 76, 12, of_server.iv.data());
  OPENSSL_cleanse(master.data(), master.size());
  OPENSSL_cleanse(block.data(), block.size());
  return derived;
}

/// Is a datagram, as far as it can be told, of a handshake with this cipher suite? Of one that is not, OpenSSL would end the
/// attempt: messages in plain text can be forged.
bool plausible(std::span<const std::byte> bytes, bool at_server) noexcept {
  const auto number = [](std::span<const std::byte> from) {
    std::size_t n = 0;
    for (const std::byte b : from) n = n << 8 | std::to_integer<std::size_t>(b);
    return n;
  };
  constexpr std::size_t kMessageHeader = 12, kFinished = kMessageHeader + 12 + kRecordTag;
  while (!bytes.empty()) {
    if (bytes.size() < kRecordHeader || bytes[1] != std::byte{0xfe}) return false;
    const std::size_t epoch = number(bytes.subspan(3, 2)), size = number(bytes.subspan(11, 2));
    if (size > bytes.size() - kRecordHeader) return false;
    const std::span<const std::byte> content = bytes.subspan(kRecordHeader, size);
    const bool cipher_spec = bytes[0] == as_byte(RecordType::change_cipher_spec);
    if (!cipher_spec && bytes[0] != as_byte(RecordType::handshake)) return false;
    bytes = bytes.subspan(kRecordHeader + size);
    if (epoch == 1 && !cipher_spec && size == kFinished) continue;
    if (epoch != 0) return false;
    if (cipher_spec) {
      if (size != 1 || content[0] != std::byte{1}) return false;
      continue;
    }
    if (size < kMessageHeader || number(content.subspan(6, 3)) != 0 ||
        number(content.subspan(1, 3)) != size - kMessageHeader ||
        number(content.subspan(9, 3)) != size - kMessageHeader)
      return false;
    // ClientHello, ClientKeyExchange; ServerHello, HelloVerifyRequest, ServerKeyExchange, ServerHelloDone: each with its
    // number in the order of messages, with or without a cookie before.
    const std::size_t type = number(content.first(1)), place = number(content.subspan(4, 2));
    const bool expected = at_server ? (type == 1 && place <= 1) || (type == 16 && (place == 1 || place == 2))
                                    : (type == 3 && place == 0) || (type == 2 && place <= 1) ||
                                          (type == 12 && (place == 1 || place == 2)) ||
                                          (type == 14 && (place == 2 || place == 3));
    if (!expected) return false;
  }
  return true;
}

}  // namespace

bool is_client_hello(std::span<const std::byte> b) noexcept {
  return b.size() > kRandomAt + kRandom + 1 && b[0] == std::byte{22} && b[3] == std::byte{0} && b[4] == std::byte{0} &&
         b[kRecordHeader] == std::byte{1};
}
bool is_dtls(std::span<const std::byte> b) noexcept {
  return b.size() > kRecordHeader && b[0] >= std::byte{20} && b[0] <= std::byte{23} && b[1] == std::byte{0xfe};
}

/// One handshake.
struct DtlsHandshake::Attempt {
  DtlsHandshake& owner;
  Endpoint peer;
  ssl_st* ssl = nullptr;
  std::span<const std::byte> in;  ///< one datagram at a time keeps the boundaries of records
  std::vector<Datagram> flight;   ///< the last one sent, to be sent again
  bool fresh = true;              ///< what is sent next begins a flight
  bool listens = false, finished = false, failed = false;
  std::array<std::byte, kRandom> random{};  ///< of the ClientHello
  std::optional<Duration> round_trip;       ///< of a client, and what it has waited for the first answer
  Duration began{0}, progressed{0}, repeated{0}, repeat_after{kRepeatAfter};

  Attempt(DtlsHandshake& o, const Endpoint& p) : owner{o}, peer{p} {}
  ~Attempt() { SSL_free(ssl); }
  Attempt(const Attempt&) = delete;

  int read(char* to, int room) {
    if (in.empty()) return -1;
    const std::size_t n = std::min(in.size(), static_cast<std::size_t>(room));
    std::memcpy(to, in.data(), n);
    in = {};
    return static_cast<int>(n);
  }
  int write(const char* from, int size) {
    const auto n = static_cast<std::size_t>(size);
    if (n > kMaxDatagramBytes) return size;
    Datagram datagram;
    datagram.assign({reinterpret_cast<const std::byte*>(from), n}, peer);
    if (!listens) {
      if (std::exchange(fresh, false)) flight.clear();
      if (flight.size() < kMostPerFlight) flight.push_back(datagram);
    }
    if (owner.outgoing_.size() < kMostOutgoing) owner.outgoing_.push_back(datagram);
    return size;
  }
};

struct DtlsHandshake::Shared {
  ssl_ctx_st* context = nullptr;
  bio_method_st* datagrams = nullptr;
  bio_addr_st* address = BIO_ADDR_new();  ///< DTLSv1_listen wants one
  Key key;
  std::array<std::uint8_t, 32> secret{};  ///< of cookies

  explicit Shared(const Key::Bytes& bytes) : key{bytes} {}
  ~Shared() {
    SSL_CTX_free(context);
    BIO_meth_free(datagrams);
    BIO_ADDR_free(address);
    OPENSSL_cleanse(secret.data(), secret.size());
  }
  Shared(const Shared&) = delete;

  static Shared& of(SSL* ssl) { return *static_cast<Shared*>(SSL_CTX_get_app_data(SSL_get_SSL_CTX(ssl))); }
  static Attempt& attempt(SSL* ssl) { return *static_cast<Attempt*>(SSL_get_app_data(ssl)); }
  static Attempt& attempt(BIO* bio) { return *static_cast<Attempt*>(BIO_get_data(bio)); }

  unsigned psk(unsigned char* to, unsigned room) const {
    if (room < Key::kSize) return 0;
    std::copy(key.bytes().begin(), key.bytes().end(), to);
    return Key::kSize;
  }
  bool cookie(const Endpoint& peer, unsigned char* to) const {
    const auto from = bytes_of(peer);
    unsigned n = 0;
    return HMAC(EVP_sha256(), secret.data(), static_cast<int>(secret.size()), from.data(), from.size(), to, &n) !=
               nullptr &&
           n == kCookie;
  }

  void make_method() {
    datagrams = BIO_meth_new(BIO_TYPE_SOURCE_SINK | BIO_get_new_index(), "twoport datagrams");
    if (datagrams == nullptr) fail("BIO");
    BIO_meth_set_create(datagrams, [](BIO* b) {
      BIO_set_init(b, 1);
      return 1;
    });
    BIO_meth_set_write(datagrams, [](BIO* b, const char* from, int size) { return attempt(b).write(from, size); });
    BIO_meth_set_read(datagrams, [](BIO* b, char* to, int room) {
      BIO_clear_retry_flags(b);
      const int n = attempt(b).read(to, room);
      if (n < 0) BIO_set_retry_read(b);
      return n;
    });
    BIO_meth_set_ctrl(datagrams, [](BIO*, int command, long, void*) -> long {
      switch (command) {
        case BIO_CTRL_FLUSH:
          return 1;
        case BIO_CTRL_DGRAM_QUERY_MTU:
        case BIO_CTRL_DGRAM_GET_FALLBACK_MTU:
          return kMtu;
        default:
          return 0;
      }
    });
  }

  void make_context(bool server) {
    context = SSL_CTX_new(server ? DTLS_server_method() : DTLS_client_method());
    if (context == nullptr || SSL_CTX_set_min_proto_version(context, DTLS1_2_VERSION) != 1 ||
        SSL_CTX_set_max_proto_version(context, DTLS1_2_VERSION) != 1)
      fail("DTLS 1.2");
    if (SSL_CTX_set_cipher_list(context, kCipherSuite) != 1) fail(kCipherSuite);
    if (SSL_CTX_set1_groups_list(context, kGroups) != 1) fail(kGroups);
    SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_OFF);
    SSL_CTX_set_options(context, SSL_OP_NO_QUERY_MTU | SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_TICKET |
                                     SSL_OP_NO_COMPRESSION | (server ? SSL_OP_COOKIE_EXCHANGE : 0));
    SSL_CTX_set_read_ahead(context, 1);
    SSL_CTX_set_app_data(context, this);
    SSL_CTX_set_psk_client_callback(
        context,
        [](SSL* ssl, const char*, char* name, unsigned name_room, unsigned char* to, unsigned room) -> unsigned {
          if (name_room < sizeof kIdentity) return 0;
          std::memcpy(name, kIdentity, sizeof kIdentity);
          return of(ssl).psk(to, room);
        });
    SSL_CTX_set_psk_server_callback(context,
                                    [](SSL* ssl, const char* name, unsigned char* to, unsigned room) -> unsigned {
                                      return std::strcmp(name, kIdentity) == 0 ? of(ssl).psk(to, room) : 0;
                                    });
    SSL_CTX_set_cookie_generate_cb(context, [](SSL* ssl, unsigned char* to, unsigned* size) {
      *size = kCookie;
      return of(ssl).cookie(attempt(ssl).peer, to) ? 1 : 0;
    });
    SSL_CTX_set_cookie_verify_cb(context, [](SSL* ssl, const unsigned char* received, unsigned size) {
      std::array<unsigned char, EVP_MAX_MD_SIZE> expected{};
      const bool made = of(ssl).cookie(attempt(ssl).peer, expected.data());
      return made && size == kCookie && CRYPTO_memcmp(expected.data(), received, kCookie) == 0 ? 1 : 0;
    });
    if (RAND_bytes(secret.data(), static_cast<int>(secret.size())) != 1) fail("random numbers");
  }
};

DtlsHandshake::DtlsHandshake(const DtlsOptions& options, const Key& key)
    : options_{options}, shared_{std::make_unique<Shared>(key.bytes())} {
  shared_->make_method();
  shared_->make_context(options.server);
  if (options.server) listener_ = make_attempt({});
}
DtlsHandshake::~DtlsHandshake() = default;

std::unique_ptr<DtlsHandshake::Attempt> DtlsHandshake::make_attempt(const Endpoint& peer) {
  auto attempt = std::make_unique<Attempt>(*this, peer);
  attempt->listens = options_.server;
  attempt->ssl = SSL_new(shared_->context);
  BIO* const bio = BIO_new(shared_->datagrams);
  if (attempt->ssl == nullptr || bio == nullptr) fail("session");
  BIO_set_data(bio, attempt.get());
  SSL_set_bio(attempt->ssl, bio, bio);
  SSL_set_app_data(attempt->ssl, attempt.get());
  DTLS_set_link_mtu(attempt->ssl, kMtu);
  DTLS_set_timer_cb(attempt->ssl, [](SSL*, unsigned) -> unsigned { return 1'000'000'000; });  // off: see send_again
  if (options_.server) {
    SSL_set_accept_state(attempt->ssl);
  } else {
    SSL_set_connect_state(attempt->ssl);
  }
  return attempt;
}

DtlsHandshake::Attempt* DtlsHandshake::find(const Endpoint& peer) noexcept {
  const auto at = std::find_if(attempts_.begin(), attempts_.end(), [&](const auto& a) { return a->peer == peer; });
  return at == attempts_.end() ? nullptr : at->get();
}

void DtlsHandshake::on(std::span<const std::byte> bytes, const Endpoint& from, Duration now) {
  if (bytes.empty() || !plausible(bytes, options_.server)) {
    ++counts_.refused;
    return;
  }
  if (options_.server && is_client_hello(bytes)) {
    on_hello(bytes, from, now);
    return;
  }
  Attempt* const attempt = find(from);
  if (attempt == nullptr) {
    ++counts_.refused;
    return;
  }
  proceed(*attempt, bytes, now);
}

/// With the cookie and the random number of an attempt it is that attempt's, which has it already: it is answered by the
/// flight that follows. All others go to the listener, which answers with a cookie or, given the right one, becomes an
/// attempt in place of the last one of this address. Nobody else than that address can therefore end an attempt.
void DtlsHandshake::on_hello(std::span<const std::byte> bytes, const Endpoint& from, Duration now) {
  std::array<std::byte, kRandom> random;
  std::copy_n(bytes.data() + kRandomAt, kRandom, random.data());
  const std::size_t session = std::to_integer<std::size_t>(bytes[kRandomAt + kRandom]);
  const std::size_t cookie_at = kRandomAt + kRandom + 1 + session;
  const bool has_cookie = cookie_at < bytes.size() && bytes[cookie_at] != std::byte{0};
  Attempt* const known = find(from);
  if (has_cookie && known != nullptr && known->random == random) return;

  listener_->peer = from;
  listener_->in = bytes;
  ERR_clear_error();
  const std::size_t before = outgoing_.size();
  const int verified = DTLSv1_listen(listener_->ssl, shared_->address);
  listener_->in = {};
  if (verified <= 0) {
    if (outgoing_.size() > before) {
      ++counts_.cookies_sent;
    } else {
      ++counts_.refused;
    }
    if (verified < 0) listener_ = make_attempt({});
    return;
  }
  make_room(from, now);
  listener_->listens = false;
  listener_->random = random;
  attempts_.push_back(std::move(listener_));
  listener_ = make_attempt({});
  answered_ = true;
  Attempt& attempt = *attempts_.back();
  attempt.began = attempt.repeated = attempt.progressed = now;
  proceed(attempt, {}, now);
}

/// For an attempt of `peer`: in place of its last one, of the oldest of its host, or of the oldest of all.
void DtlsHandshake::make_room(const Endpoint& peer, Duration now) {
  const auto erase_oldest = [&](auto belongs) {
    auto oldest = attempts_.end();
    for (auto at = attempts_.begin(); at != attempts_.end(); ++at)
      if (belongs(**at) && (oldest == attempts_.end() || (*at)->progressed < (*oldest)->progressed)) oldest = at;
    if (oldest != attempts_.end()) attempts_.erase(oldest);
  };
  std::erase_if(attempts_, [&](const auto& a) { return a->peer == peer || now - a->progressed > kRemember; });
  const auto of_host = [&](const Attempt& a) { return same_host(a.peer, peer); };
  if (std::count_if(attempts_.begin(), attempts_.end(), [&](const auto& a) { return of_host(*a); }) >=
      static_cast<std::ptrdiff_t>(kMostPerHost))
    erase_oldest(of_host);
  if (attempts_.size() >= kMostAttempts) erase_oldest([](const Attempt&) { return true; });
}

void DtlsHandshake::proceed(Attempt& attempt, std::span<const std::byte> bytes, Duration now) {
  // The last flight is the server's: it repeats it for a client that has not received it.
  if (attempt.finished && !options_.server) return;
  ERR_clear_error();
  attempt.in = bytes;
  attempt.fresh = true;
  if (attempt.finished) {
    std::array<char, 64> nothing;
    SSL_read(attempt.ssl, nothing.data(), nothing.size());
    attempt.in = {};
    if (attempt.fresh && now - attempt.repeated >= kRepeatAfter) send_again(attempt, now);
    return;
  }
  const int result = SSL_do_handshake(attempt.ssl);
  attempt.in = {};
  if (!attempt.fresh) {
    attempt.progressed = attempt.repeated = now;
    attempt.repeat_after = kRepeatAfter;
    if (!bytes.empty()) {
      answered_ = true;
      if (!attempt.round_trip) attempt.round_trip = now - attempt.began;
    }
  }
  if (result == 1) {
    attempt.progressed = now;
    finish(attempt);
  } else if (SSL_get_error(attempt.ssl, result) != SSL_ERROR_WANT_READ) {
    attempt.failed = true;
    ++counts_.refused;
  }
}

void DtlsHandshake::finish(Attempt& attempt) {
  RecordKeys of_client, of_server;
  if (!derive_keys(attempt.ssl, of_client, of_server)) {
    attempt.failed = true;
    return;
  }
  attempt.finished = true;
  answered_ = false;
  ++counts_.associations;
  associations_.push_back(std::make_unique<Association>(Association{attempt.peer, attempt.progressed - attempt.began,
                                                                    Sealer{options_.server ? of_server : of_client},
                                                                    Opener{options_.server ? of_client : of_server}}));
}

void DtlsHandshake::send_again(Attempt& attempt, Duration now) {
  attempt.repeated = now;
  attempt.repeat_after = std::min(2 * attempt.repeat_after, kRepeatAtMost);
  for (const Datagram& datagram : attempt.flight)
    if (outgoing_.size() < kMostOutgoing) outgoing_.push_back(datagram);
}

void DtlsHandshake::advance(Duration now, bool wanted) {
  for (const auto& attempt : attempts_) {
    if (attempt->finished || attempt->failed) continue;
    const Duration patience = options_.server       ? kServerGivesUpAfter
                              : attempt->round_trip ? kClientGivesUpAfter + kRoundTrips * *attempt->round_trip
                                                    : Duration::max();
    if (now - attempt->progressed >= patience) {
      attempt->failed = true;
    } else if (now - attempt->repeated >= attempt->repeat_after) {
      send_again(*attempt, now);
    }
  }
  std::erase_if(attempts_,
                [&](const auto& a) { return a->failed || (a->finished && now - a->progressed > kRemember); });
  if (options_.server || !wanted || !associations_.empty()) return;
  const bool under_way = std::any_of(attempts_.begin(), attempts_.end(), [](const auto& a) { return !a->finished; });
  if (under_way || (began_ && now - *began_ < kRepeatAfter)) return;
  began_ = now;
  attempts_.clear();
  attempts_.push_back(make_attempt(*options_.peer));
  attempts_.back()->began = attempts_.back()->progressed = now;
  proceed(*attempts_.back(), {}, now);
}

bool DtlsHandshake::take_outgoing(Datagram& datagram) {
  if (sent_ == outgoing_.size()) return false;
  datagram = outgoing_[sent_++];
  if (sent_ == outgoing_.size()) {
    outgoing_.clear();
    sent_ = 0;
  }
  return true;
}

std::unique_ptr<Association> DtlsHandshake::take_association() {
  if (associations_.empty()) return nullptr;
  std::unique_ptr<Association> association = std::move(associations_.front());
  associations_.erase(associations_.begin());
  return association;
}

}  // namespace twoport
