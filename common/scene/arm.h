#pragma once

#include <string>

#include "common/arm/parameters.h"

namespace twoport {

/// Reads an arm from a file in Protobuf text format (proto/arm.proto). Throws ConfigError with file, field, value and what is
/// allowed.
ArmParameters load_arm(const std::string& path);

}  // namespace twoport
