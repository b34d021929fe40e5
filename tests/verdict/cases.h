#pragma once

#include <cstdint>
#include <random>
#include <string>
#include <vector>

namespace twoport::test {

/// Random numbers of a seed.
class Draw {
 public:
  explicit Draw(std::uint64_t seed) : rng_{seed} {}
  double between(double low, double high) {
    return low + (high - low) * (static_cast<double>(rng_() >> 11) * 0x1.0p-53);
  }
  /// Evenly in the logarithm.
  double about(double low, double high);
  int one_of(int low, int high) { return low + static_cast<int>(rng_() % static_cast<std::uint64_t>(high - low + 1)); }
  bool coin() { return one_of(0, 1) == 1; }

 private:
  std::mt19937_64 rng_;
};

/// A scene whose stability is known without the laboratory.
struct Case {
  std::string scene;  ///< text
  bool stable;        ///< the truth
  std::string why;    ///< where it comes from, with the parameters
  double rate = 0.0;  ///< of the least damped mode [1/s]; 0: no eigenvalue tells it
};

/// One kind of case. `draw` makes one; they differ in all that the kind leaves open.
struct Kind {
  const char* name;
  Case (*draw)(Draw& draw);
};

/// All kinds.
const std::vector<Kind>& kinds();

}  // namespace twoport::test
