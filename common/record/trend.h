#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace twoport {

/// A line y = a + slope i through values at i = 0, 1, …, by least squares, and the standard error of its slope.
struct Line {
  double slope = 0.0, error = 0.0;
};
Line fit_line(std::span<const double> y);

/// Means over equal parts of a recording, under the smooth weight w = (4p(1-p))², p from 0 to 1 across a window. The weight
/// takes the ripple of an oscillation out of a mean.
inline constexpr std::size_t kTrendWindows = 8;
using WindowMeans = std::array<double, kTrendWindows>;

/// How the amplitude of a coordinate goes on.
enum class Trend : unsigned char {
  rest,  ///< below the floor: nothing moves
  decays,
  flat,  ///< neither, as far as eight turning points or a constant speed can tell
  grows,
  unclear_growth,  ///< the amplitude rises, but it is not certain that it does so by itself
  unclear_decay,
  unclear,
};
[[nodiscard]] constexpr bool is_known(Trend t) {
  return t < Trend::unclear_growth;
}

/// Trend of one coordinate. Slopes are of ln A per window, A the rms value in a window.
struct MotionTrend {
  Trend trend = Trend::rest;
  double slope = 0.0, error = 0.0;
  double rms = 0.0;       ///< in the last window
  std::size_t turns = 0;  ///< changes of sign in the last six windows
};

/// Trend of an energy.
struct EnergyTrend {
  Line line;            ///< through the last seven window means [J per window]
  double last = 0.0;    ///< mean of the last window
  double ripple = 0.0;  ///< largest less least difference from a line, first window left out

  /// Does it fall steadily: by more than five standard errors, and by more than twice its ripple?
  [[nodiscard]] bool falls() const { return line.slope < -5.0 * line.error && -7.0 * line.slope > 2.0 * ripple; }
};

/// Signals and energies over a stretch of time of any length, in constant memory, for their trends.
///
/// Ticks are gathered in blocks of equal length, at most kBlocks; when there is no room for another, neighbours are merged
/// and blocks are twice as long from then on. A block holds the mean square of each signal, its first value, its changes of
/// sign, and mean, least and largest value of each energy. A mean over a block has zeros where the weight of a window,
/// sampled once a block, repeats itself; so window means of blocks are window means of ticks.
class TrendRecord {
 public:
  static constexpr std::size_t kBlocks = 512;

  /// Allocates here, and never again. `ticks`: length of the first blocks.
  TrendRecord(std::size_t signals, std::size_t energies, std::size_t ticks = 1);

  /// What happened in a tick.
  struct Events {
    bool touching = false;  ///< something is in contact
    bool limited = false;   ///< a force was cut by a limit that is no passivity controller
  };
  /// `signals`, `energies`: arrays, vectors or spans of numbers.
  void add(const auto& signals, const auto& energies, Events events) noexcept {
    if (in_block_ == 0) [[unlikely]] {
      for (std::size_t i = 0; i < signals.size(); ++i) signal_now_[i] = {0.0, signals[i], 0};
      for (std::size_t i = 0; i < energies.size(); ++i) energy_now_[i] = {0.0, energies[i], energies[i]};
      happened_now_ = {0, false};
    }
    // What changes in few ticks is behind a branch, which costs less than a store.
    for (std::size_t i = 0; i < signals.size(); ++i) {
      const double x = signals[i];
      signal_now_[i].sum2 += x * x;
      const int sign = (x > 0.0) - (x < 0.0);
      if (sign != sign_[i] && sign != 0) [[unlikely]] {
        signal_now_[i].turns += sign_[i] != 0;
        sign_[i] = sign;
      }
    }
    for (std::size_t i = 0; i < energies.size(); ++i) {
      Energies& e = energy_now_[i];
      e.sum += energies[i];
      if (energies[i] < e.least) e.least = energies[i];
      if (energies[i] > e.most) e.most = energies[i];
    }
    if (events.touching != touching_) [[unlikely]] {
      happened_now_.contact_changes += started_;
      touching_ = events.touching;
    }
    if (events.limited) [[unlikely]]
      happened_now_.limited = true;
    started_ = true;
    if (++in_block_ == block_ticks_) [[unlikely]]
      close_block();
  }

