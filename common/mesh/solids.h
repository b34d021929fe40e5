#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "common/mesh/bounding_volume_tree.h"
#include "common/mesh/triangle_mesh.h"

namespace twoport {

/// A shell that faces outwards, without the shells in it that face inwards. With d > 0 outside and the exact distances of the shells
///
///     d = max(d_outer, d_cavity, ...)
///
/// and of several solids, which may overlap and lie in each other, the least: outside it is the exact distance of their union, on its
/// surface it is 0, inside it is negative and at most as deep as the union (as deep, where one of the solids is).
struct Solid {
  BoundingVolumeTree outer;
  std::vector<BoundingVolumeTree> cavities;
};

struct Solids {
  std::vector<Solid> all;
  /// A vertex of a shell that faces inwards and lies in no other as a whole: what is inside is unknown.
  std::optional<Eigen::Vector3d> inward;
};

/// The connected parts of a mesh without faults, each with its own vertices: triangles are connected by edges.
std::vector<TriangleMesh> shells_of(const TriangleMesh& mesh);

/// A point of a triangle of a shell that has not its inside behind it and its outside before it: of a part that is inside out, or of
/// triangles that lie on each other. By the winding number w, the sum of the solid angles of all triangles over 4π: before a
/// triangle that faces outwards it is 0, behind it 1 (Jacobson, Kavan, Sorkine-Hornung, Robust inside-outside segmentation using
/// generalized winding numbers, ACM TOG 32(4), 2013). Of a shell of more than 1400 triangles the largest are tried, so many that 4
/// million solid angles are summed.
std::optional<Eigen::Vector3d> misplaced(const TriangleMesh& shell);

/// Of a mesh without faults (faults_of).
Solids solids_of(const TriangleMesh& mesh);

}  // namespace twoport
