#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "common/base/time.h"
#include "common/link/datagram.h"
#include "common/link/endpoint.h"
#include "common/secure/key.h"
#include "common/secure/key_proof.h"
#include "common/secure/record.h"

struct ssl_ctx_st;
struct ssl_st;
struct bio_st;

namespace twoport {

/// What a finished handshake leaves: the peer, which of our keys it has, and the ciphers of both directions.
struct Association {
  Endpoint peer;
  std::size_t key = 0;
  Duration round_trip{0};
  Sealer sealer;
  Opener opener;
};

struct DtlsOptions {
  bool server = false;
  std::optional<Endpoint> peer{};  ///< a client's
};

struct DtlsCounts {
  std::uint64_t associations = 0;
  std::uint64_t cookies_sent = 0;
  std::uint64_t refused = 0;  ///< datagrams without proof of the key, or of no attempt of ours
  std::uint64_t failed = 0;   ///< last_failure() has been set
};

/// Why a handshake has come to nothing.
enum class HandshakeFailure : std::uint8_t {
  none,
  packets_lost,     ///< the other side has the key, and an attempt had no progress
  other_key,        ///< three datagrams in a row were made with no key of ours
  earlier_version,  ///< handshakes of a program that does not prove the key first
};

/// Handshakes of DTLS 1.2 with a pre-shared key, cipher suite ECDHE-PSK-CHACHA20-POLY1305 (RFC 6347, 5489, 7905), each datagram
/// behind a proof of the key (key_proof.h): datagrams and times in, datagrams and associations out. No socket, thread or clock,
/// so that it also runs in virtual time. A handshake costs a few milliseconds (ECDHE) and allocates: not for a tick.
///
///     client  of_client(attempt, no cookie, ClientHello)  ->           server: the proof holds? Nothing is kept
///             <-  cookie(attempt, cookie)                              of address, attempt and hello, good for 2 to 4 minutes
///             of_client(attempt, cookie, ClientHello)     ->           first time for this attempt? It begins
///             <-> records of DTLS in of_client and of_server           each of this attempt, or dropped
///
/// Who has no key gets no cookie and begins nothing. Who repeats what he has recorded gets a cookie that he cannot use, since it
/// must stand under the proof, and begins nothing either: an attempt begins once. A server has at most sixteen attempts, four a key;
/// a fifth takes the place of the oldest of its own key, a seventeenth that of a finished one, or none. An
/// attempt never touches an association: whoever holds one keeps it until take_association() returns the next.
///
/// A server may have several keys, one for each client. The first datagram says which; all others of the attempt, and the PSK of its
/// handshake, must be of the same.
///
/// A flight is sent again 50 ms after the last progress, then after 100, 200, 400 and every 800 ms. OpenSSL's own timers, which
/// read the system's clock, are off. The keys of an association are exported (RFC 5705): OpenSSL's own records have others.
class DtlsHandshake {
 public:
  /// A client has one key. Throws std::runtime_error when OpenSSL lacks what is needed.
  DtlsHandshake(const DtlsOptions& options, std::span<const Key> keys);
  DtlsHandshake(const DtlsOptions& options, const Key& key) : DtlsHandshake{options, std::span{&key, 1}} {}
  ~DtlsHandshake();
  DtlsHandshake(const DtlsHandshake&) = delete;

  /// A datagram that may be of a handshake.
  void on(std::span<const std::byte> bytes, const Endpoint& from, Duration now);
  /// Time goes on: flights are repeated. `wanted`: a client makes attempts until an association is there.
  void advance(Duration now, bool wanted);
  /// The next datagram to be sent, `from` being where it goes. False when there is none.
  bool take_outgoing(Datagram& datagram);
  /// A new association; null: none.
  std::unique_ptr<Association> take_association();

  /// Since the last association.
  [[nodiscard]] HandshakeFailure last_failure() const noexcept { return failure_; }
  /// With whom.
  [[nodiscard]] const Endpoint& failed_peer() const noexcept { return failed_peer_; }
  [[nodiscard]] const DtlsCounts& counts() const noexcept { return counts_; }

 private:
  struct Attempt;

  std::unique_ptr<Attempt> make_attempt(const Endpoint& peer, std::size_t key, const Bits128& number);
  void on_client(const HandshakeParts& parts, std::size_t key, const Endpoint& from, Duration now);
  void on_server(const HandshakeParts& parts, Duration now);
  void on_other_key(const HandshakeParts& parts, const Endpoint& from, Duration now);
  void proceed(Attempt& attempt, std::span<const std::byte> records, Duration now);
  void finish(Attempt& attempt);
  void send(const HandshakeParts& parts, std::size_t key, const Endpoint& to, std::size_t most_waiting);
  void send(const Attempt& attempt, std::span<const std::byte> records);
  void send_again(Attempt& attempt, Duration now);
  bool make_room(std::size_t key);
  void note_failure(HandshakeFailure why, const Endpoint& peer) noexcept;
  Attempt* find(const Endpoint& peer, std::size_t key, const Bits128& number) noexcept;
  [[nodiscard]] bool is_told(const Endpoint& peer, Duration now) noexcept;

  DtlsOptions options_;
  KeyProof proof_;
  struct Shared;
  std::unique_ptr<Shared> shared_;
  std::vector<std::unique_ptr<Attempt>> attempts_;  ///< and finished ones, which may have to repeat their last flight
  /// The last attempts of a server, by key and number: none begins twice.
  std::array<std::pair<std::size_t, Bits128>, 256> begun_{};
  std::size_t next_begun_ = 0;
  std::optional<Duration> began_;  ///< a client's last attempt
  std::deque<Datagram> outgoing_;
  std::vector<std::unique_ptr<Association>> associations_;
  DtlsCounts counts_;
  struct Told {
    Endpoint peer;
    std::optional<Duration> at;
  };
  std::array<Told, 64> told_{};  ///< whom a server has told that its key is another
  std::size_t next_told_ = 0;
  int unproved_ = 0;  ///< datagrams in a row
  HandshakeFailure failure_ = HandshakeFailure::none;
  Endpoint failed_peer_;
};

/// Are these records of DTLS a ClientHello?
bool is_client_hello(std::span<const std::byte> records) noexcept;
/// Does a datagram begin like a record of DTLS?
bool is_dtls(std::span<const std::byte> bytes) noexcept;

}  // namespace twoport
