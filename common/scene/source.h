#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/scene/load.h"
#include "proto/scene.pb.h"

// Internal to common/scene.

namespace twoport {

/// What a scene was read from.
struct SceneSource {
  schema::Scene message;
  std::string file;
  SceneFor use;
};
Scene read_scene(std::shared_ptr<const SceneSource> source);

/// The controls of a schedule's entries, each on top of the one before.
std::vector<schema::Control> scheduled(const schema::Control& control);

// Internal to common/scene.

/// Sets what "PATH=VALUE" names; creates the blocks on the way, and returns the path of the outermost that it has created, or nothing.
/// Throws ConfigError "override PATH=VALUE: sentence".
std::string apply_override(schema::Scene& scene, const std::string& assignment);
/// Overrides of one path each: A,B=VALUE sets both. Throws ConfigError where a path is empty or there twice.
std::vector<std::string> single_overrides(std::span<const std::string> overrides);

}  // namespace twoport
