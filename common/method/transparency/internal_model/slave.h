#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <type_traits>

#include "common/method/coupled_by_position.h"
#include "common/method/layers.h"
#include "common/method/transparency/reaction_force_observer.h"
#include "common/method/transparency/surface/contact_lever.h"
#include "common/method/transparency/surface/joint_surface.h"
#include "common/method/transparency/surface/payload.h"
#include "common/method/transparency/surface/surface_estimator.h"

namespace twoport {

/// The virtual coupling with a damping ratio of at least 1/4 at the robot. In joints its set point follows a yield at up to 0.5 m/s of their
/// metric: 50 mm/s of it are some 20 mm/s at the tool.
inline ControlOptions with_damped_robot(ControlOptions o) {
  constexpr double kYield_m_per_s = 0.5;
  CouplingOptions& c = o.coupling;
  c.damping_n_s_per_m = std::max(c.damping_n_s_per_m, 0.5 * std::sqrt(c.stiffness_n_per_m * o.known.robot_mass_kg));
  if (o.follower != nullptr) c.catch_up_m_per_s = std::max(c.catch_up_m_per_s, kYield_m_per_s);
  return o;
}

/// The slave half of internal-model control: the virtual coupling, and an estimate of the surface for the master's model.
///
///     x_rx  = x_m - o - q n                                set point: the master's position less its offset, and the yield
///     q     = LP_50ms of c [(f·n + K* q - f_m·n)/(K_h + K*)]+  in contact and coupled, else -> 0;   c = min(1, (R/0.2 s)²), R nominal
///     f_s   = K_c (x_sd - x_s) + B_c (v_rx - v_s)          the virtual coupling
///             - b min(0, v_s·n) n                          in contact and coupled: brakes the robot where it leaves the surface
///     B_c   = max(B, 0.5 √(K_c m))                         the coupling's damping ratio is at least 1/4; m: robot
///     b     = max(min(20 N s/m, B), min(0.4 √(K m), m/4T))     K: the surface's, in the slave's units
///     f     = f_e - bias                                   force sensor (POSITION_FORCE, POSITION_MEASURED_FORCE)
///     f     = LP_5ms of f_s - m dv_s/dt                    POSITION_POSITION: no sensor is used (ReactionForceObserver)
///     K*    = 1/(1/K + 1/K_c + |R b × n|²/K_r)             what the hand should feel: the surface in series with the coupling
///
/// q: f_m is the force that the hand felt when it was at x_m. A hand of stiffness K_h = 700 N/m that felt f instead would be q
/// further out, where f + K* q is what the robot presses without the yield. At rest f = f_m and q = 0; until a surface is
/// felt the robot presses on it as the hand will once it feels it. c: with a short delay little is pressed blindly, and lost
/// packets would make it yield. Of a surface alone with N = 6: c = 1; the point of contact changes from corner to corner within a short delay too.
///
/// For a model that may be a spring in all axes: q is a vector (yield_along_force), with c = min(1, (R/R_q)²),
/// R_q = min(0.2 s, π √(m/K_c)): a robot that is pulled back for less than half of its period on the coupling bounces, a light one has a short
/// period. In joints K_h is that of a hand at the tool. The coupling's damper is grounded in contact, (1 - g) B_c (v_rx - v_s) - g B_c v_s,
/// g = LP_100ms of 1 in contact and coupled, else of 0. The hand's motion and tremor, a delay old, would come through it with |K_c + j ω B_c|; the model knows K_c only. What acts on the
/// robot with v_s alone, g B_c and the brake, is paid by the robot, not by the link.
///
/// To the master: n, p, K*, μ, κ (surface_estimator.h; of joints: joint_surface.h), contact, the set point x_sd, and f as the returned force.
/// N = 6: contact of the force or of the torque, sqrt(K_c/K_r) τ; K* = 0 where only a torque is felt, as no surface is known. The surface is that at the contact point x + R b, from the lever of the wrench:
///
///     b = LP_a[Rᵀ(f × τ)]/LP_a[|f|²]                       ContactLever
///     s = Σ Δp + ΔR b                                      way of the robot's point that touches now; K is fitted to it. The contact
///                                                          point itself also moves where b changes, without any force
template <int N>
class InternalModelSlave final : public Copyable<InternalModelSlave<N>, SlaveTransparency<N>> {
  using Base = Copyable<InternalModelSlave<N>, SlaveTransparency<N>>;

