#pragma once

#include <algorithm>
#include <cmath>

#include "common/base/low_pass.h"
#include "common/coupling/ramp.h"
#include "common/link/round_trip.h"
#include "common/method/layers.h"
#include "common/method/transparency/surface/payload.h"
#include "common/method/transparency/surface/surface_model.h"

namespace twoport {

/// The master half of internal-model control. The wanted force is that of a local model of the surface, corrected by the
/// low-passed difference between the force that the slave measures and the model's force at the set point it then had. At
/// rest the two set points are equal, so the difference corrects any error of the model: the hand feels the measured force.
///
/// x: handle, y: its contact point (N = 1, 3: x). R: round trip. LP_a: first-order low pass with time constant a.
///
///     (1) model: SurfaceModel follows the slave's n, p, K*, μ, κ
///     (2) F(y) = K* [d(y)]+ n(y),   F_x = ρ F(x),   ρ: 0 -> 1 in 0.1 s;             stored: |F_x|²/2K*
///     (3) r   = LP_a of f - F(x_echo),   a = max(0.3 s, 6 √(m_robot/K_c)) + R/2, or 50 ms while the slave is free and not in flight
///         r_t = LP_{0.2 s + R} of the part of that along the surface (none: 0), less the stick spring's force at x_echo; both stick
///         springs decay with 0.2 s + R
///     (4) f_d = F_x + (r·n) n + r_t + stick spring at x                             inside, d(x) > 0
///         f_d = r, fading to 0 over 3 mm                                            outside;   f_d·n >= 0: a surface never pulls
///         f_d *= c ramp,   c = min(1, m_handle/(4 T² K*)) inside                     no stiffer than the sampled handle allows
///     (5) g = b v + K* T/2 (n·v) n,  v = LP_3ms Δx/T,   b = 0.5, inside + 2 min(R, 1 s) + 10 (1 - LP_20ms s);   each at most m_handle/(4T)
///     (6) o = LP_50ms (outside LP_{0.3 s + R}) of min((1 - s q c) f_d·n/K*, d) along LP_{0.5 s + 2R} n;  x_cmd = x - o
///         q = LP_20ms of |applied|/|commanded|;      f_m = s q c ramp f_d goes to the slave with x
///         s: share of f_d that the passivity layer displays
///
/// Joints: a hand that is inside when the model begins feels what the slave has measured, as if it touched there, and the slave presses as much:
///
///     δ = [d(x) - f·n/K*]+ and ρ = 1 when the model begins, then LP_1s of 0;   d(x) - δ in place of d(x) for the hand;   o + δ n;   b + 10 along n
///
/// An arm is heavy: it arrives deep, and shown the force of its depth it would be thrown back, with all of E(0).
///
/// (6) makes the slave press as hard as the hand feels where energy or device do not allow the right force.
/// In flight: free, but commanded into the surface; the robot bounces and will touch it again.
/// N = 6: y = x + R b with b from the slave; the torque of f_d is (R b) × F_x + r_τ, r_τ = LP_a of τ - (R_echo b) × F(x_echo).
template <int N>
class InternalModelMaster final : public Copyable<InternalModelMaster<N>, MasterTransparency<N>> {
 public:
  explicit InternalModelMaster(const ControlOptions& o)
      : coupling_n_per_m_{o.force_scale * o.motion_scale * o.coupling.stiffness_n_per_m},
        rotation_n_m_per_rad_{o.force_scale / o.motion_scale * o.coupling.rotational_stiffness_n_m_per_rad},
        mass_kg_{o.handle_mass_kg},
        inertia_kg_m2_{o.handle_inertia_kg_m2},
        of_joints_{N == kJointPort || o.follower != nullptr},
        residual_s_{std::clamp(kRobot * std::sqrt(o.known.robot_mass_kg / o.coupling.stiffness_n_per_m), kResidual_s,
                               kLongResidual_s)},
        ramp_{o.engage} {}

  void start(const DeviceSample<N>&) noexcept override {
    model_.forget();
    r_ = Force<N>{};
    r_along_.setZero();
    offset_m_ = late_m_ = 0.0;
    said_by_master_ = {};
    scale_slow_ = shown_ = 1.0;
    heard_ = false;
    stick_.release();
    stick_at_echo_.release();
    ramp_.drop();
  }

