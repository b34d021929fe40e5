#include "common/secure/dtls_handshake.h"

#include <openssl/crypto.h>
#include <openssl/err.h>
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
// RFC 5705, 4: a label that nobody has registered.
constexpr char kExportLabel[] = "EXPERIMENTAL twoport records";
constexpr long kMtu = kMaxDatagramBytes - kProofHeader;

constexpr Duration kRepeatAfter = 50ms, kRepeatAtMost = 800ms;
// Without progress. A client knows the round trip from the first answer; before that its ClientHello costs nobody anything.
constexpr Duration kServerGivesUpAfter = 8s, kClientGivesUpAfter = 1500ms;
constexpr int kRoundTrips = 4;       // that a client waits besides
constexpr Duration kRemember = 60s;  // a finished attempt, which may have to repeat its last flight
constexpr std::size_t kMostAttempts = 16;
constexpr std::ptrdiff_t kMostOfAKey = 4;
// [datagrams]; of the answers to those without proof or cookie, which must leave room
constexpr std::size_t kMostOutgoing = 256, kMostAnswers = 32, kMostPerFlight = 8;
constexpr Duration kCookiesLast = 2min;  // and as long again
constexpr Duration kTellAgainAfter = 20ms;
constexpr int kUnprovedInARow = 3;  // one may be damaged

[[noreturn]] void fail(const char* what) {
  char reason[160];
  ERR_error_string_n(ERR_peek_last_error(), reason, sizeof reason);
  throw std::runtime_error(std::string{"this OpenSSL cannot be used: "} + what + ": " + reason);
}

/// Address and port, for a cookie.
std::array<std::byte, 23> bytes_of(const Endpoint& e) noexcept {
  std::array<std::byte, 23> out{};
  std::transform(e.address.begin(), e.address.end(), out.begin(), [](std::uint8_t b) { return std::byte{b}; });
  for (std::size_t i = 0; i < 4; ++i) out[16 + i] = static_cast<std::byte>(e.scope >> (8 * i));
  out[20] = static_cast<std::byte>(e.port >> 8), out[21] = static_cast<std::byte>(e.port), out[22] = std::byte{e.v6};
  return out;
}
/// One IPv4 /24, also as IPv6 addresses, or one IPv6 /64: whoever has one address there may have all.
bool same_network(const Endpoint& a, const Endpoint& b) noexcept {
  static constexpr std::array<std::uint8_t, 12> kMapped{0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff};
  const auto size = !a.v6 ? 3 : std::equal(kMapped.begin(), kMapped.end(), a.address.begin()) ? 15 : 8;
  return a.v6 == b.v6 && std::equal(a.address.begin(), a.address.begin() + size, b.address.begin());
}

/// For the records of application data.
bool export_keys(SSL* ssl, RecordKeys& of_client, RecordKeys& of_server) {
  std::array<std::uint8_t, 2 * (32 + 12)> block;
  const bool exported = SSL_export_keying_material(ssl, block.data(), block.size(), kExportLabel,
                                                   sizeof kExportLabel - 1, nullptr, 0, 0) == 1;
  std::copy_n(block.data(), 32, of_client.key.data());
  std::copy_n(block.data() + 32, 32, of_server.key.data());
  std::copy_n(block.data() + 64, 12, of_client.iv.data());
  std::copy_n(block.data() + 76, 12, of_server.iv.data());
  OPENSSL_cleanse(block.data(), block.size());
  return exported;
}

template <class Bytes>
Bytes draw() {
  Bytes bytes;
  if (RAND_bytes(reinterpret_cast<unsigned char*>(bytes.data()), static_cast<int>(bytes.size())) != 1)
    fail("random numbers");
  return bytes;
}

/// Cookies under a secret that is drawn anew every two minutes; those of the last secret are good too.
class Cookies {
 public:
  Bits128 make(const Endpoint& peer, const HandshakeParts& hello, Duration now) {
    renew(now);
    return cookie(current_, peer, hello);
  }
  bool fits(const Endpoint& peer, const HandshakeParts& hello, Duration now) {
    renew(now);
    return same_bits(cookie(current_, peer, hello), hello.cookie) ||
           same_bits(cookie(last_, peer, hello), hello.cookie);
  }

 private:
  static Mac draw_secret() {
    auto secret = draw<std::array<std::uint8_t, 32>>();
    Mac mac{secret};
    OPENSSL_cleanse(secret.data(), secret.size());
    return mac;
  }
  static Bits128 cookie(Mac& mac, const Endpoint& peer, const HandshakeParts& hello) {
    return mac.of({bytes_of(peer), hello.attempt, hello.records});
  }
  void renew(Duration now) {
    if (now - since_ < kCookiesLast) return;
    last_ = now - since_ < 2 * kCookiesLast ? std::move(current_) : draw_secret();
    current_ = draw_secret();
    since_ = now;
  }

