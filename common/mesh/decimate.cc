#include "common/mesh/decimate.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>
#include <vector>

#include "common/mesh/sample_surface.h"

namespace twoport {
namespace {

TriangleMesh clustered(const TriangleMesh& mesh, double cell_m) {
  std::map<std::tuple<double, double, double>, std::uint32_t> cells;
  std::vector<std::uint32_t> cell_of;
  std::vector<double> count;
  TriangleMesh out;
  for (const Eigen::Vector3d& v : mesh.vertices) {
    const Eigen::Vector3d at = (v / cell_m).array().floor();
    const auto [cell, is_new] =
        cells.try_emplace({at.x(), at.y(), at.z()}, static_cast<std::uint32_t>(out.vertices.size()));
    if (is_new) out.vertices.emplace_back(Eigen::Vector3d::Zero()), count.push_back(0.0);
    out.vertices[cell->second] += v;
    count[cell->second] += 1.0;
    cell_of.push_back(cell->second);
  }
  for (std::size_t i = 0; i < count.size(); ++i) out.vertices[i] /= count[i];
  for (const TriangleMesh::Triangle& t : mesh.triangles) {
    const TriangleMesh::Triangle c{cell_of[t[0]], cell_of[t[1]], cell_of[t[2]]};
    if (c[0] != c[1] && c[1] != c[2] && c[2] != c[0]) out.triangles.push_back(c);
  }
  return out;
}

}  // namespace

TriangleMesh decimated(const TriangleMesh& mesh, std::size_t most) {
  TriangleMesh out = mesh;
  // Two triangles a cell of the surface.
  for (double cell_m = std::sqrt(2.0 * area_of(mesh) / static_cast<double>(std::max<std::size_t>(most, 1)));
       out.triangles.size() > most; cell_m *= 1.3)
    out = clustered(mesh, cell_m);
  return out;
}

}  // namespace twoport
