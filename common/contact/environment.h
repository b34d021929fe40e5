#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <numbers>
#include <span>
#include <utility>
#include <vector>

#include "common/base/spatial_vector.h"
#include "common/base/vector.h"
#include "common/contact/broad_phase.h"
#include "common/contact/contact_law.h"

namespace twoport {

/// Which contacts of a tool are certainly open, from distances that were measured earlier. A signed distance changes by no more than its
/// point moves, so a contact that was open by d stays open until the tool's points have gone d:
///
///     s(k) = s(k-1) + |x(k) - x(k-1)| + reach ‖R(k) - R(k-1)‖/√2        reach: the largest |r| of the points x + R r
///
/// is at least their way, as R(k) - R(k-1) has the singular values 2 sin(θ/2), 2 sin(θ/2), 0. To leave such contacts out changes no
/// result. Poses may come in any order, the stages of an integrator too.
class Clearance {
 public:
  Clearance() = default;
  /// Of a tool with `contacts` pairs of a point and a surface.
  Clearance(const std::vector<Eigen::Vector3d>& tool, int contacts)
      : until_(static_cast<std::size_t>(contacts), kUnknown) {
    for (const Eigen::Vector3d& point : tool) reach_ = std::max(reach_, point.norm());
  }

  [[nodiscard]] bool empty() const noexcept { return until_.empty(); }
  void move_to(const Eigen::Vector3d& x, const Eigen::Matrix3d& R) noexcept {
    const double way = (x - x_).norm() + reach_ / std::numbers::sqrt2 * (R - R_).norm();
    travelled_ += way + kRounding;
    x_ = x;
    R_ = R;
    if (!(travelled_ < kLong_m)) [[unlikely]]
      forget();
  }
  /// Are contacts `first` to `first + count - 1` certainly open?
  [[nodiscard]] bool open(int first, int count) const noexcept {
    for (int i = first; i < first + count; ++i)
      if (!(travelled_ < until_[static_cast<std::size_t>(i)])) return false;
    return true;
  }
  /// At the pose moved to last, the contact is open by `distance` at least [m].
  void measured(int contact, double distance) noexcept {
    until_[static_cast<std::size_t>(contact)] = travelled_ + distance - kMargin_m;
  }

 private:
  static constexpr double kUnknown = -std::numeric_limits<double>::infinity();
  static constexpr double kLong_m = 100.0;    ///< so that a sum errs by less than kRounding
  static constexpr double kRounding = 1e-14;  ///< of a way and its sum [m]
  static constexpr double kMargin_m = 1e-9;   ///< for the rounding of a distance

  /// Also where a pose was not finite.
  void forget() noexcept {
    travelled_ = 0.0;
    std::fill(until_.begin(), until_.end(), kUnknown);
  }

  double reach_ = 0.0, travelled_ = 0.0;
  Eigen::Vector3d x_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d R_ = Eigen::Matrix3d::Identity();
  std::vector<double> until_;  ///< the way from which a contact may be closed [m]
};

/// A position and, for N = 6, its attitude as a matrix too, which several computations need.
template <int N>
struct PoseWithRotation {
  Position<N> x;
  PoseWithRotation(const Position<N>& at) : x{at} {}
};
template <>
struct PoseWithRotation<6> {
  Position<6> x;
  Eigen::Matrix3d R;  ///< body to world
  PoseWithRotation(const Position<6>& at) : x{at}, R{at.attitude().toRotationMatrix()} {}
};

/// Effect of one contact on the port.
template <int N>
struct ContactPort {
  int index;                         ///< of the contact
  Feature feature;                   ///< in contact
  bool presses;                      ///< carries force: the point does not separate faster than the spring follows
  PortVector<N> normal, tangential;  ///< forces on the port; a spring is all normal [N], [N m]
  Energy potential;                  ///< elastic energy held
  double coulomb_damping = 0.0;      ///< friction force per sliding velocity, its Coulomb part [N s/m]
};

/// A contact and the feature that it is on.
struct Touched {
  int index;
  Feature feature;
  friend bool operator==(const Touched&, const Touched&) = default;
};

/// How far a point with this signed distance is from touching, at least [m]: the distance changes by no more than the point moves. Only
/// that of a mesh may change faster: each of its interpolant's partial derivatives is at most 1 beside rounding, its gradient √3.
inline double least_way(const Shape& shape, double distance) noexcept {
  return std::holds_alternative<Mesh>(shape) ? 0.5 * distance : distance;
}

/// The environment at a port of size N: for N = 1, 3 the port itself makes contact, for N = 6 points of a tool, so
/// that a wrench with torque results. All forces act on the port, in world axes, at the tool's origin [N], [N m].
///
/// A contact is a pair of a point and a surface or spring, numbered from 0: for each point first the surfaces, then the
/// springs. The caller stores the state of a contact: the environment has none.
template <int N>
class Environment {
 public:
  static constexpr int kDim = kAxes<N>;
  using Vector = PortVector<N>;

