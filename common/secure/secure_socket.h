#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <thread>
#include <vector>

#include "common/base/ring.h"
#include "common/link/datagram.h"
#include "common/link/socket.h"
#include "common/secure/dtls_handshake.h"
#include "common/secure/key.h"

namespace twoport {

struct SecureSocketOptions {
  bool server = false;
  std::optional<Endpoint> peer{};  ///< a client's
  /// Handshakes run in a thread of their own, beside the cycle; else within receive(), in virtual time.
  bool own_thread = false;
  /// A client agrees on new keys this long after the last ones.
  Duration rekey_after = std::chrono::minutes{10};
  /// Called by that thread: the peer has proved that it has the key at that place (none), or a handshake has come to nothing, which
  /// is said once in five seconds at most.
  std::function<void(HandshakeFailure, const Endpoint& peer, std::size_t key)> tell{};
};

/// A filter above another socket that encrypts and authenticates every datagram: DTLS 1.2 with a pre-shared key. What it
/// hands up comes from a holder of the key, unchanged, once, and within this association. It hands down nothing in
/// plain text.
///
/// Handshakes run beside: datagrams go to and from them through rings. The tick only seals, opens, looks at
/// source and type of a datagram, the source first, and checks that a datagram of a handshake proves a key. A client makes a new
/// handshake when nothing has been opened for 250 ms, so that a server that has started again is found, and when its keys are old.
/// Present associations stay, whatever arrives.
///
/// New keys with a peer that has some already: the client seals with them as soon as its handshake has finished, since the server has
/// them then; the server from the first record on that it has opened with them, since the client has them then. Those of before
/// open records for five seconds more, and are wiped. No keys are used for longer than half an hour.
///
/// A client has one peer, a server up to eight associations, so that whoever it is not paired with can be told so. One more
/// takes the place of the one that has been silent for longest, never of the paired peer's. A peer at whose address another key calls
/// keeps its place while it is heard within a second.
///
/// send() and receive() allocate, lock and throw nothing; not so with handshakes within receive().
class SecureSocket final : public DatagramSocket {
 public:
  /// `socket` must outlive this. Throws std::runtime_error when OpenSSL lacks what is needed.
  SecureSocket(DatagramSocket& socket, const SecureSocketOptions& options, std::span<const Key> keys);
  SecureSocket(DatagramSocket& socket, const SecureSocketOptions& options, const Key& key)
      : SecureSocket{socket, options, std::span{&key, 1}} {}
  ~SecureSocket() override;
  SecureSocket(const SecureSocket&) = delete;

  bool send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept override;
  std::optional<ReceivedDatagram> receive(Duration now) noexcept override;
  void paired(const Endpoint& peer, Duration since) noexcept override;
  [[nodiscard]] const Endpoint& local() const noexcept override;
  [[nodiscard]] SocketCounts counts() const noexcept override;

  /// Why no handshake has succeeded since the last that has.
  [[nodiscard]] HandshakeFailure last_failure() const noexcept { return failure_.load(std::memory_order_relaxed); }
  /// Handshakes that have succeeded.
  [[nodiscard]] std::uint64_t associations() const noexcept { return associations_; }
  /// The key, by its place, of the last paired peer.
  [[nodiscard]] std::optional<std::size_t> paired_key() const noexcept { return paired_key_; }

 private:
  /// An association in use.
  struct Held {
    std::unique_ptr<Association> association;
    Duration since{0}, opened{0};
    Duration ends{0};        ///< it is wiped then
    bool is_shared = false;  ///< the peer has it too: it seals
  };

  void begin_tick(Duration now) noexcept;
  void take_associations(Duration now) noexcept;
  void hold(Association* arrived, Duration now) noexcept;
  void share(std::size_t which, Duration now) noexcept;
  void forget(std::size_t which) noexcept;
  void retire(Association* association) noexcept;
  [[nodiscard]] Held* newest_shared(const Endpoint& peer) noexcept;
  bool hand_over(const ReceivedDatagram& datagram) noexcept;
  bool open(const ReceivedDatagram& datagram, Duration now, std::span<const std::byte>& plain) noexcept;
  void work();
  void tell(Duration now);
  void run();

  DatagramSocket* socket_;
  SecureSocketOptions options_;

  // Of the cycle.
  KeyProof proof_;
  std::vector<Held> held_;  ///< in the order of arrival
  std::optional<Endpoint> paired_;
  std::optional<std::size_t> paired_key_;
  std::optional<Duration> tick_;
  std::uint64_t associations_ = 0, unsent_ = 0;
  std::uint64_t flights_unsent_ = 0;  ///< of handshakes
  Rejected rejected_;
  Datagram passing_;

  // Between the two.
  std::atomic<std::int64_t> now_ns_{0};
  std::atomic<bool> wanted_{false};
  std::atomic<HandshakeFailure> failure_{HandshakeFailure::none};
  std::atomic<std::uint64_t> failed_{0}, taken_{0};
  Ring<Datagram> unproved_, hellos_, flights_, outgoing_;
  Ring<Association*> arrived_, retired_;

  // Of the handshakes.
  DtlsHandshake handshake_;
  Datagram working_, leaving_;
  bool has_leaving_ = false;
  std::uint64_t made_ = 0;
  std::uint64_t told_failed_ = 0;
  std::optional<Duration> failed_at_;  ///< told
  std::unique_ptr<Association> waiting_;
  std::atomic<bool> done_{false};
  std::thread thread_;
};

}  // namespace twoport