  Wish<N> wish(const MasterInput<N>& in) noexcept override {
    round_trip_s_ = round_trip_.step(in.slave, in.dt);
    low_pass(shown_, applied_part(in.device.applied, f_), in.dt, kScale_s);
    if (in.paused) [[unlikely]]
      ramp_.drop();
    const double ramp = ramp_.step(in.active, in.dt);  // goes on while holding; falls after release
    if (in.active && read(in.slave.words, said_)) heard_ = true;
    idle_ = ramp == 0.0;
    if (idle_) {
      offset_m_ = late_m_ = 0.0;  // said while nothing is coupled, it would be of the next registration
      return {};
    }

    if (heard_) follow_surface(in);  // (1)
    hand_ = at(in.device.x, late_m_);
    wanted_ = Force<N>{};
    if (heard_) {
      correct(in, round_trip_s_);  // (3)
      wanted_ = displayed(hand_);  // (4)
    }
    cap_ = hand_.inside ? stiffness_cap(in.dt) : 1.0;
    const Velocity<N> v = in.mean_velocity();
    low_pass(v_slow_, v, in.dt, kDamperVelocity_s);
    return {.idle = false,
            .f = capped_ = ramp * cap_ * wanted_,
            .damper = ramp * damping(v_slow_, hand_, round_trip_s_, in.dt),  // (5)
            .damped = true,
            .stored = model_.stored(hand_.surface)};  // (2)
  }
  void shown(const Force<N>& f, double share, const MasterInput<N>& in) noexcept override {
    f_ = f;
    if (idle_) return tell(f_);
    low_pass(scale_slow_, share, in.dt, kScale_s);
    move_set_point(wanted_, hand_, 1.0 - share * shown_ * cap_, round_trip_s_, in.dt);  // (6)
    tell(share * shown_ * capped_);
  }
  [[nodiscard]] Seconds round_trip() const noexcept { return round_trip_s_; }
  [[nodiscard]] bool has_payload() const noexcept override { return heard_; }
  void write_payload(Words& words) const noexcept override { write(said_by_master_, words); }
  [[nodiscard]] const MasterSays<N>& says() const noexcept { return said_by_master_; }
  [[nodiscard]] const SurfaceReport<N>& said_by_slave() const noexcept { return said_; }
  /// The newest report says that the robot touches.
  [[nodiscard]] bool touches() const noexcept { return said_.contact.value > 0.5; }
  /// It says which surface: what it touches has a force, not only a torque.
  [[nodiscard]] bool touches_surface() const noexcept { return said_.stiffness.value > 0.0; }
  /// N = 6: what the model has not predicted of the newest wrench, by the lever LP_1s b. The lever of a point of contact agrees with it;
  /// that of a face, which jumps from corner to corner, does not.
  [[nodiscard]] const Force<N>& unexplained() const noexcept { return unexplained_; }

 private:
  static constexpr int D = kAxes<N>;
  using Vector = Point<D>;

  static constexpr double kScale_s = 20e-3;
  static constexpr double kResidual_s = 0.3, kRobot = 6.0, kLongResidual_s = 1.0, kFreeResidual_s = 50e-3,
                          kAlong_s = 0.2, kFlight_n = 0.3;
  static constexpr double kFade_m = 3e-3;
  static constexpr double kDamping = 0.5, kDampingPerDelay = 2.0, kLongDelay_s = 1.0, kHarvest = 10.0,
                          kDampingOfJoints = 10.0, kDamperVelocity_s = 3e-3;  // [N s/m]
  static constexpr double kLate_s = 1.0;
  static constexpr double kOffset_s = 50e-3, kOffsetOutside_s = 0.3, kOffsetNormal_s = 0.5;
  static constexpr double kLever_s = 20e-3, kSlowLever_s = 1.0, kOffsetNegligible_m = 1e-6;

  /// A position of the handle and the model there.
  struct Hand {
    Vector arm;    ///< N = 6: R b
    Vector point;  ///< y
    SurfaceDepth<D> surface;
    bool inside;
  };

  [[nodiscard]] Hand at(const Position<N>& x, double late_m = 0.0) const noexcept {
    Hand h;
    h.arm = arm(x);
    h.point = x.translation() + h.arm;
    h.surface = model_.patch().at(h.point);
    h.surface.depth -= late_m;
    h.inside = model_.exists() && h.surface.depth > 0.0;
    return h;
  }
  [[nodiscard]] Vector arm(const Position<N>& x) const noexcept {
    if constexpr (N == 6) {
      return x.attitude() * lever_;
    } else {
      return Vector::Zero();
    }
  }

