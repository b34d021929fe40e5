#pragma once

#include <cstddef>
#include <vector>

#include "common/base/vector.h"

namespace twoport {

/// Numbers as a scene writes them; empty means "not given".
using Numbers = std::vector<double>;

/// Coordinates as a scene writes them, zero where it does not.
template <int N>
Eigen::Matrix<double, N, 1> vector(const Numbers& n) {
  Eigen::Matrix<double, N, 1> v = Eigen::Matrix<double, N, 1>::Zero();
  for (int i = 0; i < N && i < static_cast<int>(n.size()); ++i) v[i] = n[static_cast<std::size_t>(i)];
  return v;
}

/// A position as a scene writes it: N numbers, or for N = 6 x y z with or without a quaternion w x y z. Empty: origin.
template <int N>
Position<N> position(const Numbers& n) {
  if constexpr (N == 6) {
    const Eigen::Vector3d p = vector<3>(n);
    Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
    if (n.size() == 7) q = Eigen::Quaterniond{n[3], n[4], n[5], n[6]}.normalized();
    return {p, q};
  } else {
    return Position<N>{vector<N>(n)};
  }
}

}  // namespace twoport