  /// `tool`: the points in tool axes [m]; N = 6 only.
  explicit Environment(const std::vector<EnvironmentSpec>& specs, const std::vector<Eigen::Vector3d>& tool = {})
      : world_{specs}, tool_{tool} {}

  [[nodiscard]] const World& world() const { return world_; }
  /// From now on a surface has this stiffness and friction.
  void set_surface(std::size_t surface, double stiffness_n_per_m, double friction) noexcept {
    Material& material = world_.surfaces[surface].material;
    material.stiffness_n_per_m = stiffness_n_per_m;
    material.friction = friction;
  }
  [[nodiscard]] const std::vector<Eigen::Vector3d>& tool() const { return tool_; }
  [[nodiscard]] bool empty() const { return world_.surfaces.empty() && world_.springs.empty(); }
  /// Does it hold on to the port wherever that is? Else the two touch where it answers with a force.
  [[nodiscard]] bool holds() const { return !world_.springs.empty(); }
  [[nodiscard]] int contacts() const { return static_cast<int>(N == 6 ? tool_.size() : 1) * contacts_of_a_point(); }

  /// Stiffness and damping of a contact [N/m], [N s/m]; viscous friction counts as damping.
  [[nodiscard]] std::pair<double, double> impedance_of(int contact) const noexcept {
    const auto kind = static_cast<std::size_t>(contact % contacts_of_a_point());
    if (kind < world_.surfaces.size()) {
      const Material& m = world_.surfaces[kind].material;
      return {m.stiffness_n_per_m, m.all_damping_n_s_per_m()};
    }
    const Spring& s = world_.springs[kind - world_.surfaces.size()];
    return {s.stiffness_n_per_m, s.damping_n_s_per_m};
  }
  /// Point of the tool that makes this contact.
  [[nodiscard]] int point_of(int contact) const noexcept { return contact / contacts_of_a_point(); }

  /// Calls visit(const ContactPort<N>&) for every contact that the port is inside of, and for every spring.
  /// `pick(index)` returns the feature of that contact to use, or kNone.
  template <class Pick, class Visit>
  void for_each_contact(const PoseWithRotation<N>& x, const Vector& v, Pick pick, Visit visit) const noexcept {
    int point = 0;
    for_each_point(x, v, [&](const Point<kDim>& p, const Point<kDim>& pv, const Point<kDim>& arm) {
      contacts_of(
          point++, p, pv, arm, pick, [](int, const Surface&, double) {}, visit);
    });
  }
  template <class Visit>
  void for_each_contact(const PoseWithRotation<N>& x, const Velocity<N>& v, Visit visit) const noexcept {
    for_each_contact(
        x, port_vector<N>(v.vec()), [](int) { return kNearest; }, visit);
  }

