#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "common/link/delay_line.h"
#include "common/link/mailbox.h"
#include "common/record/row.h"
#include "common/runtime/cycle.h"
#include "common/scene/scene.h"
#include "lab/engine/simulation.h"
#include "master/master_node.h"
#include "master/render_node.h"
#include "sim/sim_device.h"
#include "sim/sim_robot.h"
#include "slave/slave_node.h"

// All of a tick in one function, but not under a sanitizer, where that takes minutes to compile.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define TWOPORT_FLATTEN
#else
#define TWOPORT_FLATTEN [[gnu::flatten]]
#endif

namespace twoport::lab {

/// A network in memory: reports as values, no bytes.
template <int N>
class SimTransport {
 public:
  SimTransport(DelayLine<Report<N>>& in, DelayLine<Report<N>>& out) : in_{&in}, out_{&out} {}
  template <class Visit>
  [[gnu::always_inline]] void poll(Duration now, Visit visit) noexcept {
    while (const Report<N>* r = in_->take(now)) visit(*r);
  }
  [[gnu::always_inline]] void send(const auto& r, Duration now) noexcept { out_->put(r, now); }

 private:
  DelayLine<Report<N>>*in_, *out_;
};

/// A scene over a link, in virtual time: the same nodes and the same cycle as the live programs.
///
/// Each side ticks at its own rate, from 0. A report is readable strictly after it was posted, so the order of two
/// sides that tick together does not matter.
template <int N, class Method = AnyMethod>
class LinkLoop {
 public:
  explicit LinkLoop(const Scene& scene)
      : registration_{scene.control},
        master_rate_hz_{scene.master_rate_hz},
        slave_rate_hz_{scene.slave_rate_hz},
        master_dt_{1.0 / scene.master_rate_hz},
        slave_dt_{1.0 / scene.slave_rate_hz},
        end_{to_duration(scene.duration_s)},
        device_{scene, master_dt_},
        robot_{scene, slave_dt_},
        master_{scene.control},
        slave_{scene.control},
        to_slave_{scene.to_slave, scene.seed ^ kToSlaveStream, packets_in_flight(scene.to_slave, scene.master_rate_hz)},
        to_master_{scene.to_master, scene.seed ^ kToMasterStream,
                   packets_in_flight(scene.to_master, scene.slave_rate_hz)},
        master_mail_{{to_master_, to_slave_}},
        slave_mail_{{to_slave_, to_master_}} {
    const Energy held = robot_.environment().potential(robot_.state().x) + kinetic(scene, robot_.state().v);
    initial_energy_ = scene.control.initial_energy + registration_.to_master(scene.control.initial_energy + held);
  }

  /// Runs to the end, or until `visit(row)` returns false. Returns the number of master ticks.
  template <class Visit>
  TWOPORT_FLATTEN std::uint64_t run(Visit visit) {
    std::int64_t m = 0, s = 0;
    Duration next_m{0}, next_s{0};
    while (next_m < end_) {
      // The slave first where both are due, so that a row shows both at the same moment.
      if (next_s <= next_m) {
        slave_tick(next_s, s);
        next_s = tick_time(++s, slave_rate_hz_);
        continue;
      }
      auto out = master_tick(next_m, m);
      if (!visit(row(next_m, out))) return static_cast<std::uint64_t>(m + 1);
      next_m = tick_time(++m, master_rate_hz_);
    }
    return static_cast<std::uint64_t>(m);
  }

  std::uint64_t run_silently() {
    return run([](const Row<N>&) { return true; });
  }
  [[nodiscard]] Energy initial_energy() const { return initial_energy_; }
  [[nodiscard]] double quiet_from_s() const { return device_.path().end_s(); }
  [[nodiscard]] LinkUse link() const {
    return {master_mail_.counts(), slave_mail_.counts(), to_slave_.overflowed() + to_master_.overflowed()};
  }

 private:
  static Energy kinetic(const Scene& scene, const Velocity<N>& v) {
    if (!scene.robot) return Energy{};
    double e = 0.5 * scene.robot->mass_kg * v.vec().template head<(N == 1 ? 1 : 3)>().squaredNorm();
    if constexpr (N == 6) {
      // The initial attitude's axes: good for the isotropic and the aligned case, which is how bodies start.
      const Eigen::Vector3d j = vector<3>(scene.robot->inertia_kg_m2);
      e += 0.5 * v.vec().template tail<3>().cwiseAbs2().dot(j);
    }
    return Energy{e};
  }

  [[gnu::always_inline]] auto master_tick(Duration now, std::int64_t k) noexcept {
    if (k > 0) device_.advance();
    return run_cycle(master_, device_, master_mail_, Tick<MasterClock>{Instant<MasterClock>{now}, master_dt_});
  }
  [[gnu::always_inline]] void slave_tick(Duration now, std::int64_t k) noexcept {
    if (k > 0) robot_.advance();
    auto out = run_cycle(slave_, robot_, slave_mail_, Tick<SlaveClock>{Instant<SlaveClock>{now}, slave_dt_});
    dissipated_ += registration_.to_master(out.dissipated);
  }

