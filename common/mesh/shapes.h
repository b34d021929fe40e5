#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "common/mesh/triangle_mesh.h"

namespace twoport {

// Shapes for pictures.

/// A profile of (radius, height) from axis to axis, turned about z; the first corner is half a side from the x axis.
TriangleMesh turned(const std::vector<Eigen::Vector2d>& profile, std::uint32_t sides);
/// About the origin, with edges of 1.
TriangleMesh unit_box();
/// About the origin and the z axis, with radius and height 1.
TriangleMesh unit_cylinder();
/// Two half spheres about (0, 0, ±half_length) and what is between them.
TriangleMesh capsule(double radius, double half_length);

/// Adds a mesh at a place, which may scale and mirror it.
void append(TriangleMesh& to, const TriangleMesh& mesh, const Eigen::Affine3d& at);

}  // namespace twoport
