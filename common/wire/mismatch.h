#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/link/endpoint.h"
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

/// What one side of a live link is, and what it expects of the other.
struct SessionOptions {
  Side side = Side::master;
  double rate_hz = 1000.0;       ///< of this side
  double peer_rate_hz = 1000.0;  ///< that the scene gives the other side
  std::uint64_t scene_digest = 0;
  std::vector<std::string_view> scene_field_names{};  ///< of the fields that both sides share
  std::string scene_fields{};                         ///< their digests, two bytes each
  std::optional<Endpoint> peer{};  ///< a master is given the address of its slave; a slave learns that of its master
  /// What arrives comes from a holder of the key: refusals name what differs.
  bool tells_reasons = false;
};

/// What the program with `options` and `dof`, and the sender of `header`, must agree on and differ in: a sentence that is
/// the same on both sides. Empty when they agree. The header has an identity, or `decoded` is other_version.
Sentence mismatch(const SessionOptions& options, int dof, const Header& header, Decoded decoded) noexcept;

/// What a program is told where one of the two only measures the link (kMeasurementDigest) and the other does not. `mine`: of the
/// side that says it.
Sentence no_measurement(Side side, std::uint64_t mine) noexcept;

/// What a stranger is told instead: nothing about this side. It is a sentence for is_mismatch() too.
Sentence mismatch_without_reason(Side side) noexcept;

/// Is this a sentence of mismatch(), so that the two must be started otherwise? If not, the other side is busy.
[[nodiscard]] bool is_mismatch(std::string_view reject_reason) noexcept;

}  // namespace twoport
