#pragma once

#include <algorithm>
#include <cmath>

#include "common/base/low_pass.h"
#include "common/coupling/ramp.h"
#include "common/link/round_trip.h"
#include "common/method/coupled_by_position.h"
#include "common/method/layers.h"
#include "common/method/transparency/surface/payload.h"
#include "common/passivity/energy_spring.h"

namespace twoport {

/// Master half for tools with many contacts: the delayed wrench and a local spring of full rank, anchored where the robot's set point
/// was when that wrench was measured. At rest x_echo = x - o, so the hand feels the measured wrench.
///
///     f_d  = κ (LP_a f + K e),   e = x - z,  z = LP_a x_echo,   K = diag(K_c, t K_r),  t = 0.1,   a = 0.1 s + R/2
///     |K e| <= 0.3 N + |LP_a f| + min(K_c |o|, 4 |LP_a f|): beyond, z follows x, the anchor slips; a torque counts by sqrt(K_c/K_r)
///     at a touch with κ < 0.05: z = x_echo, LP_a f = f      of a robot that bounces the spring goes on
///     κ    = LP_20ms of 1 in contact, LP_50ms of 0 else;     f_d *= c ramp,   c = min(1, m_handle/(4 T² K_c))
///     g    = b v,  v = LP_3ms Δx/T,   b = 0.5 + κ (9.5 + 10 (1 - LP_20ms s)) N s/m,  about the axes 0.3 b K_r/K_c;   at most m_handle/(4T)
///     o    = LP_50ms (outside LP_{0.3 s + R}) of (1 - s q c) f_d/K_c;   x_cmd = x - o;   f_m = s q c ramp f_d goes to the slave
///
/// x: handle. R: round trip. s, q as in InternalModelMaster. The slave is InternalModelSlave, which yields along the measured force.
template <int N>
class ContactSpringMaster final : public Copyable<ContactSpringMaster<N>, MasterTransparency<N>> {
 public:
  explicit ContactSpringMaster(const ControlOptions& o)
      : stiffness_{o.force_scale * o.motion_scale * o.coupling.stiffness_n_per_m},
        rotational_stiffness_{o.force_scale / o.motion_scale * o.coupling.rotational_stiffness_n_m_per_rad},
        mass_kg_{o.handle_mass_kg},
        inertia_kg_m2_{o.handle_inertia_kg_m2},
        k_{per_axis<N>(stiffness_, kTurn * rotational_stiffness_)},
        ramp_{o.engage} {}

  void start(const DeviceSample<N>&) noexcept override {
    f_slow_.setZero();
    offset_.setZero();
    said_by_master_ = {};
    contact_ = 0.0;
    scale_slow_ = shown_ = 1.0;
    heard_ = touches_ = false;
    ramp_.drop();
  }

  Wish<N> wish(const MasterInput<N>& in) noexcept override {
    round_trip_s_ = round_trip_.step(in.slave, in.dt).si();
    low_pass(shown_, applied_part(in.device.applied, f_), in.dt, kScale_s);
    if (in.paused) [[unlikely]]
      ramp_.drop();
    const double ramp = ramp_.step(in.active, in.dt);
    if (in.active && read(in.slave.words, said_)) heard_ = true;
    idle_ = ramp == 0.0;
    if (idle_) {
      offset_.setZero();  // said while nothing is coupled, it would be of the next registration
      return {};
    }

    wanted_ = heard_ ? displayed(in) : Force<N>{};
    cap_ = mass_kg_ > 0.0 ? std::min(1.0, 0.25 * mass_kg_ / (in.dt.si() * in.dt.si() * stiffness_)) : 1.0;
    const Velocity<N> v = in.mean_velocity();
    low_pass(v_slow_, v, in.dt, kDamperVelocity_s);
    Wish<N> out{.idle = false,
                .f = capped_ = ramp * cap_ * wanted_,
                .damper = ramp * damping(in.dt),
                .damped = true,
                .stored = Energy{0.5 * std::pow(norm(wanted_.vec()), 2) / stiffness_}};
    out.figures[layer_figure("contact_spring_share")] = 1.0;
    return out;
  }
  void shown(const Force<N>& f, double share, const MasterInput<N>& in) noexcept override {
    f_ = f;
    Force<N> felt;
    if (!idle_) {
      low_pass(scale_slow_, share, in.dt, kScale_s);
      const bool pressed = contact_ > 0.5;
      const Vector missing =
          pressed ? Vector{(1.0 - share * shown_ * cap_) / stiffness_ * wanted_.vec()} : Vector{Vector::Zero()};
      low_pass(offset_, Linear{missing.template head<D>()}, in.dt,
               pressed ? kOffset_s : kOffsetOutside_s + round_trip_s_);
      felt = share * shown_ * capped_;
    }
    said_by_master_.offset.value = Displacement<D>{offset_};
    said_by_master_.felt.value = Coords<struct SurfaceForceKind, D>{felt.vec().template head<D>()};
  }
  [[nodiscard]] bool has_payload() const noexcept override { return heard_; }
  void write_payload(Words& words) const noexcept override { write(said_by_master_, words); }
  [[nodiscard]] const MasterSays<N>& says() const noexcept { return said_by_master_; }
  /// What the spring has not predicted of the newest wrench, f - LP_a f - K (x_echo - LP_a x_echo).
  [[nodiscard]] const Force<N>& unexplained() const noexcept { return unexplained_; }

