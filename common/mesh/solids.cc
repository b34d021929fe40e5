#include "common/mesh/solids.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <numbers>
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
      const auto [at, is_new] = other.try_emplace(edge_of(from, to), k);
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

namespace {

/// van Oosterom, Strackee, The solid angle of a plane triangle, IEEE Trans. Biomedical Engineering 30(2), 1983.
double winding_number(const TriangleMesh& shell, const Eigen::Vector3d& p) {
  double half_angles = 0.0;
  for (const TriangleMesh::Triangle& t : shell.triangles) {
    const Eigen::Vector3d a = shell.vertices[t[0]] - p, b = shell.vertices[t[1]] - p, c = shell.vertices[t[2]] - p;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    half_angles += std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  }
  return half_angles / (2.0 * std::numbers::pi);
}

}  // namespace

std::optional<Eigen::Vector3d> misplaced(const TriangleMesh& shell) {
  constexpr double kMostAngles = 4e6, kOffset = 1e-7, kLeastWidth = 100.0;  // of the mesh's size, of the offset
  struct Sample {
    Eigen::Vector3d center, normal;
    double area2;
  };
  const double offset = kOffset * bounds(shell).sizes().norm();
  std::vector<Sample> samples;
  for (const TriangleMesh::Triangle& t : shell.triangles) {
    const Eigen::Vector3d &a = shell.vertices[t[0]], &b = shell.vertices[t[1]], &c = shell.vertices[t[2]];
    const Eigen::Vector3d across = (b - a).cross(c - a);
    const double area2 = across.norm(), around = (b - a).norm() + (c - b).norm() + (a - c).norm();
    if (area2 > kLeastWidth * offset * around) samples.push_back({(a + b + c) / 3.0, across / area2, area2});
  }
  const auto most = static_cast<std::size_t>(kMostAngles / (2.0 * static_cast<double>(shell.triangles.size())));
  if (samples.size() > most) {
    std::ranges::nth_element(samples, samples.begin() + static_cast<std::ptrdiff_t>(most), std::ranges::greater{},
                             &Sample::area2);
    samples.resize(most);
  }
  const double behind = volume_m3(shell) > 0.0 ? 1.0 : 0.0;  // of a cavity: 0, and -1 before it
  for (const Sample& s : samples) {
    const bool right = std::abs(winding_number(shell, s.center - offset * s.normal) - behind) < 0.5 &&
                       std::abs(winding_number(shell, s.center + offset * s.normal) - (behind - 1.0)) < 0.5;
    if (!right) return s.center;
  }
  return std::nullopt;
}

Solids solids_of(const TriangleMesh& mesh) {
  Solids solids;
  std::vector<TriangleMesh> inner;
  std::vector<double> volumes;  // of `all`
  for (TriangleMesh& shell : shells_of(mesh)) {
    const double volume = volume_m3(shell);
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
