#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace twoport {

/// The secret that two programs share. Wiped when it is destroyed; moving leaves nothing behind.
class Key {
 public:
  static constexpr std::size_t kSize = 32;  // [B]
  using Bytes = std::array<std::uint8_t, kSize>;

  explicit Key(const Bytes& bytes) noexcept : bytes_{bytes} {}
  Key(Key&& other) noexcept : bytes_{other.bytes_} { other.wipe(); }
  Key(const Key&) = delete;
  ~Key() { wipe(); }

  [[nodiscard]] const Bytes& bytes() const noexcept { return bytes_; }

 private:
  void wipe() noexcept;

  Bytes bytes_;
};

}  // namespace twoport
