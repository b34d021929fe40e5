#pragma once

#include <algorithm>
#include <string_view>

#include "common/base/low_pass.h"
#include "common/coupling/registration.h"
#include "common/method/internal_model/payload.h"
#include "common/method/internal_model/slave.h"
#include "common/method/internal_model/surface_model.h"
#include "common/method/method.h"
#include "common/passivity/energy_spring.h"

namespace twoport {

/// Master half of model-mediated teleoperation: the hand feels a local model of the surface, and nothing else.
///
///     model: SurfaceModel follows the slave's n, p, K*, μ, κ
///     f_d  = ρ F(x) + stick spring,  F = K* [d(x)]+ n              inside, else 0;   K* <= m_handle/(4 T²)
///     f    = ramp (s f_d + K* T/2 (n·v) n)                         at most m_handle/(4T)
///     s:   energy spring with K_c; a model that changes in contact cannot create energy
///
/// x: handle; N = 6: its contact point x + R b, b the slave's lever, and the torque (R b) × F.
/// Source: Mitra, Niemeyer, Int. J. Robotics Research 27(2), 2008; the energy limit in place of a gate on updates.
template <int N>
class ModelMediatedMaster {
 public:
  explicit ModelMediatedMaster(const ControlOptions& o)
      : stiffness_{o.force_scale * o.motion_scale * o.coupling.stiffness_n_per_m},
        mass_kg_{o.handle_mass_kg},
        energy_{o.initial_energy, stiffness_,
                o.force_scale / o.motion_scale * o.coupling.rotational_stiffness_n_m_per_rad, o.handle_mass_kg,
                o.handle_inertia_kg_m2} {}

  void start(const DeviceSample<N>&) noexcept {
    model_.forget();
    stick_.release();
    heard_ = false;
  }

  MasterOutput<N> step(const MasterInput<N>& in) noexcept {
    energy_.observe(in.account.net(), in.first ? Displacement<N>{} : in.interval.moved, in.device.applied, in.ended,
                    in.dt);
    MasterOutput<N> out{};
    out.energy_in = in.account.absorbed() - base_absorbed_;
    out.undissipated = energy_.undissipated();
    if (!in.active) return out;
    if (read(in.slave.words, said_)) heard_ = true;
    if (heard_) follow_surface(in.dt);
    const Vector arm = arm_of(in.device.x);
    const Vector point = in.device.x.translation() + arm;
    const SurfaceDepth<D> surface = model_.patch().at(point);
    const bool inside = model_.exists() && surface.depth > 0.0;
    const double most = mass_kg_ > 0.0 ? mass_kg_ / (4.0 * in.dt.si()) : stiffness_ * in.dt.si();
    typename Force<N>::Vector wanted = Force<N>::Vector::Zero(), damper = wanted;
    if (inside) {
      energy_.drop_above(model_.stored(surface) + Energy{kCredit_j});
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
    out.wanted = Force<N>{in.ramp * wanted};
    const Velocity<N> v = in.first ? Velocity<N>{} : in.interval.moved / in.ended;
    const double s = energy_.scale(out.wanted, v, in.dt);
    out.f = s * out.wanted + Force<N>{in.ramp * damper};
    out.dissipated = positive_part(Energy{-(1.0 - s) * dot(out.wanted, v).si() * in.dt.si()});
    return out;
  }
  [[nodiscard]] Energy deficit(const Ledger&, Energy) const noexcept { return energy_.deficit(); }
  /// Without a deficit the method starts with what the hand has put in so far, under whatever method, up to the credit: that
  /// keeps its bound of the hand's energy. What a method without control has created is not charged.
  void restart(const Ledger& account, Energy deficit) noexcept {
    base_absorbed_ = account.absorbed();
    const Energy owed = deficit > Energy{} ? deficit : Energy{-std::clamp(account.net().si(), 0.0, kCredit_j)};
    energy_.restart(account.net(), owed);
  }
  static constexpr bool has_payload() noexcept { return false; }
  void write_payload(Words&) const noexcept {}

 private:
  static constexpr int D = kAxes<N>;
  using Vector = Point<D>;
  static constexpr double kCredit_j = 20e-3, kLever_s = 20e-3;

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
    SurfacePatch<D> patch;
    patch.point = said_.point.value.translation();
    patch.normal = said_.normal.value.vec();
    patch.stiffness = said_.stiffness.value;
    patch.friction = said_.friction.value;
    patch.curvature = said_.curvature.value;
    model_.step(touches, patch, said_.robot.value.translation(), dt);
  }

  double stiffness_, mass_kg_;  ///< K_c in the master's units; mass of the handle, 0: not known
  EnergySpring<N> energy_;
  SurfaceReport<N> said_;
  bool heard_ = false;
  SurfaceModel<D> model_;
  StickSpring<D> stick_;
  Vector lever_ = Vector::Zero();  ///< b of N = 6, handle axes [m]
  Energy base_absorbed_;
};

/// The slave half is that of internal-model control: the virtual coupling and an estimate of the surface.
struct ModelMediated {
  static constexpr std::string_view kNames[] = {"MODEL_MEDIATED"};
  static constexpr std::string_view kSummary =
      "model-mediated: the hand feels a local model of the surface that the robot touches; its force is as good as the "
      "model";
  template <int N>
  using Master = ModelMediatedMaster<N>;
  template <int N>
  using Slave = InternalModelSlave<N>;
};

}  // namespace twoport
