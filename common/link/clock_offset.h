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
/// the packet with the smallest round trip of each second counts. Drift: least squares through these. The one-way delay of the
/// received packets has the same error: a delay common to one direction cannot be told from an offset.
class ClockOffset {
 public:
  /// Call in every tick.
  template <int N>
  void step(const PeerState<N>& peer) noexcept {
    if (!peer.is_new || peer.newest.echo_ns < 0) return;
    const double received = to_seconds(peer.received_at).si(), sent = to_seconds(Duration{peer.newest.sent_ns}).si(),
                 echo = to_seconds(Duration{peer.newest.echo_ns}).si();
    const std::int64_t second = peer.received_at / std::chrono::seconds{1};
    if (second > second_) {
      if (best_.round_trip < kNone) add(best_);
      best_ = {};
      second_ = second;
    }
    if (const double round_trip = received - echo; round_trip < best_.round_trip)
      best_ = {received, sent - 0.5 * (echo + received), round_trip};
    const double weight = 1.0 / static_cast<double>(++packets_);
    mean_transit_ += weight * (received - sent - mean_transit_);
    mean_at_ += weight * (received - mean_at_);
  }

  [[nodiscard]] bool known() const noexcept { return packets_ > 0 && (seconds_ > 0 || best_.round_trip < kNone); }
  [[nodiscard]] ClockFigures figures(double t_s) const noexcept {
    return {offset_s(t_s), bound_s(), drift(), one_way_s()};
  }
  /// The other clock less this one at the local time `t_s` [s].
  [[nodiscard]] double offset_s(double t_s) const noexcept {
    const Sample& s = least();
    return s.offset + drift() * (t_s - s.at);
  }
  /// Bound of its error, from the round trip of the sample used [s].
  [[nodiscard]] double bound_s() const noexcept { return 0.5 * least().round_trip; }
  /// Rate of the other clock less that of this one [s/s]; 0 before four seconds.
  [[nodiscard]] double drift() const noexcept {
    const double n = static_cast<double>(seconds_), spread = tt_ - t_ * t_ / n;
    return seconds_ < 4 || !(spread > 0.0) ? 0.0 : (to_ - t_ * o_ / n) / spread;
  }
  /// Mean one-way delay of the received packets [s].
  [[nodiscard]] double one_way_s() const noexcept { return mean_transit_ + offset_s(mean_at_); }

 private:
  static constexpr double kNone = 1e18;
  struct Sample {
    double at = 0.0, offset = 0.0, round_trip = kNone;
  };

  /// The best sample of a second. Sums are taken about the first one, which keeps their digits.
  void add(const Sample& s) noexcept {
    if (seconds_ == 0) first_ = s;
    const double t = s.at - first_.at, o = s.offset - first_.offset;
    ++seconds_;
    t_ += t, o_ += o, tt_ += t * t, to_ += t * o;
    if (s.round_trip <= least_.round_trip) least_ = s;
  }
  [[nodiscard]] const Sample& least() const noexcept { return best_.round_trip < least_.round_trip ? best_ : least_; }

  Sample best_, least_, first_;  ///< of this second; of all seconds; of the first
  std::int64_t second_ = -1, packets_ = 0, seconds_ = 0;
  double t_ = 0.0, o_ = 0.0, tt_ = 0.0, to_ = 0.0;
  double mean_transit_ = 0.0, mean_at_ = 0.0;
};

}  // namespace twoport
