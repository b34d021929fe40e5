#pragma once

#include "common/hardware/registry.h"

namespace twoport {

/// Every driver that drivers/CMakeLists.txt lists.
Registry all_drivers();

}  // namespace twoport
