#pragma once

#include <cstdint>
#include <optional>

#include "common/base/time.h"
#include "common/link/mailbox.h"

namespace twoport {

/// An estimate of the other side's clock.
struct ClockFigures {
  double offset_s;                  ///< other clock less own
  double bound_s;                   ///< of the error of offset and one-way delay
  double drift;                     ///< [s/s]
  double one_way_s;                 ///< mean delay of the received packets
  std::optional<double> error_s{};  ///< of offset_s, where the clock is known
};

/// Estimates the other side's clock from the time stamps of its reports, as NTP does. With the stamps of a packet and its echo
///
///     θ = t_sent - (t_echo + t_received)/2          other clock less own, if both ways take equally long
///     |error of θ| <= round trip / 2                whatever the asymmetry; RFC 5905, section 8
///
/// the packet with the smallest round trip counts. Drift: least squares through the means of each second, from which a constant
/// asymmetry drops out. The one-way delay of the received packets has the offset's error: a delay common to one direction cannot
/// be told from an offset.
class ClockOffset {
 public:
  /// Call in every tick.
  template <int N>
  void step(const PeerState<N>& peer) noexcept {
    if (!peer.is_new || peer.newest.echo_ns < 0) return;
    const double received = to_seconds(peer.received_at).si(), sent = to_seconds(Duration{peer.newest.sent_ns}).si(),
                 echo = to_seconds(Duration{peer.newest.echo_ns}).si();
    if (echo > received) return;  // nobody has sent this back
    const std::int64_t second = peer.received_at / std::chrono::seconds{1};
    if (second > second_) {
      if (in_second_ > 0) add();
      second_ = second;
      in_second_ = 0;
      mean_ = {};
    }
    const Sample now{received, sent - 0.5 * (echo + received), received - echo};
    if (now.round_trip <= least_.round_trip) least_ = now;
    ++in_second_;
    mean_.at += (now.at - mean_.at) / in_second_;
    mean_.offset += (now.offset - mean_.offset) / in_second_;
    const double weight = 1.0 / static_cast<double>(++packets_);
    mean_transit_ += weight * (received - sent - mean_transit_);
    mean_at_ += weight * (received - mean_at_);
  }

  [[nodiscard]] bool known() const noexcept { return packets_ > 0; }
  [[nodiscard]] ClockFigures figures(double t_s) const noexcept {
    return {offset_s(t_s), bound_s(), drift(), one_way_s()};
  }
  /// The other clock less this one at the local time `t_s` [s].
  [[nodiscard]] double offset_s(double t_s) const noexcept { return least_.offset + drift() * (t_s - least_.at); }
  /// Bound of its error, from the round trip of the sample used [s].
  [[nodiscard]] double bound_s() const noexcept { return 0.5 * least_.round_trip; }
  /// Rate of the other clock less that of this one [s/s]; 0 before four seconds.
  [[nodiscard]] double drift() const noexcept {
    const double n = static_cast<double>(seconds_), spread = tt_ - t_ * t_ / n;
    return seconds_ < 4 || !(spread > 0.0) ? 0.0 : (to_ - t_ * o_ / n) / spread;
  }
  /// Mean one-way delay of the received packets [s].
  [[nodiscard]] double one_way_s() const noexcept { return mean_transit_ + offset_s(mean_at_); }

 private:
  struct Sample {
    double at = 0.0, offset = 0.0, round_trip = 1e18;
  };

  /// The mean of a second. Sums are taken about the first one, which keeps their digits.
  void add() noexcept {
    if (seconds_ == 0) first_ = mean_;
    const double t = mean_.at - first_.at, o = mean_.offset - first_.offset;
    ++seconds_;
    t_ += t, o_ += o, tt_ += t * t, to_ += t * o;
  }

  Sample least_, mean_, first_;  ///< of all packets; of this second; of the first second
  std::int64_t second_ = -1, packets_ = 0, seconds_ = 0;
  double in_second_ = 0.0;  ///< packets
  double t_ = 0.0, o_ = 0.0, tt_ = 0.0, to_ = 0.0;
  double mean_transit_ = 0.0, mean_at_ = 0.0;
};

}  // namespace twoport
