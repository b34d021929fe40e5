#pragma once

#include <algorithm>

#include "common/base/scalar.h"

namespace twoport {

/// A factor in [0, 1] that rises while engaged and falls while not, each within `duration`. One number for all axes: a
/// force keeps its direction.
class Ramp {
 public:
  explicit Ramp(Seconds duration) : duration_{duration} {}

  double step(bool engaged, Seconds dt) noexcept {
    if (engaged && factor_ == 1.0) return factor_;
    const double by = duration_ > Seconds{} ? dt / duration_ : 1.0;
    return factor_ = std::clamp(factor_ + (engaged ? by : -by), 0.0, 1.0);
  }
  void drop() noexcept { factor_ = 0.0; }

 private:
  Seconds duration_;
  double factor_ = 0.0;
};

}  // namespace twoport
