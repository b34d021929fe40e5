#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/base/sanitized.h"
#include "common/link/clock_offset.h"
#include "common/link/delay_line.h"
#include "common/link/mailbox.h"
#include "common/link/sim_transport.h"
#include "common/record/angle.h"
#include "common/record/row.h"
#include "common/runtime/cycle.h"
#include "common/scene/scene.h"
#include "lab/engine/simulation.h"
#include "lab/engine/tap.h"
#include "lab/mechanical_energy.h"
#include "master/master_node.h"
#include "master/render_node.h"
#include "sim/sim_device.h"
#include "sim/sim_robot.h"
#include "slave/slave_node.h"

// All of a tick in one function, but not under a sanitizer, where that takes minutes to compile.
#if defined(TWOPORT_ADDRESS_SANITIZER) || defined(TWOPORT_THREAD_SANITIZER)
#define TWOPORT_FLATTEN
#else
#define TWOPORT_FLATTEN [[gnu::flatten]]
#endif

namespace twoport::lab {

using twoport::SimTransport;

/// The environment's force as old as the way back makes it: of the slave's tick from which the newest report comes that the
/// master has. While the master hears nothing it goes on, as old as that report was when it came.
template <int N>
class DelayedForce {
 public:
  /// `gaps`: the slave does not send in every tick; between two reports the force goes on, as old as the last one was when it
  /// came.
  DelayedForce(const ImpairmentOptions& way_back, double rate_hz, bool gaps)
      : past_(std::bit_ceil(packets_in_flight(way_back, rate_hz))),
        mask_{past_.size() - 1},
        lag_{1 + std::lround(way_back.delay_s * rate_hz)} {
    if (gaps) tick_of_.resize(past_.size());
  }

  /// Of the slave's next tick.
  void put(const Force<N>& f) noexcept { past_[index(ticks_++)] = f; }
  /// In a tick of the master.
  void step(const PeerState<N>& slave, bool coupled) noexcept {
    if (slave.is_new) {
      lag_ = std::min(ticks_ + 1 - tick_of(slave.newest.sequence), static_cast<std::int64_t>(mask_ + 1));
    } else if (coupled && tick_of_.empty()) {
      return;
    }
    now_ = ticks_ >= lag_ ? past_[index(ticks_ - lag_)] : Force<N>{};
  }
  [[nodiscard]] const Force<N>& now() const noexcept { return now_; }
  /// After each tick of the slave: its packets so far.
  void note_sent(std::uint64_t sent) noexcept {
    if (!tick_of_.empty()) tick_of_[index(static_cast<std::int64_t>(sent))] = ticks_;
  }

 private:
  /// Number of the tick in which a packet was sent, counted as packets are.
  [[nodiscard]] std::int64_t tick_of(std::uint64_t sequence) const noexcept {
    const auto number = static_cast<std::int64_t>(sequence);
    return tick_of_.empty() ? number : tick_of_[index(number)];
  }
  [[nodiscard]] std::size_t index(std::int64_t k) const noexcept { return static_cast<std::size_t>(k) & mask_; }

  std::vector<Force<N>> past_;
  std::size_t mask_;                   ///< size less one; the size is a power of two
  std::vector<std::int64_t> tick_of_;  ///< of each packet; empty: one in every tick
  std::int64_t ticks_ = 0, lag_;
  Force<N> now_;
};

/// Both directions of a link and the mail of both sides, in memory. Copies are independent, and nobody taps them.
template <int N>
class SimLink {
 public:
  using Transport = TappedTransport<N, SimTransport<N>>;

  explicit SimLink(const Scene& scene)
      : to_slave_{scene.to_slave, scene.seed ^ kToSlaveStream, room(scene, scene.to_slave, scene.master_rate_hz)},
        to_master_{scene.to_master, scene.seed ^ kToMasterStream, room(scene, scene.to_master, scene.slave_rate_hz)},
        master_{{to_master_, to_slave_},
                age_of_reports(scene.control),
                scene.transmission_to_master,
                scene.transmission_to_slave},
        slave_{{to_slave_, to_master_},
               age_of_reports(scene.control),
               scene.transmission_to_slave,
               scene.transmission_to_master} {}
  SimLink(const SimLink& other)
      : to_slave_{other.to_slave_}, to_master_{other.to_master_}, master_{other.master_}, slave_{other.slave_} {
    master_.transport() = Transport{to_master_, to_slave_};
    slave_.transport() = Transport{to_slave_, to_master_};
  }
  SimLink& operator=(const SimLink&) = delete;

