#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <limits>
#include <span>

namespace twoport {

/// One condition a·y >= b.
template <int N>
struct HalfSpace {
  Eigen::Matrix<double, N, 1> a;
  double b;
};

/// The point nearest to a given one that meets all conditions:
///
///     minimize |y - y0|²/2  subject to  a_i·y >= b_i
///
/// by the dual active-set method (Goldfarb and Idnani, Mathematical Programming 27, 1983) with the unit matrix as Hessian: at most
/// N conditions are active, whatever their number and however many are redundant. At the solution
///
///     y - y0 = Σ_active λ_i a_i,   λ_i >= 0,   λ_i (a_i·y - b_i) = 0.
///
/// No allocation.
template <int N>
class LeastDistance {
 public:
  using Vector = Eigen::Matrix<double, N, 1>;

  /// Moves y from y0 to the solution. A condition may be missed by `tolerance` (of b). False: there is none, or it was not found
  /// within 8 N + 16 changes; then y meets some of the conditions.
  bool solve(std::span<const HalfSpace<N>> rows, Vector& y, double tolerance) noexcept {
    count_ = 0;
    for (int changes = 0; changes < 8 * N + 16;) {
      std::size_t worst = rows.size();
      double least = -tolerance;
      for (std::size_t i = 0; i < rows.size(); ++i) {
        const double slack = rows[i].a.dot(y) - rows[i].b;
        if (slack < least) least = slack, worst = i;
      }
      if (worst == rows.size()) return true;
      double multiplier = 0.0;
      for (bool added = false; !added; ++changes) {
        if (changes >= 8 * N + 16) return false;
        const Vector& a = rows[worst].a;
        Vector z = a;
        std::array<double, N> r;
        project(z, r);
        const double squared = z.squaredNorm();
        const bool independent = count_ < N && squared > 1e-20 * a.squaredNorm();
        const double full = independent ? -least / squared : std::numeric_limits<double>::infinity();
        double step = full;
        std::size_t leaving = count_;
        for (std::size_t j = 0; j < count_; ++j)
          if (r[j] > 0.0 && lambda_[j] < step * r[j]) step = lambda_[j] / r[j], leaving = j;
        if (step == std::numeric_limits<double>::infinity()) return false;
        for (std::size_t j = 0; j < count_; ++j) lambda_[j] -= step * r[j];
        multiplier += step;
        if (independent) {
          y += step * z;
          least = a.dot(y) - rows[worst].b;
        }
        if (leaving == count_) {
          add(worst, z, multiplier);
          added = true;
        } else {
          drop(leaving, rows);
        }
      }
    }
    return false;
  }

  /// For another y0 and the same rows: true, and y and the λ are the solution, if the conditions that were active last give it; else
  /// nothing changes. Where conditions are redundant, they stay the same ones so.
  bool solve_again(std::span<const HalfSpace<N>> rows, Vector& y, double tolerance) noexcept {
    std::array<double, N> c{}, lambda{};
    const Vector at = onto_active(rows, y, c);
    for (std::size_t k = count_; k-- > 0;) {
      double sum = c[k];
      for (std::size_t j = k + 1; j < count_; ++j) sum -= triangle_[k][j] * lambda[j];
      lambda[k] = sum / triangle_[k][k];
      if (!(lambda[k] >= 0.0)) return false;
    }
    for (const HalfSpace<N>& row : rows)
      if (!(row.a.dot(at) - row.b >= -tolerance)) return false;
    lambda_ = lambda;
    y = at;
    return true;
  }

  /// The point nearest to the origin that meets the active conditions as equations.
  [[nodiscard]] Vector active_point(std::span<const HalfSpace<N>> rows) const noexcept {
    std::array<double, N> c{};
    return onto_active(rows, Vector::Zero(), c);
  }

  /// Active conditions, by their index, with their λ.
  [[nodiscard]] std::size_t active() const noexcept { return count_; }
  [[nodiscard]] std::size_t index(std::size_t j) const noexcept { return index_[j]; }
  [[nodiscard]] double lambda(std::size_t j) const noexcept { return lambda_[j]; }
  /// Orthonormal, with the span of the active conditions' vectors.
  [[nodiscard]] const Vector& direction(std::size_t j) const noexcept { return q_[j]; }

 private:
  static constexpr std::size_t kMost = static_cast<std::size_t>(N);

  /// y + Σ c_k q_k, which meets the active conditions as equations.
  [[nodiscard]] Vector onto_active(std::span<const HalfSpace<N>> rows, const Vector& y,
                                   std::array<double, N>& c) const noexcept {
    Vector at = y;
    for (std::size_t k = 0; k < count_; ++k) {
      double sum = rows[index_[k]].b - rows[index_[k]].a.dot(y);
      for (std::size_t j = 0; j < k; ++j) sum -= triangle_[j][k] * c[j];
      c[k] = sum / triangle_[k][k];
      at += c[k] * q_[k];
    }
    return at;
  }
  /// Takes from z its part in the span of the active conditions' vectors, Σ r_j a_j. A second pass removes what rounding left.
  void project(Vector& z, std::array<double, N>& r) noexcept {
    std::array<double, N> d{};
    for (int pass = 0; pass < 2; ++pass)
      for (std::size_t j = 0; j < count_; ++j) {
        const double along = q_[j].dot(z);
        d[j] += along;
        z -= along * q_[j];
      }
    for (std::size_t j = count_; j-- > 0;) {
      double sum = d[j];
      for (std::size_t k = j + 1; k < count_; ++k) sum -= triangle_[j][k] * r[k];
      r[j] = sum / triangle_[j][j];
    }
    last_ = d;
  }
  /// The condition whose projection was computed last: a = Σ last_j q_j + z.
  void add(std::size_t i, const Vector& z, double multiplier) noexcept {
    const double length = z.norm();
    for (std::size_t j = 0; j < count_; ++j) triangle_[j][count_] = last_[j];
    triangle_[count_][count_] = length;
    q_[count_] = z / length;
    index_[count_] = i;
    lambda_[count_] = multiplier;
    ++count_;
  }
  void drop(std::size_t leaving, std::span<const HalfSpace<N>> rows) noexcept {
    const std::size_t kept = count_ - 1;
    for (std::size_t j = leaving; j < kept; ++j) index_[j] = index_[j + 1], lambda_[j] = lambda_[j + 1];
    count_ = leaving;
    while (count_ < kept) {
      const std::size_t i = index_[count_];
      Vector z = rows[i].a;
      std::array<double, N> r;
      project(z, r);
      add(i, z, lambda_[count_]);
    }
  }

  std::size_t count_ = 0;
  std::array<std::size_t, kMost> index_;
  std::array<double, kMost> lambda_;
  std::array<Vector, kMost> q_;                            ///< orthonormal
  std::array<std::array<double, kMost>, kMost> triangle_;  ///< a_k = Σ_{j<=k} triangle_jk q_j
  std::array<double, N> last_;
};

}  // namespace twoport
