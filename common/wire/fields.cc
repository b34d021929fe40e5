#include "common/wire/fields.h"

#include <array>
#include <boost/endian/conversion.hpp>
#include <cstring>

namespace twoport {
namespace {

constexpr std::uint8_t kVarint = 0, kFixed64 = 1, kBytes = 2, kFixed32 = 5, kNone = 0xff;  // wire types

/// By field number, as in proto/report.proto.
constexpr std::array<std::uint8_t, 29> kTypes = {
    kNone,   kFixed32, kFixed64, kFixed64, kFixed64, kFixed64, kFixed64, kVarint,  kBytes, kFixed64,
    kVarint, kFixed64, kFixed64, kBytes,   kVarint,  kBytes,   kFixed32, kVarint,  kBytes, kBytes,
    kBytes,  kFixed32, kVarint,  kVarint,  kBytes,   kFixed64, kVarint,  kFixed64, kBytes};
constexpr std::uint32_t kVersion = 1, kSession = 2, kPeerSession = 3, kRefusal = 13;

}  // namespace

bool Fields::varint(std::uint64_t& out) noexcept {
  out = 0;
  for (unsigned shift = 0; shift < 64 && !rest_.empty(); shift += 7) {
    const auto b = std::to_integer<std::uint64_t>(rest_.front());
    rest_ = rest_.subspan(1);
    out |= (b & 0x7f) << shift;
    if (b < 0x80) return true;
  }
  return false;
}

/// Little-endian.
bool Fields::fixed(std::size_t size) noexcept {
  if (rest_.size() < size) return false;
  value = 0;
  std::memcpy(&value, rest_.data(), size);
  boost::endian::little_to_native_inplace(value);
  rest_ = rest_.subspan(size);
  return true;
}

bool Fields::next() noexcept {
  if (rest_.empty() || broken_) return false;
  std::uint64_t tag = 0, size = 0;
  broken_ = !varint(tag) || tag >> 32 != 0 || tag >> 3 == 0;
  if (broken_) return false;
  number = static_cast<std::uint32_t>(tag >> 3);
  wire_type = static_cast<std::uint32_t>(tag & 7);
  switch (wire_type) {
    case kVarint:
      broken_ = !varint(value);
      break;
    case kFixed64:
      broken_ = !fixed(8);
      break;
    case kFixed32:
      broken_ = !fixed(4);
      break;
    case kBytes:
      broken_ = !varint(size) || size > rest_.size();
      if (broken_) break;
      payload = rest_.first(size);
      rest_ = rest_.subspan(size);
      break;
    default:
      broken_ = true;
  }
  return !broken_;
}

bool only_known_fields(std::span<const std::byte> datagram) noexcept {
  Fields field{datagram};
  while (field.next())
    if (field.number >= kTypes.size() || field.wire_type != kTypes[field.number]) return false;
  return field.complete();
}

bool read_stable_fields(std::span<const std::byte> datagram, Header& header) noexcept {
  header = {};
  Fields field{datagram};
  while (field.next()) {
    const bool of_its_type = field.number < kTypes.size() && field.wire_type == kTypes[field.number];
    if (!of_its_type) continue;
    if (field.number == kVersion) header.version = static_cast<std::uint32_t>(field.value);
    if (field.number == kSession) header.session = field.value;
    if (field.number == kPeerSession) header.peer_session = field.value;
    if (field.number == kRefusal)
      header.refusal = {reinterpret_cast<const char*>(field.payload.data()), field.payload.size()};
  }
  return field.complete();
}

}  // namespace twoport
