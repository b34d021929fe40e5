#pragma once

#include <atomic>
#include <string>

#include "common/base/histogram.h"
#include "common/link/clock_offset.h"
#include "tools/doctor/link_meter.h"

namespace twoport::doctor {

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
