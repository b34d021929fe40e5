#pragma once

#include <cstdint>

#include "common/base/option_fields.h"

namespace twoport {

/// `control.transparency.random`.
struct RandomOptions {
  double force_n = 5.0, hold_ms = 5.0;
  std::uint64_t seed = 0;  ///< the scene's
  TWOPORT_OPTIONS_OF_BLOCK(force_n, hold_ms)
};

}  // namespace twoport
