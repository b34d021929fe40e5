#pragma once

#include <array>
#include <cstdint>

namespace twoport {

/// An IPv4 or IPv6 address and a port.
struct Endpoint {
  std::array<std::uint8_t, 16> address{};  ///< network order; IPv4: the first four, the rest 0
  std::uint32_t scope = 0;                 ///< IPv6 link-local: the interface
  std::uint16_t port = 0;
  bool v6 = false;

  friend bool operator==(const Endpoint&, const Endpoint&) = default;
};

}  // namespace twoport
