#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "common/secure/key.h"

struct evp_mac_ctx_st;

namespace twoport {

/// 128 bits that nobody guesses: the number of an attempt, a cookie, a MAC.
using Bits128 = std::array<std::byte, 16>;

/// Which of several keys a datagram is made with. Derived from the key and no secret: whoever reads it can tell devices apart, as by
/// the identity of a PSK in DTLS (RFC 4279), and learns nothing else of the key.
using KeyId = std::array<std::byte, 8>;

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
  KeyId key{};        ///< of its MAC
  Bits128 attempt{};  ///< drawn by the client for each attempt; the server returns it
  Bits128 cookie{};   ///< zeros: none
  std::span<const std::byte> records{};
};

/// The header of a handshake's datagrams, which proves that the sender has the key, before anything is kept, answered or read
/// by OpenSSL:
///
///     mark 16 fe 55 (3 B) | kind (1 B) | key (8 B) | attempt (16 B) | cookie (16 B) | MAC (16 B) | records of DTLS
///
/// The MAC is of all the rest, under HKDF-SHA256(key, "twoport handshake datagrams"); the identifier of the key is the beginning of
/// HKDF-SHA256(key, "twoport key identifier"). The mark is no version of DTLS.
inline constexpr std::size_t kProofHeader = 60;  // [B]

/// Nothing when the datagram does not begin with such a header. The MAC is not looked at.
std::optional<HandshakeParts> read_handshake(std::span<const std::byte> datagram) noexcept;

/// Writes and checks the header with one of several keys, which are named by their place. A datagram costs one MAC, however many
/// keys there are; one whose identifier is of none of them costs none. Of one thread.
class KeyProof {
 public:
  /// Throws std::runtime_error when OpenSSL lacks what is needed.
  explicit KeyProof(std::span<const Key> keys);
  explicit KeyProof(const Key& key) : KeyProof{std::span{&key, 1}} {}

  /// The key that the sender of a datagram that read_handshake() accepts has proved to have; nothing: none.
  std::optional<std::size_t> key_of(std::span<const std::byte> datagram) noexcept;
  /// With the key at that place, but for other_key, which has neither identifier nor MAC. `to` has room for the header and the
  /// records. Returns the length.
  std::size_t write(std::size_t key, const HandshakeParts& parts, std::span<std::byte> to) noexcept;

 private:
  struct Proof {
    KeyId id;
    Mac mac;
  };
  std::vector<Proof> proofs_;
};

}  // namespace twoport
