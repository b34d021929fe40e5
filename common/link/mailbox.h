#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <utility>

#include "common/base/time.h"
#include "common/link/age.h"
#include "common/link/deadband.h"
#include "common/link/playout.h"
#include "common/link/report.h"

namespace twoport {

/// Packet counts of one direction at the receiver. Within a session (and since the last restart of the count,
/// see Mailbox) each sequence number from the first to the newest received is counted once:
///
///     newest - first + 1 = received - duplicated + lost
struct PacketCounts {
  std::uint64_t sent = 0;      ///< by this side
  std::uint64_t received = 0;  ///< accepted, late and repeated ones included
  std::uint64_t lost = 0;      ///< gaps in the sequence that were never filled
  std::uint64_t late = 0;      ///< older than one already seen
  std::uint64_t duplicated = 0;
  std::uint64_t rejected = 0;  ///< sequence too far ahead of the newest to be true; not in `received`
  std::uint64_t stale = 0;     ///< newer than all before, but not proven young (ReportAge)
};

/// State of the other side: its newest report that was proven young when it arrived, the largest absorbed energy that it has
/// reported, and times. A report that is not young changes energies and `heard` only.
template <int N>
struct PeerState {
  /// Of the newest report that has arrived, whatever its age.
  struct Heard {
    std::uint64_t sequence = 0;
    std::int64_t sent_ns = -1;
    Duration at{0};  ///< local time
    Mode mode = Mode::idle;
    bool is_new = false;  ///< in this tick
    bool answers = true;  ///< does it send back a newer stamp of this side than those before?
  };

  PortReport<N> newest;
  Heard heard;
  double energy_in_j = 0.0;  ///< largest ever received
  Words words;               ///< of the method, merged by its rules
  std::uint32_t epoch = 0;   ///< of energy and words
  bool has_report = false;   ///< has a young report arrived in this session
  bool is_new = false;       ///< has a newer one arrived in this tick
  Duration received_at{0};   ///< local time of the newest
  Duration proven_at{
      0};  ///< local time until which the newest is as good as new: that of its echo and a round trip, if earlier
  Duration known_round_trip{0};  ///< ReportAge::round_trip()

  /// Of the newest; -1 where it is not known.
  [[nodiscard]] Duration round_trip() const noexcept {
    return newest.echo_ns >= 0 ? received_at - Duration{newest.echo_ns} : Duration{-1};
  }
};

/// Merges reports that arrive in any order and any number of times: keeps the state of the newest sequence number that was proven
/// young, and the largest energy. The transport delivers finite reports only.
///
///     transport.poll(now, f)   calls f(report) for every report that has arrived
///     transport.send(report, now)
template <int N, class Transport>
class Mailbox {
 public:
  explicit Mailbox(Transport transport, const AgeOptions& age = {}, const TransmissionOptions& incoming = {},
                   const TransmissionOptions& outgoing = {})
      : transport_{std::move(transport)}, age_{age} {
    if (incoming.playout_s > 0.0) playout_.emplace(incoming.playout_s);
    if (outgoing.deadband) deadband_.emplace(*outgoing.deadband);
  }

  const PeerState<N>& collect(Duration now) noexcept {
    known_.is_new = known_.heard.is_new = false;
    if (began_at_ == kNotYet) [[unlikely]]
      began_at_ = now;
    if (playout_) [[unlikely]]
      return collect_in_time(now);
    transport_.poll(now, [&](const Report<N>& r) { offer(r, now); });
    return known_;
  }

  /// Stamps the report and sends it.
  void post(PortReport<N>& report, Duration now) noexcept {
    if (deadband_ && !deadband_->tells(report, now)) [[unlikely]]
      return;
    stamp(report, now);
    transport_.send(report, now);
  }
  void post(PortReport<N>&& report, Duration now) noexcept { post(report, now); }
  /// The same with the method's words. By value: a report without words stays in registers.
  void post(PortReport<N> report, const Words& words, Duration now) noexcept {
    if (deadband_ && !deadband_->tells(report, now)) return;
    stamp(report, now);
    Report<N> packet{report};
    packet.words = words;
    transport_.send(packet, now);
  }

  /// A new session of the other side, all of whose reports were made after the local time `since`: its running totals start
  /// again from zero.
  void reset(Duration since) noexcept {
    known_ = {};
    age_.reset();
    began_at_ = since;
    first_ = 1;
    suspect_ = 0;
    older_for_ = older_at_ = Duration{0};
    seen_.fill(false);
    if (playout_) playout_->clear();
  }

  [[nodiscard]] const PeerState<N>& known() const noexcept { return known_; }
  [[nodiscard]] const PacketCounts& counts() const noexcept { return counts_; }
  [[nodiscard]] Transport& transport() noexcept { return transport_; }

 private:
  /// Number of sequence numbers for which late and repeated packets are distinguished; an older one counts as repeated.
  static constexpr std::uint64_t kMemory = 4096;
  /// Of a sender.
  static constexpr Duration kShortestPeriod = std::chrono::microseconds{10};
  static constexpr Duration kLongestPeriod = std::chrono::milliseconds{20};
  /// If only older reports arrive for this long, two consecutive ones restart the count.
  static constexpr Duration kDeaf = std::chrono::seconds{1};

  enum class Order : std::uint8_t { newer, older, impossible };

