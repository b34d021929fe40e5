#pragma once

#include <string>

#include "common/base/vector.h"
#include "common/coupling/options.h"

namespace twoport {

/// The axes of the device that display a force. The force of a node has no other part, and its passivity layer knows only the motion
/// along them: it sees a device of fewer axes, whose claim holds for the hand, since f·v is zero along the others.
template <int N>
class MotorMask {
 public:
  explicit MotorMask(const ControlOptions& o) {
    for (int i = 0; i < N; ++i) {
      const bool has = (o.without_motor >> i & 1) == 0;
      has_[i] = has ? 1.0 : 0.0;
      all_ = all_ && has;
    }
  }

  [[nodiscard]] bool all() const noexcept { return all_; }
  /// The part of a force or motion along the axes with motors.
  template <class Coords>
  [[nodiscard]] Coords operator()(const Coords& c) const noexcept {
    return Coords{c.vec().cwiseProduct(has_)};
  }

 private:
  typename Force<N>::Vector has_;
  bool all_ = true;
};

/// Largest force [N] and torque [N m] along axes without a motor.
struct NotDisplayed {
  double force_n = 0.0, torque_n_m = 0.0;
};

/// Their numbers, "3, 4, 5"; empty: all axes have a motor.
[[nodiscard]] inline std::string axes_without_motor(const ControlOptions& o) {
  std::string all;
  for (int i = 0; i < kJointPort; ++i)
    if ((o.without_motor >> i & 1) != 0) all += (all.empty() ? "" : ", ") + std::to_string(i);
  return all;
}
/// Into a summary.
void say_not_displayed(const ControlOptions& o, const NotDisplayed& most, auto& summary) {
  if (o.without_motor == 0) return;
  summary.set_axes_without_motor(axes_without_motor(o));
  summary.set_not_displayed_max_n(most.force_n);
  summary.set_not_displayed_max_n_m(most.torque_n_m);
}

}  // namespace twoport
