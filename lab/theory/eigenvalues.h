#pragma once

#include <Eigen/Core>

namespace twoport::lab {

/// Of a matrix that is balanced first.
Eigen::VectorXcd eigenvalues(Eigen::MatrixXd a);

}  // namespace twoport::lab
