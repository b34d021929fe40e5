#pragma once

#include <algorithm>
#include <cmath>

#include "common/base/vector.h"
#include "common/coupling/options.h"
#include "common/link/report.h"

namespace twoport {

/// Maps between the master's and the slave's world: lengths times s_x, forces times s_f, axes turned by R, and the origin
/// of the motion set when a coupling begins.
///
///     x_s = s_x R x_m + p      v_s = s_x R v_m      f_m = s_f Rᵀ f_s
///     q_s = R q_m c            ω_s = R ω_m          τ_m = (s_f / s_x) Rᵀ τ_s       a torque is a force times a length
///     E_m = (s_f / s_x) E_s                         one number for all axes
///
/// R is given by the scene. p and c (an attitude offset of the tool) are computed at engagement so that the robot does
/// not move, or given by the scene if the registration is absolute.
///
/// The nodes translate what arrives, so that a method's half sees the other side in its own world. The words of a method are in the
/// master's world on the wire, as only the slave knows p: its half translates those.
template <int N>
class Registration {
 public:
  explicit Registration(const ControlOptions& o)
      : force_{o.force_scale},
        motion_{o.motion_scale},
        torque_{force_ / motion_},
        energy_to_slave_{motion_ / force_},
        absolute_{o.registration.absolute} {
    if constexpr (kTurns) {
      rotation_ = o.registration.rotation.normalized();
      matrix_ = rotation_.toRotationMatrix();
      rotated_ = !matrix_.isIdentity(0.0);
    }
    if (absolute_)
      origin_.template head<std::min(kAxes<N>, 3)>() = o.registration.position_m.template head<std::min(kAxes<N>, 3)>();
    shifted_ = !origin_.isZero(0.0);
  }

  /// A coupling begins with the master at `master` and the robot at `slave`. True: `to_slave(master)` is now `slave`.
  void engage(const Position<N>& master, const Position<N>& slave) noexcept {
    if (absolute_) return;
    origin_.setZero();
    if constexpr (N == 6) {
      const Eigen::Quaterniond turned = rotation_ * master.attitude();
      tool_ = turned.coeffs() == slave.attitude().coeffs() ? Eigen::Quaterniond::Identity()
                                                           : (turned.conjugate() * slave.attitude()).normalized();
    }
    origin_ = slave.translation() - motion_ * along(master.translation());
    shifted_ = !origin_.isZero(0.0);
    if constexpr (N == 6) shifted_ = shifted_ || tool_.vec() != Eigen::Vector3d::Zero();
  }

