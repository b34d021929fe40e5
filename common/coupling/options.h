#pragma once

#include <cstdint>

#include "common/base/scalar.h"
#include "common/passivity/controller.h"
#include "common/passivity/observer.h"

namespace twoport {

enum class Architecture : std::uint8_t {
  render,                   ///< no link: the device against the environment directly
  position_force,           ///< the slave's coupling force comes back
  position_measured_force,  ///< the force sensor's force comes back
  position_position,        ///< each side's spring-damper pulls towards the other's position
  uncontrolled,             ///< no controller: the robot alone in its environment
};

enum class Accounts : std::uint8_t { total, normal_tangential, per_contact, translation_rotation };

/// Spring-damper of the virtual coupling, per translational and rotational axis.
struct CouplingOptions {
  double stiffness_n_per_m = 1000.0, damping_n_s_per_m = 20.0;
  double rotational_stiffness_n_m_per_rad = 10.0, rotational_damping_n_m_s_per_rad = 0.2;
  double catch_up_m_per_s = 0.05;
  bool drift_compensation = true;
};

struct ControlOptions {
  Architecture architecture = Architecture::position_force;
  CouplingOptions coupling;
  double force_scale = 1.0, motion_scale = 1.0;
  ControllerOptions controller;
  ObserverRule observer = ObserverRule::exact;
  Accounts accounts = Accounts::total;
  bool reference_energy = false;
  Energy initial_energy;
  double handle_mass_kg = 0.0, handle_inertia_kg_m2 = 0.0;  ///< apparent, at the master; 0: not known
  Seconds engage, hold_after, release_after;
};

}  // namespace twoport