  Mac current_ = draw_secret(), last_ = draw_secret();
  Duration since_{0};
};

}  // namespace

bool is_client_hello(std::span<const std::byte> b) noexcept {
  return b.size() > kRecordHeader && b[0] == std::byte{22} && b[3] == std::byte{0} && b[4] == std::byte{0} &&
         b[kRecordHeader] == std::byte{1};
}
bool is_dtls(std::span<const std::byte> b) noexcept {
  return b.size() > kRecordHeader && b[0] >= std::byte{20} && b[0] <= std::byte{23} && b[1] == std::byte{0xfe};
}

/// One handshake.
struct DtlsHandshake::Attempt {
  DtlsHandshake& owner;
  Endpoint peer;
  std::size_t key;
  Bits128 number;
  Bits128 cookie{};  ///< a client's
  ssl_st* ssl = nullptr;
  std::span<const std::byte> in;  ///< one datagram at a time keeps the boundaries of records
  std::vector<Datagram> flight;   ///< records of the last one sent, to be sent again
  bool fresh = true;              ///< what is sent next begins a flight
  bool finished = false, failed = false;
  bool answered = false;               ///< by records
  std::optional<Duration> round_trip;  ///< of the last exchange
  Duration progressed{0}, repeated{0}, repeat_after{kRepeatAfter};

  Attempt(DtlsHandshake& o, const Endpoint& p, std::size_t k, const Bits128& n)
      : owner{o}, peer{p}, key{k}, number{n} {}
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
    const std::span records{reinterpret_cast<const std::byte*>(from), static_cast<std::size_t>(size)};
    if (records.size() > kMtu) return size;
    if (std::exchange(fresh, false)) flight.clear();
    if (flight.size() < kMostPerFlight) flight.emplace_back().assign(records, peer);
    owner.send(*this, records);
    return size;
  }
};

struct DtlsHandshake::Shared {
  ssl_ctx_st* context = nullptr;
  bio_method_st* datagrams = nullptr;
  std::vector<Key> keys;
  Cookies cookies;

  explicit Shared(std::span<const Key> of) {
    keys.reserve(of.size());
    for (const Key& key : of) keys.emplace_back(key.bytes());
  }
  ~Shared() {
    SSL_CTX_free(context);
    BIO_meth_free(datagrams);
  }
  Shared(const Shared&) = delete;

  static Attempt& attempt(SSL* ssl) { return *static_cast<Attempt*>(SSL_get_app_data(ssl)); }
  static Attempt& attempt(BIO* bio) { return *static_cast<Attempt*>(BIO_get_data(bio)); }

  /// That the attempt has been proved with.
  static unsigned psk(SSL* ssl, unsigned char* to, unsigned room) {
    if (room < Key::kSize) return 0;
    const Attempt& a = attempt(ssl);
    const Key::Bytes& bytes = a.owner.shared_->keys[a.key].bytes();
    std::copy(bytes.begin(), bytes.end(), to);
    return Key::kSize;
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
    SSL_CTX_set_options(context,
                        SSL_OP_NO_QUERY_MTU | SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_TICKET | SSL_OP_NO_COMPRESSION);
    SSL_CTX_set_read_ahead(context, 1);
    SSL_CTX_set_psk_client_callback(
        context,
        [](SSL* ssl, const char*, char* name, unsigned name_room, unsigned char* to, unsigned room) -> unsigned {
          if (name_room < sizeof kIdentity) return 0;
          std::memcpy(name, kIdentity, sizeof kIdentity);
          return psk(ssl, to, room);
        });
    SSL_CTX_set_psk_server_callback(context,
                                    [](SSL* ssl, const char* name, unsigned char* to, unsigned room) -> unsigned {
                                      return std::strcmp(name, kIdentity) == 0 ? psk(ssl, to, room) : 0;
                                    });
  }
};

DtlsHandshake::DtlsHandshake(const DtlsOptions& options, std::span<const Key> keys)
    : options_{options}, proof_{keys}, shared_{std::make_unique<Shared>(keys)} {
  shared_->make_method();
  shared_->make_context(options.server);
}
DtlsHandshake::~DtlsHandshake() = default;

