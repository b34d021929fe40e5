#pragma once

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "common/base/scalar.h"
#include "common/base/vector.h"

namespace twoport {

/// F_h: the most by which the hand's own force on the handle, all that acts there but the port's force, is taken to change within
/// two ticks [N]. 10 N in a millisecond is ten times what muscles do.
inline constexpr double kHandForceChange_n = 20.0;

/// F_l: the most by which a hand is taken to push while its push is not known yet [N].
inline constexpr double kHandAgainstLock_n = 50.0;

/// A number for each axis; of joints, which move each other, a matrix.
template <int N>
using AxisMatrix = std::conditional_t<N == kJointPort, Eigen::Matrix<double, N, N>, Eigen::DiagonalMatrix<double, N>>;
template <int N>
AxisMatrix<N> axis_matrix(const Eigen::Matrix<double, N, 1>& axes) noexcept {
  return AxisMatrix<N>{axes.asDiagonal()};
}

/// What is known of a moving port: M⁻¹, and the most that a force of the hand on the tool, 1 N, accelerates it, |M⁻¹ Jᵀ| [1/kg].
template <int N>
struct PortInertia {
  AxisMatrix<N> inverse_mass = axis_matrix<N>(Eigen::Matrix<double, N, 1>::Zero());
  double of_hand = 0.0;
};

/// Predicted motion of a port in the coming interval.
template <int N>
struct VelocityPrediction {
  using Vector = typename Force<N>::Vector;
  /// Of the mean velocity to the force, r² T/(2m) per axis [m/(N s)]; of joints R M⁻¹ R T/2.
  AxisMatrix<N> mobility = axis_matrix<N>(Vector::Zero());
  Velocity<N> w{};                     ///< mean velocity without a force
  double error_bound = 0.0;            ///< norm of the error of w [m/s]
  double rotation_error_bound = 0.0;   ///< of w's rotation, N = 6 [rad/s]
  Vector unforeseen = Vector::Zero();  ///< e(k) - e(k-1)/4 [m/s], [rad/s]
  Vector free = Vector::Zero();        ///< T/(2m) at the hand; of joints the first is T/2 |M⁻¹ Jᵀ|
  /// Largest r of translation and of rotation: a force of the hand moves the port by r T/(2m).
  double ratio = 1.0, rotation_ratio = 1.0;
  Vector opened = Vector::Zero();  ///< error of w where the hand's push is not known yet

  /// Largest power of f due to the error of w [W].
  [[nodiscard]] double power_error_bound(const Force<N>& f) const noexcept {
    return power_of_error(f, error_bound, rotation_error_bound);
  }
  /// No hand within kHandForceChange_n causes a larger error of w [m/s].
  [[nodiscard]] double worst_error() const noexcept {
    return unforeseen.template head<kAxes<N>>().norm() + ratio * free[0] * kHandForceChange_n;
  }
  /// The same for any hand within kHandForceChange_n.
  [[nodiscard]] double worst_power_error(const Force<N>& f) const noexcept {
    double of_rotation = 0.0;
    if constexpr (N == 6)
      of_rotation =
          unforeseen.template tail<3>().norm() + rotation_ratio * std::sqrt(free[0] * free[3]) * kHandForceChange_n;
    return power_of_error(f, std::max(error_bound, worst_error()), std::max(rotation_error_bound, of_rotation));
  }
  /// Least power of a force no larger than f, whatever its direction, but for the error of w [W].
  [[nodiscard]] double least_power(const Force<N>& f) const noexcept {
    return -power_of_error(f, w.vec().template head<kAxes<N>>().norm(), w.vec().template tail<N - kAxes<N>>().norm());
  }

