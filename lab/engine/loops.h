#pragma once

#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>

#include "common/base/sanitized.h"
#include "common/link/clock_offset.h"
#include "common/method/passivity/time_domain/time_domain.h"
#include "common/record/angle.h"
#include "common/record/row.h"
#include "common/runtime/cycle.h"
#include "common/scene/scene.h"
#include "lab/engine/linked_nodes.h"
#include "lab/engine/simulation.h"
#include "lab/engine/tap.h"
#include "lab/mechanical_energy.h"
#include "master/render_node.h"
#include "sim/sim_device.h"
#include "sim/sim_robot.h"

namespace twoport::lab {

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
/// A report is readable strictly after it was posted, so the order of two sides that tick together does not matter.
template <int N, class Method = AnyMethod, class Plant = sim::SimRobot<N>>
class LinkLoop final : public Simulation<N> {
 public:
  /// `taps`, unless null, see every tick of both nodes; a copy has none. `of_plant`: what it is made of besides the scene.
  explicit LinkLoop(const Scene& scene, Taps<N>* taps = nullptr, const auto&... of_plant)
      : Simulation<N>{scene},
        order_{scene},
        slave_clock_{scene.slave_clock.offset_s != 0.0 || scene.slave_clock.drift != 0.0},
        nodes_{scene},
        device_{scene, nodes_.master_dt},
        robot_{scene, order_.slave_period(), of_plant...},
        held_by_environment_{robot_.environment().holds()} {
    const Energy own = scene.control.initial_energy;
    this->grant(own, own + nodes_.registration.to_master(own + lab::mechanical_energy<N>(scene.robot, robot_)));
    if (taps == nullptr) return;
    taps_ = taps;
    nodes_.master_mail.transport().tap(&taps->master);
    nodes_.slave_mail.transport().tap(&taps->slave);
  }

  [[nodiscard]] std::unique_ptr<Simulation<N>> copy() const override { return std::make_unique<LinkLoop>(*this); }
  void be_quiet() override {
    device_.hold();
    robot_.silence();
    nodes_.be_quiet();
  }
  Kicked kick(const Velocity<N>& master, const Velocity<N>& slave) override {
    return {device_.kick(master), robot_.kick(slave)};
  }
  [[nodiscard]] std::int64_t ticks() const override { return order_.ticks(); }
  [[nodiscard]] std::optional<LinkUse> link() const override {
    LinkUse use = nodes_.use();
    if (slave_clock_ && clock_offset_.known()) {
      use.clock = clock_offset_.figures(to_seconds(this->end()).si());
      use.clock->error_s = use.clock->offset_s - to_seconds(order_.slave_ahead()).si();
    }
    return use;
  }

