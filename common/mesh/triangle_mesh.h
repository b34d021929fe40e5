#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace twoport {

/// Triangles over shared vertices [m]; counterclockwise seen from outside.
struct TriangleMesh {
  using Triangle = std::array<std::uint32_t, 3>;
  std::vector<Eigen::Vector3d> vertices;
  std::vector<Triangle> triangles;
};

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

}  // namespace twoport
