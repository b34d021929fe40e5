#pragma once

#include <cstddef>
#include <cstdint>

#include "common/base/time.h"
#include "common/runtime/cycle.h"
#include "common/scene/scene.h"
#include "lab/engine/loops.h"
#include "lab/lanes/batch.h"
#include "master/master_node.h"
#include "slave/slave_node.h"

namespace twoport::lab::lanes {

/// Both nodes of a scene and the link between them, without the plants: what LinkLoop (lab/engine/loops.h) has of them, for
/// LaneMethod::nodes. Copies are independent.
template <int N>
class Nodes {
 public:
  explicit Nodes(const Scene& scene)
      : registration_{scene.control},
        rate_hz_{scene.master_rate_hz},
        dt_{1.0 / scene.master_rate_hz},
        master_{scene.control, scene.schedule},
        slave_{scene.control, scene.schedule},
        link_{scene},
        switch_times_{scene.schedule},
        delayed_force_{with_playout(scene.to_master, scene.transmission_to_master), scene.slave_rate_hz,
                       scene.transmission_to_master.deadband.has_value()} {}

  void be_quiet() noexcept {
    link_.keep_as_it_is();
    switch_times_.end();
  }
  [[nodiscard]] LinkUse use() const {
    LinkUse use = link_.use();
    use.device_limits = master_.limit_counts();
    use.robot_limits = slave_.limit_counts();
    use.switches = master_.epoch();
    return use;
  }

  /// A tick: every `width`-th of `numbers` is of this simulation, as numbers_of_slave() and numbers_of_master() name them.
  TWOPORT_FLATTEN void slave_tick(double* numbers, std::size_t width) noexcept {
    const auto at = [&](std::size_t field) -> double& { return numbers[field * width]; };
    const auto three = [&](std::size_t from) {
      typename Force<N>::Vector v;
      for (std::size_t i = 0; i < N; ++i) v[static_cast<Eigen::Index>(i)] = at(from + i);
      return v;
    };
    const Force<N> environment{three(2 * N)};
    delayed_force_.put(environment);
    Hardware<RobotSample<N>, RobotCommand<N>> robot{
        {Position<N>{three(0)}, Velocity<N>{three(N)}, Force<N>{bias_ - environment.vec()}, false}, {}};
    const auto out = run_cycle(slave_, robot, link_.slave(),
                               Tick<SlaveClock>{Instant<SlaveClock>{tick_time(slave_ticks_++, rate_hz_)}, dt_});
    delayed_force_.note_sent(link_.slave().counts().sent);
    if (out.mode != slave_mode_) [[unlikely]] {
      slave_mode_ = out.mode;
      if (out.mode == Mode::coupled)
        origin_ = slave_.target().translation() - registration_.to_slave(link_.slave().known().newest.x).translation();
    }
    for (std::size_t i = 0; i < N; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      at(3 * N + i) = robot.command.f[static_cast<int>(i)];
      at(4 * N + i) = slave_.position_error()[static_cast<int>(i)];
      at(5 * N + i) = origin_[k];
    }
    at(6 * N) = slave_.delivered().si();
    at(6 * N + 1) = static_cast<double>(out.mode);
    at(6 * N + 2) = out.dissipated.si();
  }
  TWOPORT_FLATTEN void master_tick(double* numbers, std::size_t width) noexcept {
    const auto at = [&](std::size_t field) -> double& { return numbers[field * width]; };
    const auto three = [&](std::size_t from) {
      typename Force<N>::Vector v;
      for (std::size_t i = 0; i < N; ++i) v[static_cast<Eigen::Index>(i)] = at(from + i);
      return v;
    };
    const Duration now = tick_time(ticks_++, rate_hz_);
    if (switch_times_.any()) [[unlikely]]
      while (switch_times_.due(to_seconds(now).si(), master_.epoch())) master_.switch_to_next();
    Hardware<DeviceSample<N>, Force<N>> device{{Position<N>{three(0)}, Velocity<N>{three(N)}, Force<N>{three(2 * N)}},
                                               {}};
    const auto out = run_cycle(master_, device, link_.master(), Tick<MasterClock>{Instant<MasterClock>{now}, dt_});
    delayed_force_.step(link_.master().known(), out.mode == Mode::coupled);
    for (std::size_t i = 0; i < N; ++i) {
      const int k = static_cast<int>(i);
      at(2 * N + i) = device.command[k];
      at(3 * N + i) = out.wanted[k];
      at(4 * N + i) = delayed_force_.now()[k];
    }
    at(5 * N) = master_.observed().si();
    at(5 * N + 1) = static_cast<double>(out.mode);
    at(5 * N + 2) = out.dissipated.si();
    at(5 * N + 3) = out.undissipated.si();
  }
  /// Of the force sensor.
  void set_bias(const typename Force<N>::Vector& bias) { bias_ = bias; }

 private:
  /// A reading, and the command that answers it.
  template <class Sample, class Command>
  struct Hardware {
    Sample sample;
    Command command;
    template <class Clock>
    const Sample& sense(const Tick<Clock>&) const noexcept {
      return sample;
    }
    void actuate(const Command& c) noexcept { command = c; }
  };

  Registration<N> registration_;
  double rate_hz_;
  Seconds dt_;
  MasterNode<N> master_;
  SlaveNode<N> slave_;
  SimLink<N> link_;
  SwitchTimes switch_times_;
  DelayedForce<N> delayed_force_;
  typename Force<N>::Vector bias_ = Force<N>::Vector::Zero();
  Point<kAxes<N>> origin_ = Point<kAxes<N>>::Zero();
  Mode slave_mode_ = Mode::idle;
  std::int64_t ticks_ = 0, slave_ticks_ = 0;
};

}  // namespace twoport::lab::lanes
