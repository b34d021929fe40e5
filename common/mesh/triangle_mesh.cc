#include "common/mesh/triangle_mesh.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <utility>

namespace twoport {

double volume_m3(const TriangleMesh& mesh) {
  if (mesh.triangles.empty()) return 0.0;
  // A mesh that is far from the origin would lose its volume to rounding.
  const Eigen::Vector3d& near = mesh.vertices[mesh.triangles[0][0]];
  double volume = 0.0;
  for (const TriangleMesh::Triangle& t : mesh.triangles) {
    const Eigen::Vector3d a = mesh.vertices[t[0]] - near, b = mesh.vertices[t[1]] - near,
                          c = mesh.vertices[t[2]] - near;
    volume += a.dot(b.cross(c)) / 6.0;
  }
  return volume;
}

MeshFaults faults_of(const TriangleMesh& mesh) {
  MeshFaults faults;
  faults.volume_m3 = volume_m3(mesh);
  struct Edge {
    std::uint32_t low, high;
    bool forward;  ///< run through from low to high
    bool operator<(const Edge& b) const { return std::pair{low, high} < std::pair{b.low, b.high}; }
  };
  std::vector<Edge> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (const TriangleMesh::Triangle& t : mesh.triangles)
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t a = t[i], b = t[(i + 1) % 3];
      edges.push_back({std::min(a, b), std::max(a, b), a < b});
    }
  std::sort(edges.begin(), edges.end());
  for (std::size_t i = 0, next; i < edges.size(); i = next) {
    for (next = i + 1; next < edges.size() && !(edges[i] < edges[next]);) ++next;
    if (next - i == 1)
      ++faults.open_edges;
    else if (next - i != 2 || edges[i].forward == edges[i + 1].forward)
      ++faults.odd_edges;
  }
  return faults;
}

}  // namespace twoport