  [[nodiscard]] Mailbox<N, Transport>& master() noexcept { return master_; }
  [[nodiscard]] Mailbox<N, Transport>& slave() noexcept { return slave_; }
  void keep_as_it_is() noexcept {
    to_slave_.keep_as_it_is();
    to_master_.keep_as_it_is();
  }
  [[nodiscard]] LinkUse use() const {
    return {master_.counts(), slave_.counts(), to_slave_.overflowed() + to_master_.overflowed()};
  }

 private:
  /// Of a line. A small one stays in the cache: half is enough where no packet waits for a tick, is duplicated or has a delay of its own.
  static std::size_t room(const Scene& scene, const ImpairmentOptions& way, double rate_hz) {
    const bool together = scene.master_rate_hz == scene.slave_rate_hz && scene.slave_clock.drift == 0.0;
    const std::size_t all = packets_in_flight(way, rate_hz);
    return together && way.duplicate == 0.0 && way.jitter_s == 0.0 ? all / 2 : all;
  }

  DelayLine<Report<N>> to_slave_, to_master_;
  Mailbox<N, Transport> master_, slave_;
};

/// The columns of trace.csv after a master tick with the result `out`; `dissipated` by both sides since the last one.
template <int N>
inline Row<N> columns(Duration now, const auto& out, Energy dissipated, const Force<N>& environment_force,
                      const sim::SimDevice<N>& device, const auto& robot, const auto& master,
                      const auto& slave) noexcept {
  return {.t_s = to_seconds(now).si(),
          .master_x = device.x(),
          .master_v = device.v(),
          .master_f = device.held(),
          .master_f_wanted = out.wanted,
          .slave_x = robot.state().x,
          .slave_v = robot.state().v,
          .slave_f = robot.held(),
          .env_f = environment_force,
          .position_error = slave.position_error(),
          .master_energy_j = device.port_energy().si(),
          .slave_energy_j = slave.delivered().si(),
          .observed_energy_j = master.observed().si(),
          .undissipated_j = out.undissipated.si(),
          .dissipated_j = dissipated.si(),
          .mode = out.mode,
          .figures = out.figures};
}

/// A scene over a link, in virtual time: the same nodes and the same cycle as the live programs.
///
/// Each side ticks at its own rate, from 0. A report is readable strictly after it was posted, so the order of two
/// sides that tick together does not matter.
template <int N, class Method = AnyMethod, class Plant = sim::SimRobot<N>>
class LinkLoop {
 public:
  /// `taps`, unless null, see every tick of both nodes; a copy has none. `of_plant`: what it is made of besides the scene.
  explicit LinkLoop(const Scene& scene, Taps<N>* taps = nullptr, const auto&... of_plant)
      : registration_{scene.control},
        master_dt_{1.0 / scene.master_rate_hz},
        slave_dt_{1.0 / scene.slave_rate_hz},
        master_times_{scene.master_rate_hz},
        slave_times_{true_slave_rate_hz(scene)},
        slave_times_by_itself_{scene.slave_rate_hz},
        slave_clock_offset_{to_duration(scene.slave_clock.offset_s)},
        slave_clock_{scene.slave_clock.offset_s != 0.0 || scene.slave_clock.drift != 0.0},
        end_{to_duration(scene.duration_s)},
        device_{scene, master_dt_},
        robot_{scene, Seconds{1.0 / true_slave_rate_hz(scene)}, of_plant...},
        master_{scene.control, scene.schedule},
        slave_{scene.control, scene.schedule},
        link_{scene},
        switch_times_{scene.schedule},
        delayed_force_{with_playout(scene.to_master, scene.transmission_to_master), scene.slave_rate_hz,
                       scene.transmission_to_master.deadband.has_value()},
        held_by_environment_{robot_.environment().holds()},
        initial_energy_{scene.control.initial_energy},
        granted_energy_{initial_energy_ +
                        registration_.to_master(initial_energy_ + mechanical_energy<N>(scene.robot, robot_))} {
    if (taps == nullptr) return;
    taps_ = taps;
    link_.master().transport().tap(&taps->master);
    link_.slave().transport().tap(&taps->slave);
  }

