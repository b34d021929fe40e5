#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <type_traits>

// Numbers and strings as MCAP has them: little-endian, strings with their length before them. Internal to common/mcap.

namespace twoport::mcap {

inline constexpr std::string_view kMagic{"\x89MCAP0\r\n", 8};

/// Kinds of records (mcap.dev/spec, version 0).
enum class Op : std::uint8_t {
  header = 0x01,
  footer = 0x02,
  schema = 0x03,
  channel = 0x04,
  message = 0x05,
  chunk = 0x06,
  message_index = 0x07,
  chunk_index = 0x08,
  statistics = 0x0B,
  data_end = 0x0F,
};

class Output {
 public:
  template <class T>
  Output& number(T value) {
    static_assert(std::is_unsigned_v<T>);
    for (std::size_t i = 0; i < sizeof(T); ++i)
      bytes.push_back(static_cast<char>(static_cast<std::uint64_t>(value) >> (8 * i) & 0xFFU));
    return *this;
  }
  Output& raw(std::string_view text) {
    bytes.append(text);
    return *this;
  }
  Output& string(std::string_view text) {
    number(static_cast<std::uint32_t>(text.size()));
    return raw(text);
  }
  Output& record(Op op, const Output& content) {
    number(static_cast<std::uint8_t>(op));
    number(static_cast<std::uint64_t>(content.bytes.size()));
    return raw(content.bytes);
  }

  std::string bytes;
};

/// Reads what Output has written. After a read beyond the end `ok` is false, and all further values are empty.
class InputBytes {
 public:
  explicit InputBytes(std::string_view bytes) : rest_{bytes} {}

  template <class T>
  T number() {
    T value{};
    const std::string_view piece = raw(sizeof(T));
    for (std::size_t i = 0; i < piece.size(); ++i)
      value = static_cast<T>(value | static_cast<T>(static_cast<T>(static_cast<unsigned char>(piece[i])) << (8 * i)));
    return value;
  }
  std::string_view raw(std::uint64_t size) {
    if (!ok || size > rest_.size()) {
      ok = false;
      return {};
    }
    const std::string_view piece = rest_.substr(0, static_cast<std::size_t>(size));
    rest_.remove_prefix(piece.size());
    return piece;
  }
  std::string_view string() { return raw(number<std::uint32_t>()); }
  [[nodiscard]] bool empty() const { return rest_.empty(); }

  bool ok = true;

 private:
  std::string_view rest_;
};

}  // namespace twoport::mcap
