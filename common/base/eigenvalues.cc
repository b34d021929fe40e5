#include "common/base/eigenvalues.h"

#include <Eigen/Eigenvalues>
#include <cmath>

namespace twoport {
namespace {

/// Scales states by powers of two until rows and columns are alike (Parlett and Reinsch, 1969): positions and forces
/// differ by 1e5, and eigenvalues lose as many digits without it.
void balance(Eigen::MatrixXd& a) {
  for (bool better = true; better;) {
    better = false;
    for (Eigen::Index i = 0; i < a.rows(); ++i) {
      const double self = std::abs(a(i, i)), row = a.row(i).lpNorm<1>() - self, column = a.col(i).lpNorm<1>() - self;
      if (row == 0.0 || column == 0.0) continue;
      const double scale = std::exp2(std::round(0.5 * std::log2(row / column)));
      if (column * scale + row / scale >= 0.95 * (column + row)) continue;
      a.col(i) *= scale;
      a.row(i) /= scale;
      better = true;
    }
  }
}

}  // namespace

Eigen::VectorXcd eigenvalues(Eigen::MatrixXd a) {
  balance(a);
  return Eigen::EigenSolver<Eigen::MatrixXd>{a, false}.eigenvalues();
}

}  // namespace twoport
