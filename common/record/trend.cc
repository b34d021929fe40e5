#include "common/record/trend.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace twoport {
namespace {

constexpr std::size_t kSkip = 2;  // windows that a trend of motion leaves out: what dies away first
constexpr std::size_t kUsed = kTrendWindows - kSkip;

double bump(double p) {
  const double b = 4.0 * p * (1.0 - p);
  return b * b;
}

}  // namespace

Line fit_line(std::span<const double> y) {
  const double count = static_cast<double>(y.size()), mid = 0.5 * (count - 1.0);
  double mean = 0.0, sxy = 0.0, sxx = 0.0, rr = 0.0;
  for (const double each : y) mean += each / count;
  for (std::size_t i = 0; i < y.size(); ++i) {
    const double dx = static_cast<double>(i) - mid;
    sxy += dx * (y[i] - mean);
    sxx += dx * dx;
  }
  const double slope = sxy / sxx;
  for (std::size_t i = 0; i < y.size(); ++i) {
    const double r = y[i] - mean - slope * (static_cast<double>(i) - mid);
    rr += r * r;
  }
  return {slope, std::sqrt(std::max(rr, 1e-32) / (count - 2.0) / sxx)};
}

TrendRecord::TrendRecord(std::size_t signals, std::size_t energies, std::size_t ticks)
    : signals_{signals},
      energies_{energies},
      block_ticks_{std::max<std::size_t>(ticks, 1)},
      signal_(kBlocks * signals),
      energy_(kBlocks * energies),
      happened_(kBlocks),
      signal_now_(signals),
      energy_now_(energies),
      sign_(signals, 0) {}

void TrendRecord::close_block() noexcept {
  if (filled_ < kBlocks) {
    std::copy(signal_now_.begin(), signal_now_.end(), &of_signal(filled_, 0));
    std::copy(energy_now_.begin(), energy_now_.end(), &of_energy(filled_, 0));
    happened_[filled_++] = happened_now_;
    in_block_ = 0;
    return;
  }
  for (std::size_t b = 0; b < kBlocks / 2; ++b) {
    for (std::size_t i = 0; i < signals_; ++i) {
      const Signal &one = of_signal(2 * b, i), &two = of_signal(2 * b + 1, i);
      of_signal(b, i) = {one.sum2 + two.sum2, one.first, one.turns + two.turns};
    }
    for (std::size_t i = 0; i < energies_; ++i) {
      const Energies &one = of_energy(2 * b, i), &two = of_energy(2 * b + 1, i);
      of_energy(b, i) = {one.sum + two.sum, std::min(one.least, two.least), std::max(one.most, two.most)};
    }
    const Happened &one = happened_[2 * b], &two = happened_[2 * b + 1];
    happened_[b] = {one.contact_changes + two.contact_changes, one.limited || two.limited};
  }
  // The present block goes on: it is the first half of the next one.
  filled_ = kBlocks / 2;
  block_ticks_ *= 2;
}

template <class Value>
WindowMeans TrendRecord::window_means(Value value) const {
  WindowMeans sum{}, weight{};
  for (std::size_t b = 0; b < filled_; ++b) {
    const double at = (static_cast<double>(b) + 0.5) / static_cast<double>(filled_) * kTrendWindows;
    const std::size_t w = std::min(static_cast<std::size_t>(at), kTrendWindows - 1);
    const double share = bump(at - static_cast<double>(w));
    sum[w] += share * value(b);
    weight[w] += share;
  }
  for (std::size_t w = 0; w < kTrendWindows; ++w) sum[w] /= weight[w] * static_cast<double>(block_ticks_);
  return sum;
}

WindowMeans TrendRecord::mean_squares(std::size_t signal) const {
  return window_means([&](std::size_t b) { return of_signal(b, signal).sum2; });
}
WindowMeans TrendRecord::energies(std::size_t energy) const {
  return window_means([&](std::size_t b) { return of_energy(b, energy).sum; });
}

