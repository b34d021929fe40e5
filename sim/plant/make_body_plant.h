#pragma once

#include <cstddef>
#include <memory>
#include <utility>

#include "sim/plant/body.h"
#include "sim/plant/body_plant.h"
#include "sim/plant/dormand_prince.h"
#include "sim/plant/integrators.h"
#include "sim/plant/rigid_contact.h"

namespace twoport::sim {

/// A body under a held force in an environment by a textbook integrator in equal steps; contacts are
/// detected at steps only. N = 6 steps momenta and attitude: symplectic Euler and Verlet as kick and drift.
template <int N>
class FixedStepPlant final : public BodyPlant<N> {
 public:
  FixedStepPlant(const RobotSpec& robot, std::shared_ptr<const Environment<N>> environment, double dt,
                 const BodyState<N>& start, const SimulationSpec& simulation,
                 std::size_t few = BroadPhase<kAxes<N>>::kFew)
      : body_{robot, std::move(environment), few},
        method_{simulation.integrator},
        substeps_{simulation.substeps},
        h_{dt / simulation.substeps},
        s_{start} {}

  [[nodiscard]] std::unique_ptr<BodyPlant<N>> copy() const override { return std::make_unique<FixedStepPlant>(*this); }
  BodyState<N> advance(const Force<N>& force) noexcept override {
    const Vector f = port_vector<N>(force.vec());
    if constexpr (N == 6) {
      Motion m = body_.motion(s_);
      for (int i = 0; i < substeps_; ++i) m = step(m, f);
      s_ = {m.at.x, Velocity<N>{body_.velocity(m)}};
    } else {
      Vector q = s_.x.translation(), v = s_.v.vec();
      const auto a = [&](double, const Vector& at, const Vector& speed) {
        return body_.slope_among({Position<N>{at}, speed}, f, nullptr).p;
      };
      for (int i = 0; i < substeps_; ++i) step_by(method_, h_, 0.0, q, v, a);
      s_ = {Position<N>{q}, Velocity<N>{v}};
    }
    return s_;
  }
  [[nodiscard]] Force<N> environment_force() const noexcept override {
    return Force<N>{body_.environment_force(s_.x, port_vector<N>(s_.v.vec()))};
  }

  void kick(const Velocity<N>& dv) noexcept override { s_.v += dv; }

 private:
  using Motion = typename Body<N>::Motion;
  using Vector = typename Body<N>::Vector;

  Motion step(const Motion& m, const Vector& f) const noexcept requires(N == 6) {
    const auto slope = [&](const Motion& at) { return body_.slope_among(at, f, nullptr); };
    const auto drift = [&](const Motion& at) {
      const Vector v = body_.velocity(at);
      return Motion{at.at.x.moved(h_ * v.linear, h_ * v.angular), at.p};
    };
    if (method_ == Integrator::rk4) return body_.runge_kutta(m, slope(m), f, nullptr, h_);
    const double kick = method_ == Integrator::symplectic_euler ? h_ : 0.5 * h_;
    Motion next = drift({m.at, m.p + kick * slope(m).p});
    if (method_ == Integrator::velocity_verlet) next.p += kick * slope(next).p;
    return next;
  }

  Body<N> body_;
  Integrator method_;
  int substeps_;
  double h_;
  BodyState<N> s_;
};

template <int N>
std::unique_ptr<BodyPlant<N>> make_body_plant(const RobotSpec& robot,
                                              const std::shared_ptr<const Environment<N>>& environment, double dt,
                                              const BodyState<N>& start, const SimulationSpec& simulation,
                                              std::size_t few) {
  if (simulation.integrator == Integrator::exact)
    return std::make_unique<RungeKuttaPlant<N>>(robot, environment, dt, start, few);
  if (simulation.integrator == Integrator::dormand_prince)
    return std::make_unique<DormandPrincePlant<N>>(robot, environment, dt, start, simulation.tolerance_m, few);
  return std::make_unique<FixedStepPlant<N>>(robot, environment, dt, start, simulation, few);
}

}  // namespace twoport::sim
