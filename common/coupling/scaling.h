#pragma once

#include "common/base/vector.h"
#include "common/coupling/options.h"

namespace twoport {

/// Maps between the master's and the slave's world: lengths times s_x, forces times s_f.
///
///     x_s = s_x x_m     v_s = s_x v_m     f_m = s_f f_s
///     ω_s = ω_m         τ_m = (s_f / s_x) τ_s        angles have no scale; a torque is a force times a length
///     E_m = (s_f / s_x) E_s                          one number for all axes
template <int N>
class Scaling {
 public:
  explicit Scaling(const ControlOptions& o)
      : force_{o.force_scale}, motion_{o.motion_scale}, torque_{force_ / motion_}, energy_to_slave_{motion_ / force_} {}

  Position<N> to_slave(const Position<N>& x) const noexcept {
    if constexpr (N == 6) {
      return {motion_ * x.translation(), x.attitude()};
    } else {
      return Position<N>{motion_ * x.translation()};
    }
  }
  Position<N> to_master(const Position<N>& x) const noexcept {
    if constexpr (N == 6) {
      return {x.translation() / motion_, x.attitude()};
    } else {
      return Position<N>{x.translation() / motion_};
    }
  }
  Velocity<N> to_slave(const Velocity<N>& v) const noexcept { return Velocity<N>{scaled(v.vec(), motion_, 1.0)}; }
  Velocity<N> to_master(const Velocity<N>& v) const noexcept {
    return Velocity<N>{scaled(v.vec(), 1.0 / motion_, 1.0)};
  }
  Force<N> to_master(const Force<N>& f) const noexcept { return Force<N>{scaled(f.vec(), force_, torque_)}; }
  [[nodiscard]] Energy to_slave(Energy e) const noexcept { return energy_to_slave_ * e; }
  [[nodiscard]] Energy to_master(Energy e) const noexcept { return torque_ * e; }

 private:
  using Vector = typename Force<N>::Vector;
  static Vector scaled(const Vector& v, double translation, double rotation) noexcept {
    if constexpr (N == 6) {
      Vector out;
      out << translation * v.template head<3>(), rotation * v.template tail<3>();
      return out;
    } else {
      (void)rotation;
      return translation * v;
    }
  }
  double force_, motion_;
  double torque_;  ///< s_f / s_x, an energy's too
  double energy_to_slave_;
};

}  // namespace twoport
