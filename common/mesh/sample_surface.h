#pragma once

#include <vector>

#include "common/mesh/triangle_mesh.h"

namespace twoport {

/// Points of a mesh: none of its surface is farther than `spacing` from one of them, and no two are nearer than
/// 3/4 spacing. Edges at which the surface turns by more than 30° come first, so that there are points on them. The same mesh
/// gives the same points.
std::vector<Eigen::Vector3d> sample_surface(const TriangleMesh& mesh, double spacing);

/// Its area [m²].
double area_of(const TriangleMesh& mesh);

}  // namespace twoport
