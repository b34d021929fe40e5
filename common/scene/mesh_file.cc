#include "common/scene/mesh_file.h"

#include <fmt/format.h>

#include <bit>
#include <cstdint>
#include <map>
#include <mutex>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/mesh/solids.h"
#include "common/mesh/triangle_mesh.h"

namespace twoport {
namespace {

constexpr std::size_t kMostShells = 256;  // each costs a distance field while the scene is read

}  // namespace

TriangleMesh read_mesh_file(const std::string& path, double scale) {
  TriangleMesh mesh = parse_mesh(read_whole(path), path);
  for (Eigen::Vector3d& v : mesh.vertices) v *= scale;
  const MeshFaults faults = faults_of(mesh);
  if (faults.open_edges > 0)
    throw ConfigError{
        fmt::format("{} has {} edges of one triangle only; the mesh must be closed", path, faults.open_edges)};
  if (faults.odd_edges > 0)
    throw ConfigError{
        fmt::format("{} has {} edges that do not join two triangles of the same orientation; every edge must", path,
                    faults.odd_edges)};
  if (faults.volume_m3 == 0.0) throw ConfigError{fmt::format("{} encloses no volume at scale {}", path, scale)};
  if (!(faults.volume_m3 > 0.0))
    throw ConfigError{fmt::format(
        "{} has its triangles facing inwards; their corners must be counterclockwise seen from outside", path)};
  const std::vector<TriangleMesh> shells = shells_of(mesh);
  if (shells.size() > kMostShells)
    throw ConfigError{
        fmt::format("{} has {} separate surfaces; at most {} are read", path, shells.size(), kMostShells)};
  const auto text = [](const Eigen::Vector3d& p) { return fmt::format("({:.6g}, {:.6g}, {:.6g})", p[0], p[1], p[2]); };
  for (const TriangleMesh& shell : shells) {
    if (const auto where = BoundingVolumeTree{shell}.crossing())
      throw ConfigError{fmt::format("{} has a surface that crosses itself at {} m; surfaces may only cross others",
                                    path, text(*where))};
    if (const auto where = misplaced(shell))
      throw ConfigError{fmt::format(
          "{} has a triangle around {} m with no inside behind it: it lies on another one, or a part is inside out",
          path, text(*where))};
  }
  if (const auto where = solids_of(mesh).inward)
    throw ConfigError{
        fmt::format("{} has a surface at {} m that faces inwards and lies in no other; a cavity must lie in a solid",
                    path, text(*where))};
  return mesh;
}

namespace {

Eigen::Vector3d sides(const TriangleMesh& mesh) {
  Eigen::Vector3d low = mesh.vertices[0], high = low;
  for (const Eigen::Vector3d& v : mesh.vertices) low = low.cwiseMin(v), high = high.cwiseMax(v);
  return high - low;
}

}  // namespace

double longest_side(const TriangleMesh& mesh) {
  return sides(mesh).maxCoeff();
}
double shortest_side(const TriangleMesh& mesh) {
  return sides(mesh).minCoeff();
}

std::shared_ptr<const DistanceField> shared_field(const TriangleMesh& mesh, double spacing_m) {
  // Two hashes of 64 bits: two meshes of one scene will not have both in common.
  std::uint64_t first = 0xcbf29ce484222325, second = 0x9e3779b97f4a7c15;
  const auto add = [&](std::uint64_t value) {
    first = (first ^ value) * 0x100000001b3;
    second = (std::rotl(second, 5) ^ value) * 0xbf58476d1ce4e5b9;
  };
  for (const Eigen::Vector3d& v : mesh.vertices)
    for (int i = 0; i < 3; ++i) add(std::bit_cast<std::uint64_t>(v[i]));
  for (const TriangleMesh::Triangle& t : mesh.triangles)
    for (const std::uint32_t i : t) add(i);
  add(std::bit_cast<std::uint64_t>(spacing_m));

  static std::mutex mutex;
  static std::map<std::pair<std::uint64_t, std::uint64_t>, std::weak_ptr<const DistanceField>> fields;
  static std::shared_ptr<const DistanceField> latest;  // runs of a sweep follow each other
  const std::lock_guard lock{mutex};
  std::weak_ptr<const DistanceField>& known = fields[{first, second}];
  std::shared_ptr<const DistanceField> field = known.lock();
  if (!field) known = field = std::make_shared<const DistanceField>(mesh, spacing_m);
  latest = field;
  return field;
}

}  // namespace twoport
