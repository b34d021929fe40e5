#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/recording/recording.h"

namespace twoport::lab {

/// One side of a recording, replayed.
struct ReplayedSide {
  std::string side;
  std::uint64_t ticks = 0;  ///< that were identical
  std::string
      difference;  ///< the first tick and field that are not, or why the replay ends there; empty: all are identical
};

struct Replayed {
  std::vector<ReplayedSide> sides;
  bool torn = false;  ///< the recording has no end

  [[nodiscard]] bool identical() const;
};

/// Feeds the recorded readings and reports to the same nodes and mailboxes, made from the recorded scene, and compares every
/// result, bit by bit. Throws ConfigError for what is no recording.
Replayed replay(RecordingReader& recording);

}  // namespace twoport::lab
