#pragma once

#include <cstdint>
#include <utility>

#include "common/link/delay_line.h"
#include "common/link/mailbox.h"
#include "common/runtime/cycle.h"
#include "common/scene/scene.h"
#include "lab/engine/loops.h"
#include "master/master_node.h"
#include "sim/sim_device.h"
#include "sim/sim_robot.h"
#include "slave/slave_node.h"

namespace twoport::test {

/// Both sides of a scene over a link, in virtual time, as lab::LinkLoop has them, for tests that look into them or put
/// another transport between them.
template <int N, class Transport = lab::SimTransport<N>>
struct TwoSides {
  TwoSides(const Scene& scene, Transport master_link, Transport slave_link)
      : master_dt{1.0 / scene.master_rate_hz},
        slave_dt{1.0 / scene.slave_rate_hz},
        device{scene, master_dt},
        robot{scene, slave_dt},
        master{scene.control, scene.schedule},
        slave{scene.control, scene.schedule},
        master_mail{std::move(master_link), age_of_reports(scene.control), scene.transmission_to_master,
                    scene.transmission_to_slave},
        slave_mail{std::move(slave_link), age_of_reports(scene.control), scene.transmission_to_slave,
                   scene.transmission_to_master} {}

  /// A side's tick at `now`; its first is at 0. Where both are due, the slave's comes first.
  typename SlaveNode<N>::Output slave_tick(Duration now) noexcept {
    if (now > Duration{0}) robot.advance();
    return run_cycle(slave, robot, slave_mail, Tick<SlaveClock>{Instant<SlaveClock>{now}, slave_dt});
  }
  typename MasterNode<N>::Output master_tick(Duration now) noexcept {
    if (now > Duration{0}) device.advance();
    return run_cycle(master, device, master_mail, Tick<MasterClock>{Instant<MasterClock>{now}, master_dt});
  }

  Seconds master_dt, slave_dt;
  sim::SimDevice<N> device;
  sim::SimRobot<N> robot;
  MasterNode<N> master;
  SlaveNode<N> slave;
  Mailbox<N, Transport> master_mail, slave_mail;
};

/// The network of a scene, reports as values.
template <int N>
struct DelayLines {
  explicit DelayLines(const Scene& scene)
      : to_slave{scene.to_slave, scene.seed ^ kToSlaveStream, packets_in_flight(scene.to_slave, scene.master_rate_hz)},
        to_master{scene.to_master, scene.seed ^ kToMasterStream,
                  packets_in_flight(scene.to_master, scene.slave_rate_hz)} {}
  DelayLines(const DelayLines&) = delete;

  lab::SimTransport<N> master_end() { return {to_master, to_slave}; }
  lab::SimTransport<N> slave_end() { return {to_slave, to_master}; }

  DelayLine<Report<N>> to_slave, to_master;
};

}  // namespace twoport::test
