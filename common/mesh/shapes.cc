#include "common/mesh/shapes.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <tuple>
#include <utility>
#include <vector>

#include "common/mesh/triangle_mesh.h"

namespace twoport {

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

}  // namespace twoport