  Position<N> to_slave(const Position<N>& x) const noexcept {
    if (rotated_ || shifted_) [[unlikely]]
      return placed(x);
    if constexpr (N == 6) {
      return {motion_ * x.translation(), x.attitude()};
    } else {
      return Position<N>{motion_ * x.translation()};
    }
  }
  Position<N> to_master(const Position<N>& x) const noexcept {
    if constexpr (N == 6) {
      if (rotated_ || shifted_)
        return {back(x.translation() - origin_) / motion_, rotation_.conjugate() * x.attitude() * tool_.conjugate()};
      return {x.translation() / motion_, x.attitude()};
    } else {
      if (rotated_ || shifted_) return Position<N>{back(x.translation() - origin_) / motion_};
      return Position<N>{x.translation() / motion_};
    }
  }
  /// What the master says.
  [[nodiscard]] PortReport<N> to_slave(PortReport<N> r) const noexcept {
    r.x = to_slave(r.x), r.v = to_slave(r.v), r.f = to_slave(r.f);
    r.energy_in_j = to_slave(Energy{r.energy_in_j}).si(), r.energy_net_j = to_slave(Energy{r.energy_net_j}).si();
    return r;
  }
  /// What the slave says, but for its positions.
  [[nodiscard]] PortReport<N> to_master(PortReport<N> r) const noexcept {
    r.v = to_master(r.v), r.f = to_master(r.f), r.f_coupling = to_master(r.f_coupling);
    r.f_environment = to_master(r.f_environment);
    r.energy_in_j = to_master(Energy{r.energy_in_j}).si(), r.energy_net_j = to_master(Energy{r.energy_net_j}).si();
    return r;
  }
  Velocity<N> to_slave(const Velocity<N>& v) const noexcept { return Velocity<N>{turned(v.vec(), motion_, 1.0)}; }
  Velocity<N> to_master(const Velocity<N>& v) const noexcept {
    return Velocity<N>{turned_back(v.vec(), 1.0 / motion_, 1.0)};
  }
  Force<N> to_slave(const Force<N>& f) const noexcept { return Force<N>{turned(f.vec(), 1.0 / force_, 1.0 / torque_)}; }
  Force<N> to_master(const Force<N>& f) const noexcept { return Force<N>{turned_back(f.vec(), force_, torque_)}; }
  [[nodiscard]] Energy to_slave(Energy e) const noexcept { return energy_to_slave_ * e; }
  [[nodiscard]] Energy to_master(Energy e) const noexcept { return torque_ * e; }
  /// A wave, whose square is a power, or its integral.
  template <class Wave>
  [[nodiscard]] Wave wave_to_slave(const Wave& u) const noexcept {
    return Wave{turned(u.vec(), std::sqrt(energy_to_slave_), std::sqrt(energy_to_slave_))};
  }
  template <class Wave>
  [[nodiscard]] Wave wave_to_master(const Wave& u) const noexcept {
    return Wave{turned_back(u.vec(), std::sqrt(torque_), std::sqrt(torque_))};
  }

 private:
  static constexpr bool kTurns = N == 3 || N == 6;
  using Vector = typename Force<N>::Vector;
  using Point = Eigen::Matrix<double, kAxes<N>, 1>;

  [[nodiscard]] Vector turned(const Vector& v, double linear, double angular) const noexcept {
    Vector out = scaled(v, linear, angular);
    if (rotated_) [[unlikely]]
      turn(out, matrix_);
    return out;
  }
  [[nodiscard]] Vector turned_back(const Vector& v, double linear, double angular) const noexcept {
    Vector out = scaled(v, linear, angular);
    if (rotated_) [[unlikely]]
      turn(out, matrix_.transpose());
    return out;
  }
  static Vector scaled(const Vector& v, double translation, double rotation) noexcept {
    if constexpr (N == 6) {
      const SpatialVector h = halves(v);
      return whole({translation * h.linear, rotation * h.angular});
    } else {
      (void)rotation;
      return translation * v;
    }
  }
  template <class Matrix>
  static void turn(Vector& v, const Matrix& r) noexcept {
    if constexpr (N == 6) {
      const Eigen::Vector3d linear = r * v.template head<3>(), angular = r * v.template tail<3>();
      v << linear, angular;
    } else if constexpr (N == 3) {
      v = (r * v).eval();
    } else {
      (void)v, (void)r;
    }
  }
  [[nodiscard]] Point along(const Point& p) const noexcept {
    if constexpr (kTurns) {
      return matrix_ * p;
    } else {
      return p;
    }
  }
  [[nodiscard]] Point back(const Point& p) const noexcept {
    if constexpr (kTurns) {
      return matrix_.transpose() * p;
    } else {
      return p;
    }
  }
  Position<N> placed(Position<N> x) const noexcept {
    const Point p = motion_ * along(x.translation()) + origin_;
    if constexpr (N == 6) {
      return {p, rotation_ * x.attitude() * tool_};
    } else {
      return Position<N>{p};
    }
  }

  double force_, motion_;
  double torque_;  ///< s_f / s_x, an energy's too
  double energy_to_slave_;
  bool absolute_, rotated_ = false, shifted_ = false;
  Eigen::Quaterniond rotation_ = Eigen::Quaterniond::Identity(), tool_ = Eigen::Quaterniond::Identity();
  Eigen::Matrix3d matrix_ = Eigen::Matrix3d::Identity();
  Point origin_ = Point::Zero();
};

}  // namespace twoport
