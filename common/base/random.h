#pragma once

#include <array>
#include <cmath>
#include <cstddef>
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
  /// Normal with mean 0 and standard deviation 1, by the inverse of its distribution function: one draw, no rejection.
  [[nodiscard]] double normal(std::uint64_t index, unsigned purpose = 0) const noexcept {
    return normal_quantile(uniform(index, purpose));
  }

  /// z with Φ(z) = p, relative error about 1e-16 for p in (1e-316, 1).
  /// Source: Wichura, Applied Statistics 37(3), 1988, algorithm AS 241, routine PPND16.
  [[nodiscard]] static double normal_quantile(double p) noexcept {
    const double q = p - 0.5;
    if (std::abs(q) <= 0.425) {
      const double r = 0.180625 - q * q;
      return q * ratio(r,
                       {2509.0809287301226727, 33430.575583588128105, 67265.770927008700853, 45921.953931549871457,
                        13731.693765509461125, 1971.5909503065514427, 133.14166789178437745, 3.387132872796366608},
                       {5226.495278852854561, 28729.085735721942674, 39307.89580009271061, 21213.794301586595867,
                        5394.1960214247511077, 687.1870074920579083, 42.313330701600911252, 1.0});
    }
    const double r = std::sqrt(-std::log(q < 0.0 ? p : 1.0 - p));
    const double z =
        r <= 5.0
            ? ratio(
                  r - 1.6,
                  {7.7454501427834140764e-4, 0.0227238449892691845833, 0.24178072517745061177, 1.27045825245236838258,
                   3.64784832476320460504, 5.7694972214606914055, 4.6303378461565452959, 1.42343711074968357734},
                  {1.05075007164441684324e-9, 5.475938084995344946e-4, 0.0151986665636164571966, 0.14810397642748007459,
                   0.68976733498510000455, 1.6763848301838038494, 2.05319162663775882187, 1.0})
            : ratio(r - 5.0,
                    {2.01033439929228813265e-7, 2.71155556874348757815e-5, 0.0012426609473880784386,
                     0.026532189526576123093, 0.29656057182850489123, 1.7848265399172913358, 5.4637849111641143699,
                     6.6579046435011037772},
                    {2.04426310338993978564e-15, 1.4215117583164458887e-7, 1.8463183175100546818e-5,
                     7.868691311456132591e-4, 0.0148753612908506148525, 0.13692988092273580531, 0.59983220655588793769,
                     1.0});
    return q < 0.0 ? -z : z;
  }

 private:
  static constexpr std::uint64_t kGamma = 0x9e3779b97f4a7c15;
  using Coefficients = std::array<double, 8>;  ///< of a polynomial, highest power first
  static double ratio(double r, const Coefficients& above, const Coefficients& below) noexcept {
    double a = above[0], b = below[0];
    for (std::size_t i = 1; i < above.size(); ++i) {
      a = a * r + above[i];
      b = b * r + below[i];
    }
    return a / b;
  }
  static std::uint64_t mix(std::uint64_t z) noexcept {
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
    z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
    return z ^ (z >> 31);
  }
  std::uint64_t key_;
};

}  // namespace twoport