  [[nodiscard]] std::size_t signals() const { return signals_; }
  [[nodiscard]] std::size_t number_of_energies() const { return energies_; }
  /// Ticks in whole blocks.
  [[nodiscard]] std::size_t ticks() const { return filled_ * block_ticks_; }
  /// Are there enough blocks for eight windows?
  [[nodiscard]] bool enough() const { return filled_ >= 8 * kTrendWindows; }

  [[nodiscard]] WindowMeans mean_squares(std::size_t signal) const;
  [[nodiscard]] WindowMeans energies(std::size_t energy) const;

  /// Trend of a signal. With y = ln A of the last six windows, s, e their line's slope and its error, s1, s2 the slopes of
  /// its halves, S = 5 s:
  ///
  ///     rest    A of the last window is below `floor`
  ///     grows   s > max(5 e, 1e-6), s2 > 0.6 s1, s2 > 0, and 8 turning points or S > 3
  ///     decays  s < -max(5 e, 1e-6) and (S < -3, or 8 turning points and s2 < s1/2, s2 < 0)
  ///     flat    8 turning points and |s| + 3 e < 0.03, or none and < 1e-3; of a signal that something nonlinear has shaped
  ///             (`linear` false) also |S| + 18 e < 2e-3
  ///     else    unclear
  ///
  /// The halves tell exponential growth from what grows by a power of time (s2 = 0.53 s1). Of a `linear` signal the least
  /// damped mode decides instead, and gives slope and error, where a few modes explain the signal, the mode's rate is more than
  /// ten times its error, and more than 1e-6 per window (see least_damped_mode). Of another signal it decides what is left
  /// unclear, with fewer than forty turning points, from a growth of 2 % on.
  [[nodiscard]] MotionTrend motion(std::size_t signal, double floor, bool linear) const;
  [[nodiscard]] EnergyTrend energy(std::size_t energy) const;

  /// Changes between touching and not touching, the first quarter left out.
  [[nodiscard]] std::size_t contact_changes() const;
  [[nodiscard]] bool limited() const;  ///< the first quarter left out

 private:
  struct Signal {
    double sum2, first;
    std::size_t turns;
  };
  struct Energies {
    double sum, least, most;
  };
  struct Happened {
    std::size_t contact_changes;
    bool limited;
  };
  template <class Value>
  [[nodiscard]] WindowMeans window_means(Value value) const;
  void close_block() noexcept;
  [[nodiscard]] Signal& of_signal(std::size_t block, std::size_t i) { return signal_[block * signals_ + i]; }
  [[nodiscard]] const Signal& of_signal(std::size_t block, std::size_t i) const {
    return signal_[block * signals_ + i];
  }
  [[nodiscard]] Energies& of_energy(std::size_t block, std::size_t i) { return energy_[block * energies_ + i]; }
  [[nodiscard]] const Energies& of_energy(std::size_t block, std::size_t i) const {
    return energy_[block * energies_ + i];
  }

  std::size_t signals_, energies_, block_ticks_;
  std::size_t filled_ = 0, in_block_ = 0;
  std::vector<Signal> signal_;
  std::vector<Energies> energy_;
  std::vector<Happened> happened_;
  // Of the block that is being filled.
  std::vector<Signal> signal_now_;
  std::vector<Energies> energy_now_;
  Happened happened_now_{};
  std::vector<int> sign_;  ///< of each signal's last value other than 0
  bool touching_ = false, started_ = false;
};

/// Growth rate per sample of the least damped mode in a signal that a few modes make up.
///
///     x_i ≈ Σ c_j λ_j^i,   rank at most 8,   rate = max ln |λ_j| over modes with at least 1e-3 of the signal
///
/// By a matrix pencil (Hua and Sarkar, IEEE Trans. ASSP 38(5), 1990) over 96 samples; the signal's subspace by a pivoted
/// Gram-Schmidt decomposition. `residual` is the largest difference from the signal, relative to its largest value; above
/// 1e-4 `found` is false. `error` is the larger difference of `rate` from that of the first and that of the last 64 samples.
struct DampedMode {
  bool found = false;
  double rate = 0.0, residual = 0.0, error = 0.0;
};
inline constexpr std::size_t kPencilSamples = 96;
DampedMode least_damped_mode(const std::array<double, kPencilSamples>& x);

}  // namespace twoport
