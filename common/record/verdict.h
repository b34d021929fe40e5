#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

namespace twoport {

/// Is a run stable? Judged from the motion at rest and from where its energy comes.
///
/// The second part of the run (after the operator's path has ended, if that leaves a tenth of it; else the second half)
/// is cut into eight windows. In each, activity A is the rms velocity of both sides under a smooth weight (4p(1-p))²,
/// which takes the ripple of an oscillation out of it. A line through ln A gives the growth and its standard error.
///
///   diverged    a value is not finite, or a position is beyond 100 m
///   growing     ln A rises by more than five standard errors, and the network feeds it: the port energy has fallen
///               below -5 % of the most it ever held (or A has grown tenfold, above 1 mm/s)
///   sustained   ln A does not fall, and the port energy, below the same bound, has fallen in every window: a limit
///               cycle that the network pays for
///
/// For a linear loop the line's slope is the spectral radius, so `growing` agrees with eigenvalues. A passive loop may
/// buzz on credit; it is bounded, and its chatter is reported as such.
class Verdict {
 public:
  /// `quiet_from_s`: when the operator's path ends. `duration_s`: planned end. `initial_energy_j`: E(0).
  Verdict(double quiet_from_s, double duration_s, double initial_energy_j)
      : from_s_{quiet_from_s < 0.9 * duration_s ? std::max(quiet_from_s, 0.25 * duration_s) : 0.5 * duration_s},
        window_s_{(duration_s - from_s_) / kWindows},
        initial_energy_j_{initial_energy_j},
        energy_j_{initial_energy_j},
        most_energy_j_{initial_energy_j} {}

  /// One tick: largest position of either side [m], sum of squared velocities [m²/s²], port energy without E(0) [J].
  /// Returns false once the run has diverged: there is no use in going on.
  bool add(double t_s, double reach_m, double speed2, double port_energy_j) noexcept {
    energy_j_ = initial_energy_j_ + port_energy_j;
    most_energy_j_ = std::max(most_energy_j_, energy_j_);
    if (!(reach_m <= kReach) || !std::isfinite(speed2 + port_energy_j)) {
      diverged_ = true;
      diverged_at_s_ = t_s;
      return false;
    }
    if (t_s < from_s_) return true;
    const double at = (t_s - from_s_) / window_s_;
    const auto w = static_cast<std::size_t>(at);
    if (w >= kWindows) return true;
    const double p = at - static_cast<double>(w), bump = 4.0 * p * (1.0 - p), weight = bump * bump;
    sum_[w] += weight * speed2;
    weight_[w] += weight;
    energy_at_end_[w] = energy_j_;
    filled_ = w + 1;
    return true;
  }

  [[nodiscard]] bool stable() const { return !judge().unstable; }
  [[nodiscard]] std::string words() const { return judge().words; }

 private:
  static constexpr std::size_t kWindows = 8;
  static constexpr double kReach = 100.0;
  struct Judgement {
    bool unstable;
    std::string words;
  };

  [[nodiscard]] Judgement judge() const {
    if (diverged_) return {true, "diverged at " + std::to_string(diverged_at_s_) + " s"};
    if (filled_ < 4) return {false, "bounded; too short to judge growth"};
    const std::size_t n = filled_ == kWindows ? kWindows : filled_ - 1;  // a window cut short is left out
    std::array<double, kWindows> y{};
    for (std::size_t i = 0; i < n; ++i) {
      if (weight_[i] <= 0.0 || sum_[i] <= 0.0) return {false, "bounded, at rest"};
      y[i] = 0.5 * std::log(sum_[i] / weight_[i]);
    }
    const auto [slope, error] = line(y, n);
    const double last = std::exp(y[n - 1]), first = std::exp(y[0]);
    const bool fed = energy_j_ < -0.05 * most_energy_j_ && energy_j_ < 0.0;
    if (last > kStill && slope > 5.0 * error && (fed || (last > 10.0 * first && last > 1e-3)))
      return {true, "growing: activity x" + std::to_string(std::exp(slope)) + " per window at rest, fed by the network"};
    bool falls = true;
    for (std::size_t i = 1; i < n; ++i) falls = falls && energy_at_end_[i] < energy_at_end_[i - 1];
    if (last > kStill && fed && falls && slope > -5.0 * error && slope > -0.01)
      return {true, "sustained oscillation of " + std::to_string(1e3 * last) +
                        " mm/s rms, fed by the network: port energy " + std::to_string(energy_j_) + " J and falling"};
    return {false, slope < 0.0 ? "bounded and decaying" : "bounded, not growing"};
  }

  struct Line {
    double slope, error;
  };
  static Line line(const std::array<double, kWindows>& y, std::size_t n) {
    const double count = static_cast<double>(n), mid = 0.5 * (count - 1.0);
    double mean = 0.0, sxy = 0.0, sxx = 0.0;
    for (std::size_t i = 0; i < n; ++i) mean += y[i] / count;
    for (std::size_t i = 0; i < n; ++i) {
      const double dx = static_cast<double>(i) - mid;
      sxy += dx * (y[i] - mean);
      sxx += dx * dx;
    }
    const double slope = sxy / sxx;
    double residual = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      const double r = y[i] - mean - slope * (static_cast<double>(i) - mid);
      residual += r * r;
    }
    return {slope, std::sqrt(residual / (count - 2.0) / sxx)};
  }

  static constexpr double kStill = 1e-9;  // [m/s]
  double from_s_, window_s_, initial_energy_j_, energy_j_, most_energy_j_, diverged_at_s_ = 0.0;
  bool diverged_ = false;
  std::array<double, kWindows> sum_{}, weight_{}, energy_at_end_{};
  std::size_t filled_ = 0;
};

}  // namespace twoport
