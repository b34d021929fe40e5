#pragma once

#include <cstdint>

#include "common/link/delay_line.h"
#include "common/scene/scene.h"
#include "drivers/simulated.h"
#include "lab/engine/both_nodes.h"

namespace twoport::playground {

/// One direction of the network: what the page adds, then the scene's own impairments.
template <int N>
class Direction {
 public:
  Direction(const ImpairmentOptions& of_scene, std::uint64_t seed, double rate_hz, const ImpairmentOptions& most_added)
      : added_{most_added, seed ^ kPageStream, packets_in_flight(most_added, rate_hz)},
        scene_{of_scene, seed, packets_in_flight(of_scene, rate_hz)} {
    added_.adjust(0.0, 0.0, 0.0);
  }
  void adjust(double delay_s, double jitter_s, double loss) noexcept { added_.adjust(delay_s, jitter_s, loss); }
  void put(const auto& report, Duration now) noexcept {
    if (added_.passes()) {
      scene_.put(report, now);
    } else {
      added_.put(report, now);
    }
  }
  const Report<N>* take(Duration now) noexcept {
    while (const Report<N>* report = added_.take(now)) scene_.put(*report, now);
    return scene_.take(now);
  }

 private:
  static constexpr std::uint64_t kPageStream = 0x70616765;
  DelayLine<Report<N>> added_, scene_;
};

/// Hardware for run_cycle, with its last reading kept.
template <class Hardware, class Sample>
struct Sensed {
  Hardware& hardware;
  Sample sample;
  template <class Clock>
  Sample sense(const Tick<Clock>& tick) noexcept {
    return sample = hardware.sense(tick);
  }
  void actuate(const auto& command) noexcept { hardware.actuate(command); }
};

/// The network of the playground.
template <int N>
struct PageNetwork {
  using Transport = SimTransport<N, Direction<N>>;
  /// `most_added`: of the page, to either direction.
  PageNetwork(const Scene& scene, const ImpairmentOptions& most_added)
      : to_slave{scene.to_slave, scene.seed ^ kToSlaveStream, scene.master_rate_hz, most_added},
        to_master{scene.to_master, scene.seed ^ kToMasterStream, scene.slave_rate_hz, most_added} {}
  Transport master_end() { return {to_master, to_slave}; }
  Transport slave_end() { return {to_slave, to_master}; }

  Direction<N> to_slave, to_master;
};

/// Both programs over a link in virtual time: the nodes, each with its hardware as the live programs have it.
template <int N>
class Session : lab::BothNodes<N, PageNetwork<N>> {
 public:
  using Nodes = lab::BothNodes<N, PageNetwork<N>>;
  /// `device` and `robot` must outlive this.
  Session(const Scene& scene, Device<N>& device, Robot<N>& robot, const ImpairmentOptions& most_added)
      : Nodes{scene, scene, most_added}, device_{device, {}}, robot_{robot, {}} {
    device.start();
    robot.start();
  }

  auto master_tick(lab::TickAt at) noexcept { return Nodes::master_tick(device_, at); }
  void slave_tick(lab::TickAt at) noexcept { Nodes::slave_tick(robot_, at); }

  void adjust(bool to_slave, double delay_s, double jitter_s, double loss) noexcept {
    (to_slave ? this->network.to_slave : this->network.to_master).adjust(delay_s, jitter_s, loss);
  }
  using Nodes::master, Nodes::slave;
  [[nodiscard]] const DeviceSample<N>& device() const noexcept { return device_.sample; }
  [[nodiscard]] const PeerState<N>& known() noexcept { return this->master_mail.known(); }
  [[nodiscard]] const PacketCounts& counts() noexcept { return this->master_mail.counts(); }

 private:
  Sensed<Device<N>, DeviceSample<N>> device_;
  Sensed<Robot<N>, RobotSample<N>> robot_;
};

}  // namespace twoport::playground
