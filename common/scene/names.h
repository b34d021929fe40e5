#pragma once

#include <string>

#include "common/coupling/options.h"

namespace twoport {

/// As a scene writes them, e.g. "POSITION_FORCE", "CLASSIC".
std::string to_string(Architecture architecture);
std::string to_string(Method method);

}  // namespace twoport
