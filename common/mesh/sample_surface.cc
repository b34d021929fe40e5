#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <numbers>
#include <utility>

#include "common/mesh/triangle_mesh.h"

namespace twoport {
namespace {

Eigen::Vector3d area_vector(const TriangleMesh& mesh, const TriangleMesh::Triangle& t) {
  const Eigen::Vector3d& a = mesh.vertices[t[0]];
  return 0.5 * (mesh.vertices[t[1]] - a).cross(mesh.vertices[t[2]] - a);
}

/// Points at least `apart` from each other.
class Thinned {
 public:
  explicit Thinned(double apart) : apart_{apart} {}

  void offer(const Eigen::Vector3d& p) {
    const Eigen::Vector3d cell = (p / apart_).array().floor().matrix();
    for (int i = -1; i <= 1; ++i)
      for (int j = -1; j <= 1; ++j)
        for (int k = -1; k <= 1; ++k) {
          const auto [from, to] = cells_.equal_range(key(cell + Eigen::Vector3d(i, j, k)));
          for (auto at = from; at != to; ++at)
            if ((points_[at->second] - p).squaredNorm() < apart_ * apart_) return;
        }
    cells_.emplace(key(cell), points_.size());
    points_.push_back(p);
  }
  std::vector<Eigen::Vector3d> take() { return std::move(points_); }

 private:
  static std::uint64_t key(const Eigen::Vector3d& cell) {
    const auto part = [](double c) { return static_cast<std::uint64_t>(static_cast<std::int64_t>(c)) & 0x1fffff; };
    return part(cell.x()) << 42 | part(cell.y()) << 21 | part(cell.z());
  }
  double apart_;
  std::vector<Eigen::Vector3d> points_;
  std::unordered_multimap<std::uint64_t, std::size_t> cells_;
};

}  // namespace

double area_of(const TriangleMesh& mesh) {
  double sum = 0.0;
  for (const TriangleMesh::Triangle& t : mesh.triangles) sum += area_vector(mesh, t).norm();
  return sum;
}

std::vector<Eigen::Vector3d> sample_surface(const TriangleMesh& mesh, double spacing) {
  const double fine = 0.25 * spacing;  // of the points offered
  const double cosine = std::cos(std::numbers::pi / 6.0);
  Thinned points{0.75 * spacing};

  std::map<std::pair<std::uint32_t, std::uint32_t>, std::vector<Eigen::Vector3d>> edges;
  for (const TriangleMesh::Triangle& t : mesh.triangles)
    for (std::size_t i = 0; i < 3; ++i)
      edges[std::minmax(t[i], t[(i + 1) % 3])].push_back(area_vector(mesh, t).normalized());
  std::vector<std::pair<std::uint32_t, std::uint32_t>> sharp;
  for (const auto& [edge, normals] : edges)
    if (normals.size() != 2 || normals[0].dot(normals[1]) < cosine) sharp.push_back(edge);
  // Corners, where other than two sharp edges meet or where they bend, then the edges themselves.
  std::map<std::uint32_t, std::vector<Eigen::Vector3d>> ends;
  for (const auto& [a, b] : sharp) {
    const Eigen::Vector3d along = (mesh.vertices[b] - mesh.vertices[a]).normalized();
    ends[a].push_back(along), ends[b].push_back(-along);
  }
  for (const auto& [vertex, ways] : ends)
    if (ways.size() != 2 || ways[0].dot(ways[1]) > -cosine) points.offer(mesh.vertices[vertex]);
  for (const auto& [a, b] : sharp) {
    const Eigen::Vector3d &from = mesh.vertices[a], way = mesh.vertices[b] - from;
    const double pieces = std::max(1.0, std::ceil(way.norm() / fine));
    for (double i = 0.0; i <= pieces; ++i) points.offer(from + i / pieces * way);
  }
  for (const TriangleMesh::Triangle& t : mesh.triangles) {
    const Eigen::Vector3d &a = mesh.vertices[t[0]], ab = mesh.vertices[t[1]] - a, ac = mesh.vertices[t[2]] - a;
    const double pieces = std::max(1.0, std::ceil(std::max({ab.norm(), ac.norm(), (ac - ab).norm()}) / fine));
    for (double i = 0.0; i <= pieces; ++i)
      for (double j = 0.0; i + j <= pieces; ++j) points.offer(a + i / pieces * ab + j / pieces * ac);
  }
  return points.take();
}

}  // namespace twoport