 private:
  [[nodiscard]] double power_of_error(const Force<N>& f, double error,
                                      [[maybe_unused]] double rotation_error) const noexcept {
    const double unknown = f.vec().cwiseAbs().dot(opened);
    if constexpr (N == 6) {
      return unknown + f.vec().template head<3>().norm() * error + f.vec().template tail<3>().norm() * rotation_error;
    } else {
      return unknown + f.vec().norm() * error;
    }
  }
};

/// Predicts the motion of a port under a held force from positions and applied forces. Velocity estimates are not used
/// because they lag.
///
///     u(k+1) = u(k) + d - C (f(k-1) + f(k))         u: mean velocity of interval k; d: change by the hand in an interval
///     u, d  += g e, h e                             e: measured less predicted mean velocity
///     w      = u(k) + d - C f(k-1)                  mean velocity of the coming interval without a force
///     error_bound = max(|e|, 0.95 error_bound)      translation and rotation each
///     worst_error = |e(k) - e(k-1)/4| + C/r F_h     rotation: F_h sqrt(J/m)
///
/// e(k+1) = e(k) - e(k-1)/4 + C (F(k+1) - F(k-1)) with F the hand's own force: exact for a mass under held forces, and the reason
/// why worst_error is a bound for any hand that changes its force by no more than F_h within two ticks.
///
/// After a switch of method (restart) and where an axis opens (r = 0 before) d begins at 0, so e of the second interval from then on
/// is all of d, which no e before tells: for two ticks the error has r T/m F_l more there, F_l the most that a hand is taken to push.
/// In the interval with which an axis opens no force acts on it (ModulatedTransformer): it neither gives nor takes, w = 0 and C = 0.
///
/// C = r² T/(2m) per axis, exact for a mass under held forces; of joints M⁻¹ stands for 1/m (take_inertia), and what M changes in two ticks
/// and what velocities do to each other are forces of the hand; r: the ratio of a transformer between hand and port, 1 without one
/// (take_ratio); g = 1 - θ², h = (1 - θ)² is the fading-memory (alpha-beta)
/// filter, which averages an encoder's counts over a few ticks; the response to the force is fed forward and not
/// filtered.
template <int N>
class PortVelocityPredictor {
 public:
  using Vector = typename Force<N>::Vector;

  PortVelocityPredictor(double mass_kg, double inertia_kg_m2) {
    Vector inverse = Vector::Constant(1.0 / mass_kg);
    if constexpr (N == 6) inverse.template tail<3>().setConstant(1.0 / inertia_kg_m2);
    inertia_ = {axis_matrix<N>(inverse), inverse[0]};
    inverse_at_port_ = inertia_.inverse_mass;
  }

  /// Before step(): the inertia of the interval that ends.
  void take_inertia(const PortInertia<N>& inertia) noexcept {
    inertia_ = inertia;
    set_ratio(ratio_);
  }

  /// Begins anew: nothing is known of the port's motion. `r`: the ratio in the interval that the next step tells.
  void restart(const Vector& r) noexcept {
    u_ = d_ = applied_ = before_ = Vector::Zero();
    prediction_ = {};
    unknown_.setConstant(kUnknownTicks);
    set_ratio(r);
  }
  /// `moved` since the last step, `ended` ago, while `applied` was held.
  void step(const Displacement<N>& moved, const Force<N>& applied, Seconds ended, Seconds dt) noexcept {
    if (ended.si() > 1.5 * dt.si()) [[unlikely]]
      return bridge(moved, applied, ended.si() / dt.si(), dt);
    const AxisMatrix<N> c = inverse_at_port_ * (0.5 * dt.si());
    const Vector expected = u_ + d_ - c * (applied_ + applied.vec());
    const Vector e = moved.vec() / dt.si() - expected;
    u_ = expected + kGain * e;
    d_ += kRateGain * e;
    predict(c, e, e - kRateGain * before_, applied.vec(), dt);
    set_free(dt);
  }
  /// From now on the ratio is r, after step(); v: the port's velocity with it. The hand's motion and its force on the handle go on; an axis
  /// that opens, r = 0 before, moves with v, and takes no force in the coming interval.
  ///
  ///     u, d, e  go with r'/r      f(k-1)  with r/r', as f_h = r f at the hand      C  with r'²
  void take_ratio(const Vector& r, const Velocity<N>& v, Seconds dt) noexcept {
    if (r != ratio_) [[unlikely]]
      change_ratio(r, v, dt);
  }
  [[nodiscard]] const VelocityPrediction<N>& prediction() const noexcept { return prediction_; }

 private:
  void predict(const AxisMatrix<N>& c, const Vector& e, const Vector& unforeseen, const Vector& applied,
               Seconds dt) noexcept {
    applied_ = applied;
    before_ = e;
    if ((unknown_ > 0).any()) [[unlikely]]
      forget_unknown(dt);
    prediction_.mobility = c;
    prediction_.w = Velocity<N>{u_ + d_ - c * applied_};
    prediction_.error_bound = std::max(e.template head<kAxes<N>>().norm(), kMemory * prediction_.error_bound);
    prediction_.unforeseen = unforeseen;
    if constexpr (N == 6)
      prediction_.rotation_error_bound =
          std::max(e.template tail<3>().norm(), kMemory * prediction_.rotation_error_bound);
  }

