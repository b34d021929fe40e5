#pragma once

#include <string>

#include "proto/scene.pb.h"

// Internal to common/scene.

namespace twoport {

/// Sets what "PATH=VALUE" names; creates the blocks on the way, and returns the path of the outermost that it has created, or nothing.
/// Throws ConfigError "override PATH=VALUE: sentence".
std::string apply_override(schema::Scene& scene, const std::string& assignment);

}  // namespace twoport