  /// Goes on until `end`, or until `visit(row)` returns false. Returns the number of master ticks.
  template <class Visit>
  TWOPORT_FLATTEN std::uint64_t run(Duration end, Visit visit) {
    std::int64_t from = ticks_, m = from, s = slave_ticks_;
    Duration next_m = master_times_[m], next_s = slave_times_[s];
    while (next_m < end) {
      // The slave first where both are due, so that a row shows both at the same moment.
      if (next_s <= next_m) {
        slave_tick(next_s, s);
        next_s = slave_times_[++s];
        continue;
      }
      const Duration now = next_m;
      auto out = master_tick(now, m);
      next_m = master_times_[++m];
      if (!visit(row(now, out))) break;
    }
    ticks_ = m;
    slave_ticks_ = s;
    return static_cast<std::uint64_t>(m - from);
  }

  void be_quiet() noexcept {
    device_.hold();
    robot_.silence();
    link_.keep_as_it_is();
    switch_times_.end();
  }
  Kicked kick(const Velocity<N>& master, const Velocity<N>& slave) noexcept {
    return {device_.kick(master), robot_.kick(slave)};
  }
  [[nodiscard]] Duration end() const { return end_; }
  [[nodiscard]] std::int64_t ticks() const { return ticks_; }
  [[nodiscard]] Energy initial_energy() const { return initial_energy_; }
  [[nodiscard]] Energy granted_energy() const { return granted_energy_; }
  [[nodiscard]] double quiet_from_s() const { return device_.path().end_s(); }
  [[nodiscard]] std::vector<sim::SegmentTimes> segment_times() const { return device_.path().segment_times(); }
  [[nodiscard]] LinkUse link() const {
    LinkUse use = link_.use();
    use.device_limits = master_.limit_counts();
    use.robot_limits = slave_.limit_counts();
    use.switches = master_.epoch();
    if (slave_clock_ && clock_offset_.known()) {
      const double end_s = to_seconds(end_).si();
      const double ahead_s = to_seconds(slave_time(slave_ticks_) - slave_times_[slave_ticks_]).si();
      use.clock = clock_offset_.figures(end_s);
      use.clock->error_s = use.clock->offset_s - ahead_s;
    }
    return use;
  }

 private:
  /// By the master's clock.
  static double true_slave_rate_hz(const Scene& scene) { return scene.slave_rate_hz * (1.0 + scene.slave_clock.drift); }
  auto master_tick(Duration now, std::int64_t k) noexcept {
    if (k > 0) device_.advance();
    if (switch_times_.any()) [[unlikely]]
      switch_when_due(now);
    const Tick<MasterClock> tick{Instant<MasterClock>{now}, master_dt_};
    return tapped_cycle(taps_ ? &taps_->master : nullptr, master_, device_, link_.master(), tick);
  }
  void slave_tick(Duration now, std::int64_t k) noexcept {
    if (k > 0) {
      Position<N> before = robot_.state().x;
      robot_.advance();
      into_robot_ += dot(robot_.held(), robot_.state().x - before);
    }
    coupling_energy_ = slave_.delivered() - into_robot_;
    environment_force_ = robot_.environment_force();
    delayed_force_.put(environment_force_);
    if (slave_clock_) [[unlikely]]
      now = read_slave_clock(now, k);
    auto out = slave_cycle(now);
    delayed_force_.note_sent(link_.slave().counts().sent);
    dissipated_ += registration_.to_master(out.dissipated);
    if (out.mode != slave_mode_) [[unlikely]]
      change_mode(out.mode);
  }
  auto slave_cycle(Duration now) noexcept {
    const Tick<SlaveClock> tick{Instant<SlaveClock>{now}, slave_dt_};
    return tapped_cycle(taps_ ? &taps_->slave : nullptr, slave_, robot_, link_.slave(), tick);
  }
  void switch_when_due(Duration now) noexcept {
    while (switch_times_.due(to_seconds(now).si(), master_.epoch())) master_.switch_to_next();
  }
  [[nodiscard]] Duration slave_time(std::int64_t k) const noexcept {
    return slave_clock_offset_ + slave_times_by_itself_[k];
  }
  Duration read_slave_clock(Duration now, std::int64_t k) noexcept {
    const Duration local = slave_time(k);
    link_.slave().transport().set_clock_ahead(local - now);
    return local;
  }
  /// Of the slave. When it begins to follow, the worlds have just been registered.
  void change_mode(Mode mode) noexcept {
    slave_mode_ = mode;
    if (mode != Mode::coupled) return;
    origin_ = slave_.target().translation() - registration_.to_slave(link_.slave().known().newest.x).translation();
  }

