#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <span>

namespace twoport {

/// The bytes of a fuzzer as numbers and pieces; zeros when they are used up.
class Input {
 public:
  Input(const std::uint8_t* data, std::size_t size) : rest_{reinterpret_cast<const std::byte*>(data), size} {}

  [[nodiscard]] bool empty() const { return rest_.empty(); }
  std::uint8_t byte() {
    if (rest_.empty()) return 0;
    const auto value = std::to_integer<std::uint8_t>(rest_.front());
    rest_ = rest_.subspan(1);
    return value;
  }
  std::uint64_t number(int bytes) {
    std::uint64_t value = 0;
    for (int i = 0; i < bytes; ++i) value = value << 8 | byte();
    return value;
  }
  std::span<const std::byte> piece(std::size_t size) {
    const std::span<const std::byte> head = rest_.first(size < rest_.size() ? size : rest_.size());
    rest_ = rest_.subspan(head.size());
    return head;
  }
  std::span<const std::byte> rest() { return piece(rest_.size()); }

 private:
  std::span<const std::byte> rest_;
};

/// Ends the fuzzer with the input that has broken a rule.
inline void require(bool holds, const char* rule) {
  if (holds) return;
  std::fprintf(stderr, "broken: %s\n", rule);
  std::abort();
}

}  // namespace twoport
