#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "common/base/time.h"
#include "common/base/vector.h"
#include "common/link/sensor_rest.h"

namespace twoport {

/// Takes away what a robot's force sensor reads while nothing is pressed, when the operator asks for it:
///
///     f = f_s - R z        z -> mean of R^T f_s over kWindow, within kRamp        R the tool's attitude (N = 6)
///
/// A reading does not tell a press from a drift. So a window counts only where the robot hardly moves, the coupling presses no harder than
/// kForce, both halves read the same to kForce, and no more than kMostForce would be taken away. A steady press of a robot that nothing
/// drives looks like a drift.
template <int N>
class SensorZero {
 public:
  static constexpr double kWindow_s = 0.5, kRamp_s = 0.2;
  static constexpr double kMoved_m = 25e-3, kTurned_rad = 0.1;
  static constexpr double kForce_n = 0.3, kTorque_n_m = 0.03;
  static constexpr double kMostForce_n = 10.0, kMostTorque_n_m = 1.0;

  explicit SensorZero(bool has_sensor = true) : can_{has_sensor && N != kJointPort} {}

  /// The sensor is zeroed, or that refused, when a window from now on has passed.
  void ask() noexcept {
    if (rest_.asked) return;
    if (!can_) {
      rest_.answer = N == kJointPort ? ZeroAnswer::joints : ZeroAnswer::no_sensor;
      ++rest_.answered;
      return;
    }
    rest_.asked = true;
    window_ = {};
  }
  [[nodiscard]] const SensorRest& rest() const noexcept { return rest_; }

  /// The reading f_s of a robot at x, `dt` after the one before, under the force `coupling`. `fresh`: a new reading, which may be judged.
  Force<N> step(const Force<N>& reading, const Position<N>& x, const Force<N>& coupling, Seconds dt,
                bool fresh) noexcept {
    if (!can_) return reading;
    if (fresh) {
      watch(reading, x, coupling, dt.si());
    } else {
      window_ = {};
    }
    if (left_s_ > 0.0) [[unlikely]] {
      taken_ += std::min(1.0, dt.si() / left_s_) * (zero_ - taken_);
      left_s_ -= dt.si();
      is_zeroed_ = true;
    }
    if (!is_zeroed_) [[likely]]
      return reading;
    return Force<N>{reading.vec() - turned(taken_, x, false)};
  }

 private:
  using Vector = typename Force<N>::Vector;
  struct Half {
    Vector sum = Vector::Zero();
    int readings = 0;
    [[nodiscard]] Vector mean() const noexcept { return sum / std::max(readings, 1); }
  };
  struct Window {
    double s = 0.0;
    std::array<Half, 2> half{};
    Position<N> from;                                                              ///< where it began
    double moved_m = 0.0, turned_rad = 0.0, coupling_n = 0.0, coupling_n_m = 0.0;  ///< largest
  };

  /// Into the tool's axes, or out of them.
  static Vector turned(const Vector& f, const Position<N>& x, bool into) noexcept {
    if constexpr (N == 6) {
      const Eigen::Quaterniond q = into ? x.attitude().conjugate() : x.attitude();
      Vector out;
      out << q * Eigen::Vector3d{f.template head<3>()}, q * Eigen::Vector3d{f.template tail<3>()};
      return out;
    } else {
      static_cast<void>(x), static_cast<void>(into);
      return f;
    }
  }
  static double force_of(const Vector& f) noexcept { return f.template head<kAxes<N>>().norm(); }
  static double torque_of(const Vector& f) noexcept { return N == 6 ? f.template tail<N - kAxes<N>>().norm() : 0.0; }

  void watch(const Force<N>& reading, const Position<N>& x, const Force<N>& coupling, double dt) noexcept {
    Window& w = window_;
    if (w.half[0].readings == 0) w.from = x;
    const Vector moved = (x - w.from).vec();
    w.moved_m = std::max(w.moved_m, force_of(moved)), w.turned_rad = std::max(w.turned_rad, torque_of(moved));
    w.coupling_n = std::max(w.coupling_n, force_of(coupling.vec()));
    w.coupling_n_m = std::max(w.coupling_n_m, torque_of(coupling.vec()));
    Half& half = w.half[w.s < 0.5 * kWindow_s ? 0 : 1];
    half.sum += turned(reading.vec(), x, true);
    ++half.readings;
    w.s += dt;
    if (w.s >= kWindow_s) [[unlikely]]
      judge();
  }
  void judge() noexcept {
    const Window w = window_;
    window_ = {};
    const Vector change = w.half[1].mean() - w.half[0].mean(), mean = 0.5 * (w.half[0].mean() + w.half[1].mean());
    const Vector drift = mean - zero_;
    ZeroAnswer answer = ZeroAnswer::zeroed;
    if (w.moved_m > kMoved_m || w.turned_rad > kTurned_rad) {
      answer = ZeroAnswer::moves;
    } else if (w.coupling_n > kForce_n || w.coupling_n_m > kTorque_n_m) {
      answer = ZeroAnswer::presses;
    } else if (force_of(change) > kForce_n || torque_of(change) > kTorque_n_m || w.half[1].readings == 0) {
      answer = ZeroAnswer::changes;
    } else if (force_of(drift) > kMostForce_n || torque_of(drift) > kMostTorque_n_m) {
      answer = ZeroAnswer::too_large;
    }
    if (answer == ZeroAnswer::zeroed) rest_.drift_n = force_of(drift);
    if (!rest_.asked) return;
    rest_.asked = false;
    rest_.answer = answer;
    ++rest_.answered;
    if (answer != ZeroAnswer::zeroed) return;
    ++rest_.zeroed;
    rest_.taken_n = rest_.drift_n, rest_.drift_n = 0.0;
    zero_ = mean;
    left_s_ = kRamp_s;
  }

  bool can_, is_zeroed_ = false;
  SensorRest rest_;
  Window window_;
  Vector zero_ = Vector::Zero(),
         taken_ = Vector::Zero();  ///< z, and what of it is taken away by now; in the tool's axes
  double left_s_ = 0.0;            ///< of the ramp
};

}  // namespace twoport