 private:
  // Every call in it inlined: a tick of FORCE_PROJECTED with three axes takes 253 ns, 424 without.
  TWOPORT_FLATTEN std::uint64_t advance(Duration end, const typename Simulation<N>::Visit& visit) override {
    return order_.run(
        end, [this](TickAt at) { slave_tick(at); }, [this, &visit](TickAt at) { return visit(master_tick(at)); });
  }
  [[nodiscard]] const sim::Path<sim::kPathSize<N>>* path() const override { return &device_.path(); }
  void slave_tick(TickAt at) noexcept {
    if (at.now > Duration{0}) {
      Position<N> before = robot_.port();
      robot_.advance();
      into_robot_ += dot(robot_.held(), robot_.port() - before);
    }
    coupling_energy_ = nodes_.slave.delivered() - into_robot_;
    environment_force_ = robot_.environment_force();
    const auto out = nodes_.slave_tick(robot_, at, environment_force_, taps_ ? &taps_->slave : nullptr);
    dissipated_ += nodes_.registration.to_master(out.dissipated);
  }
  /// And the row that shows both sides.
  Row<N> master_tick(TickAt at) noexcept {
    if (at.now > Duration{0}) device_.advance();
    const auto out = nodes_.master_tick(device_, at, taps_ ? &taps_->master : nullptr);
    const Energy dissipated = out.dissipated + std::exchange(dissipated_, Energy{});
    if (slave_clock_) [[unlikely]]
      clock_offset_.step(nodes_.master_mail.known());
    const bool following = nodes_.slave_mode() == Mode::coupled;
    Row<N> r = columns<N>(at.now, out, dissipated, environment_force_, device_, robot_, nodes_.master, nodes_.slave);
    r.reference = nodes_.registration.to_master(-nodes_.delayed_force());
    r.coupling_energy_j = coupling_energy_.si();
    if (following && robot_.tool()) [[unlikely]]
      r.position_error += *robot_.tool() - robot_.port();
    if constexpr (requires { r.object.x = robot_.object(); }) r.object.x = robot_.object();
    r.touching = held_by_environment_ || environment_force_.squared_norm() > 0.0;
    r.coupled = out.mode == Mode::coupled && following;
    r.following = following;
    if (r.touching && r.following) r.ahead = hand_ahead();
    return r;
  }
  /// The hand in the robot's world against the robot; translation only.
  [[nodiscard]] Displacement<N> hand_ahead() const noexcept {
    Position<N> hand = nodes_.registration.to_slave(device_.x());
    Point<kAxes<N>> ahead = hand.translation() + nodes_.origin() - robot_.state().x.translation();
    if constexpr (N == 6) {
      return Displacement<6>{SpatialVector{ahead, Eigen::Vector3d::Zero()}};
    } else {
      return Displacement<N>{ahead};
    }
  }

  TickOrder order_;
  bool slave_clock_;  ///< does the slave's clock differ?
  LinkedNodes<N, Method> nodes_;
  sim::SimDevice<N> device_;
  Plant robot_;
  NotCopied<Taps<N>> taps_;
  ClockOffset clock_offset_;
  Energy dissipated_;  ///< by the slave since the last row
  Force<N> environment_force_;
  Energy into_robot_, coupling_energy_;  ///< through the robot's port; into its coupling through both ports
  bool held_by_environment_;
};

/// When one side ticks, from 0.
class Ticker {
 public:
  explicit Ticker(double rate_hz) : rate_hz_{rate_hz} {}
  /// Calls tick(number, time) for every tick before `end`, or until it returns false. Returns the number of ticks.
  template <class Tick>
  std::uint64_t run(Duration end, Tick tick) {
    const std::int64_t from = ticks_;
    for (Duration now = tick_time(ticks_, rate_hz_); now < end; now = tick_time(ticks_, rate_hz_))
      if (!tick(ticks_++, now)) break;
    return static_cast<std::uint64_t>(ticks_ - from);
  }
  [[nodiscard]] double rate_hz() const { return rate_hz_; }
  [[nodiscard]] std::int64_t ticks() const { return ticks_; }  ///< done

 private:
  double rate_hz_;
  std::int64_t ticks_ = 0;
};

/// A virtual environment rendered on the device, in virtual time.
template <int N>
class RenderLoop final : public Simulation<N> {
 public:
  /// `taps`, unless null, see every tick of the node; a copy has none.
  explicit RenderLoop(const Scene& scene, Taps<N>* taps = nullptr)
      : Simulation<N>{scene},
        ticker_{scene.master_rate_hz},
        device_{scene, Seconds{1.0 / scene.master_rate_hz}},
        environment_{scene.environment, scene.tool},
        node_{scene.control, environment_} {
    taps_ = taps;
    const Energy granted = scene.control.initial_energy + environment_.potential(device_.x());
    this->grant(granted, granted);
  }

  [[nodiscard]] std::unique_ptr<Simulation<N>> copy() const override { return std::make_unique<RenderLoop>(*this); }
  void be_quiet() override { device_.hold(); }
  Kicked kick(const Velocity<N>& master, const Velocity<N>&) override { return {device_.kick(master), false}; }
  [[nodiscard]] std::int64_t ticks() const override { return ticker_.ticks(); }

