#pragma once

#include <optional>
#include <string>

#include "common/link/endpoint.h"
#include "common/platform/udp.h"
#include "common/record/row.h"
#include "common/wire/header.h"

namespace twoport {

struct TickView;

/// Rows of a live run as UDP datagrams to PlotJuggler, or whoever reads JSON lines: one object each, at most `rate_hz` of them per
/// second of the run. Called from the recording thread; sending never waits, and what nobody receives is lost.
class PlotStream {
 public:
  /// `address`: HOST:PORT of --stream. Throws ConfigError.
  PlotStream(const std::string& address, Side side, double rate_hz, bool of_gripper = false);

  /// False: whoever can read the network can read the stream.
  [[nodiscard]] bool stays_on_this_machine() const { return to_.loopback(); }

  /// {"timestamp": t_s, "SIDE": {NAME: number or [numbers], ...}}: the columns of trace.csv, and round_trip_ms, received, lost and
  /// late_us of the link and the loop. Of a gripper {"timestamp": t_s, "SIDE": {"gripper": {NAME: ...}}}, the columns alone. What is
  /// not known or not finite is null.
  template <int N>
  void add(const Row<N>& row, const TickView& view);

 private:
  Endpoint to_;
  UdpSocket socket_;
  Side side_;
  double period_s_;
  bool of_gripper_;
  std::optional<double> next_s_;
  std::string line_;
};

}  // namespace twoport
