#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace twoport {

/// A packet of one direction of a link that was measured or modelled.
struct TracedPacket {
  std::uint64_t sequence;
  double sent_s;   ///< of the sender's packets, from any moment on
  double delay_s;  ///< one way; NaN: the packet was lost
  [[nodiscard]] bool lost() const { return std::isnan(delay_s); }
};
/// All packets of one direction by sequence, without gaps.
using TracedWay = std::vector<TracedPacket>;
struct LinkTrace {
  TracedWay to_slave, to_master;
};

/// First line of a link's file. A row for each packet: `to_slave,17,0.016,23.4`; the delay of a lost packet is empty.
inline constexpr std::string_view kLinkTraceHeader = "direction,sequence,sent_s,delay_ms";

/// Is it a link's file, by its first line?
bool is_link_trace(std::string_view text);
/// Rows in any order; blank lines and what follows a # are skipped. Throws ConfigError that names `name` and line, the value and
/// what is allowed: a row twice, a sequence number left out, a packet sent before the one with the number before.
LinkTrace parse_link_trace(std::string_view text, const std::string& name);
/// Times to a tenth of a microsecond: packets that are read one after the other keep their order.
std::string to_csv(const LinkTrace& trace);

/// Why the delays of a file with one number a line are none; empty: they may be.
std::string why_no_delays(const std::vector<double>& ms);

/// Rows further apart than this, such as those of a ping each second, show how often packets are lost, not for how long [s].
inline constexpr double kSparse_s = 0.05;

/// Delays of the packets that a side sends at `rate_hz` over this direction [s], NaN where lost: that of the row that was on its way at
/// the time of the packet. Where the trace has the same rate to 1 %, packet k is row k. Packets of a trace arrive in the trace's
/// order, also where its sender was irregular. Of sparse rows each run of lost ones is an outage from its first to its last, and one more lost
/// row, whose share is lost of all packets, evenly.
std::vector<double> delays_at(const TracedWay& way, double rate_hz);

/// What rules that need one delay of a direction take for that of nearly every packet: with a playout buffer the least and the buffer's,
/// else the median, which a few late packets do not move [s].
inline double nominal_delay_s(double least_s, double median_s, double playout_s) {
  return playout_s > 0.0 ? least_s + playout_s : median_s;
}

/// Figures of one direction.
struct DirectionFigures {
  double received = 0.0, lost = 0.0, late = 0.0, duplicated = 0.0;  ///< packets; late: after a newer one
  double least_s = 0.0;                                             ///< smallest delay
  /// Delay above the least one: median, 99 %, largest [s]. Free of the clocks' offset.
  double jitter_p50_s = 0.0, jitter_p99_s = 0.0, jitter_max_s = 0.0;
  double longest_gap_s = 0.0;  ///< between two arrivals
  double spacing_s = 0.0;      ///< mean time between two packets that were sent
  double burst_packets = 1.0;  ///< mean number of packets lost in a row, by sequence
  /// For which nothing can have arrived, however often a packet had been sent.
  [[nodiscard]] double longest_silence_s() const { return std::max(0.0, longest_gap_s - 2.0 * spacing_s); }
  [[nodiscard]] double loss() const {
    return received + lost > duplicated ? lost / (received - duplicated + lost) : 0.0;
  }
};
/// Of a trace no packet is duplicated.
DirectionFigures figures_of(const TracedWay& way);

}  // namespace twoport
