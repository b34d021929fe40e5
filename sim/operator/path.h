#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <utility>
#include <variant>
#include <vector>

#include "common/base/random.h"
#include "common/base/vector.h"
#include "common/recording/hand.h"
#include "common/scene/scene.h"

namespace twoport::sim {

/// Tremor of a hand: on each translational axis a sum of sinusoids, drawn once from a seed.
///
///     x(t) = Σ_j a sin(2π f_j t + φ_j),   a = rms √(2/n),   f_j uniform in the j-th of n equal parts of the band
///
/// A function of time alone, the same on every machine.
template <int N>
class Tremor {
 public:
  Tremor() = default;
  Tremor(const TremorSpec& spec, std::uint64_t seed) {
    if (spec.rms_m == 0.0) return;
    const Random random{seed ^ kStream};
    constexpr double kTurn = 2.0 * std::numbers::pi;
    for (int axis = 0; axis < kAxes<N>; ++axis) {
      for (int j = 0; j < kWaves; ++j) {
        const auto wave = static_cast<std::uint64_t>(axis * kWaves + j);
        const double part = (j + random.uniform(wave, kFrequency)) / kWaves;
        waves_.push_back({.axis = axis,
                          .amplitude_m = spec.rms_m * std::sqrt(2.0 / kWaves),
                          .omega = kTurn * (spec.low_hz + part * (spec.high_hz - spec.low_hz)),
                          .phase = kTurn * random.uniform(wave, kPhase)});
      }
    }
  }

  [[nodiscard]] bool still() const noexcept { return waves_.empty(); }

  struct Sample {
    Displacement<N> x;
    Velocity<N> v;
  };
  /// Out of line, as it is rare.
  [[nodiscard]] Sample at(double t_s) const noexcept {
    typename Displacement<N>::Vector x = Displacement<N>::Vector::Zero(), v = x;
    for (const Wave& w : waves_) {
      const double angle = w.omega * t_s + w.phase;
      x[w.axis] += w.amplitude_m * std::sin(angle);
      v[w.axis] += w.amplitude_m * w.omega * std::cos(angle);
    }
    return {Displacement<N>{x}, Velocity<N>{v}};
  }

 private:
  static constexpr int kWaves = 8;
  static constexpr std::uint64_t kStream = 0x7265306d;
  enum Purpose : unsigned { kFrequency, kPhase };
  struct Wave {
    int axis;
    double amplitude_m, omega, phase;
  };
  std::vector<Wave> waves_;
};

/// When a segment ends [s], and where in it the hand could stop: the least speeds of what swings or was recorded.
struct SegmentTimes {
  double end_s;
  std::vector<double> stations_s;
};

/// Size of the intended motion of a hand at a port of size N: at one of joints the hand holds the tool.
template <int N>
inline constexpr int kPathSize = N == kJointPort ? 6 : N;

/// The intended motion of the hand: segments, each starting where the last one ended; after the last, hold.
///
///     move_to   x(s) = x0 + (x1 - x0)(10 s³ - 15 s⁴ + 6 s⁵),   s = t / duration       minimum jerk
///     sine      x(t) = x0 + A sin(2π f t) along one axis
///     multisine x(t) = x0 + Σ a (sin(2π f t + φ) - sin φ) along one direction
///     screw     x(t) = x0 turned by A sin(2π f t) about an axis and moved by L sin(2π f t) along it
///     recording x and v as recorded, linear between two samples
///
/// A tremor is added to all segments and does not end.
template <int N>
class Path {
 public:
  Path(const std::vector<SegmentSpec>& specs, const Position<N>& start, Tremor<N> tremor = {})
      : end_{start}, tremor_{std::move(tremor)} {
    for (const SegmentSpec& spec : specs) {
      const double duration_s = std::visit([](const auto& of) { return of.duration_s; }, spec);
      Segment& s = segments_.emplace_back(Segment{spec, end_s_, duration_s, end_, {}});
      if (const auto* move = std::get_if<MoveToSpec>(&spec)) {
        Position<N> to = position<N>(move->position_m);
        if constexpr (N == 6)
          if (move->position_m.size() != 7) to = Position<6>{to.translation(), end_.attitude()};
        s.along = to - end_;
        end_ = to;
      } else {
        typename Displacement<N>::Vector along = Displacement<N>::Vector::Zero();
        if (const auto* sine = std::get_if<SineSpec>(&spec)) along[sine->axis] = sine->amplitude_m;
        if (const auto* multi = std::get_if<MultiSineSpec>(&spec))
          std::copy(multi->direction.begin(), multi->direction.end(), along.data());
        s.along = Displacement<N>{along};
        end_ = s.at(duration_s).x;
      }
      end_s_ += duration_s;
      if (!std::holds_alternative<HoldSpec>(spec)) rest_from_s_ = end_s_;
    }
    if (!tremor_.still()) rest_from_s_ = std::numeric_limits<double>::infinity();
  }

  struct Sample {
    Position<N> x;
    Velocity<N> v;
  };

