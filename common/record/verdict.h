#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <string>

namespace twoport {

/// Is a run stable? Judged from how the motion of both sides goes on by itself, and from where its energy comes.
///
/// The second part of the run (after the operator's path has ended, if that leaves a tenth of it; else the second half)
/// is cut into eight windows. In each, activity A is the rms velocity of both sides under a smooth weight (4p(1-p))²,
/// which takes the ripple of an oscillation out of it. A line through ln A gives the growth and its standard error.
///
///   diverged    a value is not finite, a position is beyond 100 m or a velocity beyond 1000 m/s or rad/s
///   growing     ln A rises by more than five standard errors, and one of
///                 the hand rests, no controller has acted, and the port energy is no higher than where judging began
///                 the network has paid: port energy below -5 % of the most it ever held
///                 no controller has acted, and A has grown tenfold, above 1 mm/s
///   sustained   ln A does not fall, the network has paid, and pays on (a line through the windows' port energies falls
///               by more than five standard errors): a limit cycle that it feeds
///
/// A limit cycle that is still settling falls a little: less than 1 % per window, and the device's limit cuts its force
/// in every window, or it falls along no line, while a linear loop's decay is one by over ten standard errors.
///
/// Left to itself a linear loop follows its dominant eigenvalue ρ: ln A rises by ln ρ per tick, exactly, and whatever
/// damps the handle makes the port pay for it; so `growing` agrees with ρ > 1, down to ripple and rounding (1e-7 per
/// tick in a minute at 2 kHz). Modes that die out more slowly than the windows pass bend the line: near a boundary give
/// the run time. At exact rest nothing grows: something must set the loop in motion.
///
/// A controller that acts makes the loop another one. A passive one may buzz on credit, and swell while it lasts; it is
/// bounded, and its chatter is reported as such. So where one has acted growth alone says nothing, only growth that the
/// network has paid for with what it never got.
///
/// While the path still runs, what moves is not the loop's alone. Then a payment counts only where the force above
/// 30 Hz is at least half of the force felt (rms): a hand is slower than that.
class Verdict {
 public:
  /// `quiet_from_s`: when the operator's path ends. `duration_s`: planned end; infinity: none, and then growth is not
  /// judged. `initial_energy_j`: E(0).
  Verdict(double quiet_from_s, double duration_s, double initial_energy_j)
      : quiet_{quiet_from_s < 0.9 * duration_s},
        from_s_{quiet_ ? std::max(quiet_from_s, 0.25 * duration_s) : 0.5 * duration_s},
        window_s_{(duration_s - from_s_) / kWindows},
        initial_energy_j_{initial_energy_j},
        energy_j_{initial_energy_j},
        most_energy_j_{initial_energy_j} {}

  struct Sample {
    double t_s;
    double reach_m;        ///< largest distance of either side from the origin
    double speed2;         ///< sum of squared velocities of both sides [m²/s²]
    double port_energy_j;  ///< without E(0)
    double force2;         ///< squared force felt [N²]
    double fast_force2;    ///< of that, above 30 Hz
    bool corrected;        ///< a controller has acted
    bool limited = false;  ///< the device has not given the whole force, and no controller is why
  };
  /// Returns false once the run has diverged: there is no use in going on.
  bool add(const Sample& k) noexcept {
    energy_j_ = initial_energy_j_ + k.port_energy_j;
    most_energy_j_ = std::max(most_energy_j_, energy_j_);
    if (!(k.reach_m <= kReach && k.speed2 <= kSpeed * kSpeed) || !std::isfinite(k.port_energy_j)) {
      diverged_ = true;
      diverged_at_s_ = k.t_s;
      return false;
    }
    if (k.t_s < from_s_) return true;
    const double at = (k.t_s - from_s_) / window_s_;
    const auto w = static_cast<std::size_t>(at);
    if (w >= kWindows) return true;
    if (filled_ == 0) energy_at_start_j_ = energy_j_;
    const double p = at - static_cast<double>(w), bump = 4.0 * p * (1.0 - p), weight = bump * bump;
    sum_[w] += weight * k.speed2;
    weight_[w] += weight;
    energy_at_end_[w] = energy_j_;
    filled_ = w + 1;
    force2_ += k.force2;
    fast_force2_ += k.fast_force2;
    corrected_ = corrected_ || k.corrected;
    limited_[w] = limited_[w] || k.limited;
    return true;
  }

  [[nodiscard]] bool stable() const { return !judge().unstable; }
  [[nodiscard]] std::string text() const { return judge().text; }

 private:
  static constexpr std::size_t kWindows = 8;
  static constexpr double kReach = 100.0, kSpeed = 1000.0;
  static constexpr double kStill = 1e-9;  // [m/s]
  static constexpr double kEven = 1e-5;   // growth per window that is none: a drift at constant speed, to rounding
  static constexpr double kClean = 10.0;  // standard errors, in the decay of a linear loop's dominant mode
  static std::string digits(double value) {
    std::array<char, 32> text{};
    std::snprintf(text.data(), text.size(), "%.4g", value);
    return text.data();
  }
  struct Judgement {
    bool unstable;
    std::string text;
  };

  [[nodiscard]] Judgement judge() const {
    if (diverged_) return {true, "diverged at " + digits(diverged_at_s_) + " s"};
    if (!std::isfinite(from_s_)) return {false, "bounded; growth is not judged where no end is planned"};
    if (filled_ < 4) return {false, "bounded; too short to judge growth"};
    const std::size_t n = filled_ == kWindows ? kWindows : filled_ - 1;  // a window cut short is left out
    std::array<double, kWindows> y{};
    for (std::size_t i = 0; i < n; ++i) {
      if (weight_[i] <= 0.0 || sum_[i] <= 0.0) return {false, "bounded, at rest"};
      y[i] = 0.5 * std::log(sum_[i] / weight_[i]);
    }
    const auto [slope, error] = line(y, n);
    const double last = std::exp(y[n - 1]), first = std::exp(y[0]);
    if (last <= kStill) return {false, "bounded, at rest"};

    const bool own = quiet_ || fast_force2_ >= 0.25 * force2_;
    const bool paid = own && energy_j_ < -0.05 * most_energy_j_ && energy_j_ < 0.0;
    const bool by_itself = quiet_ && !corrected_ && energy_j_ <= energy_at_start_j_;
    const bool tenfold = !corrected_ && last > 10.0 * first && last > 1e-3;
    if (slope > std::max(5.0 * error, kEven) && (by_itself || paid || tenfold))
      return {true, "growing: activity x" + digits(std::exp(slope)) + " per window" + (quiet_ ? " at rest" : "") +
                        (paid ? ", fed by the network" : "")};
    const auto [income, income_error] = line(energy_at_end_, n);
    const bool limited = std::all_of(limited_.begin(), limited_.begin() + n, std::identity{});
    if (paid && income < -5.0 * income_error && slope > -0.01 && (limited || slope > -kClean * error))
      return {true, "sustained oscillation of " + digits(1e3 * last) + " mm/s rms, fed by the network: port energy " +
                        digits(energy_j_) + " J and falling"};
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

  bool quiet_;
  double from_s_, window_s_, initial_energy_j_, energy_j_, most_energy_j_;
  double energy_at_start_j_ = 0.0, force2_ = 0.0, fast_force2_ = 0.0, diverged_at_s_ = 0.0;
  bool diverged_ = false, corrected_ = false;
  std::array<double, kWindows> sum_{}, weight_{}, energy_at_end_{};
  std::array<bool, kWindows> limited_{};
  std::size_t filled_ = 0;
};

}  // namespace twoport
