#pragma once

#include <cmath>
#include <limits>

#include "common/base/vector.h"

namespace twoport {

/// Bound on the norm of the translational force, which must be finite. A longer one is scaled as a whole: its direction
/// stays, and a torque falls with it.
template <int N>
class ForceLimit {
 public:
  explicit ForceLimit(double max_n) : max_n_{max_n}, any_{max_n < std::numeric_limits<double>::infinity()} {}

  [[nodiscard]] Force<N> operator()(const Force<N>& f) const noexcept {
    if (!any_) return f;
    const double norm = translational_norm(f);
    return norm <= max_n_ ? f : (max_n_ / norm) * f;
  }

 private:
  static double translational_norm(const Force<N>& f) noexcept {
    if constexpr (N == 6) {
      return f.vec().template head<3>().norm();
    } else {
      return f.vec().norm();
    }
  }

  double max_n_;
  bool any_;
};

}  // namespace twoport
