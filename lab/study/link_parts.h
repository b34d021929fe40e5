#pragma once

#include <string>
#include <vector>

#include "common/link/link_trace.h"

namespace twoport::lab {

/// A part of a link's trace that a study plays: from a moment on; after the trace's end its start follows.
struct LinkPart {
  double from_s = 0.0;  ///< since the first packet
  std::string why;      ///< "the longest gap, 400 ms"; empty: the whole trace is played, in a loop
};

/// The parts of `length_s` with the longest delays, most losses, the longest gap, and the largest change of delay; of a trace that is not
/// longer, the whole. What happens in less than a part lies in its middle, wherever it lies in the trace. Parts that overlap by three
/// quarters are one.
std::vector<LinkPart> worst_parts(const LinkTrace& link, double length_s);

/// From the first packet to the end of the last one's period [s], of the longer direction.
double duration_s(const LinkTrace& link);

/// As delays_at(), from a moment on.
std::vector<double> delays_from(const TracedWay& way, double from_s, double rate_hz);

}  // namespace twoport::lab
