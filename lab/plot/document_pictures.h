#pragma once

#include <string>

namespace twoport::lab {

/// deadband: packets a second against the error of the felt force, over the width of the deadband (docs/reference/network.md).
std::string draw_deadband(const std::string& folder, int jobs);
/// torus: the mesh of scenes/render_torus_mesh.textproto with the probe's way around it, and the force on the hand
/// (docs/reference/shapes.md).
std::string draw_torus(const std::string& folder);

}  // namespace twoport::lab
