#pragma once

#include <algorithm>

#include "common/base/scalar.h"
#include "common/base/vector.h"

namespace twoport {

/// What a handle will do in the coming interval.
template <int N>
struct Foreseen {
  using Vector = typename Force<N>::Vector;
  Vector compliance = Vector::Zero();    ///< of the mean velocity to the force, T/(2m) per axis [m/(N s)]
  Velocity<N> w{};                       ///< mean velocity were there no force
  double doubt = 0.0, spin_doubt = 0.0;  ///< how wrong w may be, in whatever direction [m/s], [rad/s]

  /// Largest power that f may do through the error of w [W].
  [[nodiscard]] double doubted(const Force<N>& f) const noexcept {
    if constexpr (N == 6) {
      return f.vec().template head<3>().norm() * doubt + f.vec().template tail<3>().norm() * spin_doubt;
    } else {
      return f.vec().norm() * doubt;
    }
  }
};

/// Foresees the handle's motion under a held force from positions and the forces that were really applied; velocity
/// estimates lag and are not asked.
///
///     u(k+1) = u(k) + d - C (f(k-1) + f(k))         u: mean velocity of interval k; d: what the hand adds in an interval
///     u, d  += g e, h e                             e: measured less foreseen mean velocity
///     w      = u(k) + d - C f(k-1)                  mean velocity of the coming interval were there no force
///     doubt  = max(|e|, 0.95 doubt)                 translation and rotation each
///
/// C = T/(2m) per axis, exact for a mass under held forces; g = 1 - θ², h = (1 - θ)² is the fading-memory (alpha-beta)
/// filter, which averages an encoder's counts over a few ticks and loses nothing of the answer to the force, as that is
/// fed forward.
template <int N>
class Handle {
 public:
  using Vector = typename Force<N>::Vector;

  Handle(double mass_kg, double inertia_kg_m2) {
    mobility_.setConstant(1.0 / mass_kg);
    if constexpr (N == 6) mobility_.template tail<3>().setConstant(1.0 / inertia_kg_m2);
  }

  /// `moved` since the last step, `ended` ago, while `applied` was held.
  [[gnu::always_inline]] void step(const Displacement<N>& moved, const Force<N>& applied, Seconds ended,
                                   Seconds dt) noexcept {
    if (ended.si() > 1.5 * dt.si()) [[unlikely]]
      return bridge(moved, applied, ended.si() / dt.si(), dt);
    const Vector c = 0.5 * dt.si() * mobility_;
    const Vector expected = u_ + d_ - c.cwiseProduct(applied_ + applied.vec());
    const Vector e = moved.vec() / dt.si() - expected;
    u_ = expected + kGain * e;
    d_ += kRateGain * e;
    foresee(c, e, applied.vec());
  }
  [[nodiscard]] const Foreseen<N>& foreseen() const noexcept { return foreseen_; }

 private:
  [[gnu::always_inline]] void foresee(const Vector& c, const Vector& e, const Vector& applied) noexcept {
    applied_ = applied;
    foreseen_.compliance = c;
    foreseen_.w = Velocity<N>{u_ + d_ - c.cwiseProduct(applied_)};
    foreseen_.doubt = std::max(e.template head<kAxes>().norm(), kMemory * foreseen_.doubt);
    if constexpr (N == 6) foreseen_.spin_doubt = std::max(e.template tail<3>().norm(), kMemory * foreseen_.spin_doubt);
  }

  /// The same over n intervals at once: what is measured is their mean, and each has changed the velocity by
  /// d - 2 C f(k); believed as it is.
  [[gnu::noinline]] void bridge(Displacement<N> moved, Force<N> applied, double n, Seconds dt) noexcept {
    const Vector c = 0.5 * dt.si() * mobility_;
    const Vector half = 0.5 * (n - 1.0) * (d_ - 2.0 * c.cwiseProduct(applied.vec()));
    const Vector expected = u_ + d_ - c.cwiseProduct(applied_ + applied.vec()) + half;
    const Vector mean = moved.vec() / (n * dt.si());
    u_ = mean + half;
    foresee(c, mean - expected, applied.vec());
  }

  static constexpr int kAxes = N == 6 ? 3 : N;
  static constexpr double kTheta = 0.5, kGain = 1.0 - kTheta * kTheta, kRateGain = (1.0 - kTheta) * (1.0 - kTheta);
  static constexpr double kMemory = 0.95;

  Vector mobility_, u_ = Vector::Zero(), d_ = Vector::Zero(), applied_ = Vector::Zero();
  Foreseen<N> foreseen_{};
};

}  // namespace twoport
