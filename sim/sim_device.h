#pragma once

#include <cmath>
#include <limits>
#include <optional>

#include "common/hardware/device.h"
#include "common/passivity/observer.h"
#include "common/scene/scene.h"
#include "sim/integrators.h"
#include "sim/linear.h"
#include "sim/path.h"

namespace twoport::sim {

/// The norm that `max_force_n` bounds: the translational force.
template <int N>
double force_norm(const Force<N>& f) {
  if constexpr (N == 6) {
    return f.vec().template head<3>().norm();
  } else {
    return f.vec().norm();
  }
}

/// A hand on a haptic device, behind the device seam.
///
///     (m_d + m_h) ẍ = -f - b_d ẋ + k_h (x_h - x) + b_h (ẋ_h - ẋ) - f_c ẋ/|ẋ|
///
/// f is held over the tick; the intended motion x_h is linear within it; the step is the exact solution, with a stop
/// by Coulomb friction resolved inside it. N = 6 rotates like a sphere (isotropic inertia), in rotation-vector
/// coordinates local to the tick. Blocks that the scene does not name cost nothing and are ideal: no hand impedance, the
/// path is imposed; no operator, nobody holds; neither device nor operator, the handle rests.
template <int N>
class SimDevice final : public Device<N> {
 public:
  /// `dt` is the control period; the handle starts where the device block says.
  SimDevice(const Scene& scene, Seconds dt)
      : dt_{dt.si()},
        simulation_{scene.simulation},
        as_written_{simulation_.integrator != Integrator::exact &&
                    simulation_.integrator != Integrator::exact_per_tick},
        path_{scene.human ? scene.human->path : std::vector<SegmentSpec>{}, intent(scene),
              scene.human && scene.human->tremor ? Tremor<N>{*scene.human->tremor, scene.seed} : Tremor<N>{}} {
    x_ = start(scene);
    const HandSpec none{};
    const HandSpec& hand = scene.human && scene.human->hand ? *scene.human->hand : none;
    const DeviceSpec* device = scene.device ? &*scene.device : nullptr;
    imposed_ = scene.human && !scene.human->hand;
    held_by_hand_ = scene.human && scene.human->hand;
    const double mass = hand.mass_kg + (device ? device->mass_kg : 0.0);
    free_ = !imposed_ && mass > 0.0;
    if (device) {
      v_ = vector<N>(device->velocity_m_per_s);
      coulomb_n_ = device->coulomb_friction_n;
      resolution_ = device->position_resolution_m;
      max_force_n_ = device->max_force_n.value_or(std::numeric_limits<double>::infinity());
      estimate_ = device->velocity_estimate;
      filter_ = -std::expm1(-2.0 * std::numbers::pi * device->velocity_filter_hz * dt_);
    }
    if (imposed_) v_ = path_.at(0.0).v.vec();

    hand_k_.setConstant(hand.stiffness_n_per_m);
    hand_b_.setConstant(hand.damping_n_s_per_m);
    axis_ = {mass, hand.damping_n_s_per_m + (device ? device->damping_n_s_per_m : 0.0), hand.stiffness_n_per_m};
    if (free_) fill<0, kAxes>(axis_);
    if constexpr (N == 6) {
      hand_k_.template tail<3>().setConstant(hand.rotational_stiffness_n_m_per_rad);
      hand_b_.template tail<3>().setConstant(hand.rotational_damping_n_m_s_per_rad);
      if (free_)
        fill<3, 3>({hand.inertia_kg_m2 + (device ? device->inertia_kg_m2 : 0.0),
                    hand.rotational_damping_n_m_s_per_rad + (device ? device->rotational_damping_n_m_s_per_rad : 0.0),
                    hand.rotational_stiffness_n_m_per_rad});
    }
    intended_ = path_.at(0.0).x;
    ideal_ = resolution_ == 0.0 && estimate_ == VelocityEstimate::true_velocity;
    sensed_x_ = quantised(x_);
    sensed_v_ = Velocity<N>{v_};
  }

  /// Moves the world on by one control period, under the force held since the last actuate.
  [[gnu::always_inline]] void advance() noexcept {
    applied_ = held_;
    ++tick_;
    if (imposed_) {
      const auto s = path_.at(static_cast<double>(tick_) * dt_);
      book({s.x - x_, Velocity<N>{v_}, s.v});
      x_ = s.x;
      v_ = s.v.vec();
    } else if (free_) {
      step();
    }
    if (!ideal_) estimate();
  }

  DeviceState<N> sense() noexcept override {
    return ideal_ ? DeviceState<N>{x_, Velocity<N>{v_}, applied_} : DeviceState<N>{sensed_x_, sensed_v_, applied_};
  }

  void actuate(const Force<N>& f) noexcept override {
    held_ = f;
    if (max_force_n_ < std::numeric_limits<double>::infinity()) limit();
  }
  void release() noexcept override { held_ = Force<N>{}; }

