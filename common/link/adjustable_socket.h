#pragma once

#include <cstdint>
#include <optional>

#include "common/link/datagram.h"
#include "common/link/delay_line.h"
#include "common/link/socket.h"

namespace twoport {

/// A network between this program and the socket below that is changed while it runs: delay, jitter and loss of each
/// direction, none at first. It adds to the network of the scene. Datagrams on their way keep the delay that they have
/// been given. Only datagrams of the peer enter: others neither fill its line nor change the loss and delay of its datagrams.
class AdjustableSocket final : public DatagramSocket {
 public:
  struct Direction {
    double delay_s = 0.0;
    double jitter_s = 0.0;  ///< standard deviation of a normal; a delay is never below 0
    double loss = 0.0;      ///< probability
  };
  struct Room {
    double longest_delay_s, outgoing_hz, incoming_hz;
  };
  /// `socket` must outlive this. `room`: what the delay lines have room for; the rest is dropped and counted.
  AdjustableSocket(DatagramSocket& socket, const Endpoint& peer, const Room& room, std::uint64_t seed);

  void set_outgoing(const Direction& d) noexcept { outgoing_.adjust(d.delay_s, d.jitter_s, d.loss); }
  void set_incoming(const Direction& d) noexcept { incoming_.adjust(d.delay_s, d.jitter_s, d.loss); }

  /// Sent when its delay is over, in a later receive(). A datagram without delay and loss is sent at once.
  bool send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept override;
  /// The first call of each `now` sends what is due and asks the socket below.
  std::optional<ReceivedDatagram> receive(Duration now) noexcept override;
  void paired(const Endpoint& peer, Duration since) noexcept override { socket_->paired(peer, since); }
  [[nodiscard]] const Endpoint& local() const noexcept override { return socket_->local(); }
  [[nodiscard]] SocketCounts counts() const noexcept override;

 private:
  void pass(Duration now) noexcept;

  DatagramSocket* socket_;
  Endpoint peer_;
  DelayLine<Datagram> outgoing_, incoming_;
  Datagram moving_;
  std::optional<Duration> passed_at_;
  std::uint64_t waiting_ = 0;  ///< outgoing datagrams in the line
  Rejected rejected_;
};

}  // namespace twoport
