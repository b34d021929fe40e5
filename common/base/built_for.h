#pragma once

#include <string>

#include "common/base/check.h"

// Degrees of freedom that a source file is compiled for: with -D TWOPORT_DOF=3 of CMake those that master and slave need for scenes of three
// axes.
#ifndef TWOPORT_DOF
#define TWOPORT_DOF 1, 3, 6
#endif

namespace twoport {

[[nodiscard]] static constexpr bool built_for(int dof) {
  for (const int each : {TWOPORT_DOF})
    if (each == dof) return true;
  return false;
}

/// Calls `use.operator()<N>()` with N = dof. Throws ConfigError where the calling file is not compiled for it.
template <class Use>
int run_built_for(int dof, Use use) {
  if constexpr (built_for(1))
    if (dof == 1) return use.template operator()<1>();
  if constexpr (built_for(3))
    if (dof == 3) return use.template operator()<3>();
  if constexpr (built_for(6))
    if (dof == 6) return use.template operator()<6>();
  throw ConfigError{"dof is " + std::to_string(dof) +
                    ", which this program is not built for; scripts/build builds it for 1, 3 and 6"};
}

}  // namespace twoport
