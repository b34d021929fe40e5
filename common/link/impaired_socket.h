#pragma once

#include <cstdint>
#include <optional>

#include "common/link/datagram.h"
#include "common/link/delay_line.h"
#include "common/link/socket.h"

namespace twoport {

struct ImpairedSocketOptions {
  ImpairmentOptions incoming{};    ///< what the network does to datagrams on their way here
  std::uint64_t seed = 1;          ///< from the scene's seed and the direction
  double peer_rate_hz = 1000.0;    ///< at which the peer sends
  std::optional<Endpoint> peer{};  ///< given: datagrams of any other address are dropped and counted as rejected
};

/// The network of a scene, emulated over bytes above another socket. Incoming datagrams pass a delay line with random
/// loss and delay; outgoing ones pass at once, since the other side emulates its incoming direction.
///
/// Datagrams of the peer (the given one, or the last one paired with) and those of all other addresses have separate lines
/// and random sequences. Unpaired senders therefore neither fill the line of the peer nor change the loss and delay of its
/// datagrams. The line of the others is short and accepts few datagrams per tick.
///
/// Blackouts count from the first pairing.
class ImpairedSocket final : public DatagramSocket {
 public:
  /// `socket` must outlive this.
  ImpairedSocket(DatagramSocket& socket, const ImpairedSocketOptions& options);

  bool send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept override;
  /// Asks the socket below until it has nothing more, once for each new `now`.
  std::optional<ReceivedDatagram> receive(Duration now) noexcept override;
  void paired(const Endpoint& peer, Duration since) noexcept override;
  [[nodiscard]] const Endpoint& local() const noexcept override;
  [[nodiscard]] SocketCounts counts() const noexcept override;

 private:
  /// The next datagram from below that is let in in this tick.
  std::optional<ReceivedDatagram> accepted(Duration now) noexcept;

  DatagramSocket* socket_;
  bool peer_is_given_;
  std::optional<Endpoint> peer_;
  DelayLine<Datagram> of_peer_, of_others_;
  bool passes_;  ///< nothing is impaired: datagrams pass as they are, without a copy
  std::optional<Duration> tick_, start_;
  int left_ = 0, others_left_ = 0;  ///< datagrams still let in in this tick
  Rejected rejected_;
};

}  // namespace twoport
