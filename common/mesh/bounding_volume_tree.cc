#include "common/mesh/bounding_volume_tree.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <unordered_map>

namespace twoport {
namespace {

/// Part of a triangle: 0 its inside, 1 to 3 the edges 01, 12, 20, 4 to 6 the corners.
struct PointOfTriangle {
  Eigen::Vector3d point;
  int part;
};

/// Ericson, Real-Time Collision Detection, 2005, 5.1.5.
inline PointOfTriangle nearest_of(const std::array<Eigen::Vector3d, 3>& corner, const Eigen::Vector3d& p) noexcept {
  const Eigen::Vector3d &a = corner[0], &b = corner[1], &c = corner[2];
  Eigen::Vector3d ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0.0 && d2 <= 0.0) return {a, 4};
  Eigen::Vector3d bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0.0 && d4 <= d3) return {b, 5};
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return {a + d1 / (d1 - d3) * ab, 1};
  Eigen::Vector3d cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0.0 && d5 <= d6) return {c, 6};
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return {a + d2 / (d2 - d6) * ac, 3};
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) return {b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b), 2};
  const double scale = 1.0 / (va + vb + vc);
  return {a + vb * scale * ab + vc * scale * ac, 0};
}

/// Where the segment from p to q passes through the inside of a triangle, well away from its edges and from p and q (Möller, Trumbore,
/// Fast, minimum storage ray-triangle intersection, J. Graphics Tools 2(1), 1997).
std::optional<Eigen::Vector3d> passage(const std::array<Eigen::Vector3d, 3>& corner, const Eigen::Vector3d& p,
                                       const Eigen::Vector3d& q) {
  constexpr double kLeast = 1e-9;  // of the segment, of the triangle
  const Eigen::Vector3d along = q - p, ab = corner[1] - corner[0], ac = corner[2] - corner[0], ap = p - corner[0];
  const Eigen::Vector3d h = along.cross(ac), g = ap.cross(ab);
  const double det = ab.dot(h);
  if (!(std::abs(det) > kLeast * ab.norm() * ac.norm() * along.norm())) return std::nullopt;  // parallel
  const double u = ap.dot(h) / det, v = along.dot(g) / det, t = ac.dot(g) / det;
  if (std::min({u, v, 1.0 - u - v, t, 1.0 - t}) < kLeast) return std::nullopt;
  return p + t * along;
}

}  // namespace

double BoundingVolumeTree::Nearest::signed_distance(const Eigen::Vector3d& p) const noexcept {
  return std::copysign(std::sqrt(squared_distance), (p - point).dot(pseudonormal));
}

BoundingVolumeTree::BoundingVolumeTree(const TriangleMesh& mesh) {
  const std::size_t count = mesh.triangles.size();
  std::vector<std::uint32_t> order(count);
  std::iota(order.begin(), order.end(), 0u);
  std::vector<Eigen::Vector3d> centers;
  centers.reserve(count);
  for (const TriangleMesh::Triangle& t : mesh.triangles)
    centers.push_back((mesh.vertices[t[0]] + mesh.vertices[t[1]] + mesh.vertices[t[2]]) / 3.0);
  nodes_.reserve(count);
  build(order, 0, static_cast<std::uint32_t>(count), mesh, centers);

  faces_.reserve(count);
  normals_.resize(count);
  vertex_normals_.assign(mesh.vertices.size(), Eigen::Vector3d::Zero());
  std::unordered_map<std::uint64_t, Eigen::Vector3d> edge_normals;
  for (std::size_t i = 0; i < count; ++i) {
    const TriangleMesh::Triangle& t = mesh.triangles[order[i]];
    const Face face{{mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]}, t};
    const Eigen::Vector3d normal =
        (face.corner[1] - face.corner[0]).cross(face.corner[2] - face.corner[0]).normalized();
    normals_[i][0] = normal;
    for (std::size_t k = 0; k < 3; ++k) {
      edge_normals.try_emplace(edge_of(t[k], t[(k + 1) % 3]), Eigen::Vector3d::Zero()).first->second += normal;
      const Eigen::Vector3d to_next = face.corner[(k + 1) % 3] - face.corner[k],
                            to_last = face.corner[(k + 2) % 3] - face.corner[k];
      vertex_normals_[t[k]] += std::atan2(to_next.cross(to_last).norm(), to_next.dot(to_last)) * normal;
    }
    faces_.push_back(face);
  }
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t k = 0; k < 3; ++k)
      normals_[i][k + 1] = edge_normals.at(edge_of(faces_[i].vertex[k], faces_[i].vertex[(k + 1) % 3]));
}

