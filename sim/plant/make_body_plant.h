#pragma once

#include <memory>

#include "sim/plant/body_plant.h"
#include "sim/plant/dormand_prince.h"
#include "sim/plant/fixed_step.h"
#include "sim/plant/rigid_contact.h"

namespace twoport::sim {

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
