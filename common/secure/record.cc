#include "common/secure/record.h"

#include <openssl/crypto.h>
#include <openssl/evp.h>

#include <algorithm>
#include <cstring>
#include <stdexcept>

#include "common/secure/key.h"

namespace twoport {
namespace {

constexpr std::uint8_t kVersion[] = {0xfe, 0xfd};  // DTLS 1.2
constexpr std::uint64_t kEpoch = 1;                // all that one handshake has agreed on
constexpr std::uint64_t kSequences = std::uint64_t{1} << 48;

constexpr std::size_t kAad = 13;
using Nonce = std::array<std::uint8_t, 12>;
using Aad = std::array<std::uint8_t, kAad>;

/// `number`: epoch (16 bits) and sequence (48 bits).
void put_number(std::uint64_t number, std::uint8_t* to) noexcept {
  for (int i = 7; i >= 0; --i, number >>= 8) to[i] = static_cast<std::uint8_t>(number);
}
Nonce nonce_of(const RecordKeys& keys, std::uint64_t number) noexcept {
  Nonce nonce{};
  put_number(number, nonce.data() + 4);
  for (std::size_t i = 0; i < nonce.size(); ++i) nonce[i] ^= keys.iv[i];
  return nonce;
}
Aad aad_of(std::uint64_t number, std::size_t plain) noexcept {
  Aad aad{};
  put_number(number, aad.data());
  aad[8] = static_cast<std::uint8_t>(RecordType::application_data);
  aad[9] = kVersion[0], aad[10] = kVersion[1];
  aad[11] = static_cast<std::uint8_t>(plain >> 8), aad[12] = static_cast<std::uint8_t>(plain);
  return aad;
}

Cipher cipher_with(const RecordKeys& keys, int encrypts) {
  Cipher cipher{EVP_CIPHER_CTX_new()};
  if (!cipher ||
      EVP_CipherInit_ex(cipher.get(), EVP_chacha20_poly1305(), nullptr, keys.key.data(), keys.iv.data(), encrypts) != 1)
    throw std::runtime_error("this OpenSSL has no ChaCha20-Poly1305");
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

Sealer::Sealer(const RecordKeys& keys, std::uint64_t first)
    : keys_{keys}, cipher_{cipher_with(keys, 1)}, next_{first} {}

std::span<const std::byte> Sealer::seal(std::span<const std::byte> plain) noexcept {
  if (plain.size() + kRecordOverhead > record_.size() || next_ >= kSequences) return {};
  const std::uint64_t number = kEpoch << 48 | next_++;
  const Nonce nonce = nonce_of(keys_, number);
  const Aad aad = aad_of(number, plain.size());
  std::uint8_t* const to = record_.data();
  const std::size_t length = plain.size() + kRecordTag;
  to[0] = static_cast<std::uint8_t>(RecordType::application_data);
  to[1] = kVersion[0], to[2] = kVersion[1];
  put_number(number, to + 3);
  to[11] = static_cast<std::uint8_t>(length >> 8), to[12] = static_cast<std::uint8_t>(length);

  EVP_CIPHER_CTX* const c = cipher_.get();
  int n = 0;
  const bool sealed = EVP_EncryptInit_ex(c, nullptr, nullptr, nullptr, nonce.data()) == 1 &&
                      EVP_EncryptUpdate(c, nullptr, &n, aad.data(), static_cast<int>(aad.size())) == 1 &&
                      EVP_EncryptUpdate(c, to + kRecordHeader, &n, reinterpret_cast<const std::uint8_t*>(plain.data()),
                                        static_cast<int>(plain.size())) == 1 &&
                      EVP_EncryptFinal_ex(c, to + kRecordHeader + plain.size(), &n) == 1 &&
                      EVP_CIPHER_CTX_ctrl(c, EVP_CTRL_AEAD_GET_TAG, kRecordTag, to + kRecordHeader + plain.size()) == 1;
  if (!sealed) return {};
  return {reinterpret_cast<const std::byte*>(to), kRecordHeader + length};
}

// ---- in

Opener::Opener(const RecordKeys& keys) : keys_{keys}, cipher_{cipher_with(keys, 0)} {}

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
  const Nonce nonce = nonce_of(keys_, number);
  const Aad aad = aad_of(number, size);
  std::array<std::uint8_t, kRecordTag> tag, rest;
  std::memcpy(tag.data(), from + kRecordHeader + size, kRecordTag);
  EVP_CIPHER_CTX* const c = cipher_.get();
  int n = 0;
  const bool authentic = EVP_DecryptInit_ex(c, nullptr, nullptr, nullptr, nonce.data()) == 1 &&
                         EVP_CIPHER_CTX_ctrl(c, EVP_CTRL_AEAD_SET_TAG, kRecordTag, tag.data()) == 1 &&
                         EVP_DecryptUpdate(c, nullptr, &n, aad.data(), static_cast<int>(aad.size())) == 1 &&
                         EVP_DecryptUpdate(c, plain_.data(), &n, from + kRecordHeader, static_cast<int>(size)) == 1 &&
                         EVP_DecryptFinal_ex(c, rest.data(), &n) == 1;
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