  void follow_surface(const MasterInput<N>& in) noexcept {
    const Seconds dt = in.dt;
    const bool touches = said_.contact.value > 0.5;
    if constexpr (N == 6)
      if (touches) {
        if (model_.exists()) {
          low_pass(lever_, Vector{said_.lever.value.vec()}, dt, kLever_s);
        } else {
          lever_ = said_.lever.value.vec();
        }
      }
    const bool existed = model_.exists();
    model_.step(touches, patch_of(said_), said_.robot.value.translation(), dt);
    if (!of_joints_) return;
    if (existed && model_.exists()) return low_pass(late_m_, 0.0, dt, kLate_s);
    late_m_ = 0.0;
    if (model_.exists()) meet(in);
  }
  /// The model has begun.
  void meet(const MasterInput<N>& in) noexcept {
    const SurfaceDepth<D> surface = at(in.device.x).surface;
    const double measured = surface.normal.dot(in.slave.newest.f.vec().template head<D>());
    late_m_ = std::max(0.0, surface.depth - std::max(0.0, measured) / model_.patch().stiffness);
    model_.show_at_once();
  }

  void correct(const MasterInput<N>& in, Seconds round_trip) noexcept {
    const Force<N> f = in.slave.newest.f;
    const Hand echo = at(said_.echo.value);
    const Vector modelled = model_.force(echo.surface);
    typename Force<N>::Vector error = f.vec();
    error.template head<D>() -= modelled;
    if constexpr (N == 6) error.template tail<3>() -= echo.arm.cross(modelled);

    along_weight_ = low_pass_weight(in.dt, kAlong_s + round_trip.si());
    const bool free = said_.contact.value < 0.5;
    const double pressed = coupling_n_per_m_ * (echo.point - said_.robot.value.translation()).norm();
    const bool in_flight = echo.inside && pressed > kFlight_n;
    const double tau = free && !in_flight ? kFreeResidual_s : residual_s_ + 0.5 * round_trip.si();
    typename Force<N>::Vector unexplained = error - r_.vec();
    low_pass(r_, Force<N>{error}, in.dt, tau);

    Vector along = Vector::Zero();
    if (model_.exists()) {
      const Vector& n = echo.surface.normal;
      along = error.template head<D>();
      along -= along.dot(n) * n;
      along -= stick_at_echo_.step(echo.point, n, model_.patch().friction * modelled.norm(), coupling_n_per_m_,
                                   along_weight_);
      unexplained.template head<D>() = n.dot(unexplained.template head<D>()) * n + along - r_along_;
    } else {
      stick_at_echo_.release();
    }
    if constexpr (N == 6) {
      if (free || !model_.exists()) {
        slow_lever_ = said_.lever.value.vec();
      } else {
        low_pass(slow_lever_, Vector{said_.lever.value.vec()}, in.dt, kSlowLever_s);
      }
      unexplained.template tail<3>() += (echo.arm - said_.echo.value.attitude() * slow_lever_).cross(modelled);
      unexplained_ = Force<N>{unexplained};
    }
    r_along_ += along_weight_ * (along - r_along_);
  }

  [[nodiscard]] Force<N> displayed(const Hand& hand) noexcept {
    typename Force<N>::Vector f_d = Force<N>::Vector::Zero();
    if (!model_.exists()) return Force<N>{f_d};
    const Vector& n = hand.surface.normal;
    Vector r = r_.vec().template head<D>();
    double fade = 1.0;
    Vector f;
    if (hand.inside) {
      const Vector elastic = model_.ramp() * model_.force(hand.surface);
      f = elastic + r.dot(n) * n + r_along_ +
          stick_.step(hand.point, n, model_.patch().friction * elastic.norm(), coupling_n_per_m_, along_weight_);
      if constexpr (N == 6) f_d.template tail<3>() = hand.arm.cross(elastic);
    } else {
      fade = std::max(0.0, 1.0 + hand.surface.depth / kFade_m);
      f = fade * r;
      stick_.release();
    }
    f -= std::min(0.0, f.dot(n)) * n;
    f_d.template head<D>() = f;
    if constexpr (N == 6) f_d.template tail<3>() += fade * r_.vec().template tail<3>();
    return Force<N>{f_d};
  }

