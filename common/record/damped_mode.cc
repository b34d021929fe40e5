#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>

#include "common/base/eigenvalues.h"
#include "common/record/trend.h"

namespace twoport {
namespace {

constexpr int kRank = 8;
using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kRank, kRank>;

/// The c that takes v c nearest to z, by Gram and Schmidt, each twice; 0 for a column that the ones before span. Eigen's solvers
/// of complex matrices of any size take half a minute to compile.
Eigen::VectorXcd least_squares(const Eigen::MatrixXcd& v, const Eigen::VectorXd& z) {
  const Eigen::Index n = v.cols();
  Eigen::MatrixXcd q = v, r = Eigen::MatrixXcd::Zero(n, n);
  Eigen::VectorXcd c = Eigen::VectorXcd::Zero(n);
  for (Eigen::Index j = 0; j < n; ++j) {
    for (int again = 0; again < 2; ++again)
      for (Eigen::Index i = 0; i < j; ++i) {
        const std::complex<double> along = q.col(i).dot(q.col(j));
        r(i, j) += along;
        q.col(j) -= q.col(i) * along;
      }
    const double size = q.col(j).norm();
    if (size > 1e-13 * v.col(j).norm()) {
      r(j, j) = size;
      q.col(j) /= size;
    } else {
      q.col(j).setZero();
    }
  }
  for (Eigen::Index j = n; j-- > 0;) {
    if (r(j, j) == 0.0) continue;
    std::complex<double> sum = q.col(j).dot(z.cast<std::complex<double>>());
    for (Eigen::Index k = j + 1; k < n; ++k) sum -= r(j, k) * c[k];
    c[j] = sum / r(j, j);
  }
  return c;
}

/// The fit of least_damped_mode to samples of any number.
DampedMode fit_modes(const Eigen::VectorXd& z) {
  const Eigen::Index samples = z.size(), rows = samples / 3 + 1, columns = samples - rows + 1;
  Eigen::MatrixXd h(rows, columns);
  for (Eigen::Index i = 0; i < rows; ++i) h.row(i) = z.segment(i, columns).transpose();
  // An orthonormal basis of what its columns span, by Gram and Schmidt, the largest remainder first; each twice.
  Eigen::MatrixXd basis(rows, kRank);
  Eigen::Index rank = 0;
  for (double first = 0.0; rank < kRank; ++rank) {
    Eigen::Index largest = 0;
    const double size = h.colwise().norm().maxCoeff(&largest);
    if (rank == 0) first = size;
    if (!(size > 1e-6 * first)) break;
    Eigen::VectorXd q = h.col(largest) / size;
    q -= basis.leftCols(rank) * (basis.leftCols(rank).transpose() * q);
    basis.col(rank) = q.normalized();
    h -= basis.col(rank) * (basis.col(rank).transpose() * h);
  }
  if (rank == 0) return {};
  // A, the basis without its last row, times `step` is nearest to the basis without its first; A' A = I - b b', b the last row.
  const auto used = basis.leftCols(rank);
  const Eigen::VectorXd b = used.row(rows - 1);
  SmallMatrix step = used.topRows(rows - 1).transpose().lazyProduct(used.bottomRows(rows - 1));
  step += b * (step.transpose() * b / (1.0 - b.squaredNorm())).transpose();
  if (!step.allFinite()) return {};
  const Eigen::VectorXcd lambda = eigenvalues(step);
  Eigen::MatrixXcd v(samples, rank);
  for (Eigen::Index j = 0; j < rank; ++j)
    for (Eigen::Index k = 0; k < samples; ++k) v(k, j) = k == 0 ? std::complex<double>(1.0) : v(k - 1, j) * lambda[j];
  const Eigen::VectorXcd c = least_squares(v, z);
  Eigen::VectorXcd left_over = z.cast<std::complex<double>>();
  for (Eigen::Index j = 0; j < rank; ++j) left_over -= v.col(j) * c[j];
  const double residual = left_over.cwiseAbs().maxCoeff();
  if (!(residual <= 1e-4)) return {};
  double rate = -std::numeric_limits<double>::infinity();
  for (Eigen::Index j = 0; j < rank; ++j)
    if ((v.col(j) * c[j]).norm() > 1e-3 * std::sqrt(static_cast<double>(samples)))
      rate = std::max(rate, std::log(std::abs(lambda[j])));
  if (!std::isfinite(rate)) return {};
  return {.found = true, .rate = rate, .residual = residual};
}

}  // namespace

DampedMode least_damped_mode(const std::array<double, kPencilSamples>& x) {
  constexpr Eigen::Index kPart = 2 * kPencilSamples / 3;
  Eigen::VectorXd z = Eigen::Map<const Eigen::VectorXd>(x.data(), kPencilSamples);
  const double most = z.cwiseAbs().maxCoeff();
  if (!(most > 0.0) || !std::isfinite(most)) return {};
  z /= most;
  DampedMode all = fit_modes(z);
  if (!all.found) return {};
  all.error = std::numeric_limits<double>::infinity();
  Eigen::VectorXd first = z.head(kPart), last = z.tail(kPart);
  const double scale = last.cwiseAbs().maxCoeff();
  if (!(scale > 0.0)) return all;
  const DampedMode one = fit_modes(first / first.cwiseAbs().maxCoeff()), two = fit_modes(last / scale);
  if (one.found && two.found) all.error = std::max(std::abs(one.rate - all.rate), std::abs(two.rate - all.rate));
  return all;
}

}  // namespace twoport
