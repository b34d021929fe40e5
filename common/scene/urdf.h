#pragma once

#include <string>

#include "common/arm/parameters.h"

// Internal to common/scene.

namespace twoport {

/// Reads the arm between the root and the link `tip` of a URDF; "": the only link without children. Fixed joints join their links;
/// joints beside the arm are held at 0 or at the nearer limit. Throws ConfigError with file, line and name.
ArmParameters read_urdf(const std::string& text, const std::string& file, const std::string& tip);

}  // namespace twoport