std::unique_ptr<DtlsHandshake::Attempt> DtlsHandshake::make_attempt(const Endpoint& peer, std::size_t key,
                                                                    const Bits128& number) {
  auto attempt = std::make_unique<Attempt>(*this, peer, key, number);
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

DtlsHandshake::Attempt* DtlsHandshake::find(const Endpoint& peer, std::size_t key, const Bits128& number) noexcept {
  const auto at = std::find_if(attempts_.begin(), attempts_.end(),
                               [&](const auto& a) { return a->peer == peer && a->key == key && a->number == number; });
  return at == attempts_.end() ? nullptr : at->get();
}

void DtlsHandshake::note_failure(HandshakeFailure why, const Endpoint& peer) noexcept {
  failure_ = why, failed_peer_ = peer;
  ++counts_.failed;
}

void DtlsHandshake::on(std::span<const std::byte> bytes, const Endpoint& from, Duration now) {
  const std::optional<HandshakeParts> parts = read_handshake(bytes);
  if (!parts) {
    ++counts_.refused;
    if (is_dtls(bytes) && ++unproved_ >= kUnprovedInARow) note_failure(HandshakeFailure::earlier_version, from);
    return;
  }
  const std::optional<std::size_t> key = proof_.key_of(bytes);
  if (parts->kind == HandshakeKind::other_key || !key) {
    ++counts_.refused;
    on_other_key(*parts, from, now);
    return;
  }
  unproved_ = 0;
  if (options_.server) {
    on_client(*parts, *key, from, now);
  } else {
    on_server(*parts, now);
  }
}

/// Of a server, or of a client that proves no key of ours. The answer names the attempt, which only a receiver of the client's
/// datagrams knows, is shorter than what it answers, and goes to a network every 20 ms at most.
void DtlsHandshake::on_other_key(const HandshakeParts& parts, const Endpoint& from, Duration now) {
  const bool told = parts.kind == HandshakeKind::other_key;
  if (told != !options_.server || (told && find(from, 0, parts.attempt) == nullptr)) return;
  if (++unproved_ >= kUnprovedInARow) note_failure(HandshakeFailure::other_key, from);
  if (options_.server && parts.kind == HandshakeKind::of_client && !parts.records.empty() && !is_told(from, now))
    send({.kind = HandshakeKind::other_key, .attempt = parts.attempt}, 0, from, kMostAnswers);
}

bool DtlsHandshake::is_told(const Endpoint& peer, Duration now) noexcept {
  auto at = std::find_if(told_.begin(), told_.end(), [&](const Told& t) { return t.at && same_network(t.peer, peer); });
  if (at != told_.end() && now - *at->at < kTellAgainAfter) return true;
  if (at == told_.end()) at = told_.begin() + static_cast<std::ptrdiff_t>(next_told_++ % told_.size());
  *at = {peer, now};
  return false;
}

/// A proven datagram at the server.
void DtlsHandshake::on_client(const HandshakeParts& parts, std::size_t key, const Endpoint& from, Duration now) {
  const bool hello = is_client_hello(parts.records);
  if (Attempt* const known = find(from, key, parts.attempt)) {
    // A ClientHello that it has already is answered by the flight that follows.
    if (!hello) proceed(*known, parts.records, now);
    return;
  }
  if (parts.kind != HandshakeKind::of_client || !hello) {
    ++counts_.refused;
    return;
  }
  if (!shared_->cookies.fits(from, parts, now)) {
    ++counts_.cookies_sent;
    send({.kind = HandshakeKind::cookie, .attempt = parts.attempt, .cookie = shared_->cookies.make(from, parts, now)},
         key, from, kMostAnswers);
    return;
  }
  const std::pair begun{key, parts.attempt};
  const bool again = std::find(begun_.begin(), begun_.end(), begun) != begun_.end();
  if (again || !make_room(key)) {
    ++counts_.refused;
    return;
  }
  attempts_.push_back(make_attempt(from, key, parts.attempt));
  begun_[next_begun_++ % begun_.size()] = begun;
  Attempt& attempt = *attempts_.back();
  attempt.repeated = attempt.progressed = now;
  proceed(attempt, parts.records, now);
}

/// A proven datagram at the client. A cookie counts until the server has begun; then it may have started again, with others.
void DtlsHandshake::on_server(const HandshakeParts& parts, Duration now) {
  Attempt* const attempt = find(*options_.peer, 0, parts.attempt);
  if (attempt == nullptr || parts.kind == HandshakeKind::of_client) {
    ++counts_.refused;
    return;
  }
  if (parts.kind == HandshakeKind::of_server) {
    attempt->answered = true;
    proceed(*attempt, parts.records, now);
  } else if (!attempt->answered && attempt->cookie != parts.cookie) {
    attempt->cookie = parts.cookie;
    attempt->round_trip = now - attempt->progressed;
    attempt->progressed = now;
    send_again(*attempt, now);
    attempt->repeat_after = kRepeatAfter;
  }
}

/// For one more attempt with `key`. False: there is none.
bool DtlsHandshake::make_room(std::size_t key) {
  const auto drop_oldest = [&](auto is_one) {
    auto oldest = attempts_.end();
    for (auto at = attempts_.begin(); at != attempts_.end(); ++at)
      if (is_one(*at) && (oldest == attempts_.end() || (*at)->progressed < (*oldest)->progressed)) oldest = at;
    if (oldest != attempts_.end()) attempts_.erase(oldest);
  };
  const auto is_of_key = [&](const auto& a) { return a->key == key; };
  if (std::count_if(attempts_.begin(), attempts_.end(), is_of_key) >= kMostOfAKey) drop_oldest(is_of_key);
  if (attempts_.size() >= kMostAttempts) drop_oldest([](const auto& a) { return a->finished; });
  return attempts_.size() < kMostAttempts;
}

void DtlsHandshake::proceed(Attempt& attempt, std::span<const std::byte> records, Duration now) {
  // The last flight is the server's: it repeats it for a client that has not received it.
  if (attempt.finished && !options_.server) return;
  ERR_clear_error();
  attempt.in = records;
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
    if (!records.empty()) attempt.round_trip = now - attempt.progressed;
    attempt.progressed = attempt.repeated = now;
    attempt.repeat_after = kRepeatAfter;
  }
  if (result == 1) {
    attempt.progressed = now;
    finish(attempt);
  } else if (SSL_get_error(attempt.ssl, result) != SSL_ERROR_WANT_READ) {
    attempt.failed = true;
    ++counts_.refused;
    note_failure(HandshakeFailure::packets_lost, attempt.peer);
  }
}

