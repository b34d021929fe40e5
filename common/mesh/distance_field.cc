#include "common/mesh/distance_field.h"

#include <algorithm>
#include <array>
#include <limits>
#include <utility>

#include "common/mesh/solids.h"

namespace twoport {
namespace {

constexpr double kMargin = 4.0;  // nodes around the mesh
constexpr double kBand = 6.0;    // nodes around a triangle that are sampled exactly
constexpr std::uint32_t kNoTriangle = 0xffffffff, kInBand = 0xfffffffe;

struct Grid {
  Eigen::Vector3d origin;
  double spacing;
  std::array<std::size_t, 3> size, stride;

  [[nodiscard]] std::size_t count() const { return size[2] * stride[2]; }
  [[nodiscard]] Eigen::Vector3d at(std::size_t i, std::size_t j, std::size_t k) const {
    return origin + spacing * Eigen::Vector3d{static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)};
  }
};
Grid grid_around(const Eigen::AlignedBox3d& box, double spacing) {
  Grid grid{box.min() - Eigen::Vector3d::Constant(kMargin * spacing), spacing, {}, {}};
  for (std::size_t axis = 0; axis < 3; ++axis)
    grid.size[axis] =
        static_cast<std::size_t>(std::ceil(box.sizes()[static_cast<int>(axis)] / spacing + 2.0 * kMargin)) + 1;
  grid.stride = {1, grid.size[0], grid.size[0] * grid.size[1]};
  return grid;
}

/// kInBand for the nodes less than kBand nodes from a triangle's bounding box, else kNoTriangle.
std::vector<std::uint32_t> band_around(const BoundingVolumeTree& tree, const Grid& grid) {
  std::vector<std::uint32_t> marks(grid.count(), kNoTriangle);
  for (std::uint32_t n = 0; n < tree.size(); ++n) {
    const std::array<Eigen::Vector3d, 3>& t = tree.corners(n);
    std::array<std::size_t, 3> from, to;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto i = static_cast<int>(axis);
      const auto [low, high] = std::minmax({t[0][i], t[1][i], t[2][i]});
      from[axis] = static_cast<std::size_t>(std::max(0.0, std::ceil((low - grid.origin[i]) / grid.spacing - kBand)));
      to[axis] = std::min(grid.size[axis] - 1,
                          static_cast<std::size_t>(std::floor((high - grid.origin[i]) / grid.spacing + kBand)));
    }
    for (std::size_t k = from[2]; k <= to[2]; ++k)
      for (std::size_t j = from[1]; j <= to[1]; ++j) {
        const auto row = marks.begin() + static_cast<std::ptrdiff_t>(j * grid.stride[1] + k * grid.stride[2]);
        std::fill(row + static_cast<std::ptrdiff_t>(from[0]), row + static_cast<std::ptrdiff_t>(to[0] + 1), kInBand);
      }
  }
  return marks;
}

/// Signed distances at the nodes. In the band they are exact, by the tree. Elsewhere a node takes the nearest of the triangles that are
/// nearest to its neighbours, in sweeps along the diagonals (Tsai, Rapid and accurate computation of the distance function using grids,
/// J. Computational Physics 178, 2002), and the neighbour's sign: no surface is between them.
std::vector<float> distances(const BoundingVolumeTree& tree, const Grid& grid) {
  std::vector<float> distance(grid.count(), std::numeric_limits<float>::infinity());
  std::vector<std::uint32_t> nearest = band_around(tree, grid);
  std::vector<bool> exact(grid.count(), false);
  const auto& size = grid.size;
  std::uint32_t near = 0;
  for (std::size_t k = 0, n = 0; k < size[2]; ++k)
    for (std::size_t j = 0; j < size[1]; ++j)
      for (std::size_t i = 0; i < size[0]; ++i, ++n) {
        if (nearest[n] != kInBand) continue;
        const Eigen::Vector3d p = grid.at(i, j, k);
        const auto found = tree.nearest(p, near);
        near = nearest[n] = found.triangle;
        distance[n] = static_cast<float>(found.signed_distance(p));
        exact[n] = true;
      }
  constexpr unsigned kDiagonals = 8;
  for (unsigned sweep = 0; sweep < kDiagonals; ++sweep) {
    const auto backwards = [&](std::size_t axis) { return (sweep >> axis & 1u) != 0; };
    const auto along = [&](std::size_t step, std::size_t axis) {
      return backwards(axis) ? size[axis] - 1 - step : step;
    };
    std::array<std::size_t, 3> step;
    for (step[2] = 0; step[2] < size[2]; ++step[2])
      for (step[1] = 0; step[1] < size[1]; ++step[1])
        for (step[0] = 0; step[0] < size[0]; ++step[0]) {
          const std::size_t i = along(step[0], 0), j = along(step[1], 1), k = along(step[2], 2);
          const std::size_t n = i + j * grid.stride[1] + k * grid.stride[2];
          if (exact[n]) continue;
          const Eigen::Vector3d p = grid.at(i, j, k);
          for (std::size_t axis = 0; axis < 3; ++axis) {
            if (step[axis] == 0) continue;
            const std::size_t from = backwards(axis) ? n + grid.stride[axis] : n - grid.stride[axis];
            const std::uint32_t triangle = nearest[from];
            if (triangle == kNoTriangle || triangle == nearest[n]) continue;
            const double trial = tree.distance(triangle, p);
            if (trial >= std::abs(static_cast<double>(distance[n]))) continue;
            distance[n] = std::copysign(static_cast<float>(trial), distance[from]);
            nearest[n] = triangle;
          }
        }
  }
  return distance;
}

}  // namespace

double DistanceField::nodes(const TriangleMesh& mesh, double spacing_m) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& v : mesh.vertices) box.extend(v);
  return (box.sizes() / spacing_m + Eigen::Vector3d::Constant(2.0 * kMargin + 2.0)).prod();
}

DistanceField::DistanceField(const TriangleMesh& mesh, double spacing_m) : spacing_{spacing_m} {
  const Grid grid = grid_around(bounds(mesh), spacing_m);
  origin_ = grid.origin;
  // The nodes around u are floor(u + 1/2) and the ones beside it.
  for (std::size_t axis = 0; axis < 3; ++axis) {
    stride_[axis] = grid.stride[axis];
    last_[static_cast<int>(axis)] = static_cast<double>(grid.size[axis]) - 2.0;
  }
  const auto combine = [](std::vector<float>& with, const std::vector<float>& other, auto choose) {
    std::transform(with.begin(), with.end(), other.begin(), with.begin(), choose);
  };
  for (const Solid& solid : solids_of(mesh).all) {
    std::vector<float> of_solid = distances(solid.outer, grid);
    for (const BoundingVolumeTree& cavity : solid.cavities)
      combine(of_solid, distances(cavity, grid), [](float a, float b) { return std::max(a, b); });
    if (coefficients_.empty()) {
      coefficients_ = std::move(of_solid);
    } else {
      combine(coefficients_, of_solid, [](float a, float b) { return std::min(a, b); });
    }
  }
}

}  // namespace twoport
