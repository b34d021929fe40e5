#pragma once

#include <string>

#include "common/arm/parameters.h"
#include "common/scene/shown.h"

// Internal to common/scene.

namespace twoport {

/// Reads the arm between the root and the link `tip` of a URDF; "": the only link without children. Fixed joints join their links;
/// joints beside the arm are held at 0 or at the nearer limit. Throws ConfigError with file, line and name.
ArmParameters read_urdf(const std::string& text, const std::string& file, const std::string& tip);

/// The shapes of its links' <visual>, of a link whose <visual> cannot be read those of its <collision>, with the same errors otherwise.
ShownArm read_urdf_shapes(const std::string& text, const std::string& file, const std::string& tip);

}  // namespace twoport
