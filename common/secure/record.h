#pragma once

#include <array>
#include <bitset>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "common/link/datagram.h"

struct evp_cipher_ctx_st;

namespace twoport {

/// What protects the records of one direction: ChaCha20-Poly1305. Wiped when it is destroyed.
struct RecordKeys {
  std::array<std::uint8_t, 32> key{};
  std::array<std::uint8_t, 12> iv{};
  RecordKeys() = default;
  RecordKeys(const RecordKeys&) = default;
  RecordKeys& operator=(const RecordKeys&) = default;
  ~RecordKeys();
};

/// A record of application data of DTLS 1.2 with ChaCha20-Poly1305 (RFC 6347, 4.1; RFC 7905):
///
///     type 23 (1 B) | version fe fd (2 B) | epoch (2 B) | sequence (6 B) | length (2 B) | ciphertext | tag (16 B)
///
/// Nonce: IV xor epoch and sequence. Authenticated too: epoch, sequence, type, version and length of the plaintext.
inline constexpr std::size_t kRecordHeader = 13, kRecordTag = 16;  // [B]
inline constexpr std::size_t kRecordOverhead = kRecordHeader + kRecordTag;

enum class RecordType : std::uint8_t { change_cipher_spec = 20, alert = 21, handshake = 22, application_data = 23 };

struct CipherDeleter {
  void operator()(evp_cipher_ctx_st* context) const noexcept;
};
using Cipher = std::unique_ptr<evp_cipher_ctx_st, CipherDeleter>;

/// Seals datagrams. No two with one number: numbers end before they repeat. seal() allocates, locks and throws nothing.
class Sealer {
 public:
  /// Throws std::runtime_error when OpenSSL lacks the cipher.
  explicit Sealer(const RecordKeys& keys, std::uint64_t first = 0);

  /// The record is good until the next call. Empty when `plain` is too long, or all numbers are used.
  std::span<const std::byte> seal(std::span<const std::byte> plain) noexcept;

 private:
  Cipher cipher_;
  std::uint64_t next_;
  std::array<std::uint8_t, kMaxDatagramBytes> record_{};
};

enum class Opened : std::uint8_t {
  ok,
  malformed,      ///< no record of application data of this epoch
  not_authentic,  ///< sealed with another key, or changed on the way
  replayed,       ///< received before
  stale,          ///< too far behind the newest to tell
};

/// Opens records, each once, in any order within a window of 4096 numbers. RFC 6347, 4.1.2.6, leaves the size of the
/// window to the receiver; 64, which OpenSSL has, is 32 ms at 2 kHz, less than the jitter of many networks. open()
/// allocates, locks and throws nothing.
class Opener {
 public:
  static constexpr std::uint64_t kWindow = 4096;

  /// Throws std::runtime_error when OpenSSL lacks the cipher.
  explicit Opener(const RecordKeys& keys);

  /// The datagram is good until the next call; empty unless the result is ok.
  Opened open(std::span<const std::byte> record, std::span<const std::byte>& plain) noexcept;

 private:
  [[nodiscard]] Opened look_up(std::uint64_t sequence) const noexcept;
  void remember(std::uint64_t sequence) noexcept;

  Cipher cipher_;
  bool any_ = false;
  std::uint64_t newest_ = 0;
  std::bitset<kWindow> seen_;
  std::array<std::uint8_t, kMaxDatagramBytes> plain_{};
};

}  // namespace twoport
