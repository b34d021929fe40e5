#pragma once

#include <memory>
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

}  // namespace twoport