  /// The same by a look only at what `near`, of this environment's surfaces, finds; where it is empty, at all.
  template <class Visit>
  void for_each_contact(const PoseWithRotation<N>& x, const Vector& v, const BroadPhase<kDim>& near,
                        Visit visit) const noexcept {
    const int surfaces = static_cast<int>(world_.surfaces.size());
    for (int point = 0, index = 0; point < points(); ++point, index += contacts_of_a_point()) {
      const At at = at_point(point, x, v);
      const int* listed = nullptr;
      std::size_t count = world_.surfaces.size();
      if (!near.empty()) [[unlikely]] {
        const std::span<const int> found = near.at(at.p);
        listed = found.data(), count = found.size();
      }
      for (std::size_t i = 0; i < count; ++i) {
        const std::size_t surface = listed ? static_cast<std::size_t>(listed[i]) : i;
        touch(index + static_cast<int>(surface), world_.surfaces[surface], kNearest, at, visit);
      }
      for (int i = 0; i < static_cast<int>(world_.springs.size()); ++i)
        if (const Spring& s = world_.springs[static_cast<std::size_t>(i)]; s.acts_on(point))
          pull(index + surfaces + i, s, at, visit);
    }
  }
  /// The same only for the contacts `among`, ascending, on their features, whose law goes on where they leave: damping and viscous friction
  /// make a force begin and end with a jump, and here it has a derivative on that edge too.
  template <class Visit>
  void for_each_contact(const PoseWithRotation<N>& x, const Vector& v, std::span<const Touched> among,
                        Visit visit) const noexcept {
    const int kinds = contacts_of_a_point(), surfaces = static_cast<int>(world_.surfaces.size());
    int point = -1, end = 0;
    for (auto next = among.begin(); next != among.end();) {
      while (next->index >= end) ++point, end += kinds;
      const At at = at_point(point, x, v);
      for (; next != among.end() && next->index < end; ++next) {
        const int kind = next->index - (end - kinds);
        if (kind < surfaces)
          touch<true>(next->index, world_.surfaces[static_cast<std::size_t>(kind)], next->feature, at, visit);
        else
          pull(next->index, world_.springs[static_cast<std::size_t>(kind - surfaces)], at, visit);
      }
    }
  }

  [[nodiscard]] Force<N> force(const PoseWithRotation<N>& x, const Velocity<N>& v) const noexcept {
    Vector sum = Vector::Zero();
    for_each_contact(x, v, [&](const ContactPort<N>& c) {
      if (c.presses) sum += c.normal + c.tangential;
    });
    return Force<N>{sum};
  }

  /// for_each_contact without a look at the contacts that `clearance`, of this tool, knows to be open. The results are the same.
  template <class Visit>
  void for_each_contact(const PoseWithRotation<N>& x, const Vector& v, Clearance& clearance, Visit visit) const noexcept
      requires(N == 6) {
    const int surfaces = static_cast<int>(world_.surfaces.size()), kinds = contacts_of_a_point();
    clearance.move_to(x.x.translation(), x.R);
    for (int point = 0; point < static_cast<int>(tool_.size()); ++point) {
      if (kinds == surfaces && clearance.open(point * kinds, surfaces)) continue;
      const Eigen::Vector3d arm = x.R * tool_[static_cast<std::size_t>(point)];
      contacts_of(
          point, x.x.translation() + arm, v.linear + v.angular.cross(arm), arm,
          [&](int index) { return clearance.open(index, 1) ? kNone : kNearest; },
          [&](int index, const Surface& s, double distance) {
            clearance.measured(index, least_way(s.shape, distance));
          },
          visit);
    }
  }
  /// Knows no contact yet.
  [[nodiscard]] Clearance clearance() const { return {tool_, contacts()}; }

  /// Elastic energy held at x [J].
  [[nodiscard]] Energy potential(const Position<N>& x) const noexcept {
    double sum = 0.0;
    for_each_potential(x, [&](int, Energy u) { sum += u.si(); });
    return Energy{sum};
  }

  /// Calls visit(index, elastic energy) for every contact.
  template <class Visit>
  void for_each_potential(const Position<N>& x, Visit visit) const noexcept {
    int index = 0, point = 0;
    for_each_point(x, Vector::Zero(), [&](const Point<kDim>& p, const Point<kDim>&, const Point<kDim>&) {
      for (const Surface& s : world_.surfaces) visit(index++, Energy{s.potential<kDim>(p)});
      for (const Spring& s : world_.springs) {
        if (s.acts_on(point)) visit(index, Energy{s.potential<kDim>(p)});
        ++index;
      }
      ++point;
    });
  }

