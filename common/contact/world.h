#pragma once

#include <variant>
#include <vector>

#include "common/contact/contact_law.h"

namespace twoport {

/// One element of the environment.
using EnvironmentSpec = std::variant<Surface, Spring>;

/// Its block in a scene.
inline const char* name(const EnvironmentSpec& spec) {
  const auto* surface = std::get_if<Surface>(&spec);
  return surface != nullptr ? name(surface->shape) : Spring::kName;
}

/// All elements of the environment.
struct World {
  std::vector<Surface> surfaces;
  std::vector<Spring> springs;

  World() = default;
  explicit World(const std::vector<EnvironmentSpec>& specs) {
    for (const EnvironmentSpec& spec : specs)
      if (const auto* surface = std::get_if<Surface>(&spec))
        surfaces.push_back(*surface);
      else
        springs.push_back(std::get<Spring>(spec));
  }
};

}  // namespace twoport
