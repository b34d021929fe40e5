#pragma once

#include <algorithm>

#include "common/base/time.h"
#include "common/base/vector.h"

namespace twoport {

/// Makes a force continuous where its law changes at once. With f_before the last force under the old law and f(k) that of the
/// new one, from k = 0 on
///
///     f(k) + c(k) (f_before - f(0)),     c falls linearly from 1 to 0 in the time `over`
///
/// so a change of law adds at most T/over |f_before - f(0)| to the change of force in a tick.
template <int N>
class Bridge {
 public:
  explicit Bridge(Seconds over) : over_{over} {}

  /// The law changes before the next step.
  void begin(const Force<N>& before) noexcept {
    left_ = over_ > Seconds{} ? 1.0 : 0.0;
    before_ = before;
    first_ = true;
  }
  void stop() noexcept { left_ = 0.0; }
  /// This, where it is left and `applies`; else null, and it ends.
  [[nodiscard]] Bridge* over(bool applies) noexcept {
    if (left_ == 0.0) [[likely]]
      return nullptr;
    if (!applies) stop();
    return applies ? this : nullptr;
  }
  /// What is added to `f` in this tick.
  [[nodiscard]] Force<N> step(const Force<N>& f, Seconds dt) noexcept {
    if (first_) {
      difference_ = before_ - f;
      first_ = false;
    } else {
      left_ = std::max(0.0, left_ - dt / over_);
    }
    return added();
  }
  /// By the last step.
  [[nodiscard]] Force<N> added() const noexcept { return left_ * difference_; }

 private:
  Seconds over_;
  double left_ = 0.0;  ///< c
  bool first_ = false;
  Force<N> before_, difference_;
};

}  // namespace twoport