  [[nodiscard]] double stiffness_cap(Seconds dt) const noexcept {
    if (!(mass_kg_ > 0.0)) return 1.0;
    return std::min(1.0, 0.25 * mass_kg_ / (dt.si() * dt.si() * model_.patch().stiffness));
  }

  [[nodiscard]] Force<N> damping(const Velocity<N>& v, const Hand& hand, Seconds round_trip,
                                 Seconds dt) const noexcept {
    const double most = mass_kg_ > 0.0 ? mass_kg_ / (4.0 * dt.si()) : kHarvest;
    const double of_delay = kDampingPerDelay * std::min(round_trip.si(), kLongDelay_s);
    double b = kDamping;
    double b_normal = 0.0;
    if (hand.inside) {
      b += of_delay + kHarvest * (1.0 - scale_slow_);
      b_normal = 0.5 * dt.si() * model_.patch().stiffness + (of_joints_ ? kDampingOfJoints : 0.0);
    }
    typename Force<N>::Vector g;
    const Vector linear = v.vec().template head<D>();
    const Vector& n = hand.surface.normal;
    g.template head<D>() = std::min(b, most) * linear + std::min(b_normal, most) * n.dot(linear) * n;
    if constexpr (N == 6) {
      const double most_rotational = inertia_kg_m2_ > 0.0 ? inertia_kg_m2_ / (4.0 * dt.si()) : 0.0;
      const double b_rotational = b * rotation_n_m_per_rad_ / coupling_n_per_m_;
      g.template tail<3>() = std::min(b_rotational, most_rotational) * v.vec().template tail<3>();
    }
    return Force<N>{g};
  }

  void tell(const Force<N>& felt) noexcept {
    Vector offset = offset_m_ * offset_normal_;
    if (of_joints_) offset += late_m_ * hand_.surface.normal;
    said_by_master_.offset.value = Displacement<D>{offset};
    said_by_master_.felt.value = Coords<struct SurfaceForceKind, D>{felt.vec().template head<D>()};
  }

  /// `missing`: part of the normal force that is not displayed.
  void move_set_point(const Force<N>& f_d, const Hand& hand, double missing, Seconds round_trip, Seconds dt) noexcept {
    const Vector& n = hand.surface.normal;
    if (!hand.inside) return low_pass(offset_m_, 0.0, dt, kOffsetOutside_s + round_trip.si());
    if (offset_m_ < kOffsetNegligible_m) {
      offset_normal_ = n;
    } else {
      low_pass(offset_normal_, n, dt, kOffsetNormal_s + 2.0 * round_trip.si());
      offset_normal_.normalize();
    }
    const double wanted = missing * f_d.vec().template head<D>().dot(n) / model_.patch().stiffness;
    low_pass(offset_m_, std::min(wanted, hand.surface.depth), dt, kOffset_s);
  }

  double coupling_n_per_m_, rotation_n_m_per_rad_;  ///< K_c, K_r in the master's units
  double mass_kg_, inertia_kg_m2_;                  ///< of the handle; 0: not known
  bool of_joints_;                                  ///< the port is joints, or one of them
  double residual_s_;                               ///< a without delay
  Ramp ramp_;
  RoundTrip round_trip_;
  SurfaceReport<N> said_;
  bool heard_ = false;
  SurfaceModel<D> model_;
  StickSpring<D> stick_, stick_at_echo_;
  Force<N> r_;                       ///< r, and r_τ of N = 6
  Vector r_along_ = Vector::Zero();  ///< r_t
  double along_weight_ = 0.0;        ///< of r_t and of the stick springs' decay, in this tick
  Vector lever_ = Vector::Zero();    ///< b of N = 6, handle axes [m]
  Vector slow_lever_ = Vector::Zero();
  Force<N> unexplained_;
  double offset_m_ = 0.0;  ///< o
  double late_m_ = 0.0;    ///< δ of joints
  Vector offset_normal_ = Vector::Unit(0);
  MasterSays<N> said_by_master_;
  Velocity<N> v_slow_;                     ///< LP_3ms v
  double scale_slow_ = 1.0, shown_ = 1.0;  ///< LP_20ms s; q
  Force<N> f_;                             ///< commanded in the last tick
  // Of the last wish.
  bool idle_ = true;
  Hand hand_;
  Seconds round_trip_s_;
  Force<N> wanted_, capped_;  ///< f_d, and as it is wished
  double cap_ = 1.0;          ///< c
};

}  // namespace twoport