 private:
  static constexpr int D = kAxes<N>;
  using Vector = typename Force<N>::Vector;
  using Linear = Point<D>;

  static constexpr double kTurn = 0.1, kFilter_s = 0.1, kFilterOfRoundTrip = 0.5, kSlip_n = 0.3, kKept = 4.0,
                          kNewContact = 0.05;
  static constexpr double kTouch_s = 20e-3, kLeave_s = 50e-3, kScale_s = 20e-3, kOffset_s = 50e-3,
                          kOffsetOutside_s = 0.3, kDamperVelocity_s = 3e-3;
  static constexpr double kDampingFree = 0.5, kDamping = 9.5, kHarvest = 10.0, kDampingAboutAxes = 0.3;  // [N s/m]

  [[nodiscard]] double norm(const Vector& f) const noexcept {
    return wrench_norm(Force<N>{f}, rotational_stiffness_ > 0.0 ? stiffness_ / rotational_stiffness_ : 0.0);
  }

  [[nodiscard]] Force<N> displayed(const MasterInput<N>& in) noexcept {
    const Vector f = in.slave.newest.f.vec();
    const Position<N>& echo = said_.echo.value;
    const bool touches = said_.contact.value > 0.5;
    if (touches && !touches_ && contact_ < kNewContact) {
      anchor_ = echo_slow_ = echo;
      f_slow_ = f;
    }
    touches_ = touches;
    low_pass(contact_, touches ? 1.0 : 0.0, in.dt, touches ? kTouch_s : kLeave_s);
    const double a = low_pass_weight(in.dt, touches ? kFilter_s + kFilterOfRoundTrip * round_trip_s_ : kLeave_s);
    anchor_ = anchor_ + a * (echo - anchor_);
    echo_slow_ = echo_slow_ + a * (echo - echo_slow_);
    f_slow_ += a * (f - f_slow_);
    unexplained_ = Force<N>{f - f_slow_ - k_.cwiseProduct((echo - echo_slow_).vec())};
    Vector e = (in.device.x - anchor_).vec();
    const double f_n = norm(f_slow_), kept_n = std::min(stiffness_ * offset_.norm(), kKept * f_n);
    const double size = norm(k_.cwiseProduct(e)), most = kSlip_n + f_n + kept_n;
    if (size > most) {
      e *= most / size;
      anchor_ = in.device.x + Displacement<N>{-e};
    }
    return Force<N>{contact_ * (f_slow_ + k_.cwiseProduct(e))};
  }

  [[nodiscard]] Force<N> damping(Seconds dt) const noexcept {
    const double b = kDampingFree + contact_ * (kDamping + kHarvest * (1.0 - scale_slow_));
    const double most = mass_kg_ > 0.0 ? mass_kg_ / (4.0 * dt.si()) : kHarvest;
    const double about =
        std::min(kDampingAboutAxes * b * rotational_stiffness_ / stiffness_, inertia_kg_m2_ / (4.0 * dt.si()));
    return Force<N>{per_axis<N>(std::min(b, most), about).cwiseProduct(v_slow_.vec())};
  }

  double stiffness_, rotational_stiffness_;  ///< K_c, K_r in the master's units
  double mass_kg_, inertia_kg_m2_;           ///< of the handle; 0: not known
  Vector k_;                                 ///< diagonal of K
  Ramp ramp_;
  RoundTrip round_trip_;
  double round_trip_s_ = 0.0;
  SurfaceReport<N> said_;
  MasterSays<N> said_by_master_;
  bool heard_ = false, touches_ = false;
  double contact_ = 0.0;            ///< κ
  Position<N> anchor_, echo_slow_;  ///< z; LP_a x_echo
  Force<N> unexplained_;
  Vector f_slow_ = Vector::Zero();         ///< LP_a f
  Linear offset_ = Linear::Zero();         ///< o
  Velocity<N> v_slow_;                     ///< LP_3ms v
  double scale_slow_ = 1.0, shown_ = 1.0;  ///< LP_20ms s; q
  Force<N> f_;                             ///< commanded in the last tick
  // Of the last wish.
  bool idle_ = true;
  Force<N> wanted_, capped_;  ///< f_d, and as it is wished
  double cap_ = 1.0;          ///< c
};

}  // namespace twoport
