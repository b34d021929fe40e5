#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "common/mesh/triangle_mesh.h"

namespace twoport {

/// Largest number of triangles that is read.
inline constexpr std::size_t kMostTriangles = 2'000'000;

/// The mesh of a file's content: STL, binary or ASCII, or Wavefront OBJ, of which v and f are read and polygons are split
/// into triangles. Vertices of an STL file with equal coordinates become one; triangles without area are left out.
/// Throws ConfigError, in one sentence that begins with `name`, for anything else: sizes, numbers and indices are checked,
/// nothing is allocated that the content does not pay for.
TriangleMesh parse_mesh(std::string_view content, const std::string& name);

}  // namespace twoport
