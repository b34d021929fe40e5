#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include "common/base/scalar.h"
#include "common/base/spatial_vector.h"

namespace twoport {

/// Are all numbers of all values finite? A sum is not when one of its terms is not.
template <class... Values>
[[nodiscard]] bool all_finite(const Values&... values) noexcept {
  return std::abs((values.sum() + ...)) <= std::numeric_limits<double>::max();
}

/// Size of a port of joints, 1 to 8 of them: the coordinates of those that an arm has not are zero.
inline constexpr int kJointPort = 8;
/// Coordinates of a port of size N that are no rotations of a body: all, for N = 6 the three of translation.
template <int N>
inline constexpr int kAxes = N == 6 ? 3 : N;

/// Coordinates of one physical kind. Kinds do not mix; `.vec()` is the plain Eigen vector for use inside a step.
/// N = 1 and 3 are translations. N = 6 is translation first, then rotation, in world axes at the tool point. N = kJointPort: joints.
///
/// In a step, a local variable that holds such values and that a function returns is not const, its address goes to no function that is
/// not inlined, and no conditional expression chooses between two of them: GCC 12 would keep it in memory.
template <class Kind, int N>
class Coords {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;
  static constexpr int kSize = N;

  Coords() : v_{Vector::Zero()} {}
  explicit Coords(const Vector& v) : v_{v} {}
  explicit Coords(const SpatialVector& v) requires(N == 6) : v_{whole(v)} {}
  template <class Expression>
  explicit Coords(const Eigen::MatrixBase<Expression>& v) : v_{v} {}
  [[nodiscard]] const Vector& vec() const { return v_; }
  double operator[](int i) const { return v_[i]; }

  Coords operator-() const { return Coords{-v_}; }
  friend Coords operator+(const Coords& a, const Coords& b) { return Coords{a.v_ + b.v_}; }
  friend Coords operator-(const Coords& a, const Coords& b) { return Coords{a.v_ - b.v_}; }
  friend Coords operator*(double s, const Coords& a) { return Coords{s * a.v_}; }
  Coords& operator+=(const Coords& b) {
    v_ += b.v_;
    return *this;
  }
  [[nodiscard]] double squared_norm() const { return v_.squaredNorm(); }
  [[nodiscard]] double sum() const noexcept { return v_.sum(); }
  [[nodiscard]] bool finite() const noexcept { return all_finite(*this); }

 private:
  Vector v_;
};

template <int N>
using Velocity = Coords<struct VelocityKind, N>;  // twist: [m/s], [rad/s]
template <int N>
using Force = Coords<struct ForceKind, N>;  // wrench: [N], [N m]
template <int N>
using Displacement = Coords<struct DisplacementKind, N>;  // [m], rotation vector [rad]

/// The dual product. Power is positive into the element that the force acts on.
template <int N>
Power dot(const Force<N>& f, const Velocity<N>& v) {
  return Power{f.vec().dot(v.vec())};
}
template <int N>
Power dot(const Velocity<N>& v, const Force<N>& f) {
  return Power{f.vec().dot(v.vec())};
}
template <int N>
Energy dot(const Force<N>& f, const Displacement<N>& d) {
  return Energy{f.vec().dot(d.vec())};
}
template <int N>
Displacement<N> operator*(const Velocity<N>& v, Seconds t) {
  return Displacement<N>{v.vec() * t.si()};
}
template <int N>
Velocity<N> operator/(const Displacement<N>& d, Seconds t) {
  return Velocity<N>{d.vec() / t.si()};
}

/// Rotation vector of a unit quaternion, of length in [0, pi].
/// Below |sin(theta/2)| = 0.02 by the series of asin (relative error below 1e-17), as nearly every tick is.
inline Eigen::Vector3d rotation_vector(const Eigen::Quaterniond& q) {
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  Eigen::Vector3d s = sign * q.vec();
  const double s2 = s.squaredNorm();
  if (s2 < 4e-4) {
    const double asin_over_s =
        1.0 + s2 * (1.0 / 6 + s2 * (3.0 / 40 + s2 * (15.0 / 336 + s2 * (105.0 / 3456 + s2 * 945.0 / 42240))));
    return 2.0 * asin_over_s * s;
  }
  const double n = std::sqrt(s2);
  return (2.0 * std::atan2(n, sign * q.w()) / n) * s;
}

/// Unit quaternion of a rotation vector. Series below 0.02 rad (relative error below 1e-17).
inline Eigen::Quaterniond rotation(const Eigen::Vector3d& r) {
  const double h2 = 0.25 * r.squaredNorm();
  double c, sinc;
  if (h2 < 1e-4) {
    c = 1.0 - h2 * (1.0 / 2 - h2 * (1.0 / 24 - h2 * (1.0 / 720 - h2 / 40320)));
    sinc = 1.0 - h2 * (1.0 / 6 - h2 * (1.0 / 120 - h2 * (1.0 / 5040 - h2 / 362880)));
  } else {
    const double h = std::sqrt(h2);
    c = std::cos(h);
    sinc = std::sin(h) / h;
  }
  Eigen::Vector3d v = (0.5 * sinc) * r;
  return {c, v.x(), v.y(), v.z()};
}

/// Position of a port. N = 1, 3: a point [m]; N = kJointPort: joints [rad], prismatic ones [m].
template <int N>
class Position {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;
  Position() : p_{Vector::Zero()} {}
  explicit Position(const Vector& p) : p_{p} {}
  template <class Expression>
  explicit Position(const Eigen::MatrixBase<Expression>& p) : p_{p} {}
  [[nodiscard]] const Vector& translation() const { return p_; }
  [[nodiscard]] double sum() const noexcept { return p_.sum(); }
  [[nodiscard]] bool finite() const noexcept { return all_finite(*this); }

