#pragma once

#include <Eigen/Core>
#include <complex>

// Decompositions of matrices of any size, compiled once for all tests.

namespace twoport::test {

Eigen::MatrixXd inverse(const Eigen::MatrixXd& a);
Eigen::MatrixXd exponential(const Eigen::MatrixXd& a);

/// The mode of a map from tick to tick that grows fastest: eigenvalue, right and left eigenvector.
struct Mode {
  std::complex<double> value;
  Eigen::VectorXcd right, left;
};
Mode fastest_mode(const Eigen::MatrixXd& tick);

}  // namespace twoport::test
