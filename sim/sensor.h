#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <utility>
#include <vector>

#include "common/base/normal.h"
#include "common/base/vector.h"
#include "common/scene/scene.h"

namespace twoport::sim {

/// A force sensor: bias, white noise, latency in whole ticks. Its reading is zero until its latency has passed.
template <int N>
class ForceSensor {
 public:
  /// Shows the true force.
  ForceSensor() = default;
  ForceSensor(const ForceSensorSpec& spec, Seconds dt, std::uint64_t seed)
      : bias_{vector<N>(spec.bias_n)},
        noise_{spec.noise_n},
        random_{seed ^ kStream},
        delayed_(static_cast<std::size_t>(std::lround(spec.latency_s / dt.si()))) {}

  /// No noise, no latency: the reading depends on the present force only.
  [[nodiscard]] bool instant() const noexcept { return !(noise_ > 0.0) && delayed_.empty(); }
  /// Without noise and latency: force of the robot on the environment, from that of the environment on the robot.
  [[nodiscard]] Force<N> biased(const Force<N>& on_robot) const noexcept { return Force<N>{bias_ - on_robot.vec()}; }

  /// From now on without noise.
  void silence() noexcept { noise_ = 0.0; }

  /// Reading in a tick with the environment's force `on_robot` on the robot. Call once per tick.
  Force<N> sample(const Force<N>& on_robot) noexcept {
    Force<N> f = biased(on_robot);
    return instant() ? f : add_sensor_errors(f);
  }

 private:
  static constexpr std::uint64_t kStream = 0x5e4501;

  Force<N> add_sensor_errors(Force<N> f) noexcept {
    if (noise_ > 0.0) {
      typename Force<N>::Vector n;
      for (int i = 0; i < N; ++i) n[i] = noise_ * normal(random_, sample_, static_cast<unsigned>(i));
      f += Force<N>{n};
      ++sample_;
    }
    if (!delayed_.empty()) {
      std::swap(f, delayed_[next_]);
      next_ = (next_ + 1) % delayed_.size();
    }
    return f;
  }

  typename Force<N>::Vector bias_ = Force<N>::Vector::Zero();
  double noise_ = 0.0;
  Random random_{kStream};
  std::uint64_t sample_ = 0;
  std::vector<Force<N>> delayed_;  ///< a ring: readings of the last ticks
  std::size_t next_ = 0;
};

/// The encoders of a device: counts, and a velocity from them.
template <int N>
class Encoder {
 public:
  /// Shows the true motion.
  Encoder() = default;
  Encoder(const DeviceSpec& spec, double dt)
      : dt_{dt},
        resolution_{spec.position_resolution_m},
        estimate_{spec.velocity_estimate},
        filter_{-std::expm1(-2.0 * std::numbers::pi * spec.velocity_filter_hz * dt)},
        ideal_{resolution_ == 0.0 && estimate_ == VelocityEstimate::true_velocity} {}

  [[nodiscard]] bool ideal() const noexcept { return ideal_; }
  /// Starts to show at x, with the true velocity.
  void start(const Position<N>& x, const Velocity<N>& v) noexcept { x_ = quantised(x), v_ = v; }
  /// Once a tick, with the true motion.
  void sample(Position<N> true_x, Velocity<N> true_v) noexcept {
    const Position<N> x = quantised(true_x);
    if (estimate_ == VelocityEstimate::true_velocity) {
      v_ = true_v;
    } else {
      const Velocity<N> difference = (x - x_) / Seconds{dt_};
      v_ = estimate_ == VelocityEstimate::filtered ? v_ + filter_ * (difference - v_) : difference;
    }
    x_ = x;
  }
  [[nodiscard]] const Position<N>& x() const noexcept { return x_; }
  [[nodiscard]] const Velocity<N>& v() const noexcept { return v_; }

 private:
  [[nodiscard]] Position<N> quantised(const Position<N>& x) const noexcept {
    if (resolution_ == 0.0) return x;
    const typename Displacement<N>::Vector c = coordinates(x);
    return Position<N>{} + Displacement<N>{((c / resolution_).array().round() * resolution_).matrix()};
  }

  double dt_ = 0.0, resolution_ = 0.0;
  VelocityEstimate estimate_ = VelocityEstimate::true_velocity;
  double filter_ = 1.0;
  bool ideal_ = true;
  Position<N> x_;
  Velocity<N> v_;
};

}  // namespace twoport::sim
