#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

namespace twoport {

/// Every datagram begins with "TP" and the version of the wire.
inline constexpr std::uint32_t kProtocolVersion = 0x5450'0002;
inline constexpr std::size_t kMaxDatagram = 1168;    // [B]
inline constexpr std::size_t kMaxRefusal = 400;      // [B]
inline constexpr std::size_t kMaxSceneFields = 128;  // [B]

enum class Side : std::uint8_t { master = 1, slave = 2 };

constexpr const char* to_string(Side side) {
  return side == Side::master ? "master" : "slave";
}

/// Identity: what two programs must agree on before they exchange force.
struct Identity {
  int dof = 0;
  double rate_hz = 0.0;  ///< the rate its receiver is expected to run at
  std::uint64_t scene_digest = 0;
  Side side = Side::master;
  std::string_view scene_fields{};  ///< digests of the single fields, two bytes each; valid as long as Header::refusal
};

/// Identity::scene_digest of a program without a scene, which only measures the link (twoport-lab doctor). It is paired with its
/// like, and ends nobody else.
inline constexpr std::uint64_t kMeasurementDigest = 0x6d65'6173'7572'6521;

/// All of a datagram but the report.
struct Header {
  std::uint32_t version = kProtocolVersion;
  std::uint64_t session = 0;         ///< the sender's session number, never 0
  std::uint64_t peer_session = 0;    ///< assumed number of the peer; 0: not known
  std::optional<Identity> identity;  ///< until the peer has accepted it
  std::string_view refusal;          ///< reason for a refusal, then there is no report; empty: none
};

enum class Decoded : std::uint8_t {
  ok,
  malformed,      ///< not usable
  other_version,  ///< version, sessions and refusal are valid
  other_dof,      ///< all but the report is valid
};

}  // namespace twoport