 public:
  explicit InternalModelSlave(const ControlOptions& o)
      : Base{with_damped_robot(o)},
        along_force_{transparency_layer(o).spring_in_all_axes_from > 0 &&
                     N >= transparency_layer(o).spring_in_all_axes_from},
        damping_{
            per_axis<N>(with_damped_robot(o).coupling.damping_n_s_per_m, o.coupling.rotational_damping_n_m_s_per_rad)},
        yields_{N == 6 && !along_force_ ? 1.0 : std::min(1.0, std::pow(o.known.round_trip.si() / blind_s(o), 2))},
        senses_{o.architecture != Architecture::position_position},
        bias_{o.force_scale, stiffness_ratio(o.coupling)},
        mass_kg_{o.known.robot_mass_kg},
        observer_{per_axis<N>(o.known.robot_mass_kg, o.known.robot_inertia_kg_m2), Force<N>::Vector::Zero(),
                  kObserver_rad_per_s},
        to_master_stiffness_{o.force_scale * o.motion_scale},
        brake_n_s_per_m_{std::min(kBrake_n_s_per_m, o.coupling.damping_n_s_per_m)},
        coupling_n_per_m_{o.force_scale * o.motion_scale * o.coupling.stiffness_n_per_m},
        rotation_n_m_per_rad_{o.force_scale / o.motion_scale * o.coupling.rotational_stiffness_n_m_per_rad},
        newtons_per_n_m_{o.motion_scale * std::sqrt(stiffness_ratio(o.coupling))},
        estimator_{estimator_of(o)} {}

  void start(const RobotSample<N>& robot, bool engaged) noexcept override {
    yield_m_ = grounded_share_ = 0.0;
    coupling_.start(robot.x, engaged);
    estimator_.reset();
    torque_.reset();
    observer_.start(robot.v);
    f_ = Force<N>{};
    engaged_ = engaged;
  }
  /// x_m - o - q n.
  Position<N> commanded(const PeerState<N>& master) noexcept override {
    informed_ = read(master.words, said_);
    if (!informed_) return master.newest.x;
    typename Displacement<N>::Vector by = Displacement<N>::Vector::Zero();
    by.template head<D>() = said_.offset.value.vec() + yield_m_ * yield_normal_;
    return master.newest.x + Displacement<N>{-by};
  }

  RobotWish<N> wish(const SlaveInput<N>& in) noexcept override {
    const RobotSample<N>& robot = in.robot;
    if (along_force_) low_pass(grounded_share_, in.coupled && touches() ? 1.0 : 0.0, in.dt, kGround_s);
    typename VirtualCoupling<N>::Wanted wanted;
    if (in.active) {
      wanted = coupling_.step(robot, in.commanded, in.master.newest.v, in.master.is_new, in.coupled, in.dt);
      if (grounded_share_ > 0.0 && !robot.ideal) {
        const Velocity<N> v_rx = in.coupled ? in.master.newest.v : Velocity<N>{};
        wanted.f += Force<N>{-grounded_share_ * damping_.cwiseProduct((v_rx - robot.v).vec())};
      }
      if (in.coupled && in.master.is_new) offset_ = in.master.newest.x - in.commanded;
    } else {
      coupling_.rest(robot.x);
    }
    const Force<N> felt = senses_ ? robot.f_environment - bias_.value() : observed(robot, wanted.f, in.dt);
    const Force<N> felt_there = in.worlds.to_master(felt);
    // Six axes: before it is driven a robot may repeat one reading, which tells neither bias nor noise.
    if (N != 6 || in.active) estimate(in, felt_there);
    yield(in, felt_there);
    report(robot);
    RobotWish<N> out{.f = wanted.f, .v = wanted.v, .f_back = felt};
    out.damped = in.coupled;
    out.grounded = along_force_ && out.damped && !robot.ideal;
    if (out.damped) out.damper = leaving_brake(in);
    if (out.grounded) out.damper += Force<N>{-grounded_share_ * damping_.cwiseProduct(robot.v.vec())};
    return out;
  }
  void acted(const Force<N>& f) noexcept override { f_ = f; }
  void resume(const Position<N>& set_point) noexcept override {
    SlaveTransparency<N>::resume(set_point);
    engaged_ = true;
  }
  [[nodiscard]] Position<N> target() const noexcept override { return coupling_.target() + offset_; }
  [[nodiscard]] bool has_payload() const noexcept override { return engaged_; }
  /// The set point as it is after this tick's motion.
  void write_payload(Words& words, const Registration<N>& worlds) const noexcept override {
    SurfaceReport<N> report = report_;
    report.echo.value = worlds.to_master(coupling_.set_point());
    write(report, words);
  }

 private:
  static constexpr int D = kAxes<N>;
  static constexpr double kBrake_n_s_per_m = 20.0, kBrakeOfMass = 0.4, kObserver_rad_per_s = 200.0;
  static constexpr double kHand_n_per_m = 700.0, kYield_s = 50e-3, kYieldOfJoints_s = 20e-3, kBlind_s = 0.2,
                          kYieldNormal_s = 0.5, kYieldNegligible_m = 1e-6, kGround_s = 0.1;

