#pragma once

#include <algorithm>
#include <bitset>
#include <cstdint>
#include <utility>

#include "common/base/time.h"
#include "common/link/report.h"

namespace twoport {

/// What happened to the packets of one direction, as the receiver knows it. Within a session each sequence number from
/// the first to the newest heard is counted once:
///
///     newest - first + 1 = received - duplicated + lost
struct PacketCounts {
  std::uint64_t sent = 0;        ///< by this side
  std::uint64_t received = 0;    ///< accepted, late and repeated ones included
  std::uint64_t lost = 0;        ///< gaps in the sequence that were never filled
  std::uint64_t late = 0;        ///< older than one already seen
  std::uint64_t duplicated = 0;
  std::uint64_t rejected = 0;    ///< did not parse, wrong session, not finite
};

/// What is known of the other side: its newest report, the most energy it has ever said to have taken in, and
/// when it was last heard.
template <int N>
struct Known {
  Report<N> newest;
  double energy_in_j = 0.0;   ///< largest ever received: knowledge only grows
  bool any = false;           ///< has a report arrived in this session
  bool fresh = false;         ///< has a newer one arrived in this tick
  Duration heard{0};          ///< local time of the newest
  Duration round_trip{-1};    ///< of the newest; -1 where it is not known
};

/// Keeps what arrives, in any order and any number of times. The transport hands over reports; the newest sequence
/// wins, the largest energy wins.
///
///     transport.poll(now, f)   calls f(report) for every report that has arrived
///     transport.send(report)
template <int N, class Transport>
class Mailbox {
 public:
  explicit Mailbox(Transport transport) : transport_{std::move(transport)} {}

  const Known<N>& collect(Duration now) noexcept {
    known_.fresh = false;
    transport_.poll(now, [&](const Report<N>& r) { offer(r, now); });
    return known_;
  }

  /// Stamps the report and sends it.
  void post(Report<N>& report, Duration now) noexcept {
    report.sequence = ++counts_.sent;
    report.sent_ns = now.count();
    report.echo_ns = known_.any ? known_.newest.sent_ns + (now - known_.heard).count() : -1;
    transport_.send(report, now);
  }
  void post(Report<N>&& report, Duration now) noexcept { post(report, now); }

  /// A new session of the other side: its running totals start again from zero.
  void forget() noexcept {
    known_ = {};
    first_ = 0;
    seen_.reset();
  }

  [[nodiscard]] const Known<N>& known() const noexcept { return known_; }
  [[nodiscard]] const PacketCounts& counts() const noexcept { return counts_; }
  [[nodiscard]] Transport& transport() noexcept { return transport_; }

 private:
  /// How far back repeats are told from late arrivals; an older one counts as repeated.
  static constexpr std::uint64_t kMemory = 4096;

  void offer(const Report<N>& r, Duration now) noexcept {
    if (!r.finite()) {
      ++counts_.rejected;
      return;
    }
    ++counts_.received;
    known_.energy_in_j = std::max(known_.energy_in_j, r.energy_in_j);
    if (known_.any && r.sequence <= known_.newest.sequence) return count_old(r.sequence);
    if (known_.any) {
      count_gap(known_.newest.sequence, r.sequence);
    } else {
      first_ = r.sequence;
    }
    seen_[r.sequence % kMemory] = true;
    known_.newest = r;
    known_.heard = now;
    known_.any = known_.fresh = true;
    known_.round_trip = r.echo_ns >= 0 ? now - Duration{r.echo_ns} : Duration{-1};
  }

  /// What lies between is missing until it comes.
  void count_gap(std::uint64_t newest, std::uint64_t next) noexcept {
    counts_.lost += next - newest - 1;
    if (next - newest >= kMemory) {
      seen_.reset();
    } else {
      for (std::uint64_t s = newest + 1; s < next; ++s) seen_[s % kMemory] = false;
    }
  }

  /// An old report fills the gap it left, unless it is a copy. One older than the first heard opens a gap behind it.
  void count_old(std::uint64_t sequence) noexcept {
    const bool before_first = sequence < first_;
    const bool remembered = known_.newest.sequence - sequence < kMemory;
    if (!before_first && (!remembered || seen_[sequence % kMemory])) {
      ++counts_.duplicated;
      return;
    }
    ++counts_.late;
    if (before_first) {
      counts_.lost += first_ - sequence - 1;
      first_ = sequence;
    } else {
      --counts_.lost;
    }
    if (remembered) seen_[sequence % kMemory] = true;
  }

  Transport transport_;
  Known<N> known_;
  PacketCounts counts_;
  std::uint64_t first_ = 0;     ///< lowest sequence heard
  std::bitset<kMemory> seen_;  ///< of the last kMemory sequences
};

}  // namespace twoport
