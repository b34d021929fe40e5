#pragma once

#include <Eigen/Geometry>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <map>
#include <numbers>
#include <string>

#include "common/mesh/triangle_mesh.h"

namespace twoport::test {

/// Torus about z with its vertices on the surface: `around` times `across` quadrilaterals of two triangles each.
inline TriangleMesh torus_mesh(double radius, double tube, std::uint32_t around, std::uint32_t across) {
  TriangleMesh mesh;
  for (std::uint32_t i = 0; i < around; ++i)
    for (std::uint32_t j = 0; j < across; ++j) {
      const double a = 2 * std::numbers::pi * i / around, b = 2 * std::numbers::pi * j / across;
      const double r = radius + tube * std::cos(b);
      mesh.vertices.push_back({r * std::cos(a), r * std::sin(a), tube * std::sin(b)});
      const std::uint32_t i1 = (i + 1) % around, j1 = (j + 1) % across;
      const std::uint32_t p = i * across + j, q = i1 * across + j, r1 = i1 * across + j1, s = i * across + j1;
      mesh.triangles.push_back({p, q, r1});
      mesh.triangles.push_back({p, r1, s});
    }
  return mesh;
}

/// Sphere around the origin: the octahedron, each triangle split into four `levels` times. 8·4^levels triangles.
inline TriangleMesh sphere_mesh(double radius, int levels) {
  using Eigen::Vector3d;
  TriangleMesh mesh;
  std::map<std::array<std::int64_t, 3>, std::uint32_t> known;  // by the place, rounded
  const auto vertex = [&](const Vector3d& p) {
    const auto rounded = [&](double c) { return static_cast<std::int64_t>(std::llround(1e7 * c / radius)); };
    const auto [at, is_new] = known.try_emplace({rounded(p.x()), rounded(p.y()), rounded(p.z())},
                                                static_cast<std::uint32_t>(mesh.vertices.size()));
    if (is_new) mesh.vertices.push_back(p);
    return at->second;
  };
  const auto split = [&](const auto& self, const Vector3d& a, const Vector3d& b, const Vector3d& c, int left) -> void {
    if (left == 0) {
      mesh.triangles.push_back({vertex(radius * a), vertex(radius * b), vertex(radius * c)});
      return;
    }
    const Vector3d ab = (a + b).normalized(), bc = (b + c).normalized(), ca = (c + a).normalized();
    self(self, a, ab, ca, left - 1), self(self, ab, b, bc, left - 1), self(self, ca, bc, c, left - 1);
    self(self, ab, bc, ca, left - 1);
  };
  for (const double x : {1.0, -1.0})
    for (const double y : {1.0, -1.0})
      for (const double z : {1.0, -1.0}) {
        const Vector3d a{x, 0, 0}, b{0, y, 0}, c{0, 0, z};
        x* y* z > 0 ? split(split, a, b, c, levels) : split(split, a, c, b, levels);
      }
  return mesh;
}

/// Box around the origin.
inline TriangleMesh box_mesh(const Eigen::Vector3d& half) {
  TriangleMesh mesh;
  for (int i = 0; i < 8; ++i)
    mesh.vertices.push_back({(i & 1 ? 1 : -1) * half.x(), (i & 2 ? 1 : -1) * half.y(), (i & 4 ? 1 : -1) * half.z()});
  mesh.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                    {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return mesh;
}

/// The content of a binary STL file; coordinates are multiplied by `unit` and rounded to float.
inline std::string binary_stl(const TriangleMesh& mesh, double unit = 1.0) {
  std::string out(80, ' ');
  const auto put = [&](std::uint32_t value, int bytes) {
    for (int i = 0; i < bytes; ++i) out += static_cast<char>(value >> (8 * i) & 0xff);
  };
  const auto put_vector = [&](const Eigen::Vector3d& v) {
    for (int i = 0; i < 3; ++i) put(std::bit_cast<std::uint32_t>(static_cast<float>(v[i])), 4);
  };
  put(static_cast<std::uint32_t>(mesh.triangles.size()), 4);
  for (const TriangleMesh::Triangle& t : mesh.triangles) {
    put_vector({0, 0, 0});
    for (const std::uint32_t v : t) put_vector(unit * mesh.vertices[v]);
    put(0, 2);
  }
  return out;
}
inline std::string number_text(const Eigen::Vector3d& v) {
  char text[100];
  std::snprintf(text, sizeof text, "%.17g %.17g %.17g", v.x(), v.y(), v.z());
  return text;
}
inline std::string ascii_stl(const TriangleMesh& mesh) {
  std::string out = "solid part\n";
  for (const TriangleMesh::Triangle& t : mesh.triangles) {
    out += " facet normal 0 0 0\n  outer loop\n";
    for (const std::uint32_t v : t) out.append("   vertex ").append(number_text(mesh.vertices[v])).append("\n");
    out += "  endloop\n endfacet\n";
  }
  return out + "endsolid part\n";
}
inline std::string obj(const TriangleMesh& mesh) {
  std::string out = "# part\no part\n";
  for (const Eigen::Vector3d& v : mesh.vertices) out.append("v ").append(number_text(v)).append("\n");
  out += "vn 0 0 1\n";
  for (const TriangleMesh::Triangle& t : mesh.triangles) {
    out += "f";
    for (const std::uint32_t v : t) (out += ' ').append(std::to_string(v + 1)).append("//1");
    out += "\n";
  }
  return out;
}

}  // namespace twoport::test
