#pragma once

#include "common/base/option_fields.h"

namespace twoport {

/// `control.transparency.local_damping`.
struct LocalDampingOptions {
  double damping_n_s_per_m = 2.0;
  TWOPORT_OPTIONS_OF_BLOCK(damping_n_s_per_m)
};

}  // namespace twoport
