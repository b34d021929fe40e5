#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/mesh/triangle_mesh.h"

namespace twoport {

/// Nearest point of a mesh, by a binary tree of axis-aligned boxes. A query does not allocate.
///
/// The sign of the distance is that of (p - nearest)·n with n the pseudonormal of the feature that holds the nearest point:
/// the normal of a triangle, the sum of both triangles' at an edge, the sum weighted by angles at a vertex (Bærentzen, Aanæs,
/// Signed distance computation using the angle weighted pseudonormal, IEEE TVCG 11(3), 2005). For a closed mesh of one shell that does
/// not cross itself it is exact; see solids.h for others.
class BoundingVolumeTree {
 public:
  struct Nearest {
    Eigen::Vector3d point;         ///< of the mesh
    Eigen::Vector3d pseudonormal;  ///< there; not of unit length
    double squared_distance;
    std::uint32_t triangle;  ///< of the tree's own order: for `near` of the next query
    /// Negative inside.
    [[nodiscard]] double signed_distance(const Eigen::Vector3d& p) const noexcept;
  };

  /// Of a mesh with at least one triangle.
  explicit BoundingVolumeTree(const TriangleMesh& mesh);

  /// `near`: a triangle that is likely to be near, such as that of the query before; it only makes the query faster.
  [[nodiscard]] Nearest nearest(const Eigen::Vector3d& p, std::uint32_t near = 0) const noexcept;
  /// From one triangle of the tree's own order.
  [[nodiscard]] double distance(std::uint32_t triangle, const Eigen::Vector3d& p) const noexcept;
  /// Where an edge of the mesh goes through the inside of a triangle; nothing: the mesh does not cross itself.
  [[nodiscard]] std::optional<Eigen::Vector3d> crossing() const;
  [[nodiscard]] std::uint32_t size() const noexcept { return static_cast<std::uint32_t>(faces_.size()); }
  /// Of a triangle of the tree's own order.
  [[nodiscard]] const std::array<Eigen::Vector3d, 3>& corners(std::uint32_t triangle) const noexcept {
    return faces_[triangle].corner;
  }

 private:
  static constexpr std::uint32_t kLeaf = 4;  // triangles
  struct Node {
    Eigen::AlignedBox3d box;
    std::uint32_t first;  ///< triangle of a leaf, or the second child; the first child follows the node
    std::uint32_t count;  ///< triangles; 0: no leaf
  };
  struct Face {
    std::array<Eigen::Vector3d, 3> corner;
    std::array<std::uint32_t, 3> vertex;
  };

  std::uint32_t build(std::vector<std::uint32_t>& order, std::uint32_t first, std::uint32_t last,
                      const TriangleMesh& mesh, const std::vector<Eigen::Vector3d>& centers);

  std::vector<Node> nodes_;
  std::vector<Face> faces_;                              ///< in the order of the leaves
  std::vector<std::array<Eigen::Vector3d, 4>> normals_;  ///< of each face: its own, and those of its edges 01, 12, 20
  std::vector<Eigen::Vector3d> vertex_normals_;
};

}  // namespace twoport
