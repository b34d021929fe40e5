#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <variant>
#include <vector>

#include "common/contact/contact_law.h"

namespace twoport {

/// No finite point outside of it has a negative distance to the shape. Without an end: walls, cylinders, holes and meshes.
inline Eigen::AlignedBox3d bounds(const Shape& shape) {
  using Eigen::Vector3d;
  Eigen::AlignedBox3d box;
  const auto extend = [&](const Vector3d& center, const Vector3d& half) {
    box.extend(Vector3d{center - half});
    box.extend(Vector3d{center + half});
  };
  // Half the size of a circle of radius 1 about the axis.
  const auto circle = [](const Vector3d& a) {
    return Vector3d{std::hypot(a.y(), a.z()), std::hypot(a.z(), a.x()), std::hypot(a.x(), a.y())};
  };
  if (const auto* sphere = std::get_if<Sphere>(&shape)) {
    extend(sphere->center_m, Vector3d::Constant(sphere->radius_m));
  } else if (const auto* cuboid = std::get_if<Box>(&shape)) {
    extend(cuboid->center_m, cuboid->half_size_m);
  } else if (const auto* torus = std::get_if<Torus>(&shape)) {
    extend(torus->center_m, torus->radius_m * circle(torus->axis) + Vector3d::Constant(torus->tube_radius_m));
  } else if (const auto* capsule = std::get_if<Capsule>(&shape)) {
    for (const Vector3d& end : {capsule->start_m, capsule->end_m}) extend(end, Vector3d::Constant(capsule->radius_m));
  } else if (const auto* plate = std::get_if<Plate>(&shape)) {
    extend(plate->center_m, plate->rotation.cwiseAbs() * plate->half_size_m);
  } else if (std::holds_alternative<Peg>(shape) || std::holds_alternative<Cone>(shape)) {
    const auto* peg = std::get_if<Peg>(&shape);
    const Revolved& part = peg ? static_cast<const Revolved&>(*peg) : std::get<Cone>(shape);
    for (const Profile::Segment& s : part.profile->segments())
      for (const Eigen::Vector2d& at : {s.origin, Eigen::Vector2d{s.origin + s.to * s.along}})
        extend(part.point_m + at.y() * part.axis, at.x() * circle(part.axis));
  } else {
    constexpr double kFar = std::numeric_limits<double>::infinity();
    return {Vector3d::Constant(-kFar), Vector3d::Constant(kFar)};
  }
  const double rounding = 1e-9 * (1.0 + box.min().cwiseAbs().cwiseMax(box.max().cwiseAbs()).maxCoeff());
  return {box.min().array() - rounding, box.max().array() + rounding};
}

/// Which of many surfaces a point may be inside of, by a k-d tree: a leaf lists, in ascending order, all surfaces whose bounds meet its
/// cell. A query is one way down the tree.
template <int D>
class BroadPhase {
 public:
  /// More surfaces than these are worth a search: measured by bench_shapes.
  static constexpr std::size_t kFew = 8;

  BroadPhase() = default;
  /// `margin_m`: as if every surface had grown by it.
  explicit BroadPhase(const std::vector<Surface>& surfaces, double margin_m = 0.0) {
    std::vector<Cell> boxes;
    std::vector<int> all;
    for (const Surface& s : surfaces) {
      const Eigen::AlignedBox3d box = bounds(s.shape);
      all.push_back(static_cast<int>(boxes.size()));
      boxes.emplace_back(Point<D>{box.min().head<D>().array() - margin_m},
                         Point<D>{box.max().head<D>().array() + margin_m});
    }
    constexpr double kFar = std::numeric_limits<double>::infinity();
    build(boxes, all, {Point<D>::Constant(-kFar), Point<D>::Constant(kFar)}, kDepth);
  }

  [[nodiscard]] bool empty() const noexcept { return nodes_.empty(); }
  /// Numbers of the surfaces, ascending, among which are all whose distance from p is negative.
  [[nodiscard]] std::span<const int> at(const Point<D>& p) const noexcept {
    const Node* node = nodes_.data();
    while (node->axis >= 0) node = p[node->axis] < node->at ? node + 1 : nodes_.data() + node->first;
    return {listed_.data() + node->first, node->count};
  }

 private:
  using Cell = Eigen::AlignedBox<double, D>;
  static constexpr std::size_t kLeaf = 4;  // surfaces
  static constexpr int kDepth = 16;        // at most, so that surfaces in several leaves do not fill the memory
  struct Node {
    double at = 0.0;          ///< where the cell is split
    int axis = -1;            ///< -1: a leaf
    std::uint32_t first = 0;  ///< of a leaf's surfaces in listed_, or the child beyond `at`; the other follows the node
    std::uint32_t count = 0;  ///< of a leaf's surfaces
  };

  void build(const std::vector<Cell>& boxes, const std::vector<int>& listed, const Cell& cell, int depth) {
    const std::size_t index = nodes_.size();
    nodes_.emplace_back();
    // The split that leaves the fewest on its fuller side; one that leaves most of them on both is worth nothing.
    Node node;
    std::size_t most = listed.size() - listed.size() / 4;
    for (int axis = 0; axis < D && listed.size() > kLeaf && depth > 0; ++axis) {
      std::vector<double> ends;
      for (const int i : listed)
        for (const double end :
             {boxes[static_cast<std::size_t>(i)].min()[axis], boxes[static_cast<std::size_t>(i)].max()[axis]})
          if (cell.min()[axis] < end && end < cell.max()[axis]) ends.push_back(end);
      if (ends.empty()) continue;
      const auto middle = ends.begin() + static_cast<std::ptrdiff_t>(ends.size() / 2);
      std::nth_element(ends.begin(), middle, ends.end());
      const auto [before, beyond] = split(boxes, listed, axis, *middle);
      if (std::max(before.size(), beyond.size()) >= most) continue;
      most = std::max(before.size(), beyond.size());
      node.axis = axis, node.at = *middle;
    }
    if (node.axis < 0) {
      node.first = static_cast<std::uint32_t>(listed_.size()), node.count = static_cast<std::uint32_t>(listed.size());
      listed_.insert(listed_.end(), listed.begin(), listed.end());
    } else {
      const auto [before, beyond] = split(boxes, listed, node.axis, node.at);
      Cell below = cell, above = cell;
      below.max()[node.axis] = above.min()[node.axis] = node.at;
      build(boxes, before, below, depth - 1);
      node.first = static_cast<std::uint32_t>(nodes_.size());
      build(boxes, beyond, above, depth - 1);
    }
    nodes_[index] = node;
  }
  struct Halves {
    std::vector<int> before, beyond;
  };
  static Halves split(const std::vector<Cell>& boxes, const std::vector<int>& listed, int axis, double at) {
    Halves halves;
    for (const int i : listed) {
      const Cell& box = boxes[static_cast<std::size_t>(i)];
      if (box.min()[axis] < at) halves.before.push_back(i);
      if (box.max()[axis] >= at) halves.beyond.push_back(i);
    }
    return halves;
  }

  std::vector<Node> nodes_;
  std::vector<int> listed_;
};

}  // namespace twoport
