#pragma once

#include "common/base/vector.h"
#include "common/link/report.h"

namespace twoport {

/// One master tick as it is recorded: a row of trace.csv, and what the summary is made of.
/// A live side fills the other's columns with the newest report it has.
template <int N>
struct Row {
  double t_s = 0.0;
  Position<N> master_x{};
  Velocity<N> master_v{};
  Force<N> master_f{};         ///< at the master port from now on, power f·v into the network
  Force<N> master_f_wanted{};  ///< before passivity control
  Position<N> slave_x{};
  Velocity<N> slave_v{};
  Force<N> slave_f{};                ///< coupling force on the robot
  Force<N> env_f{};                  ///< force of the environment on the robot; under RENDER on the device
  Displacement<N> position_error{};  ///< robot against the delayed, scaled master
  double master_energy_j = 0.0;      ///< exact energy through the master port so far, E(0) not included
  double slave_energy_j = 0.0;       ///< net energy that has left the link at the slave
  double observed_energy_j = 0.0;    ///< what the master's observer believes of the first
  double undissipated_j = 0.0;       ///< what the master's controller could not yet dissipate
  double dissipated_j = 0.0;         ///< by both controllers, in this tick
  Mode mode = Mode::idle;

  // Of the summary only, no columns.
  Force<N> reference{};  ///< what of the environment should be felt: its force in the master's units and axes,
                         ///< as old as the way back makes it; sign as master_f
  double coupling_energy_j =
      0.0;                  ///< put into the robot's coupling through both its ports so far, in the slave's units
  Displacement<N> ahead{};  ///< the scaled hand against the robot; translation only
  bool touching = false;    ///< robot (device under RENDER) and environment
  bool coupled = false;     ///< both sides
  bool following = false;   ///< the slave is coupled: position_error is of now
};

}  // namespace twoport
