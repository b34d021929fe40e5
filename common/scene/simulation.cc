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

namespace {
// Below it is the rounding of positions of a metre, above it a contact is not resolved.
constexpr Rule kTolerance{[](double v) { return v >= 1e-15 && v <= 1e-4; }, "be from 1e-15 to 0.0001"};
}  // namespace

SimulationSpec read_simulation(const Block<schema::Simulation>& of) {
  const int substeps = of.integer(FIELD(substeps));
  if (substeps < 1 || substeps > 10'000) of.refuse(FIELD(substeps), "be 1 to 10000");
  return {of.choice<Integrator>(FIELD(integrator)), substeps, of.number(FIELD(tolerance_m), kTolerance)};
}

}  // namespace twoport
