#pragma once

#include <cstdint>
#include <utility>

#include "common/base/time.h"
#include "common/link/delay_line.h"
#include "common/link/mailbox.h"
#include "common/link/sim_transport.h"
#include "common/method/alternatives.h"
#include "common/recording/tick.h"
#include "common/runtime/cycle.h"
#include "common/runtime/modes.h"
#include "common/scene/scene.h"
#include "common/wire/header.h"
#include "master/master_node.h"
#include "slave/slave_node.h"

namespace twoport::lab {

using twoport::SimTransport;

/// The mailbox of a side of a scene, at this end of its link.
template <int N, class Transport>
Mailbox<N, Transport> mailbox_of(Side side, const Scene& s, Transport transport) {
  const bool master = side == Side::master;
  return Mailbox<N, Transport>{std::move(transport), age_of_reports(s.control),
                               master ? s.transmission_to_master : s.transmission_to_slave,
                               master ? s.transmission_to_slave : s.transmission_to_master};
}

/// The network of a scene in memory: reports as values.
template <int N>
struct DelayLines {
  using Transport = TappedTransport<N, SimTransport<N>>;

  explicit DelayLines(const Scene& s)
      : to_slave{s.to_slave, s.seed ^ kToSlaveStream, room(s, s.to_slave, s.master_rate_hz)},
        to_master{s.to_master, s.seed ^ kToMasterStream, room(s, s.to_master, s.slave_rate_hz)} {}

  Transport master_end() { return {to_master, to_slave}; }
  Transport slave_end() { return {to_slave, to_master}; }
  void keep_as_it_is() noexcept { to_slave.keep_as_it_is(), to_master.keep_as_it_is(); }
  [[nodiscard]] std::uint64_t overflowed() const { return to_slave.overflowed() + to_master.overflowed(); }

  DelayLine<Report<N>> to_slave, to_master;

 private:
  /// Of a line. A small one stays in the cache: half is enough where no packet waits for a tick, is duplicated or has a delay of its own.
  static std::size_t room(const Scene& s, const ImpairmentOptions& way, double rate_hz) {
    const bool together = s.master_rate_hz == s.slave_rate_hz && s.slave_clock.drift == 0.0;
    const std::size_t all = packets_in_flight(way, rate_hz);
    return together && way.duplicate == 0.0 && way.jitter_s == 0.0 ? all / 2 : all;
  }
};

/// When a side ticks.
struct TickAt {
  Duration now{0};    ///< by the master's clock
  Duration ahead{0};  ///< the side's own clock against it
};

/// When both sides tick, each at its own rate, from 0: the slave first where both are due, so that after the master's tick both are seen
/// at the same moment.
class TickOrder {
 public:
  explicit TickOrder(const Scene& s)
      : master_times_{s.master_rate_hz},
        true_slave_rate_hz_{s.slave_rate_hz * (1.0 + s.slave_clock.drift)},
        slave_times_{true_slave_rate_hz_},
        slave_times_by_itself_{s.slave_rate_hz},
        slave_offset_{to_duration(s.slave_clock.offset_s)} {}

  /// Calls slave(TickAt) and master(TickAt) for every tick before `end`, or until master() returns false. Returns the number of the
  /// master's.
  template <class Slave, class Master>
  std::uint64_t run(Duration end, Slave slave, Master master) {
    std::int64_t from = master_ticks_, m = from, s = slave_ticks_;
    Duration next_m = master_times_[m], next_s = slave_times_[s];
    while (next_m < end) {
      if (next_s <= next_m) {
        slave(TickAt{next_s, slave_ahead(s)});
        next_s = slave_times_[++s];
        continue;
      }
      const TickAt at{next_m};
      next_m = master_times_[++m];
      if (!master(at)) break;
    }
    master_ticks_ = m;
    slave_ticks_ = s;
    return static_cast<std::uint64_t>(m - from);
  }