  [[nodiscard]] static double stiffness_ratio(const CouplingOptions& c) noexcept {
    return c.rotational_stiffness_n_m_per_rad > 0.0 ? c.stiffness_n_per_m / c.rotational_stiffness_n_m_per_rad : 0.0;
  }
  /// R_q: round trip from which on the robot yields in full.
  [[nodiscard]] double blind_s(const ControlOptions& o) const noexcept {
    if (!along_force_ || !(o.known.robot_mass_kg > 0.0)) return kBlind_s;
    return std::min(kBlind_s, std::numbers::pi * std::sqrt(o.known.robot_mass_kg / o.coupling.stiffness_n_per_m));
  }
  using Estimator = std::conditional_t<N == kJointPort, JointSurface, SurfaceEstimator<D>>;
  [[nodiscard]] static Estimator estimator_of([[maybe_unused]] const ControlOptions& o) {
    if constexpr (N == kJointPort) {
      return Estimator{o};
    } else {
      return {};
    }
  }
  [[nodiscard]] bool arm_touches() const noexcept { return estimator_.contact() || torque_.contact(); }
  [[nodiscard]] bool touches() const noexcept {
    if constexpr (N == kJointPort) {
      return arm_touches() || estimator_.fingers().contact();
    } else {
      return arm_touches();
    }
  }

  /// Force on the environment without a sensor, friction of the robot included. An ideal robot tells it.
  Force<N> observed(const RobotSample<N>& robot, const Force<N>& wanted, Seconds dt) noexcept {
    if (robot.ideal) return wanted;
    return mass_kg_ > 0.0 ? observer_.step(f_, robot.v, dt) : f_;
  }

  // All below is in the master's world, and so is `felt`.

  /// The yield of a hand that does not feel yet what the robot presses.
  void yield(const SlaveInput<N>& in, const Force<N>& felt) noexcept {
    if (along_force_) return yield_along_force(in, felt);
    double wanted = 0.0;
    if (informed_ && in.coupled && estimator_.contact()) {
      const Point<D> n = estimator_.patch().normal;
      if (yield_m_ < kYieldNegligible_m) {
        yield_normal_ = n;
      } else {
        low_pass(yield_normal_, n, in.dt, kYieldNormal_s);
        yield_normal_.normalize();
      }
      const double k = in_series(estimator_.patch(), in.robot.ideal);
      const double pressed = n.dot(felt.vec().template head<D>());
      const double unfelt = pressed + k * yield_m_ - n.dot(said_.felt.value.vec());
      wanted = std::max(0.0, yields_ * unfelt / (kHand_n_per_m + k));
    }
    low_pass(yield_m_, wanted, in.dt, kYield_s);
  }

  /// q is a vector, as no single normal is known.
  ///
  ///     q = LP_50ms of c (f + K_c q - f_m)/(K_h + K_c),   |K_c q| <= |LP_50ms f|
  ///
  /// Joints: LP_20ms,   |K_h q| <= |LP_50ms f|,   K_h = 700 N/m |m|², of each axis (JointSurface::share).
  void yield_along_force(const SlaveInput<N>& in, const Force<N>& felt) noexcept {
    Point<D> q = yield_m_ * yield_normal_, wanted = Point<D>::Zero();
    if (informed_ && in.coupled && touches()) {
      const Point<D> f = felt.vec().template head<D>();
      const double k = coupling_n_per_m_;
      Point<D> hand = Point<D>::Constant(kHand_n_per_m), least = Point<D>::Constant(k);
      if constexpr (N == kJointPort) least = hand = kHand_n_per_m * estimator_.share();
      low_pass(f_slow_, f, in.dt, kYield_s);
      wanted = (yields_ / (hand.array() + k)).matrix().cwiseProduct(f + k * q - said_.felt.value.vec());
      const double most = f_slow_.norm(), size = wanted.cwiseProduct(least).norm();
      if (size > most) wanted *= most / size;
    } else {
      f_slow_.setZero();
    }
    low_pass(q, wanted, in.dt, N == kJointPort ? kYieldOfJoints_s : kYield_s);
    yield_m_ = q.norm();
    if (yield_m_ > 0.0) yield_normal_ = q / yield_m_;
  }

