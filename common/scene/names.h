#pragma once

#include <string>

#include "common/coupling/options.h"

namespace twoport {

/// As a scene writes it, e.g. "POSITION_FORCE".
std::string to_string(Architecture architecture);

}  // namespace twoport
