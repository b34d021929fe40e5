#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "common/hardware/device.h"

namespace twoport {

/// What an operator changes while working (docs/guides/at-work.md).
struct HandControls {
  bool clutched = false;     ///< the hand moves alone
  std::uint32_t locked = 0;  ///< bit i: the robot keeps axis i of the master's world
  double motion = 1.0;       ///< of translations, times that of the scene; 0 < motion <= 1
  double force = 1.0;        ///< of all forces, times that of the scene; 0 <= force <= 1

  friend bool operator==(const HandControls&, const HandControls&) = default;
};

/// Clutch (indexing), axis locks and scales: a transformer between hand and network whose ratios r, one for each axis, change. With
/// x_h, f_h motion and force at the hand, x, f at the network's port, and φ <= 1 the scale of force:
///
///     x(k) = x(k-1) + r (x_h(k) - x_h(k-1))      v = r v_h      f_h = r φ f      0 <= r <= 1
///
/// where r goes to `motion` (1 for rotations) at a rate of 1 / engage_s, and to 0 at once on a locked axis and by the clutch. r and φ
/// are constant within a period.
///
/// Energy. f_h·Δx_h = φ f·Δx: of whatever r, power at the hand is that of the port under the force φ f, and a transformer stores
/// nothing. So an account of φ f·Δx is the hand's own, and the bounds of the methods hold at the hand for every course of r. Only the
/// increments of x_h pass: that x and x_h differ by more after the clutch is another origin of the wanted motion, not work. φ <= 1
/// takes force away, as a limit does, and the account books what is left. With r = 0 the port is closed: v = 0 and f_h = 0.
/// There f itself is `applied`, as by a rigid hand, so that a wave returns as from a port that is held. In the first period of an axis that
/// opens f_h = 0: nobody at the port knows its motion yet.
///
/// Re-homing makes the present pose of the hand that of the robot: the hand is free, and the port yields to its force, v = -f / b, until
/// none is left, for 2 s at most. `applied` is 0 there, what the hand gets: as where a limit takes the whole force away, and the
/// account stays the hand's own.
template <int N>
class ModulatedTransformer {
 public:
  /// A number that is not finite or beyond its range leaves that control as it is.
  void set(const HandControls& to) noexcept {
    c_.clutched = to.clutched;
    c_.locked = to.locked;
    if (to.motion > 0.0 && to.motion <= 1.0) c_.motion = to.motion;
    if (to.force >= 0.0 && to.force <= 1.0) c_.force = to.force;
  }
  [[nodiscard]] const HandControls& controls() const noexcept { return c_; }
  void rehome() noexcept { rehome_s_ = kLongestRehoming; }
  [[nodiscard]] bool rehomes() const noexcept { return rehome_s_ > 0.0; }
  /// Is the port closed, by the clutch or while re-homing?
  [[nodiscard]] bool closed() const noexcept { return closed_; }

  /// A reading of the hand becomes one of the port, and so does the hand's true position. `pressed`: the clutch, by a button.
  void step(DeviceSample<N>& s, DeviceTruth<N>& truth, bool pressed, double ended_s, double engage_s) noexcept {
    if (!all_finite(s.x, s.v, s.applied)) return;
    if (!begun_) {
      hand_ = x_ = s.x;
      begun_ = true;
    }
    Vector moved = r_.cwiseProduct((s.x - hand_).vec() + beside_log(hand_v_, s.v.vec(), ended_s));
    hand_v_ = s.v.vec();
    if (yields_) {
      moved = -ended_s * yielding();
      rehome_s_ = at_rest() ? 0.0 : rehome_s_ - ended_s;
    }
    Vector f = s.applied.vec();
    for (int i = 0; i < N; ++i) f[i] = r_[i] > 0.0 ? f[i] / r_[i] : yields_ ? 0.0 : f_[i];

    const double step = ended_s / std::max(engage_s, 1e-9);
    yields_ = rehomes();
    closed_ = pressed || c_.clutched || yields_;
    for (int i = 0; i < N; ++i) {
      const bool stands = closed_ || (c_.locked >> i & 1u) != 0;
      const bool opens = r_[i] == 0.0;
      r_[i] = stands ? 0.0 : r_[i] + std::clamp((i < 3 ? c_.motion : 1.0) - r_[i], -step, step);
      felt_[i] = opens ? 0.0 : r_[i];
    }
    phi_ += std::clamp(c_.force - phi_, -step, step);

    const Vector v = yields_ ? Vector{-yielding()} : Vector{r_.cwiseProduct(s.v.vec())};
    x_ = x_ + Displacement<N>{Vector{moved - beside_log(v_, v, ended_s)}};
    v_ = v;
    const auto here = [&](const Position<N>& p) {
      return x_ + Displacement<N>{Vector{r_.cwiseProduct((p - s.x).vec())}};
    };
    truth.x = here(truth.x);
    truth.v = Velocity<N>{Vector{r_.cwiseProduct(truth.v.vec())}};
    hand_ = s.x;
    s.x = x_;
    s.v = Velocity<N>{v};
    s.ratio = r_;
    s.applied = Force<N>{f};
  }
  /// The force at the hand under the force `f` of the network, which is held until the next step().
  [[nodiscard]] Force<N> to_hand(const Force<N>& f) noexcept {
    f_ = f.vec();
    return Force<N>{Vector{phi_ * felt_.cwiseProduct(f_)}};
  }
  /// Force at the hand over that of the network.
  [[nodiscard]] double felt_share(int axis) const noexcept { return phi_ * felt_[axis]; }
  /// Where the last reading was, without clutch, locks and scales.
  [[nodiscard]] const Position<N>& hand() const noexcept { return hand_; }

 private:
  using Vector = typename Force<N>::Vector;
  static constexpr double kLongestRehoming = 2.0;                      // [s]
  static constexpr double kDamping = 200.0, kRotationalDamping = 2.0;  // [N s/m], [N m s/rad]
  static constexpr double kRest_n = 0.02, kRest_n_m = 0.002;           // no force is left below

  /// ∫ω dt of a period less the rotation vector of its attitudes (held_energy), so that a locked axis takes no work from the others.
  [[nodiscard]] static Vector beside_log([[maybe_unused]] const Vector& v0, [[maybe_unused]] const Vector& v1,
                                         [[maybe_unused]] double dt_s) noexcept {
    Vector out = Vector::Zero();
    if constexpr (N == 6)
      out.template tail<3>() =
          dt_s * dt_s / 12.0 * Eigen::Vector3d{v0.template tail<3>()}.cross(Eigen::Vector3d{v1.template tail<3>()});
    return out;
  }
  [[nodiscard]] Vector yielding() const noexcept {
    Vector v = f_;
    for (int i = 0; i < N; ++i) v[i] /= i < 3 ? kDamping : kRotationalDamping;
    return v;
  }
  [[nodiscard]] bool at_rest() const noexcept {
    for (int i = 0; i < N; ++i)
      if (std::abs(f_[i]) > (i < 3 ? kRest_n : kRest_n_m)) return false;
    return true;
  }

  HandControls c_;
  Vector r_ = Vector::Ones(), felt_ = Vector::Ones(), f_ = Vector::Zero();
  Vector hand_v_ = Vector::Zero(), v_ = Vector::Zero();  ///< of the last reading, at the hand and at the port
  double phi_ = 1.0, rehome_s_ = 0.0;
  bool begun_ = false, closed_ = false, yields_ = false;
  Position<N> hand_, x_;
};

}  // namespace twoport
