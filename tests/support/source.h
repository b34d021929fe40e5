#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <random>

namespace twoport::test {

/// Random numbers of a seed.
class Source {
 public:
  explicit Source(std::uint64_t seed) : random_{seed} {}
  double uniform(double from, double to) { return std::uniform_real_distribution<double>{from, to}(random_); }
  /// Each component uniform in ±size.
  template <int N>
  Eigen::Matrix<double, N, 1> vector(double size) {
    Eigen::Matrix<double, N, 1> v;
    for (int i = 0; i < N; ++i) v[i] = uniform(-size, size);
    return v;
  }

 private:
  std::mt19937_64 random_;
};

}  // namespace twoport::test
