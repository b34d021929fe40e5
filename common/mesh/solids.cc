#include "common/mesh/solids.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <numeric>
#include <unordered_map>
#include <utility>

namespace twoport {

std::vector<TriangleMesh> shells_of(const TriangleMesh& mesh) {
  std::vector<std::uint32_t> parent(mesh.triangles.size());
  std::iota(parent.begin(), parent.end(), 0u);
  const auto root = [&](std::uint32_t i) {
    for (; parent[i] != i; i = parent[i]) parent[i] = parent[parent[i]];
    return i;
  };
  std::unordered_map<std::uint64_t, std::uint32_t> other;  // triangle of an edge
  other.reserve(2 * mesh.triangles.size());
  for (std::uint32_t k = 0; k < mesh.triangles.size(); ++k)
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t from = mesh.triangles[k][i], to = mesh.triangles[k][(i + 1) % 3];
      const auto [at, is_new] =
          other.try_emplace(static_cast<std::uint64_t>(std::min(from, to)) << 32 | std::max(from, to), k);
      if (is_new) continue;
      const std::uint32_t a = root(at->second), b = root(k);
      parent[std::max(a, b)] = std::min(a, b);
    }
  std::vector<std::vector<std::uint32_t>> of_root(mesh.triangles.size());
  for (std::uint32_t i = 0; i < mesh.triangles.size(); ++i) of_root[root(i)].push_back(i);
  if (of_root[0].size() == mesh.triangles.size()) return {mesh};

  constexpr std::uint32_t kNew = 0xffffffff;
  std::vector<std::uint32_t> index(mesh.vertices.size());
  std::vector<TriangleMesh> shells;
  for (const std::vector<std::uint32_t>& triangles : of_root) {
    if (triangles.empty()) continue;
    TriangleMesh& shell = shells.emplace_back();
    for (const std::uint32_t t : triangles)
      for (const std::uint32_t v : mesh.triangles[t]) index[v] = kNew;
    for (const std::uint32_t t : triangles) {
      TriangleMesh::Triangle& corners = shell.triangles.emplace_back(mesh.triangles[t]);
      for (std::uint32_t& v : corners) {
        if (index[v] == kNew) {
          index[v] = static_cast<std::uint32_t>(shell.vertices.size());
          shell.vertices.push_back(mesh.vertices[v]);
        }
        v = index[v];
      }
    }
  }
  return shells;
}

Solids solids_of(const TriangleMesh& mesh) {
  Solids solids;
  std::vector<TriangleMesh> inner;
  std::vector<double> volumes;  // of `all`
  for (TriangleMesh& shell : shells_of(mesh)) {
    const double volume = faults_of(shell).volume_m3;
    if (volume > 0.0) {
      solids.all.push_back({BoundingVolumeTree{shell}, {}});
      volumes.push_back(volume);
    } else {
      inner.push_back(std::move(shell));
    }
  }
  // A cavity is of the smallest solid that holds all of it.
  for (const TriangleMesh& cavity : inner) {
    Solid* around = nullptr;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < solids.all.size(); ++i) {
      const auto inside = [&](const Eigen::Vector3d& p) {
        return solids.all[i].outer.nearest(p).signed_distance(p) < 0.0;
      };
      if (volumes[i] < least && std::ranges::all_of(cavity.vertices, inside))
        around = &solids.all[i], least = volumes[i];
    }
    if (around == nullptr) {
      solids.inward = cavity.vertices[0];
    } else {
      around->cavities.emplace_back(cavity);
    }
  }
  return solids;
}

}  // namespace twoport