  void estimate(const SlaveInput<N>& in, const Force<N>& felt) noexcept {
    const auto& f = felt.vec();
    const auto v = in.worlds.to_master(in.robot.v).vec().eval();
    const Position<N> x = in.worlds.to_master(in.robot.x);
    const Seconds dt = in.dt;
    contact_point_ = x.translation();
    Point<D> velocity = v.template head<D>();
    if constexpr (N == 6) {
      const auto to_tool = x.attitude().conjugate();
      lever_.step(to_tool * Eigen::Vector3d{f.template head<3>()}, to_tool * Eigen::Vector3d{f.template tail<3>()},
                  estimator_.contact(), dt);
      arm_ = x.attitude() * lever_.value();
      contact_point_ += arm_;
      velocity += Eigen::Vector3d{v.template tail<3>()}.cross(arm_);
      material_point_ += x.translation() - before_.translation() + arm_ - before_.attitude() * lever_.value();
      before_ = x;
      estimator_.step(contact_point_, material_point_, velocity, f.template head<D>(), dt);
      torque_.step(newtons_per_n_m_ * f.template tail<3>(), dt);
    } else if constexpr (N == kJointPort) {
      estimator_.step(in.robot.x, contact_point_, velocity, f, dt);
    } else {
      estimator_.step(contact_point_, velocity, f.template head<D>(), dt);
    }
    if (senses_ && !touches()) bias_.learn(in.robot.f_environment, dt);
  }

  /// On the robot.
  [[nodiscard]] Force<N> leaving_brake(const SlaveInput<N>& in) const noexcept {
    if (!estimator_.contact()) return {};
    const Point<D> n = estimator_.patch().normal;
    typename Velocity<N>::Vector leaving = Velocity<N>::Vector::Zero();
    leaving.template head<D>() = std::min(0.0, n.dot(in.worlds.to_master(in.robot.v).vec().template head<D>())) * n;
    const double of_mass = kBrakeOfMass * std::sqrt(estimator_.patch().stiffness / to_master_stiffness_ * mass_kg_);
    const double b = std::max(brake_n_s_per_m_, std::min(of_mass, 0.25 * mass_kg_ / in.dt.si()));
    return Force<N>{-b * in.worlds.to_slave(Velocity<N>{leaving}).vec()};
  }

  void report(const RobotSample<N>& robot) noexcept {
    const SurfacePatch<D>& patch = estimator_.patch();
    report_.contact.value = arm_touches() ? 1.0 : 0.0;
    report_.normal.value = Direction<D>{patch.normal};
    report_.point.value = Position<D>{patch.point};
    report_.stiffness.value = arm_touches() && !estimator_.contact() ? 0.0 : in_series(patch, robot.ideal);
    report_.friction.value = patch.friction;
    report_.curvature.value = patch.curvature;
    report_.robot.value = Position<D>{contact_point_};
    if constexpr (N == 6) report_.lever.value = Displacement<3>{lever_.value()};
    if constexpr (N == kJointPort) {
      const SurfacePatch<1>& held = estimator_.fingers().patch();
      report_.fingers_contact.value = estimator_.fingers().contact() ? 1.0 : 0.0;
      report_.fingers_side.value = held.normal[0];
      report_.fingers_point.value = held.point[0];
      report_.fingers_stiffness.value = in_series(held, robot.ideal);
    }
  }
  template <int M>
  [[nodiscard]] double in_series(const SurfacePatch<M>& patch, bool ideal) const noexcept {
    if (!(patch.stiffness > 0.0)) return 0.0;
    double compliance = 1.0 / patch.stiffness;
    if (!ideal && coupling_n_per_m_ > 0.0) compliance += 1.0 / coupling_n_per_m_;
    if constexpr (N == 6)
      if (!ideal && rotation_n_m_per_rad_ > 0.0)
        compliance += arm_.cross(patch.normal).squaredNorm() / rotation_n_m_per_rad_;
    return 1.0 / compliance;
  }

  using Base::coupling_;
  bool along_force_;  ///< the yield is along the force, and the coupling's damper is grounded in contact
  typename Force<N>::Vector damping_;  ///< B_c
  double yields_;                      ///< c
  bool senses_, engaged_ = false;
  SensorBias<N> bias_;
  double mass_kg_;  ///< of the robot; 0: not known
  ReactionForceObserver<N> observer_;
  Force<N> f_;  ///< on the robot in the last tick
  double to_master_stiffness_, brake_n_s_per_m_, coupling_n_per_m_, rotation_n_m_per_rad_;
  double newtons_per_n_m_;  ///< sqrt(K_c/K_r) in the master's units
  Estimator estimator_;
  TorqueContact torque_;  ///< N = 6
  Point<D> contact_point_ = Point<D>::Zero();
  ContactLever lever_;                          ///< N = 6: b
  Point<3> arm_ = Point<3>::Zero();             ///< R b
  Point<3> material_point_ = Point<3>::Zero();  ///< N = 6: s, but for a constant
  Position<N> before_;                          ///< N = 6: the robot's, in the last tick
  Displacement<N> offset_;                      ///< o in the slave's world
  SurfaceReport<N> report_;
  MasterSays<N> said_;
  bool informed_ = false;        ///< the master says it
  double yield_m_ = 0.0;         ///< q
  double grounded_share_ = 0.0;  ///< g
  Point<D> yield_normal_ = Point<D>::Unit(0);
  Point<D> f_slow_ = Point<D>::Zero();  ///< LP_50ms f, of yield_along_force
};

}  // namespace twoport
