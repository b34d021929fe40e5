#include "common/secure/key_proof.h"

#include <openssl/core_names.h>
#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/kdf.h>
#include <openssl/params.h>

#include <algorithm>
#include <stdexcept>
#include <string>

namespace twoport {
namespace {

constexpr std::array<std::byte, 3> kMark{std::byte{0x16}, std::byte{0xfe}, std::byte{0x55}};
constexpr std::size_t kKindAt = 3, kKeyAt = 4, kAttemptAt = 12, kCookieAt = 28, kMacAt = 44;

/// HKDF (RFC 5869) with SHA-256 and without salt: the key is uniform.
std::array<std::uint8_t, 32> derive(const Key& key, std::string purpose) {
  std::array<std::uint8_t, 32> out{};
  Key::Bytes secret = key.bytes();
  char digest[] = "SHA256";
  const OSSL_PARAM parameters[] = {
      OSSL_PARAM_construct_utf8_string(OSSL_KDF_PARAM_DIGEST, digest, 0),
      OSSL_PARAM_construct_octet_string(OSSL_KDF_PARAM_KEY, secret.data(), secret.size()),
      OSSL_PARAM_construct_octet_string(OSSL_KDF_PARAM_INFO, purpose.data(), purpose.size()),
      OSSL_PARAM_construct_end()};
  EVP_KDF* const kdf = EVP_KDF_fetch(nullptr, OSSL_KDF_NAME_HKDF, nullptr);
  EVP_KDF_CTX* const context = kdf != nullptr ? EVP_KDF_CTX_new(kdf) : nullptr;
  const bool derived = context != nullptr && EVP_KDF_derive(context, out.data(), out.size(), parameters) == 1;
  EVP_KDF_CTX_free(context);
  EVP_KDF_free(kdf);
  OPENSSL_cleanse(secret.data(), secret.size());
  if (!derived) throw std::runtime_error("this OpenSSL has no HKDF");
  return out;
}

}  // namespace

void Mac::Deleter::operator()(evp_mac_ctx_st* context) const noexcept {
  EVP_MAC_CTX_free(context);
}

Mac::Mac(std::span<const std::uint8_t, 32> key) {
  EVP_MAC* const mac = EVP_MAC_fetch(nullptr, OSSL_MAC_NAME_BLAKE2SMAC, nullptr);
  context_.reset(mac != nullptr ? EVP_MAC_CTX_new(mac) : nullptr);
  EVP_MAC_free(mac);
  std::size_t size = sizeof(Bits128);
  const OSSL_PARAM parameters[] = {OSSL_PARAM_construct_size_t(OSSL_MAC_PARAM_SIZE, &size), OSSL_PARAM_construct_end()};
  if (!context_ || EVP_MAC_init(context_.get(), key.data(), key.size(), parameters) != 1)
    throw std::runtime_error("this OpenSSL has no BLAKE2s");
}

Bits128 Mac::of(std::initializer_list<std::span<const std::byte>> pieces) noexcept {
  Bits128 out{};
  EVP_MAC_init(context_.get(), nullptr, 0, nullptr);
  for (const std::span<const std::byte> piece : pieces)
    EVP_MAC_update(context_.get(), reinterpret_cast<const unsigned char*>(piece.data()), piece.size());
  std::size_t size = 0;
  EVP_MAC_final(context_.get(), reinterpret_cast<unsigned char*>(out.data()), &size, out.size());
  return out;
}

bool same_bits(std::span<const std::byte, 16> a, std::span<const std::byte, 16> b) noexcept {
  return CRYPTO_memcmp(a.data(), b.data(), a.size()) == 0;
}

std::optional<HandshakeParts> read_handshake(std::span<const std::byte> d) noexcept {
  if (d.size() < kProofHeader || !std::equal(kMark.begin(), kMark.end(), d.begin())) return std::nullopt;
  const auto kind = std::to_integer<std::uint8_t>(d[kKindAt]);
  if (kind < static_cast<std::uint8_t>(HandshakeKind::of_client) ||
      kind > static_cast<std::uint8_t>(HandshakeKind::other_key))
    return std::nullopt;
  HandshakeParts parts{.kind = static_cast<HandshakeKind>(kind), .records = d.subspan(kProofHeader)};
  std::copy_n(d.begin() + kKeyAt, parts.key.size(), parts.key.begin());
  std::copy_n(d.begin() + kAttemptAt, parts.attempt.size(), parts.attempt.begin());
  std::copy_n(d.begin() + kCookieAt, parts.cookie.size(), parts.cookie.begin());
  return parts;
}

KeyProof::KeyProof(std::span<const Key> keys) {
  proofs_.reserve(keys.size());
  for (const Key& key : keys) {
    const std::array<std::uint8_t, 32> name = derive(key, "twoport key identifier");
    std::array<std::uint8_t, 32> secret = derive(key, "twoport handshake datagrams");
    KeyId id;
    std::transform(name.begin(), name.begin() + id.size(), id.begin(), [](std::uint8_t b) { return std::byte{b}; });
    proofs_.push_back({id, Mac{secret}});
    OPENSSL_cleanse(secret.data(), secret.size());
  }
}

std::optional<std::size_t> KeyProof::key_of(std::span<const std::byte> d) noexcept {
  const auto at = std::find_if(proofs_.begin(), proofs_.end(), [&](const Proof& p) {
    return std::equal(p.id.begin(), p.id.end(), d.begin() + kKeyAt);
  });
  if (at == proofs_.end() ||
      !same_bits(at->mac.of({d.first(kMacAt), d.subspan(kProofHeader)}), d.subspan(kMacAt).first<16>()))
    return std::nullopt;
  return static_cast<std::size_t>(at - proofs_.begin());
}

std::size_t KeyProof::write(std::size_t key, const HandshakeParts& parts, std::span<std::byte> to) noexcept {
  const bool proves = parts.kind != HandshakeKind::other_key;
  const KeyId id = proves ? proofs_[key].id : KeyId{};
  std::copy(kMark.begin(), kMark.end(), to.begin());
  to[kKindAt] = static_cast<std::byte>(parts.kind);
  std::copy(id.begin(), id.end(), to.begin() + kKeyAt);
  std::copy(parts.attempt.begin(), parts.attempt.end(), to.begin() + kAttemptAt);
  std::copy(parts.cookie.begin(), parts.cookie.end(), to.begin() + kCookieAt);
  std::copy(parts.records.begin(), parts.records.end(), to.begin() + kProofHeader);
  const Bits128 mac = proves ? proofs_[key].mac.of({to.first(kMacAt), parts.records}) : Bits128{};
  std::copy(mac.begin(), mac.end(), to.begin() + kMacAt);
  return kProofHeader + parts.records.size();
}

}  // namespace twoport
