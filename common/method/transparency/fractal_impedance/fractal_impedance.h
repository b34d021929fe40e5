#pragma once

#include <algorithm>
#include <cmath>

#include "common/method/coupled_by_position.h"
#include "common/method/layers.h"

namespace twoport {

/// What is not given: the virtual coupling's stiffness, at most 100 N/m; for rotation the same share of it. The papers give no
/// rule; with hands of 300 and 400 N/m this is stable up to a second of delay each way (README.md), 200 N/m is not.
struct FractalImpedanceGains {
  double stiffness_n_per_m, rotational_stiffness_n_m_per_rad;
};
inline FractalImpedanceGains fractal_impedance_gains(const ControlOptions& o) {
  const CouplingOptions& c = o.coupling;
  const double k = o.fractal_impedance.stiffness_n_per_m.value_or(std::min(c.stiffness_n_per_m, 100.0));
  const double share = c.stiffness_n_per_m > 0.0 ? std::min(1.0, k / c.stiffness_n_per_m) : 1.0;
  return {k, o.fractal_impedance.rotational_stiffness_n_m_per_rad.value_or(share * c.rotational_stiffness_n_m_per_rad)};
}

/// A spring that pulls with K r while its stretch r grows, and towards the middle of the largest stretch while it shrinks.
///
///     growing     F = K r,  r_max = r
///     shrinking   F = 2K (r - r_max/2)             = K r_max at r_max, 0 at the middle, -K r_max at 0
///
/// The energy ½ K r_max² that goes in is not given back: half of it at most on the way to the middle, which is taken back on
/// the way to 0. Along the stretch; translation and rotation each have their own.
/// Source: Babarahmati, Tiseo, Smith, Lin, Erden, Mistry, Nonlinear Dynamics 110, 2022, with a constant K.
template <int N>
class FractalSpring {
 public:
  using Vector = typename Force<N>::Vector;
  /// `scale`: of K; at the master impedance_scale.
  explicit FractalSpring(const ControlOptions& o, const Vector& scale = Vector::Ones()) {
    const FractalImpedanceGains gains = fractal_impedance_gains(o);
    stiffness_ = scale.cwiseProduct(per_axis<N>(gains.stiffness_n_per_m, gains.rotational_stiffness_n_m_per_rad));
  }

  void start() noexcept { translation_ = rotation_ = {}; }
  Force<N> step(const Displacement<N>& stretch) noexcept {
    Vector f = stiffness_.cwiseProduct(stretch.vec());
    if constexpr (N == 6) {
      f.template head<3>() *= translation_.factor(stretch.vec().template head<3>().norm());
      f.template tail<3>() *= rotation_.factor(stretch.vec().template tail<3>().norm());
    } else {
      f *= translation_.factor(stretch.vec().norm());
    }
    return Force<N>{f};
  }

 private:
  struct Phase {
    double before = 0.0, largest = 0.0;

    /// Of K r.
    double factor(double r) noexcept {
      const bool grows = r >= before;
      before = r;
      if (grows) largest = r;
      return grows || r == 0.0 ? 1.0 : 2.0 - largest / r;
    }
  };

  Vector stiffness_;
  Phase translation_, rotation_;
};

/// Master half: the fractal spring to the robot's position as last heard.
template <int N>
class FractalImpedanceMaster final : public Copyable<FractalImpedanceMaster<N>, MasterTransparency<N>> {
 public:
  explicit FractalImpedanceMaster(const ControlOptions& o) : tracker_{o.coupling}, spring_{o, impedance_scale<N>(o)} {}

  void start(const DeviceSample<N>& device) noexcept override {
    robot_ = device.x;
    hears_ = false;
    spring_.start();
  }
  Wish<N> wish(const MasterInput<N>& in) noexcept override {
    RobotInMasterWorld<N> robot;
    if (!in.active || !read(in.slave.words, robot)) return {};
    if (!hears_) robot_ = robot.x.value;
    hears_ = true;
    const Velocity<N> v_rx = in.slave.newest.v;
    robot_ = robot_ + tracker_.step(robot_, robot.x.value, v_rx, in.slave.is_new, in.dt) * in.dt;
    return {.idle = false, .f = in.ramp * spring_.step(in.device.x - robot_)};
  }

 private:
  SetpointTracker<N> tracker_;
  FractalSpring<N> spring_;
  Position<N> robot_;  ///< as last heard, in the master's world
  bool hears_ = false;
};

/// Slave half: the fractal spring to the master's position as last heard.
template <int N>
class FractalImpedanceSlave final : public Copyable<FractalImpedanceSlave<N>, SlaveTransparency<N>> {
 public:
  explicit FractalImpedanceSlave(const ControlOptions& o)
      : Copyable<FractalImpedanceSlave<N>, SlaveTransparency<N>>{coupled_by_position(o, o.coupling)}, spring_{o} {}

  void start(const RobotSample<N>& robot, bool engaged) noexcept override {
    SlaveTransparency<N>::start(robot, engaged);
    spring_.start();
  }
  RobotWish<N> wish(const SlaveInput<N>& in) noexcept override {
    const auto wanted = this->want(in);
    if (in.robot.ideal || !in.active) return {.f = wanted.f, .v = wanted.v};
    const Position<N> set_point = this->coupling_.set_point() + wanted.v * in.dt;
    return {.f = spring_.step(set_point - in.robot.x), .v = wanted.v};
  }

 private:
  FractalSpring<N> spring_;
};

}  // namespace twoport