  /// By the master's clock.
  [[nodiscard]] Seconds slave_period() const noexcept { return Seconds{1.0 / true_slave_rate_hz_}; }
  /// Of the master, done.
  [[nodiscard]] std::int64_t ticks() const noexcept { return master_ticks_; }
  /// Of the slave's clock, at its next tick.
  [[nodiscard]] Duration slave_ahead() const noexcept { return slave_ahead(slave_ticks_); }

 private:
  [[nodiscard]] Duration slave_ahead(std::int64_t k) const noexcept {
    return slave_offset_ + slave_times_by_itself_[k] - slave_times_[k];
  }

  TickTimes master_times_;
  double true_slave_rate_hz_;  ///< by the master's clock
  TickTimes slave_times_, slave_times_by_itself_;
  Duration slave_offset_;
  std::int64_t master_ticks_ = 0, slave_ticks_ = 0;
};

/// Both nodes of a scene, their mailboxes and the network between them; the hardware is the caller's. Network has a Transport, and
/// makes that of each end: master_end(), slave_end(). Copies are independent where those of the network are.
template <int N, class Network = DelayLines<N>, class Method = AnyMethod>
class BothNodes {
 public:
  using Transport = typename Network::Transport;

  /// `of_network`: what the network is made of; the scene alone where nothing is given.
  template <class... OfNetwork>
  explicit BothNodes(const Scene& s, OfNetwork&&... of_network)
      : network{std::forward<OfNetwork>(of_network)...},
        master_dt{1.0 / s.master_rate_hz},
        slave_dt{1.0 / s.slave_rate_hz},
        master{s.control, s.schedule},
        slave{s.control, s.schedule},
        master_mail{mailbox_of<N>(Side::master, s, network.master_end())},
        slave_mail{mailbox_of<N>(Side::slave, s, network.slave_end())},
        switch_times{s.schedule} {}
  explicit BothNodes(const Scene& s) : BothNodes{s, s} {}
  BothNodes(const BothNodes& other)
      : network{other.network},
        master_dt{other.master_dt},
        slave_dt{other.slave_dt},
        master{other.master},
        slave{other.slave},
        master_mail{other.master_mail},
        slave_mail{other.slave_mail},
        switch_times{other.switch_times} {
    master_mail.transport() = network.master_end();
    slave_mail.transport() = network.slave_end();
  }
  BothNodes& operator=(const BothNodes&) = delete;

  /// A side's tick; `tap`, where one is given, sees it.
  auto slave_tick(auto& robot, TickAt at, auto... tap) noexcept {
    if constexpr (requires { slave_mail.transport().set_clock_ahead(at.ahead); })
      slave_mail.transport().set_clock_ahead(at.ahead);
    const Tick<SlaveClock> tick{Instant<SlaveClock>{at.now + at.ahead}, slave_dt};
    return cycle(slave, robot, slave_mail, tick, tap...);
  }
  /// What the schedule says comes before it.
  auto master_tick(auto& device, TickAt at, auto... tap) noexcept {
    if (switch_times.any()) [[unlikely]]
      while (switch_times.due(to_seconds(at.now).si(), master.epoch())) master.switch_to_next();
    const Tick<MasterClock> tick{Instant<MasterClock>{at.now}, master_dt};
    return cycle(master, device, master_mail, tick, tap...);
  }

  Network network;
  Seconds master_dt, slave_dt;
  MasterNode<N, typename Method::template Master<N>> master;
  SlaveNode<N, typename Method::template Slave<N>> slave;
  Mailbox<N, Transport> master_mail, slave_mail;
  SwitchTimes switch_times;

 private:
  static auto cycle(auto& node, auto& hardware, auto& mail, const auto& tick, auto... tap) noexcept {
    if constexpr (sizeof...(tap) > 0) {
      return tapped_cycle(tap..., node, hardware, mail, tick);
    } else {
      return run_cycle(node, hardware, mail, tick);
    }
  }
};

}  // namespace twoport::lab
