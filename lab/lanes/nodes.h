#pragma once

#include <cstddef>
#include <cstdint>

#include "common/base/time.h"
#include "common/runtime/cycle.h"
#include "common/scene/scene.h"
#include "lab/engine/linked_nodes.h"
#include "lab/lanes/batch.h"

namespace twoport::lab::lanes {

/// LinkedNodes without the plants, for LaneMethod::nodes. Copies are independent.
template <int N>
class Nodes {
 public:
  explicit Nodes(const Scene& scene) : rate_hz_{scene.master_rate_hz}, nodes_{scene} {}

  void be_quiet() noexcept { nodes_.be_quiet(); }
  [[nodiscard]] LinkUse use() const { return nodes_.use(); }

  /// A tick: every `width`-th of `numbers` is of this simulation, as numbers_of_slave() and numbers_of_master() name them.
  TWOPORT_FLATTEN void slave_tick(double* numbers, std::size_t width) noexcept {
    const auto at = [&](std::size_t field) -> double& { return numbers[field * width]; };
    const Force<N> environment{vector_at(numbers + 2 * N * width, width)};
    GivenReading<RobotSample<N>> robot{{Position<N>{vector_at(numbers, width)},
                                        Velocity<N>{vector_at(numbers + N * width, width)},
                                        Force<N>{bias_ - environment.vec()}, false}};
    const auto out = nodes_.slave_tick(robot, {tick_time(slave_ticks_++, rate_hz_)}, environment);
    for (std::size_t i = 0; i < N; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      at(3 * N + i) = out.command.f[static_cast<int>(i)];
      at(4 * N + i) = nodes_.slave.position_error()[static_cast<int>(i)];
      at(5 * N + i) = nodes_.origin()[k];
    }
    at(6 * N) = nodes_.slave.delivered().si();
    at(6 * N + 1) = static_cast<double>(out.mode);
    at(6 * N + 2) = out.dissipated.si();
  }
  TWOPORT_FLATTEN void master_tick(double* numbers, std::size_t width) noexcept {
    const auto at = [&](std::size_t field) -> double& { return numbers[field * width]; };
    GivenReading<DeviceSample<N>> device{{Position<N>{vector_at(numbers, width)},
                                          Velocity<N>{vector_at(numbers + N * width, width)},
                                          Force<N>{vector_at(numbers + 2 * N * width, width)}}};
    const auto out = nodes_.master_tick(device, {tick_time(ticks_++, rate_hz_)});
    for (std::size_t i = 0; i < N; ++i) {
      const int k = static_cast<int>(i);
      at(2 * N + i) = out.command[k];
      at(3 * N + i) = out.wanted[k];
      at(4 * N + i) = nodes_.delayed_force()[k];
    }
    at(5 * N) = nodes_.master.observed().si();
    at(5 * N + 1) = static_cast<double>(out.mode);
    at(5 * N + 2) = out.dissipated.si();
    at(5 * N + 3) = out.undissipated.si();
  }
  /// Of the force sensor.
  void set_bias(const typename Force<N>::Vector& bias) { bias_ = bias; }

 private:
  static typename Force<N>::Vector vector_at(const double* numbers, std::size_t width) {
    typename Force<N>::Vector v;
    for (int i = 0; i < N; ++i) v[i] = numbers[static_cast<std::size_t>(i) * width];
    return v;
  }

  double rate_hz_;
  LinkedNodes<N> nodes_;
  typename Force<N>::Vector bias_ = Force<N>::Vector::Zero();
  std::int64_t ticks_ = 0, slave_ticks_ = 0;
};

}  // namespace twoport::lab::lanes