MotionTrend TrendRecord::motion(std::size_t signal, double floor, bool linear) const {
  const WindowMeans a2 = mean_squares(signal);
  MotionTrend t{.rms = std::sqrt(a2.back())};
  if (!(a2.back() > floor * floor) || a2.back() < 1e-290) return t;
  std::array<double, kUsed> y{};
  for (std::size_t i = 0; i < kUsed; ++i) y[i] = 0.5 * std::log(std::max(a2[i + kSkip], 1e-300));
  const std::size_t from = filled_ * kSkip / kTrendWindows;
  for (std::size_t b = from; b < filled_; ++b) t.turns += of_signal(b, signal).turns;

  const auto [slope, error] = fit_line(y);
  const double s1 = fit_line(std::span{y}.first<kUsed / 2>()).slope,
               s2 = fit_line(std::span{y}.last<kUsed / 2>()).slope;
  t.slope = slope;
  t.error = error;
  const double total = slope * (kUsed - 1), need = std::max(5.0 * error, 1e-6), spread = std::abs(slope) + 3.0 * error;
  const bool turns = t.turns >= 8, goes_on = s2 > 0.6 * s1 && s2 > 0.0;
  if (!linear && turns && std::abs(total) + 3.0 * error * kUsed < 2e-3) {
    t.trend = Trend::flat;
  } else if (slope > need) {
    t.trend = (turns || total > 3.0) && goes_on ? Trend::grows : Trend::unclear_growth;
  } else if (slope < -need) {
    t.trend = total < -3.0 || (turns && s2 < 0.5 * s1 && s2 < 0.0) ? Trend::decays : Trend::unclear_decay;
  } else if (total < -3.0 && s2 < 0.0) {
    t.trend = Trend::decays;
  } else if (total > 3.0 && goes_on) {
    t.trend = Trend::grows;
  } else if ((turns && spread < 3e-2) || (t.turns == 0 && spread < 1e-3)) {
    t.trend = Trend::flat;
  } else {
    t.trend = Trend::unclear;
  }
  if (filled_ - from < kPencilSamples || (!linear && (is_known(t.trend) || t.turns >= 40))) return t;

  const std::size_t step = (filled_ - from) / kPencilSamples;
  std::array<double, kPencilSamples> x{};
  for (std::size_t i = 0; i < kPencilSamples; ++i) x[i] = of_signal(from + i * step, signal).first;
  const DampedMode mode = least_damped_mode(x);
  if (!mode.found) return t;
  const double per_window = static_cast<double>(filled_) / static_cast<double>(step * kTrendWindows);
  const bool precise = linear && std::abs(mode.rate) > 10.0 * mode.error && std::abs(mode.rate) * per_window > 1e-6;
  const double grown = mode.rate * per_window * kUsed;
  if (linear && t.trend == Trend::flat && mode.error * per_window < t.error) {
    t.slope = mode.rate * per_window;
    t.error = mode.error * per_window;
  }
  if (!precise && (is_known(t.trend) || t.turns >= 40 || !(std::abs(grown) > std::max(0.02, 1e3 * mode.residual))))
    return t;
  t.trend = grown > 0.0 ? Trend::grows : Trend::decays;
  t.slope = mode.rate * per_window;
  t.error = precise ? mode.error * per_window : mode.residual;
  return t;
}

EnergyTrend TrendRecord::energy(std::size_t energy) const {
  const WindowMeans means = energies(energy);
  EnergyTrend t{.line = fit_line(std::span{means}.last<kTrendWindows - 1>()), .last = means.back()};
  const std::size_t from = filled_ / kTrendWindows, n = filled_ - from;
  const double mid = 0.5 * static_cast<double>(n - 1), ticks = static_cast<double>(block_ticks_);
  const double start = of_energy(from, energy).sum / ticks;
  double sxx = 0.0, sxy = 0.0, mean = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    const double x = static_cast<double>(i) - mid, y = of_energy(from + i, energy).sum / ticks - start;
    sxx += x * x;
    sxy += x * y;
    mean += y / static_cast<double>(n);
  }
  const double slope = sxy / sxx;
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (std::size_t i = 0; i < n; ++i) {
    const double on_line = start + mean + slope * (static_cast<double>(i) - mid);
    low = std::min(low, of_energy(from + i, energy).least - on_line);
    high = std::max(high, of_energy(from + i, energy).most - on_line);
  }
  t.ripple = high - low;
  return t;
}

std::size_t TrendRecord::contact_changes() const {
  std::size_t sum = 0;
  for (std::size_t b = filled_ / 4; b < filled_; ++b) sum += happened_[b].contact_changes;
  return sum;
}
bool TrendRecord::limited() const {
  return std::any_of(happened_.begin() + static_cast<std::ptrdiff_t>(filled_ / 4),
                     happened_.begin() + static_cast<std::ptrdiff_t>(filled_),
                     [](const Happened& h) { return h.limited; });
}

}  // namespace twoport
