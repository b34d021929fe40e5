#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>

#include "common/link/endpoint.h"
#include "common/link/socket.h"

namespace twoport {

/// Maximum length of a datagram: fits into one Ethernet frame over IPv4 [B].
inline constexpr std::size_t kMaxDatagramBytes = 1472;

/// A datagram that owns its bytes. A copy transfers only the bytes in use.
class Datagram {
 public:
  Datagram() noexcept {}  // NOLINT(modernize-use-equals-default): leaves the bytes alone
  Datagram(const Datagram& other) noexcept { *this = other; }
  Datagram(const ReceivedDatagram& received) noexcept { *this = received; }  // NOLINT(google-explicit-constructor)
  Datagram& operator=(const Datagram& other) noexcept {
    assign(other.bytes(), other.from);
    return *this;
  }
  Datagram& operator=(const ReceivedDatagram& received) noexcept {
    assign(received.bytes, received.from);
    return *this;
  }
  /// `bytes` is at most kMaxDatagramBytes long.
  void assign(std::span<const std::byte> bytes, const Endpoint& sender) noexcept {
    from = sender;
    size_ = bytes.size();
    std::copy(bytes.begin(), bytes.end(), bytes_.begin());
  }
  [[nodiscard]] std::span<const std::byte> bytes() const noexcept { return {bytes_.data(), size_}; }
  [[nodiscard]] std::span<std::byte> bytes() noexcept { return {bytes_.data(), size_}; }
  /// `size` is at most the present one.
  void cut(std::size_t size) noexcept { size_ = size; }

  Endpoint from;

 private:
  std::size_t size_ = 0;
  std::array<std::byte, kMaxDatagramBytes> bytes_;
};

}  // namespace twoport
