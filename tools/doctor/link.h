#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <limits>
#include <span>
#include <string>

#include "common/base/histogram.h"
#include "common/link/clock_offset.h"
#include "common/link/link_trace.h"

namespace twoport::doctor {

/// A packet as it has arrived, each copy by itself.
struct Arrival {
  std::uint64_t sequence = 0;  ///< from 1 on; 0: not known yet
  double sent_s = 0.0;         ///< by the sender's clock
  double transit_s = 0.0;      ///< received by the receiver's clock less sent by the sender's
};

/// One direction, and how many of its packets were copies.
struct HeardWay {
  TracedWay packets;
  double duplicated = 0.0;

  [[nodiscard]] DirectionFigures figures() const {
    DirectionFigures f = figures_of(packets);
    f.received += duplicated;
    f.duplicated = duplicated;
    return f;
  }
};

/// The packets of one direction from the first that has arrived up to number `last`; those that have not arrived are lost, and sent between
/// their neighbours. `arrivals` in their order. `delay_less_s` is subtracted from each transit, `sent_less_s` from each moment.
inline HeardWay way_of(std::span<const Arrival> arrivals, std::uint64_t last, double delay_less_s, double sent_less_s) {
  HeardWay heard;
  std::uint64_t first = last + 1;
  for (const Arrival& a : arrivals) first = std::min(first, a.sequence);
  TracedWay& way = heard.packets;
  for (std::uint64_t sequence = first; sequence <= last; ++sequence)
    way.push_back({sequence, 0.0, std::numeric_limits<double>::quiet_NaN()});
  for (const Arrival& a : arrivals) {
    if (a.sequence > last) continue;
    TracedPacket& packet = way[a.sequence - first];
    if (!packet.lost()) {
      ++heard.duplicated;
      continue;
    }
    packet.sent_s = a.sent_s - sent_less_s;
    packet.delay_s = std::max(0.0, a.transit_s - delay_less_s);
  }
  while (!way.empty() && way.back().lost()) way.pop_back();  // the last ones may still be on their way
  for (std::size_t i = 1, known = 0; i < way.size(); ++i) {
    if (way[i].lost()) continue;
    way[i].sent_s = std::max(way[i].sent_s, way[known].sent_s);  // a clock that was corrected
    const double step_s = (way[i].sent_s - way[known].sent_s) / static_cast<double>(i - known);
    for (std::size_t lost = known + 1; lost < i; ++lost)
      way[lost].sent_s = way[known].sent_s + step_s * static_cast<double>(lost - known);
    known = i;
  }
  return heard;
}

/// The receiver's clock less the sender's, if the fastest packet took as long there as back.
inline double clocks_apart_s(std::span<const Arrival> there, std::span<const Arrival> back) {
  const auto least = [](std::span<const Arrival> all) {
    double s = std::numeric_limits<double>::infinity();
    for (const Arrival& a : all) s = std::min(s, a.transit_s);
    return s;
  };
  return 0.5 * (least(there) - least(back));
}

struct LinkRequest {
  std::string address;  ///< of the side that answers
  std::string key;      ///< file; empty: none
  bool insecure = false;
  double rate_hz = 1000.0, seconds = 10.0;
};

struct LinkFigures {
  double seconds = 0.0;
  double silent_s = 0.0;  ///< nothing came since; the figures are of what came before. 0: it came to the end
  double sent = 0.0;
  bool encrypted = false;
  Histogram round_trip;
  bool clock_known = false;
  ClockFigures clock{};  ///< of the other side; one_way_s is the delay to this side
  HeardWay to_slave, to_master;
  [[nodiscard]] LinkTrace trace() const { return {to_slave.packets, to_master.packets}; }
};
/// Packets of one direction that a measurement may have: what a file of them may have at most.
inline constexpr double kMostPackets = 800'000;

/// Exchanges the programs' own packets with `answer` at the other end: same codec, handshake, encryption, rate. Throws ConfigError
/// and IoError with one sentence.
LinkFigures measure_link(const LinkRequest& request, const std::atomic<bool>& stop);

/// Answers until `stop`, or for `seconds`.
void answer(const LinkRequest& request, const std::atomic<bool>& stop);

}  // namespace twoport::doctor
