#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>

#include "common/link/delay_line.h"
#include "common/link/mailbox.h"
#include "common/link/sim_transport.h"
#include "common/runtime/cycle.h"
#include "common/scene/scene.h"
#include "drivers/simulated.h"
#include "master/master_node.h"
#include "slave/slave_node.h"

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

/// Both programs over a link in virtual time: the nodes, each with its hardware as the live programs have it. Each side ticks at its
/// own rate; a report is readable strictly after it was posted.
template <int N>
class Session {
 public:
  /// `most_added`: of the page, to either direction. `device` must outlive this.
  Session(const Scene& scene, Device<N>& device, Robot<N>& robot, const ImpairmentOptions& most_added)
      : device_{device, {}},
        robot_{robot, {}},
        to_slave_{scene.to_slave, scene.seed ^ kToSlaveStream, scene.master_rate_hz, most_added},
        to_master_{scene.to_master, scene.seed ^ kToMasterStream, scene.slave_rate_hz, most_added},
        master_mail_{{to_master_, to_slave_},
                     age_of_reports(scene.control),
                     scene.transmission_to_master,
                     scene.transmission_to_slave},
        slave_mail_{{to_slave_, to_master_},
                    age_of_reports(scene.control),
                    scene.transmission_to_slave,
                    scene.transmission_to_master},
        master_{scene.control, scene.schedule},
        slave_{scene.control, scene.schedule},
        switch_times_{scene.schedule} {
    device.start();
    robot.start();
  }
  Session(const Session&) = delete;

  typename MasterNode<N>::Output master_tick(Duration now, Seconds dt) noexcept {
    while (switch_times_.due(to_seconds(now).si(), master_.epoch())) master_.switch_to_next();
    return run_cycle(master_, device_, master_mail_, Tick<MasterClock>{Instant<MasterClock>{now}, dt});
  }
  /// `now` by the slave's clock, which is `ahead` of the master's.
  void slave_tick(Duration now, Duration ahead, Seconds dt) noexcept {
    slave_mail_.transport().set_clock_ahead(ahead);
    run_cycle(slave_, robot_, slave_mail_, Tick<SlaveClock>{Instant<SlaveClock>{now}, dt});
  }

  void adjust(bool to_slave, double delay_s, double jitter_s, double loss) noexcept {
    (to_slave ? to_slave_ : to_master_).adjust(delay_s, jitter_s, loss);
  }
  [[nodiscard]] MasterNode<N>& master() noexcept { return master_; }
  [[nodiscard]] const SlaveNode<N>& slave() const noexcept { return slave_; }
  [[nodiscard]] const DeviceSample<N>& device() const noexcept { return device_.sample; }
  [[nodiscard]] const PeerState<N>& known() noexcept { return master_mail_.known(); }
  [[nodiscard]] const PacketCounts& counts() noexcept { return master_mail_.counts(); }

 private:
  Sensed<Device<N>, DeviceSample<N>> device_;
  Sensed<Robot<N>, RobotSample<N>> robot_;
  Direction<N> to_slave_, to_master_;
  Mailbox<N, SimTransport<N, Direction<N>>> master_mail_, slave_mail_;
  MasterNode<N> master_;
  SlaveNode<N> slave_;
  SwitchTimes switch_times_;
};

/// When the two sides tick: the slave first where both are due.
class Clocks {
 public:
  explicit Clocks(const Scene& s)
      : master_rate_hz_{s.master_rate_hz},
        slave_rate_hz_{s.slave_rate_hz},
        true_slave_rate_hz_{s.slave_rate_hz * (1.0 + s.slave_clock.drift)},
        slave_offset_{to_duration(s.slave_clock.offset_s)} {}
  [[nodiscard]] Seconds slave_period() const { return Seconds{1.0 / true_slave_rate_hz_}; }

  /// Calls slave(now, ahead, dt) and master(now, dt) for every tick before `end`.
  void run(Duration end, auto slave, auto master) {
    for (Duration next = tick_time(m_, master_rate_hz_); next < end;) {
      if (const Duration at = tick_time(s_, true_slave_rate_hz_); at <= next) {
        const Duration local = slave_offset_ + tick_time(s_, slave_rate_hz_);
        slave(local, local - at, Seconds{1.0 / slave_rate_hz_});
        ++s_;
      } else {
        master(next, Seconds{1.0 / master_rate_hz_});
        next = tick_time(++m_, master_rate_hz_);
      }
    }
  }

 private:
  double master_rate_hz_, slave_rate_hz_, true_slave_rate_hz_;
  Duration slave_offset_;
  std::int64_t m_ = 0, s_ = 0;
};

}  // namespace twoport::playground
