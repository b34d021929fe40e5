#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "common/base/built_for.h"
#include "common/link/environment_message.h"
#include "common/link/report.h"
#include "common/wire/header.h"

namespace twoport {

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
