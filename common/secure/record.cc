#include "common/secure/record.h"

#include <openssl/crypto.h>
#include <openssl/evp.h>

#include <algorithm>
#include <span>
#include <stdexcept>

#include "common/secure/key.h"

namespace twoport {
namespace {

constexpr std::uint8_t kVersion[] = {0xfe, 0xfd};  // DTLS 1.2
constexpr std::uint64_t kEpoch = 1;                // all that one handshake has agreed on
constexpr std::uint64_t kSequences = std::uint64_t{1} << 48;

constexpr std::size_t kAad = 13;
using Aad = std::array<std::uint8_t, kAad>;

/// `number`: epoch (16 bits) and sequence (48 bits).
void put_number(std::uint64_t number, std::uint8_t* to) noexcept {
  for (int i = 7; i >= 0; --i, number >>= 8) to[i] = static_cast<std::uint8_t>(number);
}
/// `size` as OpenSSL wants it: of the plaintext when sealing, with the tag when opening.
Aad aad_of(std::uint64_t number, std::size_t size) noexcept {
  Aad aad{};
  put_number(number, aad.data());
  aad[8] = static_cast<std::uint8_t>(RecordType::application_data);
  aad[9] = kVersion[0], aad[10] = kVersion[1];
  aad[11] = static_cast<std::uint8_t>(size >> 8), aad[12] = static_cast<std::uint8_t>(size);
  return aad;
}

/// Seals or opens `text` in place, the tag behind it: one call, which makes the nonce from IV and number. A third faster than
/// nonce, data, end and tag one by one.
bool cipher_record(EVP_CIPHER_CTX* cipher, Aad aad, std::span<std::uint8_t> text) noexcept {
  return EVP_CIPHER_CTX_ctrl(cipher, EVP_CTRL_AEAD_TLS1_AAD, static_cast<int>(aad.size()), aad.data()) ==
             static_cast<int>(kRecordTag) &&
         EVP_Cipher(cipher, text.data(), text.data(), static_cast<unsigned>(text.size())) >= 0;
}

Cipher cipher_with(const RecordKeys& keys, int encrypts) {
  Cipher cipher{EVP_CIPHER_CTX_new()};
  std::array<std::uint8_t, 12> iv = keys.iv;
  const bool made =
      cipher &&
      EVP_CipherInit_ex(cipher.get(), EVP_chacha20_poly1305(), nullptr, keys.key.data(), iv.data(), encrypts) == 1 &&
      EVP_CIPHER_CTX_ctrl(cipher.get(), EVP_CTRL_AEAD_SET_IV_FIXED, static_cast<int>(iv.size()), iv.data()) == 1;
  OPENSSL_cleanse(iv.data(), iv.size());
  if (!made) throw std::runtime_error("this OpenSSL has no ChaCha20-Poly1305");
  return cipher;
}

}  // namespace

void Key::wipe() noexcept {
  OPENSSL_cleanse(bytes_.data(), bytes_.size());
}
RecordKeys::~RecordKeys() {
  OPENSSL_cleanse(key.data(), key.size());
  OPENSSL_cleanse(iv.data(), iv.size());
}
void CipherDeleter::operator()(evp_cipher_ctx_st* context) const noexcept {
  EVP_CIPHER_CTX_free(context);
}

// ---- out

Sealer::Sealer(const RecordKeys& keys, std::uint64_t first) : cipher_{cipher_with(keys, 1)}, next_{first} {}

std::span<const std::byte> Sealer::seal(std::span<const std::byte> plain) noexcept {
  if (plain.size() + kRecordOverhead > record_.size() || next_ >= kSequences) return {};
  const std::uint64_t number = kEpoch << 48 | next_++;
  std::uint8_t* const to = record_.data();
  const std::size_t length = plain.size() + kRecordTag;
  to[0] = static_cast<std::uint8_t>(RecordType::application_data);
  to[1] = kVersion[0], to[2] = kVersion[1];
  put_number(number, to + 3);
  to[11] = static_cast<std::uint8_t>(length >> 8), to[12] = static_cast<std::uint8_t>(length);

  std::copy_n(reinterpret_cast<const std::uint8_t*>(plain.data()), plain.size(), to + kRecordHeader);
  if (!cipher_record(cipher_.get(), aad_of(number, plain.size()), {to + kRecordHeader, length})) return {};
  return {reinterpret_cast<const std::byte*>(to), kRecordHeader + length};
}

// ---- in

Opener::Opener(const RecordKeys& keys) : cipher_{cipher_with(keys, 0)} {}

Opened Opener::open(std::span<const std::byte> record, std::span<const std::byte>& plain) noexcept {
  plain = {};
  const auto* const from = reinterpret_cast<const std::uint8_t*>(record.data());
  if (record.size() < kRecordOverhead || record.size() > kMaxDatagramBytes ||
      from[0] != static_cast<std::uint8_t>(RecordType::application_data) || from[1] != kVersion[0] ||
      from[2] != kVersion[1] || static_cast<std::size_t>(from[11] << 8 | from[12]) != record.size() - kRecordHeader)
    return Opened::malformed;
  std::uint64_t number = 0;
  for (int i = 3; i < 11; ++i) number = number << 8 | from[i];
  if (number >> 48 != kEpoch) return Opened::malformed;
  const std::uint64_t sequence = number & (kSequences - 1);
  if (const Opened known = look_up(sequence); known != Opened::ok) return known;

  const std::size_t size = record.size() - kRecordOverhead;
  std::copy_n(from + kRecordHeader, size + kRecordTag, plain_.data());
  const bool authentic =
      cipher_record(cipher_.get(), aad_of(number, size + kRecordTag), {plain_.data(), size + kRecordTag});
  if (!authentic) return Opened::not_authentic;
  remember(sequence);
  plain = {reinterpret_cast<const std::byte*>(plain_.data()), size};
  return Opened::ok;
}

Opened Opener::look_up(std::uint64_t sequence) const noexcept {
  if (!any_ || sequence > newest_) return Opened::ok;
  if (newest_ - sequence >= kWindow) return Opened::stale;
  return seen_[sequence % kWindow] ? Opened::replayed : Opened::ok;
}

void Opener::remember(std::uint64_t sequence) noexcept {
  if (!any_ || sequence >= newest_ + kWindow) {
    seen_.reset();
    newest_ = sequence;
  } else {
    for (; newest_ < sequence; ++newest_) seen_[(newest_ + 1) % kWindow] = false;
  }
  any_ = true;
  seen_[sequence % kWindow] = true;
}

}  // namespace twoport
