#pragma once

#include <vector>

#include "common/scene/blocks.h"

namespace twoport {

/// Delays of the packets of one direction, which are sent at `rate_hz` [s], NaN where lost: from this direction's rows of a link's
/// file (common/link/link_trace.h), or from one delay in ms per line; blank lines and what follows a # are skipped. A relative path
/// starts at the scene's folder. Empty: the block names no file.
std::vector<double> read_trace_file(const Block<schema::Impairment>& of, double rate_hz);

}  // namespace twoport
