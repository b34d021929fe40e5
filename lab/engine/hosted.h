#pragma once

#include <memory>
#include <string>
#include <variant>

#include "common/hardware/virtual_robot.h"
#include "common/scene/scene.h"
#include "lab/engine/simulation.h"

namespace twoport::lab {

/// The robot of every run, with its world, in place of the scene's robot and environment.
struct HostedRobot {
  template <int N>
  using Of = std::shared_ptr<const VirtualRobot<N>>;

  std::string choice;  ///< as --robot has it
  std::variant<Of<1>, Of<3>, Of<6>> robot;
};

/// As make_simulation(scene, taps) with that robot: each run begins with a copy of it. Throws ConfigError, which begins with the choice, for a
/// scene without a link, of another size or with a gripper.
template <int N>
std::unique_ptr<Simulation<N>> make_simulation(const Scene& scene, const HostedRobot& robot, Taps<N>* taps = nullptr);

/// Refuses: no such robot has joints for a port.
template <>
std::unique_ptr<Simulation<kJointPort>> make_simulation(const Scene&, const HostedRobot& robot, Taps<kJointPort>*);
extern template std::unique_ptr<Simulation<1>> make_simulation<1>(const Scene&, const HostedRobot&, Taps<1>*);
extern template std::unique_ptr<Simulation<3>> make_simulation<3>(const Scene&, const HostedRobot&, Taps<3>*);
extern template std::unique_ptr<Simulation<6>> make_simulation<6>(const Scene&, const HostedRobot&, Taps<6>*);

}  // namespace twoport::lab
