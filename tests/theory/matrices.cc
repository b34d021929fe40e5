#include "tests/theory/matrices.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <unsupported/Eigen/MatrixFunctions>

namespace twoport::test {

Eigen::MatrixXd inverse(const Eigen::MatrixXd& a) {
  return a.inverse();
}
Eigen::MatrixXd exponential(const Eigen::MatrixXd& a) {
  return a.exp();
}

Mode fastest_mode(const Eigen::MatrixXd& tick) {
  const auto largest = [](const Eigen::MatrixXd& a, Eigen::VectorXcd& vector) {
    const Eigen::EigenSolver<Eigen::MatrixXd> of{a};
    Eigen::Index i = 0;
    of.eigenvalues().cwiseAbs().maxCoeff(&i);
    if (of.eigenvalues()[i].imag() < 0.0)
      i = i == 0 ? 1 : of.eigenvalues()[i - 1] == std::conj(of.eigenvalues()[i]) ? i - 1 : i + 1;
    vector = of.eigenvectors().col(i);
    return of.eigenvalues()[i];
  };
  Mode mode;
  mode.value = largest(tick, mode.right);
  largest(tick.transpose(), mode.left);
  return mode;
}

}  // namespace twoport::test
