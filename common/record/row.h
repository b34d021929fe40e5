#pragma once

#include "common/base/vector.h"
#include "common/coupling/layers.h"
#include "common/link/report.h"

namespace twoport {

/// Of a row with ports of joints.
template <int N>
struct ObjectRow {};
template <>
struct ObjectRow<kJointPort> {
  Eigen::Vector3d x = Eigen::Vector3d::Zero();  ///< the scene's object [m]; zero where there is none, and live
};

/// One tick of the master: a row of trace.csv, and the input of the summary.
/// In a live run the other side's values are those of the newest report.
template <int N>
struct Row {
  double t_s = 0.0;
  Position<N> master_x{};
  Velocity<N> master_v{};
  Force<N> master_f{};         ///< at the master port until the next tick, power f·v into the network
  Force<N> master_f_wanted{};  ///< before passivity control
  Position<N> slave_x{};
  Velocity<N> slave_v{};
  Force<N> slave_f{};                ///< coupling force on the robot
  Force<N> env_f{};                  ///< force of the environment on the robot; under RENDER on the device
  Displacement<N> position_error{};  ///< robot minus the delayed, scaled master
  double master_energy_j = 0.0;      ///< exact energy through the master port so far, E(0) not included
  double slave_energy_j = 0.0;       ///< net energy that has left the link at the slave
  double observed_energy_j = 0.0;    ///< master_energy_j as observed by the master's controller
  double undissipated_j = 0.0;       ///< deficit that the master's controller has not dissipated yet
  double dissipated_j = 0.0;         ///< by both controllers, in this tick
  Mode mode = Mode::idle;
  [[no_unique_address]] ObjectRow<N> object{};
  LayerFigures figures{};  ///< of kLayerFigures, as the master's transparency layer has them

  // For the summary only, not in trace.csv.
  Force<N> reference{};  ///< force that should be felt: the environment's, in the master's units and axes, delayed
                         ///< as on the way back to the master; sign as master_f
  double coupling_energy_j =
      0.0;                  ///< energy put into the virtual coupling through both its ports so far, slave's units [J]
  Displacement<N> ahead{};  ///< scaled hand minus robot, undelayed in the laboratory; translation only
  bool touching = false;    ///< the robot (device under RENDER) touches the environment
  bool coupled = false;     ///< both sides are coupled
  bool following = false;   ///< the slave is coupled, so position_error is defined
};

}  // namespace twoport
