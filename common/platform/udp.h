#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "common/link/socket.h"

namespace twoport {

/// "127.0.0.1:45001", "[::1]:45001".
std::string to_string(const Endpoint& endpoint);

/// Reads the value of `option` as ADDR:PORT: an IP address, or a host name, which is looked up now and may take seconds; of
/// its addresses the first IPv4 one is taken, else the first. Throws ConfigError with option, value and what is allowed.
Endpoint parse_endpoint(std::string_view text, std::string_view option);

/// Any free port, on any address, from which `peer` can be reached.
Endpoint any_port_toward(const Endpoint& peer);

/// The address of --peer or --listen, which must be of this machine unless `has_key` or `insecure`. Throws ConfigError.
Endpoint parse_allowed_endpoint(std::string_view text, std::string_view option, bool has_key, bool insecure);

/// A port of this machine at which any datagram stops every program that listens there. It is sent to 127.255.255.255, so that each
/// gets it.
class StopInput {
 public:
  /// Throws ConfigError.
  explicit StopInput(std::uint16_t port);
  ~StopInput();
  StopInput(const StopInput&) = delete;
  /// Has one come since the last call? It is answered. Neither waits, allocates nor throws.
  [[nodiscard]] bool is_asked() const noexcept;

 private:
  int fd_;
};

/// A UDP socket; only wait() waits. Sending and receiving allocate nothing and throw nothing.
class UdpSocket final : public DatagramSocket {
 public:
  /// Binds to `local`; port 0 takes a free one. Throws ConfigError naming address, port and what to do.
  explicit UdpSocket(const Endpoint& local);
  /// The same, and from here on receives from `peer` only, with faster routing; without a route it
  /// receives from all. After a second of the peer's silence, and every second of it, it looks whether the system would now reach the
  /// peer from another address, and if so goes on from there. Throws ConfigError for an invalid address.
  UdpSocket(const Endpoint& local, const Endpoint& peer);
  ~UdpSocket() override;
  UdpSocket(UdpSocket&&) noexcept;
  UdpSocket& operator=(UdpSocket&&) noexcept;

  /// False, and counted, when the datagram could not be sent: no receiver, a full queue or no route.
  bool send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept override;

  /// The next received datagram; empty if there is none, or was none when the last batch was fetched. An oversized
  /// one is cut to more than kMaxDatagramBytes.
  std::optional<ReceivedDatagram> receive(Duration now) noexcept override;

  /// A socket that receives from all gets a second one for `peer`, on the same port and connected: the system finds its route once
  /// instead of for each datagram, and others cannot fill its queue. The others are then looked at once a millisecond.
  /// On all addresses of the machine it answers, and is paired, from the one that was called.
  /// Six system calls, at a new peer only; without success nothing changes.
  void paired(const Endpoint& peer, Duration since) noexcept override;

  /// Sleeps until a datagram is there, at most for `span`. The only call that waits: for a loop that runs on arrival and costs no
  /// core meanwhile.
  void wait(Duration span) const noexcept;

  /// From `span` after the first receive of a `now` on, that `now` fetches no further batch: work of a tick is bounded in
  /// time, whatever arrives. What is left stays with the system, which drops what finds its queue full.
  void limit(Duration span) noexcept;

  /// Marks what is sent from here on: the differentiated services code point (RFC 2474), 0 to 63; 46 is expedited forwarding. Networks
  /// may ignore it or take it away. Throws ConfigError where the system refuses it.
  void mark(int code_point);

  /// Where it is bound, with the port that was taken.
  [[nodiscard]] const Endpoint& local() const noexcept override;
  [[nodiscard]] SocketCounts counts() const noexcept override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace twoport
