#pragma once

#include <algorithm>
#include <cmath>
#include <variant>
#include <vector>

#include "common/contact/shape.h"

namespace twoport {

/// Below this sliding speed Coulomb friction falls linearly to zero [m/s].
inline constexpr double kStictionSpeed = 1e-3;

/// Contact properties of a surface: stiffness and damping along the normal, friction across it.
struct Material {
  double stiffness_n_per_m, damping_n_s_per_m, friction, viscous_friction_n_s_per_m;

  /// What no direction exceeds, for the length of steps.
  [[nodiscard]] double all_damping_n_s_per_m() const noexcept { return damping_n_s_per_m + viscous_friction_n_s_per_m; }
};

/// Force of one contact on the point that touches [N], in two parts.
template <int D>
struct ContactForce {
  Point<D> normal, tangential;
  double coulomb_damping;  ///< μ |f_n| / max(|v_t|, 1 mm/s) [N s/m]
};

/// A shape with its material: spring and damper along the normal, friction across it.
struct Surface {
  Shape shape;
  Material material;

  /// Force on a point that is inside, at a signed distance -d, moving with v = v_n n + v_t [m/s]. False, and nothing
  /// written, if it leaves faster than the spring follows. `kContinued`: the law beyond that, and outside; it pulls there, without Coulomb
  /// friction.
  ///
  ///     f_n = max(0, K d - B v_n) n                       never pulls
  ///     f_t = -B_t v_t - μ |f_n| v_t / max(|v_t|, 1 mm/s)
  template <int D, bool kContinued = false>
  [[nodiscard]] bool force(const SignedDistance<D>& at, double vn, const Point<D>& v,
                           ContactForce<D>& out) const noexcept {
    const double depth = -at.distance;
    const double fn = material.stiffness_n_per_m * depth - material.damping_n_s_per_m * vn;
    if (!kContinued && fn <= 0.0) return false;
    out.normal = fn * at.normal;
    out.tangential.setZero();
    out.coulomb_damping = 0.0;
    if constexpr (D > 1) {
      if (material.friction > 0.0 || material.viscous_friction_n_s_per_m > 0.0) {
        Point<D> vt = v - vn * at.normal;
        if (const double squared = at.normal.squaredNorm(); std::abs(squared - 1.0) > 1e-9) [[unlikely]]
          vt = v - vn / squared * at.normal;  // the gradient of an interpolated distance
        const double pressed = kContinued ? std::max(fn, 0.0) : fn;
        out.coulomb_damping = material.friction * pressed / std::max(vt.norm(), kStictionSpeed);
        out.tangential = -(material.viscous_friction_n_s_per_m + out.coulomb_damping) * vt;
      }
    }
    return true;
  }
  /// Elastic energy of a point at a signed distance [J]: K d²/2 inside.
  [[nodiscard]] double potential(double distance) const noexcept {
    const double depth = std::max(0.0, -distance);
    return 0.5 * material.stiffness_n_per_m * depth * depth;
  }
  template <int D>
  [[nodiscard]] double potential(const Point<D>& p) const noexcept {
    return potential(signed_distance<D>(shape, p).distance);
  }
};

/// Motion of an anchor about its place: a sin(2πft) along one axis. Amplitude 0: none.
struct AnchorMotion {
  int axis = 0;
  double amplitude_m = 0.0, frequency_hz = 0.0;
};

/// A spring and damper between a point and an anchor; bilateral.
struct Spring {
  static constexpr const char* kName = "spring";
  double stiffness_n_per_m, damping_n_s_per_m;
  Eigen::Vector3d anchor_m;
  AnchorMotion motion{};   ///< a simulated robot adds its force (sim/sim_robot.h)
  int contact_point = -1;  ///< the only point of a tool that it acts on; -1: all

  /// Does it act on the tool's point with this index?
  [[nodiscard]] bool acts_on(int point) const noexcept { return contact_point < 0 || contact_point == point; }

  /// K (anchor - p) - B v  [N]
  template <int D>
  [[nodiscard]] Point<D> force(const Point<D>& p, const Point<D>& v) const noexcept {
    return stiffness_n_per_m * (anchor_m.head<D>() - p) - damping_n_s_per_m * v;
  }
  /// K |anchor - p|²/2  [J]
  template <int D>
  [[nodiscard]] double potential(const Point<D>& p) const noexcept {
    return 0.5 * stiffness_n_per_m * (anchor_m.head<D>() - p).squaredNorm();
  }
};

/// One element of the environment.
using EnvironmentSpec = std::variant<Surface, Spring>;

/// Its block in a scene.
inline const char* name(const EnvironmentSpec& spec) {
  const auto* surface = std::get_if<Surface>(&spec);
  return surface != nullptr ? name(surface->shape) : Spring::kName;
}

/// All elements of the environment.
struct World {
  std::vector<Surface> surfaces;
  std::vector<Spring> springs;

  World() = default;
  explicit World(const std::vector<EnvironmentSpec>& specs) {
    for (const EnvironmentSpec& spec : specs)
      if (const auto* surface = std::get_if<Surface>(&spec))
        surfaces.push_back(*surface);
      else
        springs.push_back(std::get<Spring>(spec));
  }
};

}  // namespace twoport
