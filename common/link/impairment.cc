#include "common/link/impairment.h"

#include <algorithm>
#include <cmath>

#include "common/base/normal.h"

namespace twoport {
namespace {

/// What a number of one packet is drawn for.
enum Purpose : unsigned { kBurstState, kBurstLoss, kLoss, kJitter, kReorder, kDuplicate, kJitterOfDuplicate };

}  // namespace

double longest_delay_s(const ImpairmentOptions& o) {
  double longest = o.delay_s + 10.0 * o.jitter_s;
  for (const double d : o.recorded_delay_s) longest = std::max(longest, d);
  for (const DelayStep& s : o.delay_step) longest = std::max(longest, s.delay_s + 10.0 * o.jitter_s);
  return longest + o.reorder_s;
}
std::size_t packets_in_flight(const ImpairmentOptions& o, double rate_hz) {
  return static_cast<std::size_t>(std::min(2.0 * longest_delay_s(o) * rate_hz + 64.0, 1e6));
}

Impairment::Impairment(const ImpairmentOptions& options, std::uint64_t seed)
    : options_{options}, random_{seed}, fixed_delay_{std::max(Duration{0}, to_duration(options.delay_s))} {
  certain_ = is_certain();
}

bool Impairment::is_certain() const noexcept {
  const ImpairmentOptions& o = options_;
  return o.jitter_s == 0.0 && o.loss == 0.0 && !o.burst && o.blackout.empty() && o.duplicate == 0.0 &&
         o.reorder == 0.0 && o.recorded_delay_s.empty() && o.delay_step.empty();
}

void Impairment::adjust(double delay_s, double jitter_s, double loss) noexcept {
  options_.delay_s = delay_s;
  options_.jitter_s = jitter_s;
  options_.loss = loss;
  fixed_delay_ = std::max(Duration{0}, to_duration(delay_s));
  certain_ = is_certain();
}

void Impairment::change_delay(Duration since_start) noexcept {
  for (; steps_done_ < options_.delay_step.size(); ++steps_done_) {
    const DelayStep& step = options_.delay_step[steps_done_];
    if (since_start < to_duration(step.at_s)) return;
    options_.delay_s = step.delay_s;
    fixed_delay_ = to_duration(step.delay_s);
  }
}

bool Impairment::lost(Duration since_start) noexcept {
  bool gone = !options_.recorded_delay_s.empty() && std::isnan(options_.recorded_delay_s[recorded_next_]);
  if (options_.burst) {
    const GilbertElliottOptions& b = *options_.burst;
    const double u = random_.uniform(packet_, kBurstState);
    bad_state_ = bad_state_ ? u >= b.r : u < b.p;
    gone = random_.uniform(packet_, kBurstLoss) < (bad_state_ ? b.loss_bad : b.loss_good);
  }
  if (options_.loss > 0.0 && random_.uniform(packet_, kLoss) < options_.loss) gone = true;
  for (const BlackoutWindow& w : options_.blackout) {
    const Duration into = since_start - to_duration(w.start_s);
    if (into >= Duration{0} && into < to_duration(w.duration_s)) gone = true;
  }
  return gone;
}

Duration Impairment::delay(unsigned purpose) noexcept {
  if (!options_.recorded_delay_s.empty()) {
    const double recorded = options_.recorded_delay_s[recorded_next_];
    return std::isnan(recorded) ? Duration{0} : std::max(Duration{0}, to_duration(recorded));
  }
  if (options_.jitter_s == 0.0) return fixed_delay_;
  double unit = 0.0;  // mean 0, standard deviation 1
  switch (options_.jitter_distribution) {
    case JitterDistribution::normal:
      unit = normal(random_, packet_, purpose);
      break;
    case JitterDistribution::uniform:
      unit = std::sqrt(12.0) * (random_.uniform(packet_, purpose) - 0.5);
      break;
    case JitterDistribution::pareto: {
      // Pareto tail index 3 from 1: mean 3/2, variance 3/4; never early by more than 0.58 standard deviations.
      const double pareto = std::pow(random_.uniform(packet_, purpose), -1.0 / 3.0);
      unit = (pareto - 1.5) / std::sqrt(0.75);
      break;
    }
  }
  return std::max(Duration{0}, to_duration(options_.delay_s + options_.jitter_s * unit));
}

Impairment::Fate Impairment::drawn(Duration since_start) noexcept {
  change_delay(since_start);
  Fate fate{lost(since_start) ? 0 : 1, {delay(kJitter), Duration{0}}};
  if (options_.reorder > 0.0 && random_.uniform(packet_, kReorder) < options_.reorder)
    fate.delay[0] += to_duration(options_.reorder_s);
  if (options_.duplicate > 0.0 && random_.uniform(packet_, kDuplicate) < options_.duplicate && fate.copies == 1) {
    fate.copies = 2;
    fate.delay[1] = delay(kJitterOfDuplicate);
  }
  ++packet_;
  if (!options_.recorded_delay_s.empty()) recorded_next_ = (recorded_next_ + 1) % options_.recorded_delay_s.size();
  return fate;
}

}  // namespace twoport
