#pragma once

#include <algorithm>
#include <cmath>
#include <string_view>

#include "common/method/coupling_slave.h"

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
  explicit FractalSpring(const ControlOptions& o) {
    const FractalImpedanceGains gains = fractal_impedance_gains(o);
    stiffness_ = per_axis<N>(gains.stiffness_n_per_m, gains.rotational_stiffness_n_m_per_rad);
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
class FractalImpedanceMaster {
 public:
  explicit FractalImpedanceMaster(const ControlOptions& o) : registration_{o}, tracker_{o.coupling}, spring_{o} {}

  void start(const DeviceSample<N>& device) noexcept {
    robot_ = device.x;
    hears_ = false;
    spring_.start();
  }
  MasterOutput<N> step(const MasterInput<N>& in) noexcept {
    MasterOutput<N> out{};
    out.energy_in = in.account.absorbed() - base_absorbed_;
    RobotInMasterWorld<N> robot;
    if (!in.active || !read(in.slave.words, robot)) return out;
    if (!hears_) robot_ = robot.x.value;
    hears_ = true;
    const Velocity<N> v_rx = registration_.to_master(in.slave.newest.v);
    robot_ = robot_ + tracker_.step(robot_, robot.x.value, v_rx, in.slave.is_new, in.dt) * in.dt;
    out.wanted = in.ramp * spring_.step(in.device.x - robot_);
    out.f = out.wanted;
    return out;
  }
  [[nodiscard]] Energy deficit(const Ledger&, Energy) const noexcept { return Energy{}; }
  void restart(const Ledger& account, Energy) noexcept { base_absorbed_ = account.absorbed(); }
  static constexpr bool has_payload() noexcept { return false; }
  void write_payload(Words&) const noexcept {}

 private:
  Registration<N> registration_;
  SetpointTracker<N> tracker_;
  FractalSpring<N> spring_;
  Energy base_absorbed_;
  Position<N> robot_;  ///< as last heard, in the master's world
  bool hears_ = false;
};

/// Slave half: the fractal spring to the master's position as last heard.
template <int N>
class FractalImpedanceSlave : public CouplingSlave<N> {
 public:
  explicit FractalImpedanceSlave(const ControlOptions& o)
      : CouplingSlave<N>{coupled_by_position(o, o.coupling)}, spring_{o} {}

  void start(const RobotSample<N>& robot, const PeerState<N>& master) noexcept {
    CouplingSlave<N>::start(robot, master);
    spring_.start();
  }
  SlaveOutput<N> step(const SlaveInput<N>& in) noexcept {
    const auto wanted = this->want(in);
    if (in.robot.ideal || !in.active) return this->act(in, wanted.f, wanted.v, wanted.v);
    const Position<N> set_point = this->coupling_.set_point() + wanted.v * in.dt;
    return this->act(in, spring_.step(set_point - in.robot.x), wanted.v, wanted.v);
  }

 private:
  FractalSpring<N> spring_;
};

struct FractalImpedance {
  static constexpr std::string_view kNames[] = {"FRACTAL_IMPEDANCE"};
  static constexpr bool kKeepsAccount = false;
  static constexpr std::string_view kSummary =
      "springs that give back less than they take, without a damper; no account of energy";
  template <int N>
  using Master = FractalImpedanceMaster<N>;
  template <int N>
  using Slave = FractalImpedanceSlave<N>;
};

}  // namespace twoport
