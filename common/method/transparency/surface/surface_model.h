#pragma once

#include <algorithm>

#include "common/base/low_pass.h"
#include "common/base/scalar.h"
#include "common/contact/signed_distance.h"
#include "common/method/transparency/surface/surface_patch.h"

namespace twoport {

/// The master's model of the surface that the slave touches. It follows the slave's estimate without a jump, and remembers a
/// surface that the slave has left.
///
///     contact, no model      model = estimate, ρ = 0
///     contact                (d, m) = the model's depth and normal at the estimate's p
///                            n = m + a (n' - m),  p = p' - (1 - a) d m,  likewise K*, κ,   a = T/50 ms;   μ: T/100 ms
///     free or K* = 0, d(x_s) > 2 mm    p += y n, y = T/20 ms (d - 2 mm): no surface where the robot is free;   ρ -= y/20 mm
///                                      ρ < 0 or d(x_s) > 20 mm: no model. What was lifted, and left, hangs in no other place
///     else                             ρ rises to 1 in 0.1 s
///
/// n', p', K*', κ': the slave's estimate. d(x_s): depth of the robot in the model.
template <int D>
class SurfaceModel {
 public:
  using Vector = Point<D>;

  void forget() noexcept { exists_ = false, ramp_ = 0.0; }
  /// ρ = 1.
  void show_at_once() noexcept { ramp_ = 1.0; }

  /// `estimate` of the newest packet, whose normal may be any vector; `robot`: the robot's contact point in it.
  void step(bool contact, SurfacePatch<D> estimate, const Vector& robot, Seconds dt) noexcept {
    double rise = dt.si() / kRamp_s;
    if (contact && make_valid(estimate)) {
      if (exists_) {
        follow(estimate, dt);
      } else {
        patch_ = estimate;
        exists_ = true;
        ramp_ = 0.0;
      }
    } else if (exists_) {
      const double yielded_m = yield_to(robot, dt);
      if (yielded_m > 0.0) rise = -yielded_m / kForget_m;
    }
    if (!exists_) return;
    ramp_ = std::min(1.0, ramp_ + rise);
    if (ramp_ < 0.0) forget();
  }

  [[nodiscard]] bool exists() const noexcept { return exists_; }
  [[nodiscard]] double ramp() const noexcept { return ramp_; }  ///< ρ
  [[nodiscard]] const SurfacePatch<D>& patch() const noexcept { return patch_; }
  /// F = K* [d]+ n.
  [[nodiscard]] Vector force(const SurfaceDepth<D>& at) const noexcept {
    if (!exists_ || at.depth <= 0.0) return Vector::Zero();
    return patch_.stiffness * at.depth * at.normal;
  }
  /// |ρ F|²/2K*.
  [[nodiscard]] Energy stored(const SurfaceDepth<D>& at) const noexcept {
    if (!exists_ || at.depth <= 0.0) return {};
    const double depth = ramp_ * at.depth;
    return Energy{0.5 * patch_.stiffness * depth * depth};
  }

 private:
  static constexpr double kFollow_s = 50e-3, kFriction_s = 0.1, kRamp_s = 0.1;
  static constexpr double kYield_s = 20e-3, kYield_m = 2e-3, kForget_m = 20e-3;
  static constexpr double kMost_n_per_m = 1e6, kMostCurvature_per_m = 1e3;

  /// Normalizes the normal and limits the rest. False: no surface can be made of it.
  static bool make_valid(SurfacePatch<D>& of) noexcept {
    const double size = of.normal.norm();
    if (!(size > 1e-6) || !(of.stiffness > 0.0)) return false;
    of.normal /= size;
    of.stiffness = std::min(of.stiffness, kMost_n_per_m);
    of.friction = std::clamp(of.friction, 0.0, 1.0);
    of.curvature = std::clamp(of.curvature, -kMostCurvature_per_m, kMostCurvature_per_m);
    return true;
  }

  void follow(const SurfacePatch<D>& estimate, Seconds dt) noexcept {
    const double a = low_pass_weight(dt, kFollow_s);
    const SurfaceDepth<D> old = patch_.at(estimate.point);
    Vector n = old.normal + a * (estimate.normal - old.normal);
    const double size = n.norm();
    patch_.normal = size > 1e-3 ? Vector{n / size} : estimate.normal;
    patch_.point = estimate.point - (1.0 - a) * old.depth * old.normal;
    low_pass(patch_.stiffness, estimate.stiffness, dt, kFollow_s);
    low_pass(patch_.curvature, estimate.curvature, dt, kFollow_s);
    low_pass(patch_.friction, estimate.friction, dt, kFriction_s);
  }

  /// y.
  double yield_to(const Vector& robot, Seconds dt) noexcept {
    const SurfaceDepth<D> at = patch_.at(robot);
    if (at.depth > kForget_m) forget();
    if (!exists_ || at.depth <= kYield_m) return 0.0;
    const double yielded_m = low_pass_weight(dt, kYield_s) * (at.depth - kYield_m);
    patch_.point += yielded_m * at.normal;
    return yielded_m;
  }

  SurfacePatch<D> patch_;
  bool exists_ = false;
  double ramp_ = 0.0;
};

/// Static friction on a surface: a spring along it whose anchor z slips.
///
///     f = K e,   e = y - z along the surface,   |e| <= μ F_n/K: beyond, z follows y;   e decays with the time constant τ
///
/// The decay leaves what lasts to the measured force: two springs that have followed two set points differ by what they remember.
template <int D>
class StickSpring {
 public:
  using Vector = Point<D>;
  void release() noexcept { sticks_ = false; }
  /// Force at y, opposite to sliding for the hand (positive f·v enters the port); `most` = μ F_n, `decay` = T/τ.
  Vector step(const Vector& y, const Vector& normal, double most, double stiffness, double decay = 0.0) noexcept {
    if (D == 1 || !(stiffness > 0.0)) return Vector::Zero();
    if (!sticks_) anchor_ = y;
    sticks_ = true;
    Vector e = y - anchor_;
    e -= e.dot(normal) * normal;
    e -= decay * e;
    const double size = e.norm(), longest = most / stiffness;
    if (size > longest) e *= longest / size;
    anchor_ = y - e;
    return stiffness * e;
  }

 private:
  Vector anchor_ = Vector::Zero();
  bool sticks_ = false;
};

}  // namespace twoport
