#include "common/scene/blocks.h"

namespace twoport {

static_assert(same_number(Integrator::exact, schema::Simulation::EXACT) &&
              same_number(Integrator::exact_per_tick, schema::Simulation::EXACT_PER_TICK) &&
              same_number(Integrator::symplectic_euler, schema::Simulation::SYMPLECTIC_EULER) &&
              same_number(Integrator::trapezoidal, schema::Simulation::TRAPEZOIDAL) &&
              same_number(Integrator::velocity_verlet, schema::Simulation::VELOCITY_VERLET) &&
              same_number(Integrator::rk4, schema::Simulation::RK4) &&
              same_number(Integrator::dormand_prince, schema::Simulation::DORMAND_PRINCE) &&
              same_number(Integrator::dormand_prince, schema::Simulation::Integrator_MAX));

SimulationSpec read_simulation(const Block<schema::Simulation>& of) {
  return {static_cast<Integrator>(of->integrator()), of->substeps(), of->tolerance_m()};
}

}  // namespace twoport
