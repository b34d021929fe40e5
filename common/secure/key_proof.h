#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <optional>
#include <span>

#include "common/secure/key.h"

struct evp_mac_ctx_st;

namespace twoport {

/// 128 bits that nobody guesses: the number of an attempt, a cookie, a MAC.
using Bits128 = std::array<std::byte, 16>;

/// BLAKE2s with a key, 16 bytes long. Neither allocates nor throws once it is made. Of one thread.
class Mac {
 public:
  /// Throws std::runtime_error when OpenSSL lacks BLAKE2s.
  explicit Mac(std::span<const std::uint8_t, 32> key);
  /// Of the pieces one behind the other.
  Bits128 of(std::initializer_list<std::span<const std::byte>> pieces) noexcept;

 private:
  struct Deleter {
    void operator()(evp_mac_ctx_st* context) const noexcept;
  };
  std::unique_ptr<evp_mac_ctx_st, Deleter> context_;
};

/// Equal? Takes the same time whatever differs.
bool same_bits(std::span<const std::byte, 16> a, std::span<const std::byte, 16> b) noexcept;

/// Who sends a datagram of a handshake, and what it is.
enum class HandshakeKind : std::uint8_t {
  of_client = 1,  ///< records of DTLS
  of_server,      ///< records of DTLS
  cookie,         ///< of a server that keeps nothing: begin again with this cookie
  other_key,      ///< of a server: the MAC does not fit its key. Has no MAC itself
};

/// A datagram of a handshake, in its parts.
struct HandshakeParts {
  HandshakeKind kind = HandshakeKind::of_client;
  Bits128 attempt{};  ///< drawn by the client for each attempt; the server returns it
  Bits128 cookie{};   ///< zeros: none
  std::span<const std::byte> records{};
};

/// The header of a handshake's datagrams, which proves that the sender has the key, before anything is kept, answered or read
/// by OpenSSL:
///
///     mark 16 fe 54 (3 B) | kind (1 B) | attempt (16 B) | cookie (16 B) | MAC (16 B) | records of DTLS
///
/// The MAC is of all the rest, under HKDF-SHA256(key, "twoport handshake datagrams"). The mark is no version of DTLS.
inline constexpr std::size_t kProofHeader = 52;  // [B]

/// Nothing when the datagram does not begin with such a header. The MAC is not looked at.
std::optional<HandshakeParts> read_handshake(std::span<const std::byte> datagram) noexcept;

/// Writes and checks the header. Of one thread.
class KeyProof {
 public:
  /// Throws std::runtime_error when OpenSSL lacks what is needed.
  explicit KeyProof(const Key& key);

  /// Has the sender of a datagram that read_handshake() accepts the key?
  bool holds(std::span<const std::byte> datagram) noexcept;
  /// `to` has room for the header and the records. Returns the length.
  std::size_t write(const HandshakeParts& parts, std::span<std::byte> to) noexcept;

 private:
  Mac mac_;
};

}  // namespace twoport