  /// The truth, which no encoder shows: position, velocity, the force held now, and the energy that has gone into the
  /// master port since the start, E(0) not included.
  [[nodiscard]] const Position<N>& x() const { return x_; }
  [[nodiscard]] Velocity<N> v() const { return Velocity<N>{v_}; }
  [[nodiscard]] const Force<N>& held() const { return held_; }
  [[nodiscard]] Energy port_energy() const { return energy_; }
  [[nodiscard]] const Path<N>& path() const { return path_; }

 private:
  using Vector = Eigen::Matrix<double, N, 1>;
  static constexpr int kAxes = N == 6 ? 3 : N;
  static constexpr int kStops = 3;  ///< by friction, within one tick

  static Position<N> start(const Scene& scene) {
    return scene.device ? position<N>(scene.device->position_m) : Position<N>{};
  }
  /// Where the intended motion begins: where the handle does; a hand without a path holds the origin.
  static Position<N> intent(const Scene& scene) {
    const bool waits = scene.human && scene.human->hand && scene.human->path.empty();
    return waits ? Position<N>{} : start(scene);
  }

  template <int From, int Count>
  void fill(const Oscillator& o) {
    inverse_mass_.template segment<Count>(From).setConstant(1.0 / o.mass_kg);
    damping_.template segment<Count>(From).setConstant(o.damping_n_s_per_m);
    stiffness_.template segment<Count>(From).setConstant(o.stiffness_n_per_m);
    const Response r = simulation_.integrator == Integrator::trapezoidal ? trapezoidal(o, dt_ / simulation_.substeps)
                                                                         : Response{o, dt_};
    xv_.template segment<Count>(From).setConstant(r.xv);
    xu_.template segment<Count>(From).setConstant(r.xu);
    xw_.template segment<Count>(From).setConstant(r.xw);
    vv_.template segment<Count>(From).setConstant(r.vv);
    vu_.template segment<Count>(From).setConstant(r.vu);
    vw_.template segment<Count>(From).setConstant(r.vw);
  }

  [[gnu::always_inline]] void step() noexcept {
    // In displacement from where the tick begins: u(s) = u + w s.
    Vector u = -held_.vec(), w = Vector::Zero();
    if (held_by_hand_) {
      const Position<N> next = path_.at(static_cast<double>(tick_) * dt_).x;
      const Vector rate = (next - intended_).vec() / dt_;
      const Vector stretch = (intended_ - x_).vec();
      u += hand_k_.cwiseProduct(stretch) + hand_b_.cwiseProduct(rate);
      w = hand_k_.cwiseProduct(rate);
      if constexpr (N == 6) {
        // r = log(R_h Rᵀ) turns as it grows: ṙ = ω_h - ω - ½ r×(ω_h + ω) + (1/12) r×(r×(ω_h - ω)).
        const Eigen::Vector3d r = stretch.template tail<3>(), w_h = rate.template tail<3>(),
                              w_d = v_.template tail<3>();
        w.template tail<3>() -= hand_k_[3] * r.cross(0.5 * (w_h + w_d) - r.cross(w_h - w_d) / 12.0);
      }
      intended_ = next;
    }
    Vector moved = xv_.cwiseProduct(v_) + xu_.cwiseProduct(u) + xw_.cwiseProduct(w);
    Vector v = vv_.cwiseProduct(v_) + vu_.cwiseProduct(u) + vw_.cwiseProduct(w);
    if (as_written_) {
      stepped(u, w, moved, v);
    } else if (coulomb_n_ != 0.0) {
      rub(u, w, moved, v);
    }
    if constexpr (N == 6) {
      // From ∫ω dt to the rotation vector of the interval.
      const Eigen::Vector3d w0 = v_.template tail<3>(), w1 = v.template tail<3>();
      moved.template tail<3>() -= dt_ * dt_ / 12.0 * w0.cross(w1);
    }
    const Position<N> before = x_;
    x_ = x_ + Displacement<N>{moved};
    // As an observer sees it to the last bit; for a pose to rounding, its logarithm being dear.
    Interval<N> interval{N == 6 ? Displacement<N>{moved} : x_ - before, Velocity<N>{v_}, Velocity<N>{v}};
    v_ = v;
    book(interval);
  }
  /// Energy into the master port under the force that was held.
  void book(const Interval<N>& interval) noexcept {
    energy_ += held_energy(ObserverRule::exact, held_, interval, Seconds{dt_});
  }

