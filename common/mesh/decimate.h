#pragma once

#include <cstddef>

#include "common/mesh/triangle_mesh.h"

namespace twoport {

/// A mesh of at most `most` triangles, for a picture: the vertices in a cell of a cubic grid become their mean, and triangles whose
/// corners do not lie in three cells are left out (Rossignac, Borrel, Multi-resolution 3D approximations for rendering complex scenes,
/// 1993). The same mesh where it has no more.
TriangleMesh decimated(const TriangleMesh& mesh, std::size_t most);

}  // namespace twoport
