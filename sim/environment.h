#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <vector>

#include "common/base/vector.h"
#include "common/scene/scene.h"
#include "sim/linear.h"
#include "sim/path.h"

namespace twoport::sim {

template <int N>
inline constexpr int kAxes = N == 1 ? 1 : 3;

/// Which side of a shape answers. Only a box has more than one, and is not smooth where they meet.
using Face = signed char;
inline constexpr Face kNearest = -1, kNone = -2;

/// What touches, and how deep: depth = -(signed distance) [m], positive inside; normal = its gradient, outward. Both
/// come from one function, so that the elastic force has a potential.
template <int D>
struct Touch {
  double depth;
  Eigen::Matrix<double, D, 1> normal;
  Face face = 0;
};

/// A solid shape in D = 1 or 3 dimensions.
template <int D>
struct Shape {
  using Vector = Eigen::Matrix<double, D, 1>;
  enum class Kind : unsigned char { wall, sphere, cylinder, box } kind;
  Vector a = Vector::Zero();  ///< wall: normal; else: centre or a point of the axis
  Vector b = Vector::Zero();  ///< cylinder: axis; box: half size
  double r = 0.0;             ///< wall: offset; sphere, cylinder: radius

  /// A `face` that it returned before continues smoothly past the edges of the box.
  [[nodiscard, gnu::always_inline]] Touch<D> touch(const Vector& p, Face face = kNearest) const noexcept {
    if (kind == Kind::wall) return {r - a.dot(p), a};
    return solid(p, face);
  }

 private:
  [[gnu::noinline]] Touch<D> solid(const Vector& p, Face face) const noexcept {
    if (kind == Kind::box) return flat(p - a, face);
    return round(kind == Kind::sphere ? Vector{p - a} : Vector{(p - a) - b.dot(p - a) * b});
  }
  Touch<D> flat(const Vector& from_centre, Face face) const noexcept {
    int axis = face / 2;
    bool negative = face % 2 != 0;
    if (face == kNearest) {
      (from_centre.cwiseAbs() - b).maxCoeff(&axis);
      negative = from_centre[axis] < 0.0;
    }
    Vector n = Vector::Zero();
    n[axis] = negative ? -1.0 : 1.0;
    return {b[axis] - n[axis] * from_centre[axis], n, static_cast<Face>(2 * axis + negative)};
  }
  Touch<D> round(const Vector& from_centre) const noexcept {
    const double distance = from_centre.norm();
    Vector n = Vector::Unit(0);
    if (distance > 0.0) n = from_centre / distance;
    return {r - distance, n};
  }
};

/// Force of one contact on the point that touches, in two parts.
template <int D>
struct ContactForce {
  Eigen::Matrix<double, D, 1> normal, tangential;
  Face face = 0;
};

template <int D>
struct Surface {
  using Vector = Eigen::Matrix<double, D, 1>;
  Shape<D> shape;
  Material material;

  /// Force on a point at p moving with v. Null vectors where it does not touch.
  ///
  ///     f_n = max(0, K d - B v_n) n                       never pulls
  ///     f_t = -B_t v_t - μ |f_n| v_t / max(|v_t|, 1 mm/s)
  [[nodiscard, gnu::always_inline]] bool force(const Vector& p, const Vector& v, ContactForce<D>& out,
                                               Face face = kNearest) const noexcept {
    const Touch<D> t = shape.touch(p, face);
    return t.depth > 0.0 && force(t, t.normal.dot(v), v, out);
  }
  /// The same for what touches, at the velocity vn along its normal.
  [[nodiscard, gnu::always_inline]] bool force(const Touch<D>& t, double vn, const Vector& v,
                                               ContactForce<D>& out) const noexcept {
    const double fn = material.stiffness_n_per_m * t.depth - material.damping_n_s_per_m * vn;
    if (fn <= 0.0) return false;
    out.face = t.face;
    out.normal = fn * t.normal;
    out.tangential.setZero();
    if constexpr (D > 1) {
      if (material.friction > 0.0 || material.viscous_friction_n_s_per_m > 0.0) {
        Vector vt = v - vn * t.normal;
        const double coulomb = material.friction * fn / std::max(vt.norm(), kStictionSpeed);
        out.tangential = -(material.viscous_friction_n_s_per_m + coulomb) * vt;
      }
    }
    return true;
  }
  [[nodiscard]] double potential(const Vector& p) const noexcept {
    const double d = std::max(0.0, shape.touch(p).depth);
    return 0.5 * material.stiffness_n_per_m * d * d;
  }
};

template <int D>
struct AnchoredSpring {
  using Vector = Eigen::Matrix<double, D, 1>;
  double stiffness_n_per_m, damping_n_s_per_m;
  Vector anchor;

  [[nodiscard]] Vector force(const Vector& p, const Vector& v) const noexcept {
    return stiffness_n_per_m * (anchor - p) - damping_n_s_per_m * v;
  }
  [[nodiscard]] double potential(const Vector& p) const noexcept {
    return 0.5 * stiffness_n_per_m * (anchor - p).squaredNorm();
  }
};

/// Everything that can be touched, as seen by one point in D dimensions.
template <int D>
struct World {
  std::vector<Surface<D>> surfaces;
  std::vector<AnchoredSpring<D>> springs;

