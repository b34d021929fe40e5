#include "common/platform/plot_stream.h"

#include <cmath>
#include <iterator>
#include <span>
#include <string_view>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "common/base/fmt.h"
#include "common/base/time.h"
#include "common/platform/recorder.h"
#include "common/record/columns.h"

namespace twoport {
namespace {

void append(std::string& line, double value) {
  if (std::isfinite(value)) {
    fmt::format_to(std::back_inserter(line), "{:.7g}", value);
  } else {
    line += "null";
  }
}
template <class Vector>
void append(std::string& line, const Vector& v) {
  for (int i = 0; i < v.size(); ++i) append(line += i == 0 ? '[' : ',', v[i]);
  line += ']';
}
void append_named(std::string& line, std::string_view name, const auto& value) {
  fmt::format_to(std::back_inserter(line), ",\"{}\":", name);
  append(line, value);
}

}  // namespace

PlotStream::PlotStream(const std::string& address, Side side, double rate_hz, bool of_gripper)
    : to_{parse_endpoint(address, "--stream")},
      socket_{any_port_toward(to_)},
      side_{side},
      period_s_{1.0 / rate_hz},
      of_gripper_{of_gripper} {
  if (to_.port == 0)
    throw ConfigError{"--stream " + address +
                      ": the port is 0; it must be from 1 to 65535, for example 9870, PlotJuggler's"};
}

template <int N>
void PlotStream::add(const Row<N>& row, const TickView& view) {
  if (next_s_ && row.t_s < *next_s_) return;
  next_s_ = next_s_ && row.t_s < *next_s_ + period_s_ ? *next_s_ + period_s_ : row.t_s + period_s_;
  line_ = "{\"timestamp\":";
  append(line_, row.t_s);
  fmt::format_to(std::back_inserter(line_), ",\"{}\":{{", to_string(side_));
  if (of_gripper_) {
    line_ += "\"gripper\":{";
  } else {
    append_named(line_, "round_trip_ms", view.round_trip >= Duration{0} ? 1e3 * to_seconds(view.round_trip).si() : NAN);
    append_named(line_, "received", static_cast<double>(view.received));
    append_named(line_, "lost", static_cast<double>(view.lost));
    append_named(line_, "late_us", 1e6 * to_seconds(view.late).si());
  }
  for_each_column(row, [&](const Column& column, const auto& value) { append_named(line_, column.name, value); });
  line_.erase(line_.find("{,") + 1, 1);
  line_ += of_gripper_ ? "}}}\n" : "}}\n";
  socket_.send(std::as_bytes(std::span{line_}), to_, Duration{0});
}

#define TWOPORT_COMPILE_ADD(N, ...) template void PlotStream::add(const Row<N>&, const TickView&);
TWOPORT_EACH_DOF(TWOPORT_COMPILE_ADD)

}  // namespace twoport
