#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

namespace twoport {

/// An IPv4 or IPv6 address and a port.
struct Endpoint {
  std::array<std::uint8_t, 16> address{};  ///< network order; IPv4: the first four, the rest 0
  std::uint32_t scope = 0;                 ///< IPv6 link-local: the interface
  std::uint16_t port = 0;
  bool v6 = false;

  /// An address that only programs on this machine reach: 127.0.0.0/8, ::1, or the former as an IPv6 address.
  [[nodiscard]] bool loopback() const noexcept {
    if (!v6) return address[0] == 127;
    const auto zeros = [&](std::size_t n) {
      return std::all_of(address.begin(), address.begin() + static_cast<std::ptrdiff_t>(n),
                         [](std::uint8_t b) { return b == 0; });
    };
    return (zeros(15) && address[15] == 1) ||
           (zeros(10) && address[10] == 0xff && address[11] == 0xff && address[12] == 127);
  }

  friend bool operator==(const Endpoint&, const Endpoint&) = default;
};

}  // namespace twoport
