#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <numbers>
#include <vector>

#include "common/base/spatial_vector.h"
#include "common/base/vector.h"

namespace twoport {

/// Which contacts of a tool are certainly open, from distances that were measured earlier. A signed distance changes by no more than its
/// point moves, so a contact that was open by d stays open until the tool's points have gone d:
///
///     s(k) = s(k-1) + |x(k) - x(k-1)| + reach ‖R(k) - R(k-1)‖/√2        reach: the largest |r| of the points x + R r
///
/// is at least their way, as R(k) - R(k-1) has the singular values 2 sin(θ/2), 2 sin(θ/2), 0. To leave such contacts out changes no
/// result. Poses may come in any order, the stages of an integrator too.
class Clearance {
 public:
  Clearance() = default;
  /// Of a tool with `contacts` pairs of a point and a surface.
  Clearance(const std::vector<Eigen::Vector3d>& tool, int contacts)
      : until_(static_cast<std::size_t>(contacts), kUnknown) {
    for (const Eigen::Vector3d& point : tool) reach_ = std::max(reach_, point.norm());
  }

  [[nodiscard]] bool empty() const noexcept { return until_.empty(); }
  void move_to(const Eigen::Vector3d& x, const Eigen::Matrix3d& R) noexcept {
    const double way = (x - x_).norm() + reach_ / std::numbers::sqrt2 * (R - R_).norm();
    travelled_ += way + kRounding;
    x_ = x;
    R_ = R;
    if (!(travelled_ < kLong_m)) [[unlikely]]
      forget();
  }
  /// Are contacts `first` to `first + count - 1` certainly open?
  [[nodiscard]] bool open(int first, int count) const noexcept {
    for (int i = first; i < first + count; ++i)
      if (!(travelled_ < until_[static_cast<std::size_t>(i)])) return false;
    return true;
  }
  /// At the pose moved to last, the contact is open by `distance` at least [m].
  void measured(int contact, double distance) noexcept {
    until_[static_cast<std::size_t>(contact)] = travelled_ + distance - kMargin_m;
  }

 private:
  static constexpr double kUnknown = -std::numeric_limits<double>::infinity();
  static constexpr double kLong_m = 100.0;    ///< so that a sum errs by less than kRounding
  static constexpr double kRounding = 1e-14;  ///< of a way and its sum [m]
  static constexpr double kMargin_m = 1e-9;   ///< for the rounding of a distance

  /// Also where a pose was not finite.
  void forget() noexcept {
    travelled_ = 0.0;
    std::fill(until_.begin(), until_.end(), kUnknown);
  }

  double reach_ = 0.0, travelled_ = 0.0;
  Eigen::Vector3d x_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d R_ = Eigen::Matrix3d::Identity();
  std::vector<double> until_;  ///< the way from which a contact may be closed [m]
};

}  // namespace twoport