  Row<N> row(Duration now, const auto& out) noexcept {
    const Energy dissipated = out.dissipated + dissipated_;
    dissipated_ = Energy{};
    delayed_force_.step(link_.master().known(), out.mode == Mode::coupled);
    if (slave_clock_) [[unlikely]]
      clock_offset_.step(link_.master().known());
    Row<N> r = columns<N>(now, out, dissipated, environment_force_, device_, robot_, master_, slave_);
    r.reference = registration_.to_master(-delayed_force_.now());
    r.coupling_energy_j = coupling_energy_.si();
    r.touching = held_by_environment_ || environment_force_.squared_norm() > 0.0;
    r.coupled = out.mode == Mode::coupled && slave_mode_ == Mode::coupled;
    r.following = slave_mode_ == Mode::coupled;
    if (r.touching && r.following) r.ahead = hand_ahead();
    return r;
  }
  /// The hand in the robot's world against the robot; translation only.
  [[nodiscard]] Displacement<N> hand_ahead() const noexcept {
    Position<N> hand = registration_.to_slave(device_.x());
    Point<kAxes<N>> ahead = hand.translation() + origin_ - robot_.state().x.translation();
    if constexpr (N == 6) {
      return Displacement<6>{SpatialVector{ahead, Eigen::Vector3d::Zero()}};
    } else {
      return Displacement<N>{ahead};
    }
  }

  Registration<N> registration_;
  Seconds master_dt_, slave_dt_;
  TickTimes master_times_, slave_times_;  ///< by the master's clock
  TickTimes slave_times_by_itself_;
  Duration slave_clock_offset_;
  bool slave_clock_;  ///< does the slave's clock differ?
  Duration end_;
  sim::SimDevice<N> device_;
  Plant robot_;
  MasterNode<N, typename Method::template Master<N>> master_;
  SlaveNode<N, typename Method::template Slave<N>> slave_;
  SimLink<N> link_;
  NotCopied<Taps<N>> taps_;
  SwitchTimes switch_times_;
  ClockOffset clock_offset_;
  Energy dissipated_;
  std::int64_t ticks_ = 0, slave_ticks_ = 0;  ///< done

  // What nobody in the loop knows.
  DelayedForce<N> delayed_force_;
  Force<N> environment_force_;
  Energy into_robot_, coupling_energy_;  ///< through the robot's port; into its coupling through both ports
  Point<kAxes<N>> origin_ = Point<kAxes<N>>::Zero();  ///< of the hand's world in the robot's
  Mode slave_mode_ = Mode::idle;
  bool held_by_environment_;
  Energy initial_energy_, granted_energy_;
};

/// A virtual environment rendered on the device, in virtual time.
template <int N>
class RenderLoop {
 public:
  /// `taps`, unless null, see every tick of the node; a copy has none.
  explicit RenderLoop(const Scene& scene, Taps<N>* taps = nullptr)
      : rate_hz_{scene.master_rate_hz},
        end_{to_duration(scene.duration_s)},
        device_{scene, Seconds{1.0 / scene.master_rate_hz}},
        environment_{scene.environment, scene.tool},
        node_{scene.control, environment_},
        initial_energy_{scene.control.initial_energy + environment_.potential(device_.x())} {
    taps_ = taps;
  }

