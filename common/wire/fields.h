#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

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
  bool varint(std::uint64_t& value) noexcept;
  bool fixed(std::size_t size) noexcept;

  std::span<const std::byte> rest_;
  bool broken_ = false;
};

/// Has the datagram only fields that proto/report.proto has, each of its type? Protobuf allocates for all others.
bool only_known_fields(std::span<const std::byte> datagram) noexcept;

/// Reads the fields that keep number and type in every version: protocol version, sessions and refusal, the refusal as it
/// came. False when the bytes are no Protobuf message.
bool read_stable_fields(std::span<const std::byte> datagram, Header& header) noexcept;

}  // namespace twoport
