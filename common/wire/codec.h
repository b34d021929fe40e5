#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string_view>

#include "common/link/report.h"

namespace twoport {

/// Every datagram begins with "TP" and the version of the wire.
inline constexpr std::uint32_t kProtocolVersion = 0x5450'0001;
inline constexpr std::size_t kMaxDatagram = 1024;  // [B]
inline constexpr std::size_t kMaxRefusal = 400;    // [B]

enum class Side : std::uint8_t { master = 1, slave = 2 };

/// Who is speaking: what two programs must agree on before they exchange force.
struct Identity {
  int dof = 0;
  double rate_hz = 0.0;  ///< the rate its receiver is expected to run at
  std::uint64_t scene_digest = 0;
  Side side = Side::master;
};

/// One datagram as values.
template <int N>
struct Envelope {
  std::uint32_t version = kProtocolVersion;
  std::uint64_t session = 0;       ///< drawn when the sender started, never 0
  std::uint64_t peer_session = 0;  ///< whom the sender is talking to; 0 while it does not know
  Report<N> report;
  std::optional<Identity> identity;  ///< until the peer has accepted it
  std::string_view refusal;          ///< why the peer is refused; empty: it is not. Then there is no report
};

enum class Decoded : std::uint8_t {
  ok,
  malformed,      ///< nothing of it may be used
  other_version,  ///< version, sessions and refusal are good
  other_dof,      ///< all but the report is good
};

/// Envelope <-> bytes. Two Protobuf messages and one buffer are kept and reused.
/// Real time: no allocation, no lock, no throw, except that `decode` allocates for a datagram which Protobuf can read
/// but which has fields that nobody knows.
template <int N>
class Codec {
 public:
  Codec();
  ~Codec();
  Codec(Codec&&) noexcept;
  Codec& operator=(Codec&&) noexcept;

  /// The bytes are good until the next encode. A refusal is cut at kMaxRefusal.
  std::span<const std::byte> encode(const Envelope<N>& envelope) noexcept;

  /// Fills `envelope` as far as the result says. Any bytes will do: what is truncated, has the wrong number of
  /// samples, an unknown mode, an attitude that is none, a number that is not finite or a time that is none is
  /// malformed. `refusal` is good until the next decode, and printable ASCII.
  Decoded decode(std::span<const std::byte> bytes, Envelope<N>& envelope) noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

extern template class Codec<1>;
extern template class Codec<3>;
extern template class Codec<6>;

}  // namespace twoport
