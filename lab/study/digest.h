#pragma once

#include <fmt/format.h>

#include <bit>
#include <cstdint>
#include <string>
#include <string_view>

namespace twoport::lab {

/// FNV-1a over a sequence of texts and numbers: distinguishes sweeps and detects edited lines. Not
/// cryptographic.
class Digest {
 public:
  void add(std::string_view text) {
    for (const char c : text) mix(static_cast<unsigned char>(c));
    mix(0xff);  // no text holds it: the next one begins here
  }
  void add(double number) {
    for (auto bits = std::bit_cast<std::uint64_t>(number); bits != 0; bits >>= 8) mix(bits & 0xff);
    mix(0xff);
  }
  [[nodiscard]] std::string text() const { return fmt::format("{:016x}", value_); }

 private:
  void mix(std::uint64_t byte) { value_ = (value_ ^ byte) * 0x100000001b3; }
  std::uint64_t value_ = 0xcbf29ce484222325;
};

}  // namespace twoport::lab
