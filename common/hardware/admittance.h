#pragma once

#include <algorithm>

#include "common/base/vector.h"
#include "common/hardware/servo.h"

namespace twoport {

/// Mass, inertia and damping in free space of the body between a coupling and a robot that obeys positions only.
struct AdmittanceBody {
  double mass_kg = 2.0, inertia_kg_m2 = 0.02;
  double damping_n_s_per_m = 30.0, rotational_damping_n_m_s_per_rad = 0.3;
};

/// A body that the coupling and the measured force drive. The robot gets its position x as a set point; the coupling sees it in place of
/// the robot, which follows late:
///
///     m v' = f - f_e - d v                     implicit in v;  f: of the coupling, f_e: of the robot on the environment
///     d = d_0;  in contact at least            d_c = K_w (lag + delay + period/2),  K_w = 20 kN/m, and back to d_0 with 0.5 s
///     f_e counts beyond 0.3 N (0.03 N m) only  that of a sensor at rest does not move the robot
///
/// and the rotation by the same law with J and d J/m. The port of the robot in accounts is this body's: f·v. What the robot does
/// beyond it is its own.
template <int N>
class Admittance {
 public:
  explicit Admittance(const Servo& servo, const AdmittanceBody& body = {}) {
    m_.setConstant(body.mass_kg);
    free_.setConstant(body.damping_n_s_per_m);
    if constexpr (N == 6) {
      m_.template tail<3>().setConstant(body.inertia_kg_m2);
      free_.template tail<3>().setConstant(body.rotational_damping_n_m_s_per_rad);
    }
    contact_ = (kWall_n_per_m * servo.behind().si() / body.mass_kg) * m_;
    d_ = free_;
  }

  void rest(const Position<N>& x) noexcept {
    x_ = x;
    v_ = Velocity<N>{};
    d_ = free_;
  }
  /// After the robot has gone its own way: at first damped as in contact, as the coupling may be stretched.
  void resume(const Position<N>& x) noexcept {
    rest(x);
    d_ = contact_;
  }
  void stop() noexcept { v_ = Velocity<N>{}; }
  void step(const Force<N>& f, const Force<N>& on_environment, Seconds dt) noexcept {
    const double h = dt.si();
    Vector felt = on_environment.vec();
    bool touches = beyond(felt.template head<kAxes<N>>(), kSensed_n);
    if constexpr (N == 6) touches = beyond(felt.template tail<3>(), kSensed_n_m) || touches;
    if (!touches) d_ += std::min(1.0, h / kBack_s) * (free_ - d_);
    if (touches) d_ = d_.cwiseMax(contact_);
    const Vector v = (m_.cwiseProduct(v_.vec()) + h * (f.vec() - felt)).cwiseQuotient(m_ + h * d_);
    v_ = Velocity<N>{v};
    x_ = x_ + v_ * dt;
  }
  void kick(const Velocity<N>& dv) noexcept { v_ += dv; }

  [[nodiscard]] const Position<N>& x() const noexcept { return x_; }
  [[nodiscard]] const Velocity<N>& v() const noexcept { return v_; }

 private:
  using Vector = typename Force<N>::Vector;
  static constexpr double kWall_n_per_m = 20e3, kSensed_n = 0.3, kSensed_n_m = 0.03, kBack_s = 0.5;

  /// Shortens a reading by what does not count. True: something is left.
  static bool beyond(auto&& f, double least) noexcept {
    const double norm = f.norm();
    f *= norm > least ? 1.0 - least / norm : 0.0;
    return norm > least;
  }

  Vector m_, free_, contact_, d_;
  Position<N> x_;
  Velocity<N> v_;
};

}  // namespace twoport