  /// Times must not decrease from call to call.
  Sample at(double t_s) noexcept {
    if (t_s >= rest_from_s_) return {end_, {}};
    Sample s = intended(t_s);
    if (!tremor_.still()) {
      const auto shake = tremor_.at(t_s);
      s = {s.x + shake.x, s.v + shake.v};
    }
    return s;
  }
  /// From now on the hand holds where it was to be at t_s, and does not tremble.
  void hold(double t_s) noexcept {
    end_ = at(t_s).x;
    rest_from_s_ = t_s;
  }
  /// Times of the segments, in order.
  [[nodiscard]] std::vector<SegmentTimes> segment_times() const {
    std::vector<SegmentTimes> all;
    for (const Segment& s : segments_) {
      SegmentTimes& times = all.emplace_back(SegmentTimes{.end_s = s.start_s + s.duration_s, .stations_s = {}});
      if (std::holds_alternative<HoldSpec>(s.spec) || std::holds_alternative<MoveToSpec>(s.spec)) continue;
      constexpr int kSamples = 4096;
      const auto after_s = [&](int i) { return s.duration_s * i / kSamples; };
      const auto speed = [&](int i) { return s.at(after_s(i)).v.vec().squaredNorm(); };
      double before = speed(0), now = speed(1);
      for (int i = 1; i < kSamples; ++i) {
        const double after = speed(i + 1);
        if (now < before && now <= after) times.stations_s.push_back(s.start_s + after_s(i));
        before = std::exchange(now, after);
      }
    }
    return all;
  }
  /// When the last segment that moves ends and the hand holds still [s]; infinite with tremor.
  [[nodiscard]] double end_s() const { return rest_from_s_; }

 private:
  Sample intended(double t_s) noexcept {
    if (t_s >= end_s_) return {end_, {}};
    while (t_s >= segments_[current_].start_s + segments_[current_].duration_s) ++current_;
    return segments_[current_].at(t_s - segments_[current_].start_s);
  }

  struct Segment {
    SegmentSpec spec;
    double start_s, duration_s;
    Position<N> from;
    Displacement<N> along;  ///< of move_to the whole way, of sine the amplitude, of multisine the direction

    Sample at(double t) const noexcept {
      return std::visit([&](const auto& of) { return sample(of, t); }, spec);
    }
    Sample sample(const HoldSpec&, double) const noexcept { return {from, {}}; }
    Sample sample(const MoveToSpec&, double t) const noexcept {
      const double s = t / duration_s;
      const double x = s * s * s * (10.0 - s * (15.0 - 6.0 * s));
      const double v = 30.0 * s * s * (1.0 - s) * (1.0 - s) / duration_s;
      return {from + x * along, Velocity<N>{v * along.vec()}};
    }
    Sample sample(const SineSpec& of, double t) const noexcept {
      const double omega = 2.0 * std::numbers::pi * of.frequency_hz;
      return {from + std::sin(omega * t) * along, Velocity<N>{omega * std::cos(omega * t) * along.vec()}};
    }
    Sample sample(const MultiSineSpec& of, double t) const noexcept {
      double x = 0.0, v = 0.0;
      for (const MultiSineSpec::Wave& w : of.waves) {
        const double rate = 2.0 * std::numbers::pi * w.frequency_hz;
        x += w.amplitude_m * (std::sin(rate * t + w.phase_rad) - std::sin(w.phase_rad));
        v += w.amplitude_m * rate * std::cos(rate * t + w.phase_rad);
      }
      return {from + x * along, Velocity<N>{v * along.vec()}};
    }
    Sample sample(const RecordedHandSpec& of, double t) const noexcept {
      const RecordedHand& hand = *of.hand;
      const std::vector<double>& times = hand.t_s;
      const auto after = static_cast<std::size_t>(std::upper_bound(times.begin(), times.end(), t) - times.begin());
      if (after == 0) return recorded_at(hand, 0);
      if (after == times.size()) return recorded_at(hand, after - 1);
      const Sample a = recorded_at(hand, after - 1), b = recorded_at(hand, after);
      const double share = (t - times[after - 1]) / (times[after] - times[after - 1]);
      return {a.x + share * (b.x - a.x), a.v + share * (b.v - a.v)};
    }
    [[nodiscard]] static Sample recorded_at(const RecordedHand& hand, std::size_t i) noexcept {
      const double *x = hand.x.data() + i * (N == 6 ? 7 : N), *v = hand.v.data() + i * N;
      const Velocity<N> velocity{Eigen::Map<const typename Velocity<N>::Vector>{v}};
      if constexpr (N == 6) {
        return {Position<6>{Eigen::Vector3d{x[0], x[1], x[2]}, Eigen::Quaterniond{x[3], x[4], x[5], x[6]}}, velocity};
      } else {
        return {Position<N>{Eigen::Map<const typename Position<N>::Vector>{x}}, velocity};
      }
    }
    Sample sample(const ScrewSpec& of, double t) const noexcept {
      const double omega = 2.0 * std::numbers::pi * of.frequency_hz;
      const double share = std::sin(omega * t), rate = omega * std::cos(omega * t);
      if constexpr (N >= 3) {
        const Eigen::Vector3d point = vector<3>(of.point_m), axis = vector<3>(of.axis);
        const double angle = of.angle_rad, travel = of.travel_m;
        const Eigen::Quaterniond q = rotation(share * angle * axis);
        const Eigen::Vector3d arm = q * (from.translation() - point);
        const Eigen::Vector3d p = point + arm + share * travel * axis;
        const Eigen::Vector3d v = rate * (angle * axis.cross(arm) + travel * axis);
        if constexpr (N == 6) {
          Velocity<6>::Vector twist;
          twist << v, rate * angle * axis;
          return {{p, q * from.attitude()}, Velocity<6>{twist}};
        } else {
          return {Position<N>{p}, Velocity<N>{v}};
        }
      } else {
        (void)share, (void)rate;
        return {from, {}};
      }
    }
  };

  std::vector<Segment> segments_;
  Position<N> end_;
  Tremor<N> tremor_;
  double end_s_ = 0.0, rest_from_s_ = 0.0;
  std::size_t current_ = 0;
};

}  // namespace twoport::sim
