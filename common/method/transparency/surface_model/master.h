#pragma once

#include <algorithm>
#include <limits>

#include "common/base/low_pass.h"
#include "common/method/layers.h"
#include "common/method/transparency/surface/payload.h"
#include "common/method/transparency/surface/surface_model.h"

namespace twoport {

/// Master half of model-mediated teleoperation: the hand feels a local model of the surface, and nothing else.
///
///     model: SurfaceModel follows the slave's n, p, K*, μ, κ
///     f_d  = ρ F(x) + stick spring,  F = K* [d(x)]+ n              inside, else 0;   K* <= m_handle/(4 T²)
///     g    = K* T/2 (n·v) n                                        at most m_handle/(4T)
///
/// x: handle; N = 6: its contact point x + R b, b the slave's lever, and the torque (R b) × F.
/// Source: Mitra, Niemeyer, Int. J. Robotics Research 27(2), 2008; the energy limit in place of a gate on updates.
template <int N>
class SurfaceModelMaster final : public Copyable<SurfaceModelMaster<N>, MasterTransparency<N>> {
 public:
  explicit SurfaceModelMaster(const ControlOptions& o)
      : stiffness_{o.force_scale * o.motion_scale * o.coupling.stiffness_n_per_m}, mass_kg_{o.handle_mass_kg} {}

  void start(const DeviceSample<N>&) noexcept override {
    model_.forget();
    stick_.release();
    heard_ = false;
  }

  Wish<N> wish(const MasterInput<N>& in) noexcept override {
    if (!in.active) return {};
    if (read(in.slave.words, said_)) heard_ = true;
    if (heard_) follow_surface(in.dt);
    const Vector arm = arm_of(in.device.x);
    const Vector point = in.device.x.translation() + arm;
    const SurfaceDepth<D> surface = model_.patch().at(point);
    const bool inside = model_.exists() && surface.depth > 0.0;
    const double most = mass_kg_ > 0.0 ? mass_kg_ / (4.0 * in.dt.si()) : stiffness_ * in.dt.si();
    typename Force<N>::Vector wanted = Force<N>::Vector::Zero(), damper = wanted;
    if (inside) {
      const double k = model_.patch().stiffness;
      const Vector elastic = std::min(1.0, most / (k * in.dt.si())) * model_.ramp() * model_.force(surface);
      const Vector f =
          elastic + stick_.step(point, surface.normal, model_.patch().friction * elastic.norm(), stiffness_);
      wanted.template head<D>() = f;
      if constexpr (N == 6) wanted.template tail<3>() = arm.cross(f);
      const Vector v = in.device.v.vec().template head<D>();
      damper.template head<D>() = std::min(0.5 * in.dt.si() * k, most) * surface.normal.dot(v) * surface.normal;
    } else {
      stick_.release();
    }
    return {.idle = false,
            .f = Force<N>{in.ramp * wanted},
            .damper = Force<N>{in.ramp * damper},
            .damped = true,
            .stored = inside ? model_.stored(surface) : Energy{std::numeric_limits<double>::infinity()}};
  }

 private:
  static constexpr int D = kAxes<N>;
  using Vector = Point<D>;
  static constexpr double kLever_s = 20e-3;

  [[nodiscard]] Vector arm_of(const Position<N>& x) const noexcept {
    if constexpr (N == 6) {
      return x.attitude() * lever_;
    } else {
      (void)x;
      return Vector::Zero();
    }
  }
  void follow_surface(Seconds dt) noexcept {
    const bool touches = said_.contact.value > 0.5;
    if constexpr (N == 6)
      if (touches) low_pass(lever_, Vector{said_.lever.value.vec()}, dt, model_.exists() ? kLever_s : 0.0);
    model_.step(touches, patch_of(said_), said_.robot.value.translation(), dt);
  }

  double stiffness_, mass_kg_;  ///< K_c in the master's units; mass of the handle, 0: not known
  SurfaceReport<N> said_;
  bool heard_ = false;
  SurfaceModel<D> model_;
  StickSpring<D> stick_;
  Vector lever_ = Vector::Zero();  ///< b of N = 6, handle axes [m]
};

}  // namespace twoport
