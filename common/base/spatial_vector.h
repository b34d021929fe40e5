#pragma once

#include <Eigen/Core>
#include <cstring>
#include <type_traits>

namespace twoport {

/// A velocity, force or momentum of a body as two 3-vectors, translation and rotation. Where both are computed
/// separately this is faster than a 6-vector, which is stored in threes and loaded in twos and stalls.
struct SpatialVector {
  Eigen::Vector3d linear, angular;

  static SpatialVector Zero() { return {Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()}; }
  SpatialVector& operator+=(const SpatialVector& b) {
    linear += b.linear;
    angular += b.angular;
    return *this;
  }
  SpatialVector& operator-=(const SpatialVector& b) {
    linear -= b.linear;
    angular -= b.angular;
    return *this;
  }
  SpatialVector& operator/=(double s) {
    linear /= s;
    angular /= s;
    return *this;
  }
  SpatialVector operator-() const { return {-linear, -angular}; }
  friend SpatialVector operator+(SpatialVector a, const SpatialVector& b) { return a += b; }
  friend SpatialVector operator-(SpatialVector a, const SpatialVector& b) { return a -= b; }
  friend SpatialVector operator*(double s, const SpatialVector& a) { return {s * a.linear, s * a.angular}; }
};

/// The same for a port of size N: an N-vector, for N = 6 its two halves.
template <int N>
using PortVector = std::conditional_t<N == 6, SpatialVector, Eigen::Matrix<double, N, 1>>;

/// Its translational part.
inline Eigen::Vector3d& translation(SpatialVector& v) {
  return v.linear;
}
inline const Eigen::Vector3d& translation(const SpatialVector& v) {
  return v.linear;
}
template <int D>
Eigen::Matrix<double, D, 1>& translation(Eigen::Matrix<double, D, 1>& v) {
  return v;
}
template <int D>
const Eigen::Matrix<double, D, 1>& translation(const Eigen::Matrix<double, D, 1>& v) {
  return v;
}

/// One factor for translation and one for rotation.
struct PortScale {
  double linear = 0.0, angular = 0.0;
  friend SpatialVector operator*(const PortScale& s, const SpatialVector& v) {
    return {s.linear * v.linear, s.angular * v.angular};
  }
  template <int D>
  friend Eigen::Matrix<double, D, 1> operator*(const PortScale& s, const Eigen::Matrix<double, D, 1>& v) {
    return s.linear * v;
  }
};

/// A 6-vector of two halves, and its halves, by pairs of numbers as Eigen stores and loads a 6-vector: a load that spans two earlier stores
/// waits for them.
[[nodiscard]] inline Eigen::Matrix<double, 6, 1> whole(const SpatialVector& v) noexcept {
  using Pair [[gnu::vector_size(16)]] = double;
  const Pair pairs[] = {{v.linear[0], v.linear[1]}, {v.linear[2], v.angular[0]}, {v.angular[1], v.angular[2]}};
  Eigen::Matrix<double, 6, 1> out;
  std::memcpy(out.data(), pairs, sizeof pairs);
  return out;
}
[[nodiscard]] inline SpatialVector halves(const Eigen::Matrix<double, 6, 1>& v) noexcept {
  using Pair [[gnu::vector_size(16)]] = double;
  Pair pairs[3];
  std::memcpy(pairs, v.data(), sizeof pairs);
  return {{pairs[0][0], pairs[0][1], pairs[1][0]}, {pairs[1][1], pairs[2][0], pairs[2][1]}};
}

template <int N>
PortVector<N> port_vector(const Eigen::Matrix<double, N, 1>& v) {
  if constexpr (N == 6) {
    return halves(v);
  } else {
    return v;
  }
}

}  // namespace twoport
