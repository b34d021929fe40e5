#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/base/random.h"
#include "common/base/time.h"

namespace twoport {

enum class JitterDistribution : std::uint8_t { normal, uniform, pareto };

/// Two-state loss: good -> bad with probability p, bad -> good with r, per packet.
struct GilbertElliottOptions {
  double p = 0.0, r = 1.0, loss_good = 0.0, loss_bad = 1.0;
};
struct BlackoutWindow {
  double start_s = 0.0, duration_s = 0.0;
};
/// From `at_s` on the delay is `delay_s`.
struct DelayStep {
  double at_s = 0.0, delay_s = 0.0;
};

/// Impairments of one direction of the network.
struct ImpairmentOptions {
  double delay_s = 0.0;
  double jitter_s = 0.0;  ///< standard deviation, whatever the distribution
  JitterDistribution jitter_distribution = JitterDistribution::normal;
  double loss = 0.0;
  std::optional<GilbertElliottOptions> burst;
  std::vector<BlackoutWindow> blackout;
  double duplicate = 0.0;
  double reorder = 0.0, reorder_s = 0.005;
  std::vector<double> recorded_delay_s;  ///< replayed in a loop in place of delay and jitter; NaN: lost; empty: none
  std::vector<DelayStep> delay_step{};   ///< in the order of their times
};

/// Longest delay, up to ten standard deviations of jitter [s].
double longest_delay_s(const ImpairmentOptions& options);
/// Capacity for the packets in flight at `rate_hz`, all duplicated.
std::size_t packets_in_flight(const ImpairmentOptions& options, double rate_hz);

/// What the seeds of the two directions are made from, with the scene's.
inline constexpr std::uint64_t kToSlaveStream = 0x70736c61, kToMasterStream = 0x746d6173;

/// Number of copies and delay of each packet of one direction: a function of the seed and of the packet's number. Only
/// the state of a loss burst and the place in a recording are carried from packet to packet. The same code serves real
/// datagrams and virtual time.
class Impairment {
 public:
  struct Fate {
    int copies;  ///< 0: lost
    Duration delay[2];
  };

  Impairment(const ImpairmentOptions& options, std::uint64_t seed);

  /// Fate of the packet sent `since_start` after the run began. No allocation.
  Fate draw(Duration since_start) noexcept {
    return certain_ ? Fate{1, {fixed_delay_, fixed_delay_}} : drawn(since_start);
  }
  /// Does every packet arrive once, after fixed_delay()?
  [[nodiscard]] bool certain() const noexcept { return certain_; }
  [[nodiscard]] Duration fixed_delay() const noexcept { return fixed_delay_; }
  /// From now on there are no blackouts and no steps of the delay.
  void keep_as_it_is() noexcept { options_.blackout.clear(), options_.delay_step.clear(); }
  /// Changes delay, jitter and loss from the next packet on.
  void adjust(double delay_s, double jitter_s, double loss) noexcept;

 private:
  Fate drawn(Duration since_start) noexcept;
  [[nodiscard]] bool lost(Duration since_start) noexcept;
  [[nodiscard]] Duration delay(unsigned purpose) noexcept;
  /// Takes the delay of the last step that is due.
  void change_delay(Duration since_start) noexcept;

  [[nodiscard]] bool is_certain() const noexcept;

  ImpairmentOptions options_;
  Random random_;
  Duration fixed_delay_;
  bool certain_;
  bool bad_state_ = false;
  std::uint64_t packet_ = 0;  ///< number of the one that is drawn
  std::size_t recorded_next_ = 0, steps_done_ = 0;
};

}  // namespace twoport
