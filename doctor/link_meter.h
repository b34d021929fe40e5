#pragma once

#include <algorithm>
#include <bitset>
#include <cmath>
#include <cstdint>
#include <vector>

#include "common/base/time.h"
#include "common/link/payload.h"

namespace twoport::doctor {

/// Figures of one direction, at its receiver.
struct DirectionFigures {
  double received = 0.0, lost = 0.0, late = 0.0, duplicated = 0.0;  ///< packets; late: after a newer one
  /// Transit time above the least one: median, 99 %, largest [s]. Free of the clocks' offset.
  double jitter_p50_s = 0.0, jitter_p99_s = 0.0, jitter_max_s = 0.0;
  double longest_gap_s = 0.0;  ///< between two arrivals
  double burst_packets = 1.0;  ///< mean number of packets lost in a row
  [[nodiscard]] double loss() const {
    return received + lost > duplicated ? lost / (received - duplicated + lost) : 0.0;
  }
};

/// As numbers of a packet: the side that answers sends its own figures back.
inline Words to_words(const DirectionFigures& f) {
  Words w;
  for (const double v : {f.received, f.lost, f.late, f.duplicated, f.jitter_p50_s, f.jitter_p99_s, f.jitter_max_s,
                         f.longest_gap_s, f.burst_packets})
    payload::put(w, v);
  return w;
}
inline bool from_words(const Words& w, DirectionFigures& f) {
  if (w.count != 9) return false;
  f = {w.at[0], w.at[1], w.at[2], w.at[3], w.at[4], w.at[5], w.at[6], w.at[7], w.at[8]};
  return true;
}

/// Counts the packets of one direction.
class DirectionMeter {
 public:
  DirectionMeter() { transits_s_.reserve(kMost); }

  void on(std::uint64_t sequence, Duration sent, Duration received) {
    if (received_ == 0) {
      first_ = newest_ = sequence;
      seen_.reset();
    }
    ++received_;
    if (received_ > 1) longest_gap_ = std::max(longest_gap_, received - last_arrival_);
    last_arrival_ = received;
    if (transits_s_.size() < kMost) transits_s_.push_back(to_seconds(received - sent).si());
    if (sequence > newest_) {
      if (sequence > newest_ + 1) ++gaps_;
      for (std::uint64_t s = newest_ + 1; s < std::min(sequence, newest_ + kMemory); ++s) seen_[s % kMemory] = false;
      newest_ = sequence;
    } else if (received_ > 1) {
      if (newest_ - sequence >= kMemory || sequence < first_ || seen_[sequence % kMemory]) {
        ++duplicated_;
        return;
      }
      ++late_;
    }
    seen_[sequence % kMemory] = true;
    ++unique_;
  }

  /// Since the last packet.
  [[nodiscard]] Duration silence(Duration now) const { return received_ > 0 ? now - last_arrival_ : now; }
  /// `now`: a silence up to now is a gap too.
  [[nodiscard]] DirectionFigures figures(Duration now) const {
    DirectionFigures f;
    f.received = static_cast<double>(received_);
    f.late = static_cast<double>(late_);
    f.duplicated = static_cast<double>(duplicated_);
    if (received_ > 0) f.lost = static_cast<double>(newest_ - first_ + 1 - unique_);
    f.longest_gap_s = to_seconds(received_ > 0 ? std::max(longest_gap_, now - last_arrival_) : longest_gap_).si();
    f.burst_packets = gaps_ > 0 ? std::max(1.0, f.lost / static_cast<double>(gaps_)) : 1.0;
    if (transits_s_.empty()) return f;
    std::vector<double> sorted = transits_s_;
    std::sort(sorted.begin(), sorted.end());
    const auto above_least = [&](double p) {
      const auto rank = static_cast<std::size_t>(std::ceil(p * static_cast<double>(sorted.size())));
      return sorted[std::max<std::size_t>(rank, 1) - 1] - sorted.front();
    };
    f.jitter_p50_s = above_least(0.5);
    f.jitter_p99_s = above_least(0.99);
    f.jitter_max_s = above_least(1.0);
    return f;
  }

 private:
  static constexpr std::size_t kMost = 200000;     ///< transit times kept
  static constexpr std::uint64_t kMemory = 65536;  ///< sequence numbers for which late and repeated are told apart

  std::uint64_t received_ = 0, unique_ = 0, late_ = 0, duplicated_ = 0, gaps_ = 0, first_ = 0, newest_ = 0;
  Duration last_arrival_{0}, longest_gap_{0};
  std::vector<double> transits_s_;
  std::bitset<kMemory> seen_;
};

/// What a scene for this network should say.
struct LinkAdvice {
  double delay_ms = 0.0, loss = 0.0, burst_packets = 1.0;  ///< for `recommend`: the worse direction
  double playout_to_slave_ms = 0.0, playout_to_master_ms = 0.0, hold_after_s = 0.1;
};

/// playout: nothing below a millisecond of jitter (99 %), else that jitter, rounded up. hold_after_s: four times the longest gap,
/// rounded up to 50 ms, at least the default 0.1 s. Delay: half of the round trip, playout included.
inline LinkAdvice advise(double round_trip_s, const DirectionFigures& to_slave, const DirectionFigures& to_master) {
  const auto playout_ms = [](const DirectionFigures& f) {
    return f.jitter_p99_s < 1e-3 ? 0.0 : std::ceil(1e3 * f.jitter_p99_s - 1e-9);
  };
  LinkAdvice a;
  a.playout_to_slave_ms = playout_ms(to_slave);
  a.playout_to_master_ms = playout_ms(to_master);
  a.delay_ms = 500.0 * round_trip_s + std::max(a.playout_to_slave_ms, a.playout_to_master_ms);
  a.loss = std::max(to_slave.loss(), to_master.loss());
  a.burst_packets = std::max(to_slave.burst_packets, to_master.burst_packets);
  const double gap_s = std::max(to_slave.longest_gap_s, to_master.longest_gap_s);
  a.hold_after_s = std::max(0.1, 0.05 * std::ceil(4.0 * gap_s / 0.05 - 1e-9));
  return a;
}

}  // namespace twoport::doctor