  /// The step by an integrator as it is usually written; Coulomb friction explicit, smooth below kStictionSpeed.
  [[gnu::noinline]] void stepped(const Vector& u, const Vector& w, Vector& moved, Vector& v) const noexcept {
    const double h = dt_ / simulation_.substeps;
    const auto pushed = [&](double t, const Vector& speed) {
      Vector load = u + t * w;
      if (coulomb_n_ > 0.0) {
        const Axes s = speed.template head<kAxes>();
        load.template head<kAxes>() -= coulomb_n_ / std::max(s.norm(), kStictionSpeed) * s;
      }
      return load;
    };
    const auto a = [&](double t, const Vector& q, const Vector& speed) -> Vector {
      return inverse_mass_.cwiseProduct(pushed(t, speed) - damping_.cwiseProduct(speed) - stiffness_.cwiseProduct(q));
    };
    moved.setZero();
    v = v_;
    for (int i = 0; i < simulation_.substeps; ++i) {
      if (simulation_.integrator != Integrator::trapezoidal) {
        step_by(simulation_.integrator, h, i * h, moved, v, a);
        continue;
      }
      const Vector load = pushed(i * h, v) - stiffness_.cwiseProduct(moved);
      moved += xv_.cwiseProduct(v) + xu_.cwiseProduct(load) + xw_.cwiseProduct(w);
      v = vv_.cwiseProduct(v) + vu_.cwiseProduct(load) + vw_.cwiseProduct(w);
    }
  }

  /// The translation's step with Coulomb friction: slide against the velocity until it stops along its
  /// direction, then stick if the other forces allow, else slide on.
  [[gnu::noinline]] void rub(const Vector& u, const Vector& w, Vector& moved, Vector& v) noexcept {
    moved.template head<kAxes>().setZero();
    v.template head<kAxes>() = v_.template head<kAxes>();
    double done = 0.0;
    for (int part = 0; done < dt_; ++part) {
      const double h = dt_ - done;
      const Axes load = (u + done * w - hand_k_.cwiseProduct(moved)).template head<kAxes>();
      const Axes velocity = v.template head<kAxes>();
      Axes direction = velocity;
      if (velocity.squaredNorm() < 1e-24) {
        if (load.norm() <= coulomb_n_) {
          v.template head<kAxes>().setZero();
          return;
        }
        direction = load;
      }
      direction.normalize();
      const Axes pushed = load - coulomb_n_ * direction;
      const Axes slope = w.template head<kAxes>();
      // Motion along the direction of sliding ends where its velocity crosses zero.
      const AxisState along =
          propagate(axis_, {0, direction.dot(velocity)}, direction.dot(pushed), direction.dot(slope), h);
      double until = h;
      const bool stops = part < kStops && along.v < 0.0 && direction.dot(velocity) > 0.0;
      if (stops) {
        double lo = 0.0, hi = h;
        for (int i = 0; i < 50; ++i) {
          until = 0.5 * (lo + hi);
          const double vel =
              propagate(axis_, {0, direction.dot(velocity)}, direction.dot(pushed), direction.dot(slope), until).v;
          (vel > 0.0 ? lo : hi) = until;
        }
      }
      for (int i = 0; i < kAxes; ++i) {
        const AxisState s = propagate(axis_, {0, velocity[i]}, pushed[i], slope[i], until);
        moved[i] += s.x;
        v[i] = s.v;
      }
      if (stops) v.template head<kAxes>() -= direction.dot(v.template head<kAxes>()) * direction;
      if (v.template head<kAxes>().squaredNorm() < 1e-24) v.template head<kAxes>().setZero();
      done += until;
    }
  }

  [[gnu::noinline]] void limit() noexcept {
    const double norm = force_norm(held_);
    if (!(norm <= max_force_n_)) held_ = (max_force_n_ / norm) * held_;
  }

  Position<N> quantised(const Position<N>& x) const noexcept {
    if (resolution_ == 0.0) return x;
    const typename Displacement<N>::Vector c = coordinates(x);
    return Position<N>{} + Displacement<N>{((c / resolution_).array().round() * resolution_).matrix()};
  }

  [[gnu::noinline]] void estimate() noexcept {
    const Position<N> x = quantised(x_);
    if (estimate_ == VelocityEstimate::true_velocity) {
      sensed_v_ = Velocity<N>{v_};
    } else {
      const Velocity<N> difference = (x - sensed_x_) / Seconds{dt_};
      const double share = estimate_ == VelocityEstimate::filtered ? filter_ : 1.0;
      sensed_v_ = estimate_ == VelocityEstimate::filtered ? sensed_v_ + share * (difference - sensed_v_) : difference;
    }
    sensed_x_ = x;
  }

  using Axes = Eigen::Matrix<double, kAxes, 1>;
  double dt_;
  SimulationSpec simulation_;
  bool as_written_;
  Path<N> path_;
  bool imposed_ = false, held_by_hand_ = false, free_ = false;
  bool ideal_ = true;  ///< sensors show the truth
  Oscillator axis_{};
  Vector inverse_mass_, damping_, stiffness_, hand_k_, hand_b_, xv_, xu_, xw_, vv_, vu_, vw_;
  double coulomb_n_ = 0.0, resolution_ = 0.0, max_force_n_ = std::numeric_limits<double>::infinity(), filter_ = 1.0;
  VelocityEstimate estimate_ = VelocityEstimate::true_velocity;

  Position<N> x_;
  Vector v_ = Vector::Zero();
  Force<N> applied_, held_;
  Position<N> intended_, sensed_x_;
  Velocity<N> sensed_v_;
  Energy energy_;
  std::int64_t tick_ = 0;
};

}  // namespace twoport::sim
