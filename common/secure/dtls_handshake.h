#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "common/base/time.h"
#include "common/link/datagram.h"
#include "common/link/endpoint.h"
#include "common/secure/key.h"
#include "common/secure/record.h"

struct ssl_ctx_st;
struct ssl_st;
struct bio_st;

namespace twoport {

/// What a finished handshake leaves: the peer, and the ciphers of both directions.
struct Association {
  Endpoint peer;
  Duration took{0};  ///< from the first datagram of the attempt on
  Sealer sealer;
  Opener opener;
};

struct DtlsOptions {
  bool server = false;
  std::optional<Endpoint> peer{};  ///< a client's
};

struct DtlsCounts {
  std::uint64_t associations = 0;
  std::uint64_t cookies_sent = 0;  ///< HelloVerifyRequests
  std::uint64_t refused = 0;       ///< datagrams of nobody's handshake, or of one that failed
  std::uint64_t failed = 0;        ///< attempts that somebody has answered, and that have come to nothing
};

/// Handshakes of DTLS 1.2 with a pre-shared key, cipher suite ECDHE-PSK-CHACHA20-POLY1305 (RFC 6347, 5489, 7905):
/// datagrams and times in, datagrams and associations out. No socket, thread or clock, so that it also runs in virtual time.
/// A handshake costs a few milliseconds (ECDHE) and allocates: not for a tick.
///
/// A client makes attempts while it is wanted. A server keeps no state for a sender until it has returned a cookie, and
/// then one attempt an address, four an IP address, sixteen in all. An attempt never touches an association: whoever holds
/// one keeps it until take() returns the next, which happens only after the peer has proved that it has the key.
///
/// A flight is sent again, byte for byte, 50 ms after the last progress, then after 100, 200, 400 and every 800 ms. OpenSSL's
/// own timers, which read the system's clock, are off.
class DtlsHandshake {
 public:
  /// Throws std::runtime_error when OpenSSL lacks what is needed.
  DtlsHandshake(const DtlsOptions& options, const Key& key);
  ~DtlsHandshake();
  DtlsHandshake(const DtlsHandshake&) = delete;

  /// A datagram of a handshake.
  void on(std::span<const std::byte> bytes, const Endpoint& from, Duration now);
  /// Time goes on: flights are repeated. `wanted`: a client makes attempts until an association is there.
  void advance(Duration now, bool wanted);
  /// The next datagram to be sent, `from` being where it goes. False when there is none.
  bool take_outgoing(Datagram& datagram);
  /// A new association; null: none.
  std::unique_ptr<Association> take_association();

  /// Has somebody answered since the last association, and not finished a handshake? Then the keys differ, or packets are
  /// lost.
  [[nodiscard]] bool answered() const noexcept { return answered_; }
  /// Of the last attempt that has failed.
  [[nodiscard]] const Endpoint& failed_peer() const noexcept { return failed_peer_; }
  [[nodiscard]] const DtlsCounts& counts() const noexcept { return counts_; }

 private:
  struct Attempt;

  std::unique_ptr<Attempt> make_attempt(const Endpoint& peer);
  void on_hello(std::span<const std::byte> bytes, const Endpoint& from, Duration now);
  void proceed(Attempt& attempt, std::span<const std::byte> bytes, Duration now);
  void finish(Attempt& attempt);
  void send_again(Attempt& attempt, Duration now);
  void make_room(const Endpoint& peer, Duration now);
  Attempt* find(const Endpoint& peer) noexcept;

  DtlsOptions options_;
  struct Shared;
  std::unique_ptr<Shared> shared_;
  std::unique_ptr<Attempt> listener_;               ///< a server's, until a sender has returned its cookie
  std::vector<std::unique_ptr<Attempt>> attempts_;  ///< and finished ones, which may have to repeat their last flight
  std::optional<Duration> began_;                   ///< a client's last attempt
  std::vector<Datagram> outgoing_;
  std::size_t sent_ = 0;  ///< of outgoing_
  std::vector<std::unique_ptr<Association>> associations_;
  DtlsCounts counts_;
  bool answered_ = false;
  Endpoint failed_peer_;
};

/// Does a datagram begin with a ClientHello in plain text?
bool is_client_hello(std::span<const std::byte> bytes) noexcept;
/// Does a datagram begin with a record of DTLS of this type?
bool is_dtls(std::span<const std::byte> bytes) noexcept;

}  // namespace twoport
