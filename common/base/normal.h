#pragma once

#include <boost/random/normal_distribution.hpp>
#include <cstdint>
#include <limits>
#include <utility>

#include "common/base/random.h"

namespace twoport {

/// The numbers of one draw: bits(index, purpose), and for the few draws that need more than one, hashes of the number before.
class Draws {
 public:
  using result_type = std::uint64_t;
  Draws(const Random& random, std::uint64_t index, unsigned purpose) noexcept : next_{random.bits(index, purpose)} {}
  static constexpr result_type min() noexcept { return 0; }
  static constexpr result_type max() noexcept { return std::numeric_limits<result_type>::max(); }
  result_type operator()() noexcept { return std::exchange(next_, Random{next_}.bits(0)); }

 private:
  std::uint64_t next_;
};

/// Normal with mean 0 and standard deviation 1, a function of seed, stream, index and purpose (Random), by the ziggurat of Boost.Random
/// (Marsaglia, Tsang, J. Statistical Software 5(8), 2000). Real time: no state, no allocation.
[[nodiscard]] inline double normal(const Random& random, std::uint64_t index, unsigned purpose = 0) noexcept {
  Draws draws{random, index, purpose};
  return boost::random::normal_distribution<double>{}(draws);
}

}  // namespace twoport