  template <class Visit>
  std::uint64_t run(Duration end, Visit visit) {
    NoMail mail;
    const Seconds dt{1.0 / rate_hz_};
    std::int64_t from = ticks_, k = from;
    for (Duration now = tick_time(k, rate_hz_), next; now < end; now = next) {
      if (k > 0) device_.advance();
      const auto out = cycle(mail, now, dt);
      const Row<N> row{.t_s = to_seconds(now).si(),
                       .master_x = device_.x(),
                       .master_v = device_.v(),
                       .master_f = device_.held(),
                       .master_f_wanted = out.wanted,
                       .env_f = -out.wanted,
                       .master_energy_j = device_.port_energy().si(),
                       .observed_energy_j = node_.observed().si() - initial_energy_.si(),
                       .undissipated_j = out.undissipated.si(),
                       .dissipated_j = out.dissipated.si(),
                       .mode = Mode::coupled,
                       .reference = out.wanted,
                       .touching = environment_.holds() || out.wanted.squared_norm() > 0.0,
                       .coupled = true};
      next = tick_time(++k, rate_hz_);
      if (!visit(row)) break;
    }
    ticks_ = k;
    return static_cast<std::uint64_t>(k - from);
  }

  void be_quiet() noexcept { device_.hold(); }
  Kicked kick(const Velocity<N>& master, const Velocity<N>&) noexcept { return {device_.kick(master), false}; }
  [[nodiscard]] Duration end() const { return end_; }
  [[nodiscard]] std::int64_t ticks() const { return ticks_; }
  [[nodiscard]] Energy initial_energy() const { return initial_energy_; }
  [[nodiscard]] Energy granted_energy() const { return initial_energy_; }
  [[nodiscard]] double quiet_from_s() const { return device_.path().end_s(); }
  [[nodiscard]] std::vector<sim::SegmentTimes> segment_times() const { return device_.path().segment_times(); }

 private:
  auto cycle(NoMail& mail, Duration now, Seconds dt) noexcept {
    const Tick<MasterClock> tick{Instant<MasterClock>{now}, dt};
    return tapped_cycle(taps_ ? &taps_->master : nullptr, node_, device_, mail, tick);
  }

  NotCopied<Taps<N>> taps_;
  double rate_hz_;
  Duration end_;
  sim::SimDevice<N> device_;
  Environment<N> environment_;
  RenderNode<N> node_;
  Energy initial_energy_;
  std::int64_t ticks_ = 0;  ///< done
};

/// A robot alone in its environment, in virtual time: nobody acts on it.
template <int N>
class BodyLoop {
 public:
  explicit BodyLoop(const Scene& scene)
      : rate_hz_{scene.slave_rate_hz},
        end_{to_duration(scene.duration_s)},
        spec_{scene.robot},
        robot_{scene, Seconds{1.0 / scene.slave_rate_hz}} {}

  template <class Visit>
  std::uint64_t run(Duration end, Visit visit) {
    std::int64_t from = ticks_, k = from;
    for (Duration now = tick_time(k, rate_hz_), next; now < end; now = next) {
      if (k > 0) robot_.advance();
      next = tick_time(++k, rate_hz_);
      if (!visit(Row<N>{.t_s = to_seconds(now).si(),
                        .slave_x = robot_.state().x,
                        .slave_v = robot_.state().v,
                        .env_f = robot_.environment_force(),
                        .touching = robot_.environment().holds() || robot_.environment_force().squared_norm() > 0.0}))
        break;
    }
    ticks_ = k;
    return static_cast<std::uint64_t>(k - from);
  }

  /// The same, with nobody looking on.
  std::uint64_t run_silently() {
    const auto ticks = static_cast<std::uint64_t>(std::ceil(to_seconds(end_).si() * rate_hz_ - 1e-6));
    for (std::uint64_t k = 1; k < ticks; ++k) robot_.move();
    return ticks;
  }

  void be_quiet() noexcept { robot_.silence(); }
  Kicked kick(const Velocity<N>&, const Velocity<N>& slave) noexcept { return {false, robot_.kick(slave)}; }
  [[nodiscard]] Duration end() const { return end_; }
  [[nodiscard]] std::int64_t ticks() const { return ticks_; }
  [[nodiscard]] Energy initial_energy() const { return Energy{}; }
  [[nodiscard]] Energy granted_energy() const { return Energy{}; }
  [[nodiscard]] Energy mechanical_energy() const { return lab::mechanical_energy<N>(spec_, robot_); }
  [[nodiscard]] double quiet_from_s() const { return 0.0; }
  [[nodiscard]] std::vector<sim::SegmentTimes> segment_times() const { return {}; }

 private:
  double rate_hz_;
  Duration end_;
  std::optional<RobotSpec> spec_;
  sim::SimRobot<N> robot_;
  std::int64_t ticks_ = 0;  ///< done
};

}  // namespace twoport::lab
