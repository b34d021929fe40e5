#pragma once

#include <optional>

#include "common/base/built_for.h"
#include "common/base/spatial_vector.h"
#include "common/contact/contact_law.h"
#include "common/passivity/observer.h"
#include "common/scene/scene.h"
#include "sim/plant/integrators.h"

namespace twoport::sim {

/// The handle of a device with the hand's mass, stiffness and damping on it, under a load that is linear in time:
///
///     (m_d + m_h) ẍ = u + w s - (b_d + b_h) ẋ - k_h (x - x(0)) - f_c ẋ/|ẋ|
///
/// The step is the exact solution; Coulomb friction stops and releases the handle at the moment at which it does. N = 6 rotates like a sphere
/// (isotropic inertia), in rotation-vector coordinates local to the tick.
template <int N>
class HandlePlant {
 public:
  using Vector = PortVector<N>;

  /// State between two ticks.
  struct State {
    Position<N> x;
    Vector v;
  };

  HandlePlant(const DeviceSpec& device, const HandSpec& hand, const SimulationSpec& simulation, double dt,
              const State& start)
      : dt_{dt},
        simulation_{simulation},
        fixed_{simulation.integrator != Integrator::exact && simulation.integrator != Integrator::exact_per_tick &&
               simulation.integrator != Integrator::dormand_prince},
        coulomb_n_{device.coulomb_friction_n},
        s_{start} {
    const Oscillator axis{device.mass_kg + hand.mass_kg, device.damping_n_s_per_m + hand.damping_n_s_per_m,
                          hand.stiffness_n_per_m};
    const Oscillator turn{device.inertia_kg_m2 + hand.inertia_kg_m2,
                          device.rotational_damping_n_m_s_per_rad + hand.rotational_damping_n_m_s_per_rad,
                          hand.rotational_stiffness_n_m_per_rad};
    axis_ = axis;
    if (axis.mass_kg > 0.0) fill(axis, &PortScale::linear);
    if (N == 6 && turn.mass_kg > 0.0) fill(turn, &PortScale::angular);
    if constexpr (N == 6) {
      if (device.principal_inertia_kg_m2.empty() && device.principal_rotational_damping_n_m_s_per_rad.empty()) return;
      const auto three = [](const Numbers& given, double for_all) {
        return given.empty() ? Eigen::Vector3d::Constant(for_all).eval() : vector<3>(given);
      };
      principal_.emplace(Principal{
          three(device.principal_inertia_kg_m2, device.inertia_kg_m2).array() + hand.inertia_kg_m2,
          three(device.principal_rotational_damping_n_m_s_per_rad, device.rotational_damping_n_m_s_per_rad).array() +
              hand.rotational_damping_n_m_s_per_rad,
          hand.rotational_stiffness_n_m_per_rad});
    }
  }

  /// Does it have a mass?
  [[nodiscard]] bool moves() const noexcept { return axis_.mass_kg > 0.0; }
  /// One tick under the load u + w s, for one that moves. Returns the motion of the port.
  Interval<N> advance(const Vector& u, const Vector& w) noexcept {
    Vector v0 = s_.v, moved = xv_ * v0 + xu_ * u + xw_ * w, v = vv_ * v0 + vu_ * u + vw_ * w;
    if (fixed_) {
      const Motion m = step_fixed(u, w);
      moved = m.moved, v = m.v;
    } else if (coulomb_n_ != 0.0) {
      const Motion m = step_with_friction(u, w);
      translation(moved) = translation(m.moved), translation(v) = translation(m.v);
    }
    Position<N> before = s_.x;
    if constexpr (N == 6) {
      if (principal_) [[unlikely]]
        return turn_about_principal_axes(moved, v, u.angular, w.angular);
      // From ∫ω dt to the rotation vector of the interval.
      moved.angular -= dt_ * dt_ / 12.0 * v0.angular.cross(v.angular);
      s_ = {before.moved(moved.linear, moved.angular), v};
      // As an observer computes it, except for rounding: the logarithm of a pose is expensive.
      return {Displacement<N>{moved}, Velocity<N>{v0}, Velocity<N>{v}};
    } else {
      s_ = {before + Displacement<N>{moved}, v};
      return {s_.x - before, Velocity<N>{v0}, Velocity<N>{v}};  // as an observer computes it, to the bit
    }
  }

  [[nodiscard]] Velocity<N> velocity() const noexcept { return Velocity<N>{s_.v}; }
  [[nodiscard]] const State& state() const noexcept { return s_; }
  /// Continues from `state`.
  void set_state(const State& state) noexcept { s_ = state; }

 private:
  static constexpr int kParts = 64;       ///< of a tick, between stops and releases by friction, that are told apart
  static constexpr double kRest = 1e-12;  ///< slower is at rest [m/s]
  using Axes = Eigen::Matrix<double, kAxes<N>, 1>;

  void fill(const Oscillator& o, double PortScale::*part) {
    inverse_mass_.*part = 1.0 / o.mass_kg;
    damping_.*part = o.damping_n_s_per_m;
    stiffness_.*part = o.stiffness_n_per_m;
    const Response r = simulation_.integrator == Integrator::trapezoidal ? trapezoidal(o, dt_ / simulation_.substeps)
                                                                         : Response{o, dt_};
    xv_.*part = r.xv, xu_.*part = r.xu, xw_.*part = r.xw;
    vv_.*part = r.vv, vu_.*part = r.vu, vw_.*part = r.vw;
  }

  /// Inertia [kg m²] and damping [N m s/rad] about the handle's axes; stiffness of the hand [N m/rad].
  struct Principal {
    Eigen::Vector3d inertia, damping;
    double stiffness;
  };
  /// The end of a tick in which the translation has been solved, and the rotation of a body with three principal moments is
  /// integrated; N = 6 only.
  Interval<N> turn_about_principal_axes(Vector moved, Vector v, Eigen::Vector3d u, Eigen::Vector3d w) noexcept;

  /// Over one tick: the displacement, and the velocity at its end.
  struct Motion {
    Vector moved, v;
  };
  [[nodiscard]] Motion step_fixed(Vector u, Vector w) const noexcept;
  [[nodiscard]] Motion step_with_friction(Vector load_0, Vector slope_0) const noexcept;
  [[nodiscard]] double release(const Axes& load, const Axes& w) const noexcept;
  [[nodiscard]] bool turns(const Axes& load, const Axes& w, const Axes& direction, double left) const noexcept
      requires(N > 1);
  double slide_straight(const Axes& load, const Axes& w, const Axes& direction, double left, bool may_stop, Axes& moved,
                        Axes& v) const noexcept;
  double slide_turning(const Axes& load, const Axes& w, const Axes& start, double left, Axes& moved,
                       Axes& v) const noexcept requires(N > 1);

  double dt_;
  SimulationSpec simulation_;
  bool fixed_;  ///< by a textbook integrator
  double coulomb_n_;
  Oscillator axis_;  ///< of translation
  PortScale inverse_mass_, damping_, stiffness_, xv_, xu_, xw_, vv_, vu_, vw_;
  std::optional<Principal> principal_;  ///< N = 6: where the three differ
  State s_;
};
template <>
Interval<6> HandlePlant<6>::turn_about_principal_axes(SpatialVector moved, SpatialVector v, Eigen::Vector3d u,
                                                      Eigen::Vector3d w) noexcept;
TWOPORT_DECLARE(HandlePlant);

}  // namespace twoport::sim