  [[gnu::always_inline]] Row<N> row(Duration now, const auto& out) noexcept {
    const Energy dissipated = out.dissipated + dissipated_;
    dissipated_ = Energy{};
    return {.t_s = to_seconds(now).si(),
            .master_x = device_.x(),
            .master_v = device_.v(),
            .master_f = device_.held(),
            .master_f_wanted = out.wanted,
            .slave_x = robot_.state().x,
            .slave_v = robot_.state().v,
            .slave_f = robot_.held(),
            .env_f = robot_.environment_force(),
            .position_error = slave_.position_error(),
            .master_energy_j = device_.port_energy().si(),
            .slave_energy_j = slave_.delivered().si(),
            .observed_energy_j = master_.observed().si(),
            .undissipated_j = out.undissipated.si(),
            .dissipated_j = dissipated.si(),
            .mode = out.mode};
  }

  Registration<N> registration_;
  double master_rate_hz_, slave_rate_hz_;
  Seconds master_dt_, slave_dt_;
  Duration end_;
  sim::SimDevice<N> device_;
  sim::SimRobot<N> robot_;
  MasterNode<N, typename Method::template Master<N>> master_;
  SlaveNode<N, typename Method::template Slave<N>> slave_;
  DelayLine<Report<N>> to_slave_, to_master_;
  Mailbox<N, SimTransport<N>> master_mail_, slave_mail_;
  Energy dissipated_, initial_energy_;
};

/// A virtual environment rendered on the device, in virtual time.
template <int N>
class RenderLoop {
 public:
  explicit RenderLoop(const Scene& scene)
      : rate_hz_{scene.master_rate_hz},
        end_{to_duration(scene.duration_s)},
        device_{scene, Seconds{1.0 / scene.master_rate_hz}},
        environment_{scene.environment, scene.tool},
        node_{scene.control, environment_},
        initial_energy_{scene.control.initial_energy + environment_.potential(device_.x())} {}

  template <class Visit>
  std::uint64_t run(Visit visit) {
    NoMail mail;
    const Seconds dt{1.0 / rate_hz_};
    std::int64_t k = 0;
    for (Duration now{0}; now < end_; now = tick_time(++k, rate_hz_)) {
      if (k > 0) device_.advance();
      const auto out = run_cycle(node_, device_, mail, Tick<MasterClock>{Instant<MasterClock>{now}, dt});
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
                       .mode = Mode::coupled};
      if (!visit(row)) return static_cast<std::uint64_t>(k + 1);
    }
    return static_cast<std::uint64_t>(k);
  }

  std::uint64_t run_silently() {
    return run([](const Row<N>&) { return true; });
  }
  [[nodiscard]] Energy initial_energy() const { return initial_energy_; }
  [[nodiscard]] double quiet_from_s() const { return device_.path().end_s(); }

 private:
  double rate_hz_;
  Duration end_;
  sim::SimDevice<N> device_;
  Environment<N> environment_;
  RenderNode<N> node_;
  Energy initial_energy_;
};

/// A robot alone in its environment, in virtual time: nobody acts on it.
template <int N>
class BodyLoop {
 public:
  explicit BodyLoop(const Scene& scene)
      : rate_hz_{scene.slave_rate_hz},
        end_{to_duration(scene.duration_s)},
        robot_{scene, Seconds{1.0 / scene.slave_rate_hz}} {}

  template <class Visit>
  std::uint64_t run(Visit visit) {
    std::int64_t k = 0;
    for (Duration now{0}; now < end_; now = tick_time(++k, rate_hz_)) {
      if (k > 0) robot_.advance();
      if (!visit(Row<N>{.t_s = to_seconds(now).si(),
                        .slave_x = robot_.state().x,
                        .slave_v = robot_.state().v,
                        .env_f = robot_.environment_force()}))
        return static_cast<std::uint64_t>(k + 1);
    }
    return static_cast<std::uint64_t>(k);
  }

  /// The same, with nobody looking on.
  std::uint64_t run_silently() {
    const auto ticks = static_cast<std::uint64_t>(std::ceil(to_seconds(end_).si() * rate_hz_ - 1e-6));
    for (std::uint64_t k = 1; k < ticks; ++k) robot_.move();
    return ticks;
  }

  [[nodiscard]] Energy initial_energy() const { return Energy{}; }
  [[nodiscard]] double quiet_from_s() const { return 0.0; }

 private:
  double rate_hz_;
  Duration end_;
  sim::SimRobot<N> robot_;
};

}  // namespace twoport::lab
