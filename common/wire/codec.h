#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "common/base/built_for.h"
#include "common/link/environment_message.h"
#include "common/link/report.h"
#include "common/wire/header.h"

namespace twoport {

/// Walks over the fields of a Protobuf message without building one: no allocation, whatever the bytes are.
class Fields {
 public:
  explicit Fields(std::span<const std::byte> bytes) noexcept : rest_{bytes} {}

  /// Goes on to the next field. False at the end, and where the bytes are no field.
  bool next() noexcept;
  /// After next() has returned false: were all bytes fields?
  [[nodiscard]] bool complete() const noexcept { return rest_.empty() && !broken_; }

  std::uint32_t number = 0;
  std::uint32_t wire_type = 0;         ///< 0 varint, 1 64 bits, 2 bytes, 5 32 bits; no others
  std::uint64_t value = 0;             ///< of 0, 1 and 5
  std::span<const std::byte> payload;  ///< of 2

 private:
  std::span<const std::byte> rest_;
  bool broken_ = false;
};

/// Has the datagram only fields that proto/report.proto has, each of its type? Protobuf allocates for all others.
bool only_known_fields(std::span<const std::byte> datagram) noexcept;

/// Reads the fields that keep number and type in every version: protocol version, sessions and refusal, the refusal as it
/// came. False when the bytes are no Protobuf message.
bool read_stable_fields(std::span<const std::byte> datagram, Header& header) noexcept;

/// One datagram as values.
template <int N>
struct Envelope : Header {
  Report<N> report;
  bool has_gripper = false;
  Report<1> gripper{};  ///< with has_gripper; its number, stamps and epoch are the report's
  EnvironmentMessage environment{};
};

/// Envelope <-> bytes. Two Protobuf messages and one buffer are kept and reused.
/// Real time: no allocation, no lock, no throw, whatever the bytes are.
template <int N>
class Codec {
 public:
  Codec();
  ~Codec();
  Codec(Codec&&) noexcept;
  Codec& operator=(Codec&&) noexcept;

  /// The bytes are good until the next encode. A refusal is cut at kMaxRefusal.
  std::span<const std::byte> encode(const Envelope<N>& envelope) noexcept;

  /// Fills `envelope` as far as the result allows. Accepts any bytes: a truncated datagram, a wrong number of samples,
  /// an unknown mode, an invalid attitude or time, or a non-finite number is malformed. `refusal` is valid until the
  /// next decode, and printable ASCII.
  Decoded decode(std::span<const std::byte> bytes, Envelope<N>& envelope) noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

TWOPORT_DECLARE(Codec);

}  // namespace twoport
