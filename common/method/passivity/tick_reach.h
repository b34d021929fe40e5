#pragma once

#include <algorithm>

#include "common/base/scalar.h"
#include "common/base/vector.h"

namespace twoport {

/// What a force does at most in a tick, at a port whose coming motion is not known.
///
///     W = Σ |f_i| d_i     d: twice the largest motion of a tick in the last half second, per axis
template <int N>
class TickReach {
 public:
  void observe(const Displacement<N>& moved, Seconds dt) noexcept {
    largest_ = moved.vec().cwiseAbs().cwiseMax(std::max(0.0, 1.0 - dt.si() / kMemory_s) * largest_);
  }
  [[nodiscard]] Energy most(const Force<N>& f) const noexcept {
    return Energy{kReach * f.vec().cwiseAbs().dot(largest_)};
  }
  /// Largest part in [0, 1] of f that does no more than `available`.
  [[nodiscard]] double part(const Force<N>& f, Energy available) const noexcept {
    const Energy all = most(f);
    return all > available ? positive_part(available) / all : 1.0;
  }

 private:
  static constexpr double kReach = 2.0, kMemory_s = 0.5;
  typename Force<N>::Vector largest_ = Force<N>::Vector::Zero();
};

}  // namespace twoport
