#pragma once

#include <Eigen/Core>

namespace twoport {

/// Of a matrix that is balanced first. Allocates.
Eigen::VectorXcd eigenvalues(Eigen::MatrixXd a);

}  // namespace twoport
