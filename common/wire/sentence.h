#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdio>
#include <string_view>

#include "common/wire/header.h"

namespace twoport {

/// A sentence of bounded length that is built without allocating.
class Sentence {
 public:
  Sentence() = default;
  explicit Sentence(std::string_view text) : size_{std::min(text.size(), kMaxRefusal)} {
    std::copy_n(text.data(), size_, text_.data());
  }
  /// As printf.
  template <class... Args>
  explicit Sentence(const char* format, Args... args) {
    const int n = std::snprintf(text_.data(), text_.size(), format, args...);
    size_ = std::min(static_cast<std::size_t>(std::max(n, 0)), text_.size() - 1);
  }
  [[nodiscard]] std::string_view view() const { return {text_.data(), size_}; }
  [[nodiscard]] bool empty() const { return size_ == 0; }

 private:
  std::array<char, kMaxRefusal + 1> text_{};
  std::size_t size_ = 0;
};

}  // namespace twoport
