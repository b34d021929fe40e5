#pragma once

#include "common/base/vector.h"
#include "common/coupling/options.h"

namespace twoport {

/// The virtual coupling's spring-damper.
///
///     f = K (x_d - x) + B (v_d - v)        translation [N] and, for N = 6, rotation [N m] with their own K and B
template <int N>
class SpringDamper {
 public:
  using Vector = typename Force<N>::Vector;
  explicit SpringDamper(const CouplingOptions& o) {
    k_.setConstant(o.stiffness_n_per_m);
    b_.setConstant(o.damping_n_s_per_m);
    if constexpr (N == kJointPort) b_ = b_.cwiseMax(o.damping_of_joints);
    if constexpr (N == 6) {
      k_.template tail<3>().setConstant(o.rotational_stiffness_n_m_per_rad);
      b_.template tail<3>().setConstant(o.rotational_damping_n_m_s_per_rad);
    }
  }
  Force<N> force(const Displacement<N>& stretch, const Velocity<N>& rate) const noexcept {
    return Force<N>{k_.cwiseProduct(stretch.vec()) + b_.cwiseProduct(rate.vec())};
  }

  /// Energy stored in the spring, ½ eᵀK e [J].
  [[nodiscard]] Energy stored(const Displacement<N>& stretch) const noexcept {
    return Energy{0.5 * stretch.vec().dot(k_.cwiseProduct(stretch.vec()))};
  }

  /// Compliance of one sampling interval, (B + K T)⁻¹ per axis [m/(N s)]. Computed when T changes.
  [[nodiscard]] const Vector& mobility(Seconds dt) noexcept {
    if (dt != period_) {
      period_ = dt;
      compliance_ = (b_ + k_ * dt.si()).cwiseInverse();
    }
    return compliance_;
  }

 private:
  Vector k_, b_, compliance_ = Vector::Zero();
  Seconds period_{-1.0};
};

}  // namespace twoport
