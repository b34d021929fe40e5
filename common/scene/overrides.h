#pragma once

#include <string>

#include "proto/scene.pb.h"

// Internal to common/scene.

namespace twoport {

/// Sets what "PATH=VALUE" names; creates the blocks on the way. Throws ConfigError "override PATH=VALUE: sentence".
void apply_override(schema::Scene& scene, const std::string& assignment);

}  // namespace twoport
