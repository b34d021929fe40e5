#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <random>

#include "common/link/datagram.h"
#include "common/link/due_queue.h"
#include "common/link/impairment.h"
#include "common/link/socket.h"

namespace twoport {

class MemorySocket;

/// A network inside one process, in virtual time: any number of sockets; impairments can change at any time; the same
/// seed gives the same run. A datagram sent at t can be read strictly later than t, so results do not depend on which
/// of two programs is stepped first.
class MemoryNetwork {
 public:
  /// Impairments of a path.
  struct Conditions {
    ImpairmentOptions impairment{};
    double corruption = 0.0;  ///< share of datagrams in which 1 to 4 bytes are replaced, or the end is cut off
  };

  /// `room` for datagrams on their way to each address.
  explicit MemoryNetwork(std::uint64_t seed = 1, std::size_t room = 256);
  ~MemoryNetwork();
  MemoryNetwork(const MemoryNetwork&) = delete;

  /// The address number `host` of this network, and a port.
  static Endpoint address(std::uint8_t host, std::uint16_t port);

  /// Binds to an address that no open socket has. Datagrams that came due before `now` are lost; those still on their
  /// way reach the new socket. The network must outlive the socket.
  MemorySocket open(const Endpoint& local, Duration now);

  /// For datagrams sent to `to` from now on. Blackouts count from time 0.
  void set_conditions(const Endpoint& to, const Conditions& conditions, std::uint64_t seed);
  /// The same for all addresses, those still to come included.
  void set_conditions(const Conditions& conditions);

  /// Sends as if from `from`, which need not be an address of a socket.
  bool send(std::span<const std::byte> bytes, const Endpoint& from, const Endpoint& to, Duration now) noexcept;

 private:
  friend class MemorySocket;

  struct Destination {
    Destination(const Endpoint& address, const Conditions& conditions, std::uint64_t seed, std::size_t room);
    Endpoint address;
    Impairment impairment;
    double corruption;
    DueQueue<Datagram> line;
    bool bound = false;
    std::uint64_t lost = 0, overflowed = 0;
  };
  Destination* find(const Endpoint& address) noexcept;
  Destination& at(const Endpoint& address);
  void corrupt(Datagram& datagram) noexcept;

  std::mt19937_64 random_;
  std::size_t room_;
  Conditions conditions_;
  std::deque<Destination> destinations_;  ///< stay where they are
  Datagram travelling_;
};

/// A socket of a MemoryNetwork. Destroying it models the end of its program.
class MemorySocket final : public DatagramSocket {
 public:
  ~MemorySocket() override;
  MemorySocket(const MemorySocket&) = delete;

  bool send(std::span<const std::byte> bytes, const Endpoint& to, Duration now) noexcept override;
  std::optional<ReceivedDatagram> receive(Duration now) noexcept override;
  [[nodiscard]] const Endpoint& local() const noexcept override;
  [[nodiscard]] SocketCounts counts() const noexcept override;

 private:
  friend class MemoryNetwork;
  MemorySocket(MemoryNetwork& network, MemoryNetwork::Destination& here) : network_{&network}, here_{&here} {}

  MemoryNetwork* network_;
  MemoryNetwork::Destination* here_;
  std::uint64_t unsent_ = 0;
};

}  // namespace twoport
