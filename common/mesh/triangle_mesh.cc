#include "common/mesh/triangle_mesh.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <numbers>
#include <numeric>
#include <tuple>
#include <utility>
#include <vector>

#include "common/mesh/joined.h"

namespace twoport {

Eigen::AlignedBox3d bounds(const TriangleMesh& mesh) {
  Eigen::AlignedBox3d box;
  for (const TriangleMesh::Triangle& t : mesh.triangles)
    for (const std::uint32_t v : t) box.extend(mesh.vertices[v]);
  return box;
}

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

namespace {

/// Calls f(edge, of one triangle only) for each that is not of two triangles of the same orientation.
template <class F>
void for_each_fault(const TriangleMesh& mesh, const F& f) {
  std::vector<std::pair<std::uint64_t, bool>> edges;  // and is it run through from its lower vertex?
  edges.reserve(3 * mesh.triangles.size());
  for (const TriangleMesh::Triangle& t : mesh.triangles)
    for (std::size_t i = 0; i < 3; ++i) edges.emplace_back(edge_of(t[i], t[(i + 1) % 3]), t[i] < t[(i + 1) % 3]);
  std::sort(edges.begin(), edges.end());
  for (std::size_t i = 0, next; i < edges.size(); i = next) {
    for (next = i + 1; next < edges.size() && edges[i].first == edges[next].first;) ++next;
    if (next - i != 2 || edges[i].second == edges[i + 1].second) f(edges[i].first, next - i == 1);
  }
}
std::pair<std::uint32_t, std::uint32_t> ends_of(std::uint64_t edge) {
  return {static_cast<std::uint32_t>(edge >> 32), static_cast<std::uint32_t>(edge)};
}

}  // namespace

MeshFaults faults_of(const TriangleMesh& mesh) {
  MeshFaults faults;
  faults.volume_m3 = volume_m3(mesh);
  for_each_fault(mesh, [&](std::uint64_t, bool open) { ++(open ? faults.open_edges : faults.odd_edges); });
  return faults;
}

Eigen::Vector3d odd_edge_of(const TriangleMesh& mesh) {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for_each_fault(mesh, [&](std::uint64_t edge, bool open) {
    const auto [a, b] = ends_of(edge);
    if (!open) middle = 0.5 * (mesh.vertices[a] + mesh.vertices[b]);
  });
  return middle;
}

std::vector<Eigen::AlignedBox3d> gaps_of(const TriangleMesh& mesh) {
  std::vector<std::uint32_t> parent(mesh.vertices.size());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto root = [&](std::uint32_t i) {
    for (; parent[i] != i; i = parent[i]) parent[i] = parent[parent[i]];
    return i;
  };
  std::vector<std::uint32_t> at;
  for_each_fault(mesh, [&](std::uint64_t edge, bool open) {
    if (!open) return;
    const auto [a, b] = ends_of(edge);
    parent[root(a)] = root(b);
    at.push_back(a), at.push_back(b);
  });
  std::map<std::uint32_t, Eigen::AlignedBox3d> boxes;
  for (const std::uint32_t v : at) boxes[root(v)].extend(mesh.vertices[v]);
  std::vector<Eigen::AlignedBox3d> gaps;
  for (const auto& [v, box] : boxes) gaps.push_back(box);
  std::ranges::stable_sort(gaps, std::ranges::greater{}, [](const auto& box) { return box.sizes().squaredNorm(); });
  return gaps;
}

TriangleMesh turned(const std::vector<Eigen::Vector2d>& profile, std::uint32_t sides) {
  TriangleMesh mesh;
  for (const Eigen::Vector2d& p : profile)
    for (std::uint32_t s = 0; s < sides; ++s) {
      const double angle = 2.0 * std::numbers::pi * (s + 0.5) / sides;
      mesh.vertices.emplace_back(p.x() * std::cos(angle), p.x() * std::sin(angle), p.y());
    }
  const auto at = [&](std::uint32_t i, std::uint32_t s) { return i * sides + (profile[i].x() > 0.0 ? s % sides : 0); };
  for (std::uint32_t i = 0; i + 1 < profile.size(); ++i)
    for (std::uint32_t s = 0; s < sides; ++s) {
      if (profile[i].x() > 0.0) mesh.triangles.push_back({at(i, s), at(i, s + 1), at(i + 1, s + 1)});
      if (profile[i + 1].x() > 0.0) mesh.triangles.push_back({at(i, s), at(i + 1, s + 1), at(i + 1, s)});
    }
  return mesh;
}

TriangleMesh unit_box() {
  constexpr double kCorner = std::numbers::sqrt2 / 2;
  return turned({{0, -0.5}, {kCorner, -0.5}, {kCorner, 0.5}, {0, 0.5}}, 4);
}
TriangleMesh unit_cylinder() {
  return turned({{0, -0.5}, {1, -0.5}, {1, 0.5}, {0, 0.5}}, 32);
}
TriangleMesh capsule(double radius, double half_length) {
  constexpr int kSteps = 12;
  std::vector<Eigen::Vector2d> profile;
  for (int i = 0; i <= kSteps; ++i) {
    const double angle = std::numbers::pi * i / kSteps, middle = 2 * i < kSteps ? -half_length : half_length;
    if (2 * i == kSteps && half_length > 0.0) profile.emplace_back(radius, -half_length);
    profile.emplace_back(i % kSteps == 0 ? 0.0 : radius * std::sin(angle), middle - radius * std::cos(angle));
  }
  return turned(profile, 24);
}

void append(TriangleMesh& to, const TriangleMesh& mesh, const Eigen::Affine3d& at) {
  const auto first = static_cast<std::uint32_t>(to.vertices.size());
  const bool mirrored = at.linear().determinant() < 0.0;
  for (const Eigen::Vector3d& v : mesh.vertices) to.vertices.push_back(at * v);
  for (auto [a, b, c] : mesh.triangles) {
    if (mirrored) std::swap(b, c);
    to.triangles.push_back({first + a, first + b, first + c});
  }
}

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