  explicit World(const std::vector<EnvironmentSpec>& specs) {
    using Kind = typename Shape<D>::Kind;
    const auto zero = Eigen::Matrix<double, D, 1>::Zero().eval();
    for (const EnvironmentSpec& spec : specs) {
      if (const auto* w = std::get_if<WallSpec>(&spec)) {
        surfaces.push_back({{Kind::wall, vector<D>(w->normal), zero, w->offset_m}, w->material});
      } else if (const auto* s = std::get_if<SphereSpec>(&spec)) {
        surfaces.push_back({{Kind::sphere, vector<D>(s->center_m), zero, s->radius_m}, s->material});
      } else if (const auto* c = std::get_if<CylinderSpec>(&spec)) {
        surfaces.push_back({{Kind::cylinder, vector<D>(c->point_m), vector<D>(c->axis), c->radius_m}, c->material});
      } else if (const auto* b = std::get_if<BoxSpec>(&spec)) {
        surfaces.push_back({{Kind::box, vector<D>(b->center_m), vector<D>(b->half_size_m), 0.0}, b->material});
      } else {
        const auto& e = std::get<SpringSpec>(spec);
        springs.push_back({e.stiffness_n_per_m, e.damping_n_s_per_m, vector<D>(e.anchor_m)});
      }
    }
  }
};

/// A position and, for N = 6, its attitude as a matrix, which several things need.
template <int N>
struct Placed {
  Position<N> x;
  Placed(const Position<N>& at) : x{at} {}
};
template <>
struct Placed<6> {
  Position<6> x;
  Eigen::Matrix3d R;  ///< body to world
  Placed(const Position<6>& at) : x{at}, R{at.attitude().toRotationMatrix()} {}
};

/// The environment as a port of size N sees it: N = 1, 3 touch with the port itself, N = 6 with points of a tool, so
/// that a wrench with torque comes back. All forces act on the port, in world axes, at the tool's origin.
template <int N>
class Environment {
 public:
  static constexpr int kDim = kAxes<N>;
  using Point = Eigen::Matrix<double, kDim, 1>;
  using Wrench = typename Force<N>::Vector;

  explicit Environment(const Scene& scene) : world_{scene.environment} {
    for (const Numbers& p : scene.tool) tool_.push_back(vector<3>(p));
  }

  [[nodiscard]] const World<kDim>& world() const { return world_; }
  [[nodiscard]] const std::vector<Eigen::Vector3d>& tool() const { return tool_; }
  [[nodiscard]] bool empty() const { return world_.surfaces.empty() && world_.springs.empty(); }
  [[nodiscard]] int contacts() const {
    return static_cast<int>((N == 6 ? tool_.size() : 1) * (world_.surfaces.size() + world_.springs.size()));
  }

  /// Calls visit(index, normal wrench, tangential wrench) for every contact; a spring is all normal.
  template <class Visit>
  void for_each_contact(const Placed<N>& x, const Velocity<N>& v, Visit visit) const noexcept {
    for_each_contact(
        x, v, [](int) { return kNearest; },
        [&](int index, Face, const Wrench& n, const Wrench& t) { visit(index, n, t); });
  }

  /// The same as visit(index, face, ...), where pick(index) tells which face of that contact answers, if any.
  template <class Pick, class Visit>
  void for_each_contact(const Placed<N>& x, const Velocity<N>& v, Pick pick, Visit visit) const noexcept {
    int index = 0;
    for_each_point(x, v, [&](const Point& p, const Point& pv, const Point& arm) {
      ContactForce<kDim> c;
      for (const auto& s : world_.surfaces) {
        const Face face = pick(index);
        if (face != kNone && s.force(p, pv, c, face))
          visit(index, c.face, wrench(c.normal, arm), wrench(c.tangential, arm));
        ++index;
      }
      for (const auto& s : world_.springs) visit(index++, Face{0}, wrench(s.force(p, pv), arm), Wrench{Wrench::Zero()});
    });
  }

  [[nodiscard, gnu::always_inline]] Force<N> force(const Placed<N>& x, const Velocity<N>& v) const noexcept {
    Wrench sum = Wrench::Zero();
    for_each_contact(x, v, [&](int, const Wrench& n, const Wrench& t) { sum += n + t; });
    return Force<N>{sum};
  }

  /// Elastic energy held at x [J].
  [[nodiscard]] Energy potential(const Position<N>& x) const noexcept {
    double sum = 0.0;
    for_each_point(x, {}, [&](const Point& p, const Point&, const Point&) {
      for (const auto& s : world_.surfaces) sum += s.potential(p);
      for (const auto& s : world_.springs) sum += s.potential(p);
    });
    return Energy{sum};
  }

  /// Elastic energy of each contact, in the order of for_each_contact.
  template <class Visit>
  void for_each_potential(const Position<N>& x, Visit visit) const noexcept {
    int index = 0;
    for_each_point(x, {}, [&](const Point& p, const Point&, const Point&) {
      for (const auto& s : world_.surfaces) visit(index++, Energy{s.potential(p)});
      for (const auto& s : world_.springs) visit(index++, Energy{s.potential(p)});
    });
  }

 private:
  template <class Visit>
  void for_each_point(const Placed<N>& at, const Velocity<N>& v, Visit visit) const noexcept {
    if constexpr (N == 6) {
      Eigen::Vector3d linear = v.vec().template head<3>(), angular = v.vec().template tail<3>();
      for (const Eigen::Vector3d& point : tool_) {
        Eigen::Vector3d arm = at.R * point;
        visit(Point{at.x.translation() + arm}, Point{linear + angular.cross(arm)}, arm);
      }
    } else {
      visit(at.x.translation(), v.vec(), Point{Point::Zero()});
    }
  }
  static Wrench wrench(const Point& f, const Point& arm) noexcept {
    if constexpr (N == 6) {
      Wrench w;
      w << f, arm.cross(f);
      return w;
    } else {
      (void)arm;
      return f;
    }
  }

  World<kDim> world_;
  std::vector<Eigen::Vector3d> tool_;
};

}  // namespace twoport::sim
