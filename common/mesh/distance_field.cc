#include "common/mesh/distance_field.h"

#include <array>

#include "common/mesh/bounding_volume_tree.h"

namespace twoport {
namespace {

constexpr double kMargin = 4.0;  // nodes around the mesh

struct Grid {
  Eigen::Vector3d origin;
  std::array<std::size_t, 3> size;
};
Grid grid_around(const Eigen::Vector3d& low, const Eigen::Vector3d& high, double spacing) {
  Grid grid{low - Eigen::Vector3d::Constant(kMargin * spacing), {}};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto i = static_cast<int>(axis);
    grid.size[axis] = static_cast<std::size_t>(std::ceil((high[i] - low[i]) / spacing + 2.0 * kMargin)) + 1;
  }
  return grid;
}

}  // namespace

double DistanceField::nodes(const TriangleMesh& mesh, double spacing_m) {
  Eigen::Vector3d low = mesh.vertices[0], high = low;
  for (const Eigen::Vector3d& v : mesh.vertices) low = low.cwiseMin(v), high = high.cwiseMax(v);
  return ((high - low) / spacing_m + Eigen::Vector3d::Constant(2.0 * kMargin + 2.0)).prod();
}

DistanceField::DistanceField(const TriangleMesh& mesh, double spacing_m) : spacing_{spacing_m} {
  const BoundingVolumeTree tree{mesh};
  const auto [origin, size] = grid_around(tree.low(), tree.high(), spacing_m);
  origin_ = origin;
  stride_[0] = 1, stride_[1] = size[0], stride_[2] = size[0] * size[1];
  // The nodes around u are floor(u + 1/2) and the ones beside it.
  for (int axis = 0; axis < 3; ++axis) last_[axis] = static_cast<double>(size[static_cast<std::size_t>(axis)]) - 2.0;
  coefficients_.resize(size[0] * size[1] * size[2]);
  std::uint32_t near = 0;
  for (std::size_t k = 0, n = 0; k < size[2]; ++k)
    for (std::size_t j = 0; j < size[1]; ++j)
      for (std::size_t i = 0; i < size[0]; ++i, ++n) {
        const Eigen::Vector3d p = origin + spacing_m * Eigen::Vector3d{static_cast<double>(i), static_cast<double>(j),
                                                                       static_cast<double>(k)};
        const auto found = tree.nearest(p, near);
        near = found.triangle;
        coefficients_[n] = static_cast<float>(found.signed_distance(p));
      }
}

}  // namespace twoport