std::uint32_t BoundingVolumeTree::build(std::vector<std::uint32_t>& order, std::uint32_t first, std::uint32_t last,
                                        const TriangleMesh& mesh, const std::vector<Eigen::Vector3d>& centers) {
  const auto index = static_cast<std::uint32_t>(nodes_.size());
  Node node{{}, first, last - first};
  Eigen::AlignedBox3d of_centers;
  for (std::uint32_t i = first; i < last; ++i) {
    for (const std::uint32_t v : mesh.triangles[order[i]]) node.box.extend(mesh.vertices[v]);
    of_centers.extend(centers[order[i]]);
  }
  nodes_.push_back(node);
  if (last - first <= kLeaf) return index;
  int axis = 0;
  of_centers.sizes().maxCoeff(&axis);
  const std::uint32_t middle = first + (last - first) / 2;
  std::nth_element(order.begin() + first, order.begin() + middle, order.begin() + last,
                   [&](std::uint32_t a, std::uint32_t b) { return centers[a][axis] < centers[b][axis]; });
  build(order, first, middle, mesh, centers);
  const std::uint32_t second = build(order, middle, last, mesh, centers);
  nodes_[index].first = second;
  nodes_[index].count = 0;
  return index;
}

double BoundingVolumeTree::distance(std::uint32_t triangle, const Eigen::Vector3d& p) const noexcept {
  return (p - nearest_of(faces_[triangle].corner, p).point).norm();
}

std::optional<Eigen::Vector3d> BoundingVolumeTree::crossing() const {
  std::vector<std::uint32_t> stack;
  for (const Face& face : faces_)
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t from = face.vertex[k], to = face.vertex[(k + 1) % 3];
      if (from > to) continue;  // of the other triangle of this edge
      const Eigen::Vector3d &p = face.corner[k], &q = face.corner[(k + 1) % 3];
      const Eigen::AlignedBox3d of_edge{p.cwiseMin(q), p.cwiseMax(q)};
      stack.assign(1, 0);
      while (!stack.empty()) {
        const std::uint32_t at = stack.back();
        stack.pop_back();
        const Node& node = nodes_[at];
        if (!node.box.intersects(of_edge)) continue;
        if (node.count == 0) {
          stack.push_back(at + 1), stack.push_back(node.first);
          continue;
        }
        for (std::uint32_t i = node.first; i < node.first + node.count; ++i) {
          const std::array<std::uint32_t, 3>& v = faces_[i].vertex;
          const bool shares = std::any_of(v.begin(), v.end(), [&](std::uint32_t c) { return c == from || c == to; });
          if (shares) continue;
          if (const auto where = passage(faces_[i].corner, p, q)) return where;
        }
      }
    }
  return std::nullopt;
}

BoundingVolumeTree::Nearest BoundingVolumeTree::nearest(const Eigen::Vector3d& p, std::uint32_t near) const noexcept {
  if (near >= faces_.size()) near = 0;
  PointOfTriangle best = nearest_of(faces_[near].corner, p);
  double least = (p - best.point).squaredNorm();
  std::uint32_t triangle = near;

  // The tree is halved at each level: its depth is at most 32.
  struct Waiting {
    std::uint32_t node;
    double squared;
  };
  std::array<Waiting, 40> stack;
  std::size_t waiting = 0;
  std::uint32_t at = 0;
  for (;;) {
    const Node& node = nodes_[at];
    bool descend = false;
    if (node.count > 0) {
      for (std::uint32_t i = node.first; i < node.first + node.count; ++i) {
        const PointOfTriangle trial = nearest_of(faces_[i].corner, p);
        const double squared = (p - trial.point).squaredNorm();
        if (squared < least) least = squared, best = trial, triangle = i;
      }
    } else {
      std::uint32_t near_child = at + 1, far_child = node.first;
      double near_squared = nodes_[near_child].box.squaredExteriorDistance(p);
      double far_squared = nodes_[far_child].box.squaredExteriorDistance(p);
      if (far_squared < near_squared) std::swap(near_child, far_child), std::swap(near_squared, far_squared);
      if (far_squared < least) stack[waiting++] = {far_child, far_squared};
      descend = near_squared < least;
      at = near_child;
    }
    if (descend) continue;
    while (waiting > 0 && !(stack[waiting - 1].squared < least)) --waiting;
    if (waiting == 0) break;
    at = stack[--waiting].node;
  }
  const auto part = static_cast<std::size_t>(best.part);
  const Eigen::Vector3d& normal =
      part < 4 ? normals_[triangle][part] : vertex_normals_[faces_[triangle].vertex[part - 4]];
  return {best.point, normal, least, triangle};
}

}  // namespace twoport
