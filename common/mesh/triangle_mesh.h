#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace twoport {

/// Triangles over shared vertices [m]; counterclockwise seen from outside.
struct TriangleMesh {
  using Triangle = std::array<std::uint32_t, 3>;
  std::vector<Eigen::Vector3d> vertices;
  std::vector<Triangle> triangles;
};

/// The same for both directions of an edge.
inline std::uint64_t edge_of(std::uint32_t a, std::uint32_t b) {
  return static_cast<std::uint64_t>(a < b ? a : b) << 32 | (a < b ? b : a);
}
/// Of the triangles.
Eigen::AlignedBox3d bounds(const TriangleMesh& mesh);

/// What keeps a mesh from being the boundary of a solid.
struct MeshFaults {
  std::size_t open_edges = 0;  ///< of one triangle only
  std::size_t odd_edges = 0;   ///< of more than two, or of two that turn opposite ways
  double volume_m3 = 0.0;      ///< negative where the triangles face inwards
  [[nodiscard]] bool none() const { return open_edges == 0 && odd_edges == 0 && volume_m3 > 0.0; }
};
MeshFaults faults_of(const TriangleMesh& mesh);
/// Of a closed mesh; negative where its triangles face inwards. The sum of the tetrahedra over its triangles.
double volume_m3(const TriangleMesh& mesh);

/// A mesh of at most `most` triangles, for a picture: the vertices in a cell of a cubic grid become their mean, and triangles whose
/// corners do not lie in three cells are left out (Rossignac, Borrel, Multi-resolution 3D approximations for rendering complex scenes,
/// 1993). The same mesh where it has no more.
TriangleMesh decimated(const TriangleMesh& mesh, std::size_t most);

/// Points of a mesh: none of its surface is farther than `spacing` from one of them, and no two are nearer than
/// 3/4 spacing. Edges at which the surface turns by more than 30° come first, so that there are points on them. The same mesh
/// gives the same points.
std::vector<Eigen::Vector3d> sample_surface(const TriangleMesh& mesh, double spacing);

/// Its area [m²].
double area_of(const TriangleMesh& mesh);

/// Largest number of triangles that is read.
inline constexpr std::size_t kMostTriangles = 2'000'000;

/// The mesh of a file's content: STL, binary or ASCII, or Wavefront OBJ, of which v and f are read and polygons are split
/// into triangles. Vertices of an STL file with equal coordinates become one; triangles without area are left out.
/// Throws ConfigError, in one sentence that begins with `name`, for anything else: sizes, numbers and indices are checked,
/// nothing is allocated that the content does not pay for.
TriangleMesh parse_mesh(std::string_view content, const std::string& name);

// Shapes for pictures.

/// A profile of (radius, height) from axis to axis, turned about z; the first corner is half a side from the x axis.
TriangleMesh turned(const std::vector<Eigen::Vector2d>& profile, std::uint32_t sides);
/// About the origin, with edges of 1.
TriangleMesh unit_box();
/// About the origin and the z axis, with radius and height 1.
TriangleMesh unit_cylinder();
/// Two half spheres about (0, 0, ±half_length) and what is between them.
TriangleMesh capsule(double radius, double half_length);

/// Adds a mesh at a place, which may scale and mirror it.
void append(TriangleMesh& to, const TriangleMesh& mesh, const Eigen::Affine3d& at);

}  // namespace twoport