  /// From b to a.
  friend Displacement<N> operator-(const Position& a, const Position& b) { return Displacement<N>{a.p_ - b.p_}; }
  friend Position operator+(const Position& a, const Displacement<N>& d) { return Position{a.p_ + d.vec()}; }
  friend Vector difference(const Position& a, const Position& b) { return a.p_ - b.p_; }

 private:
  Vector p_;
};

/// Position of a port. N = 6: a pose, translation [m] and attitude (unit quaternion, body to world).
template <>
class Position<6> {
 public:
  Position() : p_{Eigen::Vector3d::Zero()}, q_{Eigen::Quaterniond::Identity()} {}
  Position(const Eigen::Vector3d& p, const Eigen::Quaterniond& q) : p_{p}, q_{q} {}
  [[nodiscard]] const Eigen::Vector3d& translation() const { return p_; }
  [[nodiscard]] const Eigen::Quaterniond& attitude() const { return q_; }
  [[nodiscard]] double sum() const noexcept { return p_.sum() + q_.coeffs().sum(); }
  [[nodiscard]] bool finite() const noexcept { return all_finite(*this); }

  /// From b to a: translation and world rotation vector log(R_a R_b^T).
  friend Displacement<6> operator-(const Position& a, const Position& b) { return Displacement<6>{difference(a, b)}; }
  friend SpatialVector difference(const Position& a, const Position& b) {
    return {a.p_ - b.p_, rotation_vector(a.q_ * b.q_.conjugate())};
  }
  friend Position operator+(const Position& a, const Displacement<6>& d) {
    const SpatialVector by = halves(d.vec());
    return a.moved(by.linear, by.angular);
  }
  /// Moved by a translation [m] and turned by a rotation vector [rad], both in world axes.
  [[nodiscard]] Position moved(const Eigen::Vector3d& by, const Eigen::Vector3d& turn) const {
    Eigen::Quaterniond q = rotation(turn) * q_;
    // One Newton step of 1/sqrt keeps the quaternion on the unit sphere.
    const double scale = 1.5 - 0.5 * q.squaredNorm();
    return {p_ + by, Eigen::Quaterniond{scale * q.coeffs()}};
  }

 private:
  Eigen::Vector3d p_;
  Eigen::Quaterniond q_;
};

/// A position written as numbers: N coordinates for N = 1, 3; translation and rotation vector for N = 6.
template <int N>
typename Displacement<N>::Vector coordinates(const Position<N>& x) {
  return (x - Position<N>{}).vec();
}

}  // namespace twoport
