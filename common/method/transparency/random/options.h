#pragma once

#include <cstdint>

namespace twoport {

/// `control.transparency.random`.
struct RandomOptions {
  double force_n = 5.0, hold_ms = 5.0;
  std::uint64_t seed = 0;  ///< the scene's
};

}  // namespace twoport