 private:
  [[nodiscard]] int contacts_of_a_point() const {
    return static_cast<int>(world_.surfaces.size() + world_.springs.size());
  }
  /// for_each_contact for one point; open(index, surface, distance) is told of a contact that is open.
  template <class Pick, class Open, class Visit>
  void contacts_of(int point, const Point<kDim>& p, const Point<kDim>& pv, const Point<kDim>& arm, const Pick& pick,
                   const Open& open, const Visit& visit) const noexcept {
    int index = point * contacts_of_a_point();
    ContactForce<kDim> c;
    for (const Surface& s : world_.surfaces) {
      const Feature feature = pick(index);
      if (feature != kNone) {
        const SignedDistance<kDim> at = signed_distance<kDim>(s.shape, p, feature);
        if (at.distance < 0.0) {
          const Energy potential{s.potential(at.distance)};
          if (s.force(at, at.normal.dot(pv), pv, c))
            visit(ContactPort<N>{index, at.feature, true, wrench(c.normal, arm), wrench(c.tangential, arm), potential,
                                 c.coulomb_damping});
          else
            visit(ContactPort<N>{index, at.feature, false, Vector::Zero(), Vector::Zero(), potential});
        } else {
          open(index, s, at.distance);
        }
      }
      ++index;
    }
    for (const Spring& s : world_.springs) {
      if (s.acts_on(point))
        visit(ContactPort<N>{index, 0, true, wrench(s.force<kDim>(p, pv), arm), Vector::Zero(),
                             Energy{s.potential<kDim>(p)}});
      ++index;
    }
  }
  /// Calls visit(position, velocity, arm from the tool's origin) for every contact point.
  template <class Visit>
  void for_each_point(const PoseWithRotation<N>& at, const Vector& v, Visit visit) const noexcept {
    if constexpr (N == 6) {
      for (const Eigen::Vector3d& point : tool_) {
        Eigen::Vector3d arm = at.R * point;
        visit(Point<3>{at.x.translation() + arm}, Point<3>{v.linear + v.angular.cross(arm)}, arm);
      }
    } else {
      visit(at.x.translation(), v, Point<kDim>{Point<kDim>::Zero()});
    }
  }
  /// Place and velocity of a contact point, and its arm from the tool's origin.
  struct At {
    Point<kDim> p, v, arm;
  };
  [[nodiscard]] int points() const noexcept { return N == 6 ? static_cast<int>(tool_.size()) : 1; }
  [[nodiscard]] At at_point(int point, const PoseWithRotation<N>& x, const Vector& v) const noexcept {
    if constexpr (N == 6) {
      At at;
      at.arm = x.R * tool_[static_cast<std::size_t>(point)];
      at.p = x.x.translation() + at.arm;
      at.v = v.linear + v.angular.cross(at.arm);
      return at;
    } else {
      (void)point;
      return {x.x.translation(), v, Point<kDim>::Zero()};
    }
  }
  /// `kContinued`: outside of the surface too.
  template <bool kContinued = false, class Visit>
  static void touch(int index, const Surface& s, Feature feature, const At& at, const Visit& visit) noexcept {
    const SignedDistance<kDim> found = signed_distance<kDim>(s.shape, at.p, feature);
    if (!kContinued && !(found.distance < 0.0)) return;
    const Energy potential{s.potential(found.distance)};
    ContactForce<kDim> c;
    if (s.template force<kDim, kContinued>(found, found.normal.dot(at.v), at.v, c))
      visit(ContactPort<N>{index, found.feature, true, wrench(c.normal, at.arm), wrench(c.tangential, at.arm),
                           potential, c.coulomb_damping});
    else
      visit(ContactPort<N>{index, found.feature, false, Vector::Zero(), Vector::Zero(), potential});
  }
  template <class Visit>
  static void pull(int index, const Spring& s, const At& at, const Visit& visit) noexcept {
    visit(ContactPort<N>{index, 0, true, wrench(s.force<kDim>(at.p, at.v), at.arm), Vector::Zero(),
                         Energy{s.potential<kDim>(at.p)}});
  }
  static Vector wrench(const Point<kDim>& f, const Point<kDim>& arm) noexcept {
    if constexpr (N == 6) {
      return {f, arm.cross(f)};
    } else {
      (void)arm;
      return f;
    }
  }

  World world_;
  std::vector<Eigen::Vector3d> tool_;
};

}  // namespace twoport
