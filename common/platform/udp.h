#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace twoport {

/// An IPv4 or IPv6 address and a port.
struct Endpoint {
  std::array<std::uint8_t, 16> address{};  ///< network order; IPv4: the first four, the rest 0
  std::uint32_t scope = 0;                 ///< IPv6 link-local: the interface
  std::uint16_t port = 0;
  bool v6 = false;

  friend bool operator==(const Endpoint&, const Endpoint&) = default;
};

/// "127.0.0.1:45001", "[::1]:45001".
std::string to_string(const Endpoint& endpoint);

/// Reads the value of `option` as ADDR:PORT, an address being a number. Throws ConfigError with option, value and what
/// is allowed.
Endpoint parse_endpoint(std::string_view text, std::string_view option);

/// Any free port, on any address, from which `peer` can be reached.
Endpoint any_port_toward(const Endpoint& peer);

struct ReceivedDatagram {
  std::span<const std::byte> bytes;  ///< good until the next receive; longer than any of ours where it was cut
  Endpoint from;
};

/// A UDP socket that never waits. Sending and receiving allocate nothing and throw nothing.
class UdpSocket {
 public:
  /// Binds to `local`; port 0 takes a free one. Throws ConfigError naming address, port and what to do.
  explicit UdpSocket(const Endpoint& local);
  ~UdpSocket();
  UdpSocket(UdpSocket&&) noexcept;
  UdpSocket& operator=(UdpSocket&&) noexcept;

  /// Where it is bound, with the port that was taken.
  [[nodiscard]] const Endpoint& local() const noexcept;

  /// From here on receive from `peer` only, and find the way there faster. Where there is none now, nothing changes.
  void keep_to(const Endpoint& peer) noexcept;

  /// False, and counted, when the datagram could not be handed over: nobody listens there, the queue is full, no route.
  /// To the protocol it is one more lost packet.
  bool send_to(std::span<const std::byte> bytes, const Endpoint& to) noexcept;

  /// The oldest datagram that waits; nothing when none does, or none did when the last batch of them was fetched.
  std::optional<ReceivedDatagram> receive() noexcept;

  [[nodiscard]] std::uint64_t unsent() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace twoport
