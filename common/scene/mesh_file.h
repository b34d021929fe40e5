#pragma once

#include <memory>
#include <string>

#include "common/mesh/distance_field.h"
#include "common/mesh/triangle_mesh.h"

// Meshes of a scene. Internal to common/scene.

namespace twoport {

/// The closed mesh of a file, with its coordinates times `scale`. Throws ConfigError that begins with the path for a file that
/// cannot be read or whose mesh does not bound a solid.
TriangleMesh read_mesh_file(const std::string& path, double scale);

/// The longest side of the box around it.
double longest_side(const TriangleMesh& mesh);
double shortest_side(const TriangleMesh& mesh);

/// Its distance field. While one of the same mesh and spacing is in use anywhere in the program, that one.
std::shared_ptr<const DistanceField> shared_field(const TriangleMesh& mesh, double spacing_m);

}  // namespace twoport
