#pragma once

#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/scene/scene.h"

namespace twoport {

/// An optional part of a scene's model: a field that is given and whose option says that it is removable.
struct ScenePart {
  std::string path;  ///< in the scene file; that of a shape names its kind
  std::vector<std::pair<int, int>>
      way;  ///< of each field from the scene to it the index in its block, and of a list that of the element
};

/// In the order of proto/scene.proto; a block precedes its parts.
std::vector<ScenePart> removable_parts(const Scene& scene);

/// The scene read without these, given in that order; with the duration and the expectations that `scene` has. Throws ConfigError where
/// the rest is no scene, as without the only mass of the handle.
Scene without(const Scene& scene, const std::vector<ScenePart>& parts);

/// The path, without indices, of the first field that the scene's text gives and that `names` do not name, neither itself nor a block
/// around it; empty: there is none.
std::string field_beyond(const Scene& scene, const std::set<std::string>& names);

}  // namespace twoport
