#pragma once

#include <algorithm>
#include <cmath>

#include "common/method/layers.h"

namespace twoport {

/// Lower bounds of the damping that the device has by itself: as given, else those of the scene's device.
struct BoundingDamping {
  double translation_n_s_per_m, rotation_n_m_s_per_rad;
};
inline BoundingDamping bounding_damping(const ControlOptions& o) {
  return {o.energy_bounding.damping_n_s_per_m.value_or(o.known.device_damping_n_s_per_m),
          o.energy_bounding.rotational_damping_n_m_s_per_rad.value_or(o.known.device_rotational_damping_n_m_s_per_rad)};
}

/// Largest factor s in [0, 1] of a force that keeps an account of energy E >= 0 over the next interval T, whatever the port
/// does in it, with a damping b that the port is known to have.
///
///     min over Δx of  b|Δx|²/T + s f·Δx  =  -T s²|f|²/(4b)   >= -E        s² = 4 E / (T Σ f_i²/b_i)
///
/// Source: Kim, Ryu, Int. J. Robotics Research 29(6), 2010; this is the form for several axes with the least conservative bound.
template <int N>
double energy_bounding_scale(const Force<N>& f, Energy e, const typename Force<N>::Vector& inverse_damping,
                             Seconds dt) noexcept {
  const double most = 4.0 * std::max(0.0, e.si()), needed = dt.si() * f.vec().cwiseAbs2().dot(inverse_damping);
  return needed <= most ? 1.0 : std::sqrt(most / needed);
}

/// The energy bounding algorithm at the hand.
///
///     E(k)  = E(k-1) + b|Δx|²/T + f_applied(k-1)·Δx,    E(0) = initial_energy_j
///     f     = s f_d,   s = energy_bounding_scale(f_d, E(k))
///
/// An axis without damping takes no force.
template <int N>
class EnergyBoundingMaster final : public Copyable<EnergyBoundingMaster<N>, MasterPassivity<N>> {
 public:
  explicit EnergyBoundingMaster(const ControlOptions& o) : initial_{o.initial_energy}, energy_{o.initial_energy} {
    const BoundingDamping b = bounding_damping(o);
    damping_ = per_axis_damping(b);
    for (int i = 0; i < N; ++i) inverse_[i] = damping_[i] > 0.0 ? 1.0 / damping_[i] : 0.0;
  }

  Shown<N> limit(const Wish<N>& wish, const MasterInput<N>& in) noexcept override {
    if (!in.first) {
      const auto& moved = in.interval.moved.vec();
      energy_ += Energy{moved.cwiseAbs2().dot(damping_) / in.ended.si()};
    }
    energy_ += in.account.net() - net_before_;
    net_before_ = in.account.net();
    Shown<N> out;
    out.energy_in = in.account.absorbed() - base_absorbed_;
    out.undissipated = positive_part(-energy_);
    if (wish.idle) return out;
    const Force<N> wanted = wish.total();
    Force<N> f = wanted;
    if constexpr (N == 6) {
      if (damping_[0] == 0.0)
        f = Force<N>{(typename Force<N>::Vector() << Eigen::Vector3d::Zero(), f.vec().template tail<3>()).finished()};
      if (damping_[3] == 0.0)
        f = Force<N>{(typename Force<N>::Vector() << f.vec().template head<3>(), Eigen::Vector3d::Zero()).finished()};
    } else {
      if (damping_[0] == 0.0) f = Force<N>{};
    }
    out.f = energy_bounding_scale(f, energy_, inverse_, in.dt) * f;
    out.share = share_of(out.f, wanted);
    out.dissipated = positive_part(dot(out.f - wanted, in.device.v) * in.dt);
    return out;
  }
  [[nodiscard]] Energy balance(const Ledger&, Energy) const noexcept override { return energy_ - initial_; }
  void restart(const Ledger& account, Energy balance) noexcept override {
    base_absorbed_ = account.absorbed();
    net_before_ = account.net();
    energy_ = initial_ + put_in_by_hand(balance, account);
  }

 private:
  using Vector = typename Force<N>::Vector;
  static Vector per_axis_damping(const BoundingDamping& b) {
    Vector v = Vector::Constant(b.translation_n_s_per_m);
    if constexpr (N == 6) v.template tail<3>().setConstant(b.rotation_n_m_s_per_rad);
    return v;
  }

  Vector damping_, inverse_ = Vector::Zero();
  Energy initial_, energy_, net_before_, base_absorbed_;
};

}  // namespace twoport