  const PeerState<N>& collect_in_time(Duration now) noexcept {
    transport_.poll(now, [&](const Report<N>& r) { playout_->put(r, now); });
    while (const Report<N>* r = playout_->take(now)) offer(*r, now);
    return known_;
  }

  void stamp(PortReport<N>& report, Duration now) noexcept {
    report.sequence = ++counts_.sent;
    report.sent_ns = now.count();
    const auto& heard = known_.heard;
    report.echo_ns = heard.sent_ns >= 0 ? heard.sent_ns + std::min(now - heard.at, age_.longest_wait()).count() : -1;
  }

  void offer(const Report<N>& r, Duration now) noexcept {
    Order order = Order::newer;
    if (r.sequence != known_.heard.sequence + 1) [[unlikely]] {
      order = count(r.sequence, now);
      if (order == Order::impossible) {
        ++counts_.rejected;
        return;
      }
    }
    ++counts_.received;
    const bool newer = order == Order::newer;
    const bool young = newer && is_young(r, now);
    if (r.epoch != known_.epoch && newer) [[unlikely]]
      begin_epoch(r.epoch);
    if (r.epoch == known_.epoch) [[likely]] {
      known_.energy_in_j = std::max(known_.energy_in_j, r.energy_in_j);
      known_.words.merge(r.words, young);
    }
    if (!newer) return;
    seen_[r.sequence % kMemory] = true;
    known_.heard = {r.sequence, r.sent_ns, now, r.mode, true, age_.is_answered()};
    if (!young) [[unlikely]] {
      ++counts_.stale;
      return;
    }
    known_.newest = r;
    known_.received_at = now;
    known_.known_round_trip = age_.round_trip();
    known_.proven_at = std::min(now, made_after(r) + known_.known_round_trip);
    known_.has_report = known_.is_new = true;
  }

  /// The latest own time of which `r` proves that it was made later.
  [[nodiscard]] Duration made_after(const Report<N>& r) const noexcept {
    return r.echo_ns >= 0 ? Duration{r.echo_ns} : began_at_;
  }
  [[nodiscard]] bool is_young(const Report<N>& r, Duration now) noexcept {
    return r.echo_ns >= 0 ? age_.admits(Duration{r.echo_ns}, now) : age_.admits_first(began_at_, now);
  }

  /// Another method: its totals start from zero; those of other epochs are ignored. The newest packet decides, so a wrong
  /// epoch lasts until the next right one, whose totals are whole.
  void begin_epoch(std::uint32_t epoch) noexcept {
    known_.epoch = epoch;
    known_.energy_in_j = 0.0;
    known_.words = {};
  }

  /// A sequence number that is not the next. One further ahead than the sender can have reached is rejected unless its
  /// successor follows; the count restarts if only older numbers arrive for a second. A wrong number therefore blocks
  /// reception for at most a second.
  Order count(std::uint64_t sequence, Duration now) noexcept {
    if (known_.heard.sequence == 0) return begin(sequence);
    const std::uint64_t newest = known_.heard.sequence;
    const bool follows = sequence == std::exchange(suspect_, sequence) + 1;
    if (sequence > newest) {
      if (sequence - newest > kMemory + static_cast<std::uint64_t>((now - known_.heard.at) / kShortestPeriod))
        return follows ? begin(sequence) : Order::impossible;
      count_gap(sequence);
      return Order::newer;
    }
    // Time without polling does not count.
    older_for_ = older_at_ > known_.heard.at ? older_for_ + std::min(now - older_at_, kLongestPeriod) : Duration{0};
    older_at_ = now;
    if (follows && older_for_ > kDeaf) return begin(sequence);
    count_old(sequence);
    return Order::older;
  }

  Order begin(std::uint64_t sequence) noexcept {
    first_ = sequence;
    seen_.fill(false);
    return Order::newer;
  }

  /// The numbers between are missing until they arrive.
  void count_gap(std::uint64_t next) noexcept {
    const std::uint64_t newest = known_.heard.sequence;
    counts_.lost += next - newest - 1;
    if (next - newest >= kMemory) {
      seen_.fill(false);
    } else {
      for (std::uint64_t s = newest + 1; s < next; ++s) seen_[s % kMemory] = false;
    }
  }

  /// An old report fills the gap it left, unless it is a copy. One older than the first received opens a gap behind it.
  void count_old(std::uint64_t sequence) noexcept {
    const bool remembered = known_.heard.sequence - sequence < kMemory;
    const bool before_first = sequence < first_;
    if (before_first ? first_ - sequence > kMemory : !remembered || seen_[sequence % kMemory]) {
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

  static constexpr Duration kNotYet = Duration::min();

  Transport transport_;
  PeerState<N> known_;
  ReportAge age_;
  Duration began_at_ = kNotYet;  ///< the session; without one the first collect()
  PacketCounts counts_;
  std::uint64_t first_ = 1;              ///< lowest sequence received since the count began
  std::uint64_t suspect_ = 0;            ///< the last sequence that was not the next
  Duration older_for_{0}, older_at_{0};  ///< time with older reports only, and time of the last
  std::array<bool, kMemory> seen_{};     ///< of the last kMemory sequences
  std::optional<Playout<N>> playout_;
  std::optional<Deadband<N>> deadband_;
};

}  // namespace twoport
