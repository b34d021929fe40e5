#pragma once

#include "common/base/time.h"
#include "common/link/delay_line.h"
#include "common/link/report.h"

namespace twoport {

/// A network in memory: reports as values, no bytes.
template <int N, class Line = DelayLine<Report<N>>>
class SimTransport {
 public:
  SimTransport(Line& in, Line& out) : in_{&in}, out_{&out} {}
  template <class Visit>
  void poll(Duration now, Visit visit) noexcept {
    now -= clock_ahead_;
    while (const Report<N>* r = in_->take(now)) visit(*r);
  }
  void send(const auto& r, Duration now) noexcept { out_->put(r, now - clock_ahead_); }
  /// The clock of this end against the network's.
  void set_clock_ahead(Duration ahead) noexcept { clock_ahead_ = ahead; }

 private:
  Line *in_, *out_;
  Duration clock_ahead_{0};
};

}  // namespace twoport
