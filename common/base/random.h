#pragma once

#include <cstdint>

namespace twoport {

/// A random number as a function of (seed, stream, index, purpose) only: index counts packets or ticks, purpose
/// distinguishes the draws of one packet. The same on every machine, in any order, from any thread.
///
///     key        = mix(seed + γ)               seed: the scene's, XOR the number of the stream
///     bits(i, p) = mix(key + γ (16 i + p))     γ = 2^64/φ, odd;  p < 16
///
/// mix is the finaliser of SplitMix64 (Steele, Lea, Flood, OOPSLA 2014), variant 13 of Stafford: a bijection in which each
/// bit of the input changes each bit of the output with probability one half.
/// Real time: no state, no allocation.
class Random {
 public:
  explicit Random(std::uint64_t seed) : key_{mix(seed + kGamma)} {}

  [[nodiscard]] std::uint64_t bits(std::uint64_t index, unsigned purpose = 0) const noexcept {
    return mix(key_ + kGamma * (16 * index + purpose));
  }
  /// Uniform in (0, 1), 52 bits, without the end points.
  [[nodiscard]] double uniform(std::uint64_t index, unsigned purpose = 0) const noexcept {
    return (static_cast<double>(bits(index, purpose) >> 12) + 0.5) * 0x1.0p-52;
  }

 private:
  static constexpr std::uint64_t kGamma = 0x9e3779b97f4a7c15;
  static std::uint64_t mix(std::uint64_t z) noexcept {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
    z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
    return z ^ (z >> 31);
  }
  std::uint64_t key_;
};

}  // namespace twoport