void DtlsHandshake::finish(Attempt& attempt) {
  RecordKeys of_client, of_server;
  if (!export_keys(attempt.ssl, of_client, of_server)) {
    attempt.failed = true;
    return;
  }
  attempt.finished = true;
  failure_ = HandshakeFailure::none;
  ++counts_.associations;
  associations_.push_back(std::make_unique<Association>(
      Association{attempt.peer, attempt.key, attempt.round_trip.value_or(0s),
                  Sealer{options_.server ? of_server : of_client}, Opener{options_.server ? of_client : of_server}}));
}

void DtlsHandshake::send(const HandshakeParts& parts, std::size_t key, const Endpoint& to, std::size_t most_waiting) {
  if (outgoing_.size() >= most_waiting) return;
  std::array<std::byte, kMaxDatagramBytes> bytes;
  outgoing_.emplace_back().assign({bytes.data(), proof_.write(key, parts, bytes)}, to);
}
void DtlsHandshake::send(const Attempt& attempt, std::span<const std::byte> records) {
  send({.kind = options_.server ? HandshakeKind::of_server : HandshakeKind::of_client,
        .attempt = attempt.number,
        .cookie = attempt.cookie,
        .records = records},
       attempt.key, attempt.peer, kMostOutgoing);
}
void DtlsHandshake::send_again(Attempt& attempt, Duration now) {
  attempt.repeated = now;
  attempt.repeat_after = std::min(2 * attempt.repeat_after, kRepeatAtMost);
  for (const Datagram& records : attempt.flight) send(attempt, records.bytes());
}

void DtlsHandshake::advance(Duration now, bool wanted) {
  for (const auto& attempt : attempts_) {
    if (attempt->finished || attempt->failed) continue;
    const Duration patience = options_.server       ? kServerGivesUpAfter
                              : attempt->round_trip ? kClientGivesUpAfter + kRoundTrips * *attempt->round_trip
                                                    : Duration::max();
    if (now - attempt->progressed >= patience) {
      attempt->failed = true;
      note_failure(HandshakeFailure::packets_lost, attempt->peer);
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
  attempts_.push_back(make_attempt(*options_.peer, 0, draw<Bits128>()));
  attempts_.back()->progressed = attempts_.back()->repeated = now;
  proceed(*attempts_.back(), {}, now);
}

bool DtlsHandshake::take_outgoing(Datagram& datagram) {
  if (outgoing_.empty()) return false;
  datagram = outgoing_.front();
  outgoing_.pop_front();
  return true;
}

std::unique_ptr<Association> DtlsHandshake::take_association() {
  if (associations_.empty()) return nullptr;
  std::unique_ptr<Association> association = std::move(associations_.front());
  associations_.erase(associations_.begin());
  return association;
}

}  // namespace twoport