  void forget_unknown(Seconds dt) noexcept {
    unknown_ = (unknown_ - 1).max(0);
    count_push(dt);
  }
  void count_push(Seconds dt) noexcept {
    for (int i = 0; i < N; ++i)
      prediction_.opened[i] = unknown_[i] > 0 ? ratio_[i] * dt.si() *
                                                    std::sqrt(inertia_.inverse_mass.diagonal()[i] * inertia_.of_hand) *
                                                    kHandAgainstLock_n
                                              : 0.0;
  }
  void set_ratio(const Vector& r) noexcept {
    ratio_ = r;
    if constexpr (N == kJointPort) {
      inverse_at_port_ = r.asDiagonal() * inertia_.inverse_mass * r.asDiagonal();
    } else {
      inverse_at_port_ = axis_matrix<N>(inertia_.inverse_mass.diagonal().cwiseProduct(r.cwiseAbs2()));
    }
    prediction_.ratio = r.template head<kAxes<N>>().maxCoeff();
    if constexpr (N == 6) prediction_.rotation_ratio = r.template tail<3>().maxCoeff();
  }
  void change_ratio(Vector r, Velocity<N> v, Seconds dt) noexcept {
    const auto opens = (ratio_.array() == 0.0 && r.array() != 0.0).eval();
    for (int i = 0; i < N; ++i) {
      const bool was_closed = ratio_[i] == 0.0;
      const double by = was_closed ? 0.0 : r[i] / ratio_[i];
      if (was_closed) unknown_[i] = kUnknownTicks;
      u_[i] = was_closed ? v[i] : by * u_[i];
      d_[i] *= by;
      before_[i] *= by;
      prediction_.unforeseen[i] *= by;
      applied_[i] *= was_closed || r[i] == 0.0 ? 0.0 : ratio_[i] / r[i];
    }
    set_ratio(r);
    count_push(dt);
    prediction_.mobility = inverse_at_port_ * (0.5 * dt.si());
    Vector w = u_ + d_ - prediction_.mobility * applied_;
    for (int i = 0; i < N; ++i) {
      if (!opens[i]) continue;
      w[i] = prediction_.opened[i] = 0.0;
      if constexpr (N == kJointPort) {
        prediction_.mobility.row(i).setZero();
        prediction_.mobility.col(i).setZero();
      } else {
        prediction_.mobility.diagonal()[i] = 0.0;
      }
    }
    prediction_.w = Velocity<N>{w};
  }

  /// The same over n intervals at once: what is measured is their mean, and each has changed the velocity by
  /// d - 2 C f(k). The measured mean is taken without filtering.
  void bridge(Displacement<N> moved, Force<N> applied, double n, Seconds dt) noexcept {
    const AxisMatrix<N> c = inverse_at_port_ * (0.5 * dt.si());
    const Vector half = 0.5 * (n - 1.0) * (d_ - 2.0 * (c * applied.vec()));
    const Vector expected = u_ + d_ - c * (applied_ + applied.vec()) + half;
    const Vector mean = moved.vec() / (n * dt.si());
    u_ = mean + half;
    predict(c, mean - expected, mean - expected, applied.vec(), dt);
    set_free(dt);
  }
  void set_free(Seconds dt) noexcept {
    if constexpr (N == kJointPort) {
      prediction_.free[0] = 0.5 * dt.si() * inertia_.of_hand;
    } else {
      prediction_.free = 0.5 * dt.si() * inertia_.inverse_mass.diagonal();
    }
  }

  static constexpr double kTheta = 0.5, kGain = 1.0 - kTheta * kTheta, kRateGain = (1.0 - kTheta) * (1.0 - kTheta);
  static constexpr double kMemory = 0.95;
  using Ticks = Eigen::Array<int, N, 1>;
  static constexpr int kUnknownTicks = 2;

  Ticks unknown_ = Ticks::Zero();  ///< ticks until d of an axis is known
  PortInertia<N> inertia_;
  Vector ratio_ = Vector::Ones();
  AxisMatrix<N> inverse_at_port_;  ///< r²/m
  Vector u_ = Vector::Zero(), d_ = Vector::Zero(), applied_ = Vector::Zero(), before_ = Vector::Zero();
  VelocityPrediction<N> prediction_{};
};

}  // namespace twoport
