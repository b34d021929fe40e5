#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "common/base/time.h"
#include "common/link/endpoint.h"
#include "common/link/rejected.h"

namespace twoport {

struct ReceivedDatagram {
  std::span<const std::byte> bytes;  ///< good until the next receive
  Endpoint from;
  Duration arrived{0};  ///< strictly before the `now` of the receive that returned it
};

/// Datagrams that a socket, or a filter above it, did not pass on.
struct SocketCounts {
  std::uint64_t unsent = 0;  ///< of those that the layer above has sent: could not be handed over
  Rejected rejected{};
  std::uint64_t lost = 0;        ///< dropped by the impairment
  std::uint64_t overflowed = 0;  ///< of the peer, dropped because the delay line was full
};

/// Datagrams in, datagrams out: a socket (UDP or memory), or a filter above another DatagramSocket.
///
///     Mailbox            reports: newest state, largest energy
///     LinkTransport      Handshake over Codec: bytes <-> reports of this session
///     SecureSocket       with a key: encrypts and authenticates; sends and drops datagrams of its own
///     ImpairedSocket     the network that the scene describes, over bytes
///     UdpSocket          or MemorySocket, in virtual time
///
/// `now` is the time since the loop began and must not decrease. No call waits, allocates or throws. One thread.
class DatagramSocket {
 public:
  virtual ~DatagramSocket() = default;

  /// False, and counted, when the datagram could not be handed over; to the protocol it is one more lost packet.
  virtual bool send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept = 0;

  /// The next datagram; nothing when none waits.
  virtual std::optional<ReceivedDatagram> receive(Duration now) noexcept = 0;

  /// The session above uses `peer` from now on. `since`: time at which `peer` was found.
  virtual void paired(const Endpoint& /*peer*/, Duration /*since*/) noexcept {}

  /// The address that this socket is bound to.
  [[nodiscard]] virtual const Endpoint& local() const noexcept = 0;

  /// Of this socket and of all below it.
  [[nodiscard]] virtual SocketCounts counts() const noexcept = 0;
};

}  // namespace twoport
