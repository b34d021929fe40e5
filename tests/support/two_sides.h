#pragma once

#include <utility>

#include "lab/engine/both_nodes.h"
#include "sim/sim_device.h"
#include "sim/sim_robot.h"

namespace twoport::test {

/// Both nodes of a scene over a link, with simulated hardware, for tests that look into them or put another network between them.
template <int N, class Network = lab::DelayLines<N>>
struct TwoSides : lab::BothNodes<N, Network> {
  using Nodes = lab::BothNodes<N, Network>;

  template <class... OfNetwork>
  explicit TwoSides(const Scene& scene, OfNetwork&&... of_network)
      : Nodes{scene, std::forward<OfNetwork>(of_network)...},
        device{scene, this->master_dt},
        robot{scene, this->slave_dt} {}

  /// A side's tick at `now`; its first is at 0. Where both are due, the slave's comes first.
  auto slave_tick(Duration now) noexcept {
    if (now > Duration{0}) robot.advance();
    return Nodes::slave_tick(robot, {now});
  }
  auto master_tick(Duration now) noexcept { return master_tick(device, now); }
  /// The same with another device before the simulated one.
  auto master_tick(auto& before, Duration now) noexcept {
    if (now > Duration{0}) device.advance();
    return Nodes::master_tick(before, {now});
  }

  sim::SimDevice<N> device;
  sim::SimRobot<N> robot;
};

}  // namespace twoport::test
