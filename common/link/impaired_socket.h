#pragma once

#include <cstdint>
#include <optional>

#include "common/link/datagram.h"
#include "common/link/delay_line.h"
#include "common/link/socket.h"

namespace twoport {

struct ImpairedSocketOptions {
  ImpairmentOptions incoming{};    ///< what the network does to datagrams on their way here, at first
  std::uint64_t seed = 1;          ///< from the scene's seed and the direction
  double peer_rate_hz = 1000.0;    ///< at which the peer sends
  std::optional<Endpoint> peer{};  ///< given: datagrams of any other address are dropped and counted as rejected
  double rate_hz = 0.0;            ///< at which this side sends, where set_outgoing() may be called
  double longest_set_s = 0.0;      ///< longest delay that is set while it runs: the lines have room for it
};

/// An emulated network over bytes above another socket. Incoming datagrams pass a delay line with random loss and delay. Outgoing
/// ones pass at once, since the other side emulates its incoming direction, until set_outgoing() says otherwise.
///
/// Datagrams of the peer (the given one, or the last one paired with) and those of all other addresses have separate lines
/// and random sequences. Unpaired senders therefore neither fill the line of the peer nor change the loss and delay of its
/// datagrams. The line of the others is short and accepts few datagrams per tick.
///
/// Blackouts count from the first pairing.
class ImpairedSocket final : public DatagramSocket {
 public:
  struct Direction {
    double delay_s = 0.0;
    double jitter_s = 0.0;  ///< standard deviation; a delay is never below 0
    double loss = 0.0;      ///< probability
  };
  /// `socket` must outlive this.
  ImpairedSocket(DatagramSocket& socket, const ImpairedSocketOptions& options);

  // Of datagrams from now on; those on their way keep the delay that they have been given.
  void set_incoming(const Direction& d) noexcept;
  void set_outgoing(const Direction& d) noexcept { outgoing_.adjust(d.delay_s, d.jitter_s, d.loss); }

  /// With an impaired direction sent when its delay is over, in a later receive().
  bool send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept override;
  /// For each new `now` sends what is due, and asks the socket below until it has nothing more.
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
  DelayLine<Datagram> of_peer_, of_others_, outgoing_;
  std::optional<Duration> tick_, start_;
  int left_ = 0, others_left_ = 0;  ///< datagrams still let in in this tick
  Rejected rejected_;
};

}  // namespace twoport