 private:
  std::uint64_t advance(Duration end, const typename Simulation<N>::Visit& visit) override {
    NoMail mail;
    return ticker_.run(end, [&](std::int64_t k, Duration now) {
      if (k > 0) device_.advance();
      const auto out = cycle(mail, now);
      return visit(Row<N>{.t_s = to_seconds(now).si(),
                          .master_x = device_.x(),
                          .master_v = device_.v(),
                          .master_f = device_.held(),
                          .master_f_wanted = out.wanted,
                          .env_f = -out.wanted,
                          .master_energy_j = device_.port_energy().si(),
                          .observed_energy_j = node_.observed().si() - this->initial_energy().si(),
                          .undissipated_j = out.undissipated.si(),
                          .dissipated_j = out.dissipated.si(),
                          .mode = Mode::coupled,
                          .reference = out.wanted,
                          .touching = environment_.holds() || out.wanted.squared_norm() > 0.0,
                          .coupled = true});
    });
  }
  [[nodiscard]] const sim::Path<sim::kPathSize<N>>* path() const override { return &device_.path(); }
  auto cycle(NoMail& mail, Duration now) noexcept {
    const Tick<MasterClock> tick{Instant<MasterClock>{now}, Seconds{1.0 / ticker_.rate_hz()}};
    return tapped_cycle(taps_ ? &taps_->master : nullptr, node_, device_, mail, tick);
  }

  NotCopied<Taps<N>> taps_;
  Ticker ticker_;
  sim::SimDevice<N> device_;
  Environment<N> environment_;
  RenderNode<N> node_;
};

/// A robot alone in its environment, in virtual time: nobody acts on it.
template <int N>
class BodyLoop final : public Simulation<N> {
 public:
  explicit BodyLoop(const Scene& scene)
      : Simulation<N>{scene},
        ticker_{scene.slave_rate_hz},
        spec_{scene.robot},
        robot_{scene, Seconds{1.0 / scene.slave_rate_hz}} {}

  std::uint64_t run_silently() override {
    const auto ticks = static_cast<std::uint64_t>(std::ceil(to_seconds(this->end()).si() * ticker_.rate_hz() - 1e-6));
    for (std::uint64_t k = 1; k < ticks; ++k) robot_.move();
    return ticks;
  }
  [[nodiscard]] std::unique_ptr<Simulation<N>> copy() const override { return std::make_unique<BodyLoop>(*this); }
  void be_quiet() override { robot_.silence(); }
  Kicked kick(const Velocity<N>&, const Velocity<N>& slave) override { return {false, robot_.kick(slave)}; }
  [[nodiscard]] std::int64_t ticks() const override { return ticker_.ticks(); }
  [[nodiscard]] std::optional<Energy> mechanical_energy() const override {
    return lab::mechanical_energy<N>(spec_, robot_);
  }

 private:
  std::uint64_t advance(Duration end, const typename Simulation<N>::Visit& visit) override {
    return ticker_.run(end, [&](std::int64_t k, Duration now) {
      if (k > 0) robot_.advance();
      const Force<N> f = robot_.environment_force();
      return visit(Row<N>{.t_s = to_seconds(now).si(),
                          .slave_x = robot_.state().x,
                          .slave_v = robot_.state().v,
                          .env_f = f,
                          .touching = robot_.environment().holds() || f.squared_norm() > 0.0});
    });
  }

  Ticker ticker_;
  std::optional<RobotSpec> spec_;
  sim::SimRobot<N> robot_;
};

template <int N>
std::unique_ptr<Simulation<N>> make_simulation(const Scene& scene, Taps<N>* taps) {
  if constexpr (N != kJointPort) {
    if (scene.control.architecture == Architecture::render) return std::make_unique<RenderLoop<N>>(scene, taps);
    if (scene.control.architecture == Architecture::uncontrolled) return std::make_unique<BodyLoop<N>>(scene);
    // One loop for each size does for every method; the controllers that sweeps run most have one of their own, 10 % faster.
    if (transparency_layer(scene.control).is_plain && scene.control.controller.method != ::twoport::Method::none &&
        scene.schedule.empty())
      return std::make_unique<LinkLoop<N, TimeDomainPassivity>>(scene, taps);
  }
  return std::make_unique<LinkLoop<N>>(scene, taps);
}

}  // namespace twoport::lab
