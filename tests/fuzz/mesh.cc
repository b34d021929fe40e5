#include <string>

#include "common/base/check.h"
#include "common/mesh/distance_field.h"
#include "common/mesh/triangle_mesh.h"
#include "tests/fuzz/input.h"

// Any bytes as the file of a mesh: they are one, with indices of its vertices and finite coordinates, or refused in one sentence. Its
// distance is finite everywhere, whatever its surfaces cross.
namespace twoport {
namespace {

void check(const std::string& content) {
  try {
    const TriangleMesh mesh = parse_mesh(content, "fuzz");
    require(!mesh.triangles.empty() && mesh.triangles.size() <= kMostTriangles, "a mesh has triangles");
    for (const TriangleMesh::Triangle& t : mesh.triangles)
      for (const std::uint32_t v : t) {
        require(v < mesh.vertices.size(), "a triangle names vertices");
        require(mesh.vertices[v].allFinite(), "vertices are finite");
      }
    if (!faults_of(mesh).none()) return;
    Eigen::Vector3d low = mesh.vertices[0], high = low;
    for (const Eigen::Vector3d& v : mesh.vertices) low = low.cwiseMin(v), high = high.cwiseMax(v);
    const double side = (high - low).maxCoeff();
    if (!(side > 1e-9) || mesh.triangles.size() > 1000) return;
    const DistanceField field{mesh, side / 4.0};
    const auto at = field.at(0.5 * (low + high));
    require(std::isfinite(at.distance), "the distance is a number");
  } catch (const ConfigError& e) {
    require(std::string{e.what()}.find('\n') == std::string::npos, "a refusal is one line");
  }
}

}  // namespace
}  // namespace twoport

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  twoport::check({reinterpret_cast<const char*>(data), size});
  return 0;
}
