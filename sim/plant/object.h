#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "common/contact/contact_law.h"
#include "common/scene/scene.h"

namespace twoport::sim {

/// A box that does not turn, between two fingers and on the surfaces of an environment: contacts whose friction sticks.
///
///     f_n = max(0, K d - B v_n) n         d: depth of the point, v: its velocity against the solid
///     f_t = -K δ - B v_t, at most μ f_n    δ = (r - a) across n, r: the point in the solid
///
/// a, the anchor, stays while the contact sticks, follows where K |δ| is beyond μ f_n, and is r where the contact is open. Within a step of an
/// integrator anchors stay, so that a force is a function of positions and velocities; settle() moves them after it.
class Object {
 public:
  using Point = Eigen::Vector3d;
  struct Moving {
    Point x, v;
  };
  using Fingers = std::array<Moving, 2>;
  /// Forces of contacts on the fingers and on the box [N], their power on all of them together [W], elastic energy [J].
  struct Forces {
    std::array<Point, 2> on_finger;
    Point on_box;
    double power, elastic_j;
  };

  Object(const ObjectSpec& spec, const std::vector<Surface>& surfaces, const std::array<Point, 2>& fingers)
      : spec_{spec}, box_{Point::Zero(), spec.half_size_m}, surfaces_{surfaces}, anchors_(2 + surfaces.size()) {
    for (std::size_t i = 0; i < 2; ++i) anchors_[i] = fingers[i] - spec.position_m;
    for (std::size_t i = 0; i < surfaces.size(); ++i) anchors_[2 + i] = foot(spec.position_m);
  }

  [[nodiscard]] const ObjectSpec& spec() const noexcept { return spec_; }

  [[nodiscard]] Forces forces(const Moving& box, const Fingers& fingers) const noexcept {
    Forces all{{Point::Zero(), Point::Zero()}, Point::Zero(), 0.0, 0.0};
    for_each_contact(box, fingers, [&](std::size_t i, const Contact& c) {
      const Hold h = hold(c, anchors_[i]);
      if (i < 2)
        all.on_finger[i] = h.force, all.on_box -= h.force;
      else
        all.on_box += h.force;
      all.power += h.force.dot(c.v);
      all.elastic_j += h.elastic_j;
    });
    return all;
  }
  /// After a step.
  void settle(const Moving& box, const Fingers& fingers) noexcept {
    for_each_contact(box, fingers, [&](std::size_t i, const Contact& c) { anchors_[i] = hold(c, anchors_[i]).anchor; });
  }

 private:
  struct Contact {
    const Material* of;
    SignedDistance<3> at;
    Point r, v;
  };
  struct Hold {
    Point force, anchor;
    double elastic_j;
  };

  [[nodiscard]] Point foot(const Point& x) const noexcept { return x - spec_.half_size_m.z() * Point::UnitZ(); }

  template <class Visit>
  void for_each_contact(const Moving& box, const Fingers& fingers, const Visit& visit) const noexcept {
    for (std::size_t i = 0; i < 2; ++i) {
      const Point r = fingers[i].x - box.x;
      visit(i, Contact{&spec_.material, box_.signed_distance<3>(r, kNearest), r, fingers[i].v - box.v});
    }
    for (std::size_t i = 0; i < surfaces_.size(); ++i) {
      const Point p = foot(box.x);
      visit(2 + i, Contact{&surfaces_[i].material, signed_distance<3>(surfaces_[i].shape, p), p, box.v});
    }
  }
  [[nodiscard]] static Hold hold(const Contact& c, const Point& anchor) noexcept {
    const double depth = -c.at.distance, vn = c.at.normal.dot(c.v);
    if (!(depth > 0.0)) return {Point::Zero(), c.r, 0.0};
    const Material& m = *c.of;
    const double pressed = std::max(0.0, m.stiffness_n_per_m * depth - m.damping_n_s_per_m * vn),
                 most = m.friction * pressed;
    const Point apart = c.r - anchor, stretch = apart - c.at.normal.dot(apart) * c.at.normal,
                spring = -m.stiffness_n_per_m * stretch;
    Point across = spring - m.damping_n_s_per_m * (c.v - vn * c.at.normal);
    if (const double size = across.norm(); size > most) across *= most / size;
    const double stretched = spring.norm();
    return {pressed * c.at.normal + across, stretched > most ? Point{c.r - most / stretched * stretch} : anchor,
            0.5 * m.stiffness_n_per_m * (depth * depth + stretch.squaredNorm())};
  }

  ObjectSpec spec_;
  Box box_;
  std::vector<Surface> surfaces_;
  std::vector<Point> anchors_;  ///< of the fingers, then of the surfaces
};

}  // namespace twoport::sim
