#include "common/mesh/joined.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <compare>
#include <cstdint>
#include <map>
#include <numbers>
#include <numeric>
#include <tuple>
#include <unordered_map>
#include <utility>

namespace twoport {
namespace {

using Triangle = TriangleMesh::Triangle;

/// Sets that grow together; each is named by its least member.
class Sets {
 public:
  explicit Sets(std::size_t members) : parent_(members) { std::iota(parent_.begin(), parent_.end(), 0u); }

  std::uint32_t of(std::uint32_t i) {
    for (; parent_[i] != i; i = parent_[i]) parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(std::uint32_t i, std::uint32_t k) {
    const std::uint32_t a = of(i), b = of(k);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

/// Side i of triangle k is half an edge and has the number 3 k + i, as the corner has that it begins at.
class Joiner {
 public:
  explicit Joiner(const TriangleMesh& mesh) : mesh_{mesh}, corners_{3 * mesh.triangles.size()} {
    left_.resize(3 * mesh.triangles.size());
    std::iota(left_.begin(), left_.end(), 0u);
  }

  /// Joins halves between the same `place`s, a number of each vertex; what is left is tried again. Halves that are alone with one another
  /// are joined; of more, with `all`, those that have solid between them.
  void join(const std::vector<std::uint32_t>& place, bool all) {
    std::vector<std::pair<std::uint64_t, std::uint32_t>> halves;
    halves.reserve(left_.size());
    for (const std::uint32_t h : left_) halves.emplace_back(edge_of(place[vertex(h)], place[vertex(next(h))]), h);
    std::ranges::sort(halves);
    left_.clear();
    const auto along = [&](std::uint32_t h) { return place[vertex(h)] < place[vertex(next(h))]; };
    for (std::size_t i = 0, end; i < halves.size(); i = end) {
      for (end = i + 1; end < halves.size() && halves[i].first == halves[end].first;) ++end;
      const std::uint32_t h = halves[i].second;
      const bool has_length = place[vertex(h)] != place[vertex(next(h))];
      if (has_length && end - i == 2 && along(h) != along(halves[i + 1].second)) {
        join(h, halves[i + 1].second);
        continue;
      }
      std::vector<std::uint32_t> here;
      for (std::size_t k = i; k < end; ++k) here.push_back(halves[k].second);
      if (has_length && all) join_around(here, along);
      left_.insert(left_.end(), here.begin(), here.end());
    }
  }
  /// Halves left between the same places run in the same direction: they are one edge, and no gap.
  void join_odd(const std::vector<std::uint32_t>& place) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> first;
    for (const std::uint32_t h : left_) {
      const auto [at, is_new] = first.try_emplace({place[vertex(h)], place[vertex(next(h))]}, h);
      if (is_new) continue;
      corners_.join(h, at->second);
      corners_.join(next(h), next(at->second));
    }
  }
  /// Of the vertices of what is left; others have a place of their own.
  [[nodiscard]] std::vector<std::uint32_t> places_within(double distance) const {
    std::vector<std::uint32_t> place(mesh_.vertices.size());
    std::iota(place.begin(), place.end(), 0u);
    std::vector<std::uint32_t> open;
    for (const std::uint32_t h : left_) open.push_back(vertex(h)), open.push_back(vertex(next(h)));
    std::ranges::sort(open);
    open.erase(std::unique(open.begin(), open.end()), open.end());
    if (distance > 0.0) {
      Sets sets{mesh_.vertices.size()};
      std::map<std::tuple<double, double, double>, std::vector<std::uint32_t>> cells;
      for (const std::uint32_t v : open) {
        const Eigen::Vector3d& p = mesh_.vertices[v];
        const Eigen::Vector3d cell = (p / distance).array().floor();
        for (int i = -1; i <= 1; ++i)
          for (int j = -1; j <= 1; ++j)
            for (int k = -1; k <= 1; ++k)
              if (const auto at = cells.find({cell.x() + i, cell.y() + j, cell.z() + k}); at != cells.end())
                for (const std::uint32_t other : at->second)
                  if ((mesh_.vertices[other] - p).squaredNorm() <= distance * distance) sets.join(v, other);
        cells[{cell.x(), cell.y(), cell.z()}].push_back(v);
      }
      for (const std::uint32_t v : open) place[v] = sets.of(v);
    } else {
      std::map<std::array<double, 3>, std::uint32_t> first;
      for (const std::uint32_t v : open) {
        const Eigen::Vector3d& p = mesh_.vertices[v];
        place[v] = first.try_emplace({p.x() + 0.0, p.y() + 0.0, p.z() + 0.0}, v).first->second;
      }
    }
    return place;
  }
  [[nodiscard]] bool done() const { return left_.empty(); }
  TriangleMesh mesh() {
    constexpr std::uint32_t kNew = 0xffffffff;
    std::vector<std::uint32_t> index(3 * mesh_.triangles.size(), kNew);
    TriangleMesh out;
    for (std::uint32_t k = 0; k < mesh_.triangles.size(); ++k) {
      Triangle t{};
      for (std::uint32_t i = 0; i < 3; ++i) {
        std::uint32_t& of = index[corners_.of(3 * k + i)];
        if (of == kNew) {
          of = static_cast<std::uint32_t>(out.vertices.size());
          out.vertices.push_back(mesh_.vertices[vertex(3 * k + i)]);
        }
        t[i] = of;
      }
      if (t[0] != t[1] && t[1] != t[2] && t[2] != t[0]) out.triangles.push_back(t);
    }
    return out;
  }

 private:
  static std::uint32_t next(std::uint32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }
  [[nodiscard]] std::uint32_t vertex(std::uint32_t h) const { return mesh_.triangles[h / 3][h % 3]; }
  [[nodiscard]] const Eigen::Vector3d& at(std::uint32_t h) const { return mesh_.vertices[vertex(h)]; }
  void join(std::uint32_t a, std::uint32_t b) { corners_.join(a, next(b)), corners_.join(b, next(a)); }

  /// Takes the halves that it joins out of `halves`. Around the edge, seen along it, solid begins behind a triangle that runs against it
  /// and ends at the next one that runs along it.
  template <class Along>
  void join_around(std::vector<std::uint32_t>& halves, const Along& along) {
    constexpr double kSame = 1e-6;  // [rad]
    const auto turn = static_cast<std::int64_t>(std::llround(2.0 * std::numbers::pi / kSame));
    const std::uint32_t h0 = halves[0], from = along(h0) ? h0 : next(h0), to = along(h0) ? next(h0) : h0;
    const Eigen::Vector3d axis = (at(to) - at(from)).normalized(), across = axis.unitOrthogonal();
    const Eigen::Vector3d up = axis.cross(across);
    struct Side {
      std::int64_t angle;
      bool begins;
      std::uint32_t half;
      auto operator<=>(const Side&) const = default;
    };
    std::vector<Side> sides;
    for (const std::uint32_t h : halves) {
      const Eigen::Vector3d d = at(next(next(h))) - at(from);
      const auto angle = static_cast<std::int64_t>(std::llround(std::atan2(d.dot(up), d.dot(across)) / kSame));
      sides.push_back({(angle % turn + turn) % turn, !along(h), h});
    }
    std::ranges::sort(sides);
    std::vector<std::uint32_t> begun, ends;
    for (const Side& side : sides) {
      if (side.begins) {
        begun.push_back(side.half);
      } else if (begun.empty()) {
        ends.push_back(side.half);
      } else {
        join(begun.back(), side.half);
        begun.pop_back();
      }
    }
    // Solid over the angle 0.
    std::size_t i = 0;
    for (; i < ends.size() && !begun.empty(); ++i, begun.pop_back()) join(begun.back(), ends[i]);
    halves = std::move(begun);
    halves.insert(halves.end(), ends.begin() + static_cast<std::ptrdiff_t>(i), ends.end());
  }

  const TriangleMesh& mesh_;
  Sets corners_;
  std::vector<std::uint32_t> left_;  ///< halves that are not joined
};

TriangleMesh joined(const TriangleMesh& mesh) {
  Joiner joiner{mesh};
  std::vector<std::uint32_t> own(mesh.vertices.size());
  std::iota(own.begin(), own.end(), 0u);
  joiner.join(own, false);
  if (joiner.done()) return mesh;
  std::vector<std::uint32_t> place = joiner.places_within(0.0);
  joiner.join(place, true);
  if (!joiner.done()) {
    double largest = 0.0;
    for (const Eigen::Vector3d& v : mesh.vertices) largest = std::max(largest, v.cwiseAbs().maxCoeff());
    place = joiner.places_within(std::ldexp(largest, -20));
    joiner.join(place, true);
    joiner.join_odd(place);
  }
  return joiner.mesh();
}

bool is_flat(const TriangleMesh& mesh, const Triangle& t) {
  const Eigen::Vector3d& a = mesh.vertices[t[0]];
  return !((mesh.vertices[t[1]] - a).cross(mesh.vertices[t[2]] - a).squaredNorm() > 0.0);
}

/// Turns the longest side of each flat triangle, until none is left or nothing changes; those that are left are taken out.
std::size_t take_in_flat(TriangleMesh& mesh) {
  const auto key = [](std::uint32_t from, std::uint32_t to) { return static_cast<std::uint64_t>(from) << 32 | to; };
  std::unordered_map<std::uint64_t, std::uint32_t> of_half;
  std::vector<std::uint32_t> flat;
  for (std::uint32_t k = 0; k < mesh.triangles.size(); ++k) {
    const Triangle& t = mesh.triangles[k];
    for (std::size_t i = 0; i < 3; ++i) of_half[key(t[i], t[(i + 1) % 3])] = k;
    if (is_flat(mesh, t)) flat.push_back(k);
  }
  for (std::size_t tries = 10 * flat.size(); !flat.empty() && tries > 0; --tries) {
    const std::uint32_t k = flat.back();
    flat.pop_back();
    const Triangle t = mesh.triangles[k];
    if (!is_flat(mesh, t)) continue;
    const auto length = [&](std::size_t i) {
      return (mesh.vertices[t[(i + 1) % 3]] - mesh.vertices[t[i]]).squaredNorm();
    };
    const std::size_t i = length(0) >= length(1) && length(0) >= length(2) ? 0 : length(1) >= length(2) ? 1 : 2;
    const std::uint32_t from = t[i], to = t[(i + 1) % 3], between = t[(i + 2) % 3];
    const auto beyond = of_half.find(key(to, from));
    if (beyond == of_half.end() || beyond->second == k) continue;
    const std::uint32_t n = beyond->second;
    std::uint32_t far = 0;
    for (const std::uint32_t v : mesh.triangles[n])
      if (v != from && v != to) far = v;
    if (far == between) continue;
    mesh.triangles[n] = {to, between, far};
    mesh.triangles[k] = {between, from, far};
    of_half.erase(key(from, to)), of_half.erase(key(to, from));
    of_half[key(to, between)] = of_half[key(between, far)] = of_half[key(far, to)] = n;
    of_half[key(between, from)] = of_half[key(from, far)] = of_half[key(far, between)] = k;
    flat.push_back(k), flat.push_back(n);
  }
  const std::size_t before = mesh.triangles.size();
  std::erase_if(mesh.triangles, [&](const Triangle& t) { return is_flat(mesh, t); });
  return before - mesh.triangles.size();
}

}  // namespace

TriangleMesh joined(TriangleMesh mesh, const std::vector<Triangle>& flat, std::size_t& left_out) {
  left_out = flat.size();
  TriangleMesh without = joined(mesh);
  if (flat.empty()) return without;
  const std::size_t open = faults_of(without).open_edges;
  if (open == 0) return without;
  mesh.triangles.insert(mesh.triangles.end(), flat.begin(), flat.end());
  TriangleMesh with = joined(mesh);
  const std::size_t out = take_in_flat(with);
  if (faults_of(with).open_edges >= open) return without;
  left_out = out;
  return with;
}

}  // namespace twoport
