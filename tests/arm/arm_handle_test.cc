// An arm as hand controller: what the hand feels, and where the sampled loops of force feedback and of a rendered spring are stable.

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/arm/arm_model.h"
#include "common/scene/load.h"
#include "lab/theory/sampled_loop.h"
#include "sim/plant/arm.h"
#include "sim/sim_device.h"
#include "tests/support/no_alloc.h"
#include "tests/theory/matrices.h"

namespace twoport::sim::arm_handle_test {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Seven = ArmPlant;
using test::exponential, test::inverse, test::Mode;

constexpr double kPeriod = 5e-4;

Scene scene(const std::string& arm, const std::string& who = "") {
  return parse_scene(
      "dof: 6 duration_s: 9 rate_hz: 2000 control { architecture: RENDER } device { position_m: [0.1, 0, 0.3] "
      "arm { file: \"" TWOPORT_ARMS "/fr3.textproto\" " +
          arm + " } } " + who,
      "handle");
}

// ---- what the hand feels

const std::string kLeads =
    "operator { hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 inertia_kg_m2: 1e-4 "
    "rotational_stiffness_n_m_per_rad: 5 rotational_damping_n_m_s_per_rad: 0.05 } path { move_to { position_m: "
    "[0.2, 0.02, 0.28, 0.98877108, 0.0998334, 0.0998334, 0.05] duration_s: 2 } } path { move_to { position_m: "
    "[0.1, 0, 0.3, 1, 0, 0, 0] duration_s: 2 } } }";

struct Felt {
  double force_n = 0.0, torque_n_m = 0.0;
};
/// Largest wrench between hand and handle while the hand moves by 0.1 m and 0.3 rad in 2 s and back.
Felt felt_in_free_air(const Scene& s) {
  SimDevice<6> d{s, Seconds{kPeriod}};
  Felt most;
  for (int k = 0; k < 9000; ++k) {
    d.actuate(Force<6>{});
    d.advance();
    const Vector6 f = d.arm()->outside_force().vec() + d.arm()->tool_inertia().vec();
    most.force_n = std::max(most.force_n, f.head<3>().norm());
    most.torque_n_m = std::max(most.torque_n_m, f.tail<3>().norm());
  }
  EXPECT_NEAR(d.x().translation().x(), 0.1, 2e-3) << "it follows the hand back";
  return most;
}
Felt felt_in_free_air(const std::string& arm) {
  return felt_in_free_air(scene(arm, kLeads));
}

TEST(ArmAtTheHand, IsLightInFreeAirWithForceFeedback) {
  const Felt heavy = felt_in_free_air("joint_damping_n_m_s_per_rad: 0.3");
  const Felt light = felt_in_free_air("joint_damping_n_m_s_per_rad: 0.3 force_feedback { gain: 19 }");
  RecordProperty("heavy_n", std::to_string(heavy.force_n));
  RecordProperty("heavy_n_m", std::to_string(heavy.torque_n_m));
  RecordProperty("light_n", std::to_string(light.force_n));
  RecordProperty("light_n_m", std::to_string(light.torque_n_m));
  std::printf("free air, gain 0: %.3f N, %.4f N m; gain 19: %.3f N, %.4f N m\n", heavy.force_n, heavy.torque_n_m,
              light.force_n, light.torque_n_m);
  EXPECT_GT(heavy.force_n, 1.0);
  EXPECT_LE(light.force_n, 0.5);
  EXPECT_LE(light.torque_n_m, 0.050);  // measured 46 mN m; a hand of 0.1 kg beyond the sensor allows a gain of 50
}

// What scenes/arm_handle_gripper.textproto says of its arm.
TEST(ArmAtTheHand, TheScenesArmIsLightInFreeAir) {
  Scene s = scene("", kLeads);
  s.device->arm = load_scene(TWOPORT_SCENES "/arm_handle_gripper.textproto").device->arm;
  const Felt felt = felt_in_free_air(s);
  std::printf("the scene's arm in free air: %.3f N, %.1f mN m\n", felt.force_n, 1e3 * felt.torque_n_m);
  EXPECT_LE(felt.force_n, 0.5);
  EXPECT_LE(felt.torque_n_m, 0.020);  // measured 11 mN m; 46 without a gain of its own for torques
}

/// Largest torques at the tool that the arm alone asks for along the motion above, with a gain of 19 [N m]: of the rotation's
/// acceleration, of the translation's, of velocities, of the joints' damping.
struct Shares {
  double rotation = 0.0, translation = 0.0, velocity = 0.0, friction = 0.0;
};
Shares torque_shares(double damping) {
  const Scene s =
      scene("joint_damping_n_m_s_per_rad: " + std::to_string(damping) + " force_feedback { gain: 19 }", kLeads);
  SimDevice<6> d{s, Seconds{kPeriod}};
  const ArmModel model{*s.device->arm->parameters};
  Shares most;
  Seven::State before = d.arm()->state();
  for (int k = 0; k < 8000; ++k) {
    d.advance();
    const Seven::State now = d.arm()->state();
    const auto p = model.pose(now.q);
    const auto J = model.jacobian(p);
    const Eigen::Matrix<double, 7, 7> mobility = inverse(model.inertia(p));
    const Matrix6 lambda = inverse(J * mobility * J.transpose());
    const Eigen::Matrix<double, 6, 7> to_tool = lambda * J * mobility;
    const Vector6 turning = model.bias_acceleration(p, now.v);
    const Vector6 a = J * (now.v - before.v) / kPeriod + turning;
    const Vector6 velocity = to_tool * model.bias_torque(p, now.v, Eigen::Vector3d::Zero()) - lambda * turning;
    const auto keep = [](double& x, const Eigen::Vector3d& torque) { x = std::max(x, torque.norm() / 20.0); };
    keep(most.rotation, lambda.bottomRightCorner<3, 3>() * a.tail<3>());
    keep(most.translation, lambda.bottomLeftCorner<3, 3>() * a.head<3>());
    keep(most.velocity, velocity.tail<3>());
    keep(most.friction, (to_tool * (damping * now.v)).tail<3>());
    before = now;
  }
  return most;
}

TEST(ArmAtTheHand, TorqueInFreeAirIsInertia) {
  const Shares of = torque_shares(0.3);
  std::printf("torque in free air [mN m]: rotation %.1f, translation %.1f, velocity %.1f, friction %.1f\n",
              1e3 * of.rotation, 1e3 * of.translation, 1e3 * of.velocity, 1e3 * of.friction);
  EXPECT_GT(of.rotation + of.translation, 4.0 * (of.velocity + of.friction));
}

TEST(ArmAtTheHand, CarriesItsWeightAndStaysWhereItIs) {
  SimDevice<6> d{scene("tool_mass_kg: 0.3 force_feedback { gain: 9 }"), Seconds{kPeriod}};
  const Position<6> start = d.x();
  for (int k = 0; k < 4000; ++k) d.advance();
  EXPECT_LT((d.x() - start).vec().norm(), 1e-9);
  EXPECT_LT(std::abs(d.port_energy().si()), 1e-12);
}

TEST(ArmAtTheHand, RestsWhereTheHandsSpringHoldsTheForce) {
  SimDevice<6> d{
      scene("joint_damping_n_m_s_per_rad: 1",
            "operator { hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 60 inertia_kg_m2: 1e-4 "
            "rotational_stiffness_n_m_per_rad: 5 rotational_damping_n_m_s_per_rad: 1 } path { hold { duration_s: 9 } } "
            "}"),
      Seconds{kPeriod}};
  const Position<6> start = d.x();
  Vector6 f;
  f << 2.0, -1.0, 1.0, 0.02, 0.05, -0.03;
  for (int k = 0; k < 16000; ++k) {
    d.actuate(Force<6>{f});
    d.advance();
  }
  Vector6 expected = -f / 400.0;
  expected.tail<3>() = -f.tail<3>() / 5.0;
  // Displayed f pushes the handle by -f; what is left of the motion after 8 s is less.
  EXPECT_LT(((d.x() - start).vec() - expected).norm(), 1e-3 * expected.norm());
}

/// D Λ D: the inertia of the arm without its tool as the force feedback shows it, D = diag(1/√(1 + gain), 1/√(1 + torque_gain)).
Matrix6 shaped(const Matrix6& lambda, double gain, double torque_gain) {
  Vector6 D;
  D << Eigen::Vector3d::Constant(1.0 / std::sqrt(1.0 + gain)),
      Eigen::Vector3d::Constant(1.0 / std::sqrt(1.0 + torque_gain));
  return D.asDiagonal() * lambda * D.asDiagonal();
}

TEST(ArmAtTheHand, TheGainOfTorquesShapesTheInertiaOfTheRotation) {
  const auto feedback = [](double gain, double torque_gain) {
    return "joint_damping_n_m_s_per_rad: 0 null_space_damping_n_m_s_per_rad: 0 force_feedback { gain: " +
           std::to_string(gain) + " torque_gain: " + std::to_string(torque_gain) + " }";
  };
  const Scene known = scene("");
  const ArmModel arm{*known.device->arm->parameters};
  const Matrix6 lambda = inverse(tool_mobility(arm, joint_vector(known.device->arm->joint_position_rad)));
  for (const auto& [gain, torque_gain] : {std::pair{0.0, 9.0}, {9.0, 0.0}, {4.0, 4.0}, {19.0, 99.0}}) {
    const Matrix6 inertia = shaped(lambda, gain, torque_gain);
    EXPECT_LT((inertia - inertia.transpose()).norm(), 1e-12 * inertia.norm());
    for (int axis = 0; axis < 6; ++axis) {
      const double size = axis < 3 ? 0.2 : 0.01;
      const Vector6 f = size * Vector6::Unit(axis);
      std::string push = "operator { hand { mass_kg: 0 force_n: [";
      for (int i = 0; i < 6; ++i) push += std::to_string(f[i]) + (i < 5 ? ", " : "] } }");
      SimDevice<6> d{scene(feedback(gain, torque_gain), push), Seconds{kPeriod}};
      const Position<6> start = d.x();
      const int ticks = 20;
      for (int k = 0; k < ticks; ++k) d.advance();
      const double t = ticks * kPeriod;
      const Vector6 way = (d.x() - start).vec();
      // Measured up to 2.4e-3: the arm turns meanwhile.
      EXPECT_LT((inertia * (2.0 / (t * t) * way) - f).norm(), 5e-3 * size)
          << "gains " << gain << ", " << torque_gain << ", axis " << axis;
    }
  }
}

/// Acceleration of the tool under a constant force in x, from its way in 20 ticks.
double acceleration(double gain, double mass_kg) {
  SimDevice<6> d{scene("joint_damping_n_m_s_per_rad: 0 null_space_damping_n_m_s_per_rad: 0 force_feedback { gain: " +
                           std::to_string(gain) + " }",
                       "operator { hand { mass_kg: " + std::to_string(mass_kg) + " force_n: [0.5, 0, 0] } }"),
                 Seconds{kPeriod}};
  const double start = d.x().translation().x();
  const int ticks = 20;
  for (int k = 0; k < ticks; ++k) d.advance();
  const double t = ticks * kPeriod;
  return 2.0 * (d.x().translation().x() - start) / (t * t);
}

TEST(ArmAtTheHand, ForceFeedbackDividesItsInertia) {
  const Scene s = scene("");
  const ArmModel arm{*s.device->arm->parameters};
  const ArmModel::Joints q = joint_vector(s.device->arm->joint_position_rad);
  // The device's attitude is the identity, whatever that of the flange: mobilities are compared in the base's axes.
  const double mobility = tool_mobility(arm, q)(0, 0);
  for (const double gain : {0.0, 1.0, 9.0, 49.0})
    EXPECT_NEAR(acceleration(gain, 0.0), 0.5 * mobility * (1.0 + gain), 1e-3 * 0.5 * mobility * (1.0 + gain)) << gain;
  // A mass beyond the sensor is not divided: with gain 9 about 1.13 kg of the arm and 1 kg of the hand. The hand's part of
  // the feedback is one tick late at the first tick.
  const double alone = acceleration(9.0, 0.0), held = acceleration(9.0, 1.0);
  EXPECT_LT(held, 0.7 * alone);
}

// ---- stability of sampled loops, by eigenvalues

using Matrix7 = Eigen::Matrix<double, 7, 7>;
using Matrix14 = Eigen::Matrix<double, 14, 14>;

/// The arm at rest in its first position, (δq, v) from tick to tick, under torques τ = F (δq, v) that are held for a tick:
///
///     M δq̈ = -G_q δq - d v + τ,   τ = G_q δq - (1 + g) Jᵀ R J δq - N (k_n δq + d_n v)
///
/// G_q = ∂g/∂q: the weight is compensated where the tick begins. R: a rendered spring at the tool.
Matrix14 tick_of(const Scene& s, double damping, double gain, const Matrix6& R) {
  constexpr double kNullStiffness = 10.0, kNullDamping = 2.0, h = 1e-6;
  const ArmModel arm{*s.device->arm->parameters};
  const ArmModel::Joints q = joint_vector(s.device->arm->joint_position_rad);
  const auto p = arm.pose(q);
  const Matrix7 mobility = inverse(arm.inertia(p));
  const Eigen::Matrix<double, 6, 7> J = arm.jacobian(p);
  Matrix7 weight;
  for (int i = 0; i < 7; ++i) {
    const auto at = [&](double by) {
      return arm.gravity_torque(arm.pose(q + by * Matrix7::Identity().col(i)), ArmPlant::kGravity);
    };
    weight.col(i) = (at(h) - at(-h)) / (2.0 * h);
  }
  const Matrix7 N = Matrix7::Identity() - J.transpose() * inverse(J * mobility * J.transpose()) * J * mobility;
  Eigen::Matrix<double, 21, 21> held = Eigen::Matrix<double, 21, 21>::Zero();
  held.block<7, 7>(0, 7).setIdentity();
  held.block<7, 7>(7, 0) = -mobility * weight;
  held.block<7, 7>(7, 7) = -damping * mobility;
  held.block<7, 7>(7, 14) = mobility;
  Eigen::Matrix<double, 7, 14> F;
  F << weight - (1.0 + gain) * J.transpose() * R * J - kNullStiffness * N, -kNullDamping * N;
  const Eigen::Matrix<double, 21, 21> tick = exponential(held * kPeriod);
  return tick.topLeftCorner<14, 14>() + tick.topRightCorner<14, 7>() * F;
}

double growth(const Mode& of) {
  return std::log(std::abs(of.value)) / kPeriod;
}

Matrix6 stiffness(double k) {
  Matrix6 K = Matrix6::Zero();
  K.topLeftCorner<3, 3>().diagonal().setConstant(k);
  K.bottomRightCorner<3, 3>().diagonal().setConstant(1e-2 * k);
  return K;
}

/// Growth of that mode's part of the simulated motion [1/s]: the arm starts in it, and the left eigenvector sees no other.
double measured_growth(const Scene& s, const Mode& mode, const Matrix6& R) {
  constexpr double kStart = 1e-6;  // [rad]: far from where the arm turns, far from rounding
  constexpr int kTicks = 1000;
  const auto nothing = std::make_shared<const Environment<6>>(std::vector<EnvironmentSpec>{});
  const Position<6> start = position<6>(s.device->position_m);
  Seven arm{*s.device->arm, nothing, kPeriod, start, std::nullopt};
  const Seven::State rest = arm.state();
  const Eigen::Matrix<double, 14, 1> first = kStart / mode.right.real().head<7>().norm() * mode.right.real();
  arm.set_state({rest.q + first.head<7>(), first.tail<7>()});
  const auto part = [&] {
    Eigen::Matrix<double, 14, 1> now;
    now << arm.state().q - rest.q, arm.state().v;
    return std::abs((mode.left.transpose() * now.cast<std::complex<double>>())(0));
  };
  const double before = part();
  for (int k = 0; k < kTicks; ++k) arm.advance(Force<6>{Vector6{-R * (arm.body().x - start).vec()}});
  return std::log(part() / before) / (kTicks * kPeriod);
}

// ---- the loop of the force feedback, with a hand beyond the sensor

using Matrix21 = Eigen::Matrix<double, 21, 21>;

/// The arm at rest in its first position with a hand on it whose intended position rests, (δq, v, τ) from tick to tick:
///
///     M δq̈ = -(G_q + Jᵀ K J) δq - (d + Jᵀ B J) v + τ,   τ(k) = G_q δq + Jᵀ S f_s - N (k_n δq + d_n v),   S = Λ D⁻¹ Λ⁻¹ D⁻¹ - 1
///
/// M and N with the hand's mass, Λ without. f_s = -K J δq - B J v - M_h J δq̈ is read with the torques of the tick before.
Matrix21 tick_with_hand(const Scene& s, const HandSpec& hand) {
  constexpr double h = 1e-6;
  const ArmSpec& spec = *s.device->arm;
  const ArmTool held{.mass_kg = hand.mass_kg, .inertia = hand.inertia_kg_m2 * Eigen::Matrix3d::Identity()};
  const ArmModel bare{*spec.parameters}, arm{*spec.parameters, held};
  const ArmModel::Joints q = joint_vector(spec.joint_position_rad);
  const auto p = arm.pose(q);
  const Matrix7 mobility = inverse(arm.inertia(p)), one = Matrix7::Identity();
  const Eigen::Matrix<double, 6, 7> J = arm.jacobian(p);
  Matrix7 weight;
  for (int i = 0; i < 7; ++i) {
    const auto at = [&](double by) { return arm.gravity_torque(arm.pose(q + by * one.col(i)), ArmPlant::kGravity); };
    weight.col(i) = (at(h) - at(-h)) / (2.0 * h);
  }
  const Matrix7 N = one - J.transpose() * inverse(J * mobility * J.transpose()) * J * mobility;
  Vector6 k, b, m;
  const auto both = [](double linear, double angular) {
    Vector6 v;
    v << Eigen::Vector3d::Constant(linear), Eigen::Vector3d::Constant(angular);
    return v;
  };
  k = both(hand.stiffness_n_per_m, hand.rotational_stiffness_n_m_per_rad);
  b = both(hand.damping_n_s_per_m, hand.rotational_damping_n_m_s_per_rad);
  m = both(hand.mass_kg, hand.inertia_kg_m2);
  Matrix21 held_tick = Matrix21::Zero();
  held_tick.block<7, 7>(0, 7).setIdentity();
  held_tick.block<7, 7>(7, 0) = -mobility * (weight + J.transpose() * k.asDiagonal() * J);
  held_tick.block<7, 7>(7, 7) =
      -mobility * (spec.joint_damping_n_m_s_per_rad * one + J.transpose() * b.asDiagonal() * J);
  held_tick.block<7, 7>(7, 14) = mobility;
  Eigen::Matrix<double, 6, 21> sensed = -(m.asDiagonal() * J * held_tick.middleRows<7>(7));
  sensed.leftCols<7>() -= k.asDiagonal() * J;
  sensed.middleCols<7>(7) -= b.asDiagonal() * J;
  const Matrix6 lambda = inverse(tool_mobility(bare, q));
  const Matrix6 S =
      lambda * inverse(shaped(lambda, spec.force_feedback_gain, spec.force_feedback_torque_gain)) - Matrix6::Identity();
  Eigen::Matrix<double, 7, 21> torque = J.transpose() * S * sensed;
  torque.leftCols<7>() += weight - spec.null_space_stiffness_n_m_per_rad * N;
  torque.middleCols<7>(7) -= spec.null_space_damping_n_m_s_per_rad * N;
  // Torques of the coming tick from what was read, then the tick.
  const Matrix21 tick = exponential(held_tick * kPeriod);
  Matrix21 all;
  all.topRows<14>().setZero();
  all.topLeftCorner<14, 14>() = tick.topLeftCorner<14, 14>();
  all.topRows<14>() += tick.topRightCorner<14, 7>() * torque;
  all.bottomRows<7>() = torque;
  return all;
}
double radius(const Matrix21& tick) {
  return eigenvalues(tick).cwiseAbs().maxCoeff();
}

/// The value at which a rising growth is zero.
template <class Growth>
double boundary(Growth growth, double low, double high, int halvings) {
  for (int i = 0; i < halvings; ++i) {
    const double middle = std::sqrt(low * high);
    (growth(middle) > 0.0 ? high : low) = middle;
  }
  return low;
}

TEST(ArmAtTheHand, RenderedSpringIsStableUpToTheEigenvalues) {
  for (const double gain : {0.0, 4.0}) {
    const Scene s = scene("joint_damping_n_m_s_per_rad: 1 force_feedback { gain: " + std::to_string(gain) + " }");
    const auto mode = [&](double k) { return test::fastest_mode(tick_of(s, 1.0, gain, stiffness(k))); };
    const double known = boundary([&](double k) { return growth(mode(k)); }, 10.0, 1e6, 60);
    const double seen =
        boundary([&](double k) { return measured_growth(s, mode(k), stiffness(k)); }, 0.9 * known, 1.1 * known, 16);
    std::printf("gain %g: rendered spring up to %.1f N/m by eigenvalues, %.1f N/m simulated\n", gain, known, seen);
    EXPECT_NEAR(seen, known, 1e-3 * known);  // measured 4e-6; 16 halvings of 20 % resolve 3e-6
    for (const double part : {0.9, 1.1}) {
      const Mode of = mode(part * known);
      EXPECT_NEAR(measured_growth(s, of, stiffness(part * known)), growth(of), 1e-2 * std::abs(growth(of))) << part;
    }
  }
}

// A spring along three axes holds the tip of an arm with rotors of 0.1 kg m²; a weak one holds its attitude.
TEST(ArmAtTheHand, SpringAtTheTipIsStableUpToTheEigenvalues) {
  Scene s = scene("joint_damping_n_m_s_per_rad: 0.5");
  auto light = std::make_shared<ArmParameters>(*s.device->arm->parameters);
  for (ArmJoint& joint : light->joints) joint.rotor_inertia = 0.1;
  s.device->arm->parameters = light;
  const auto tip = [](double k) {
    Vector6 K;
    K << k, k, k, 10.0, 10.0, 10.0;
    return Matrix6{K.asDiagonal()};
  };
  const auto mode = [&](double k) { return test::fastest_mode(tick_of(s, 0.5, 0.0, tip(k))); };
  const double known = boundary([&](double k) { return growth(mode(k)); }, 1000.0, 1e6, 60);
  const double seen =
      boundary([&](double k) { return measured_growth(s, mode(k), tip(k)); }, 0.9 * known, 1.1 * known, 16);
  std::printf("spring at the tip up to %.1f N/m by eigenvalues, %.1f N/m simulated\n", known, seen);
  EXPECT_NEAR(seen, known, 1e-3 * known);
}

TEST(ArmAtTheHand, ForceFeedbackIsStableUpToTheEigenvalues) {
  const auto with = [](double gain, double torque_gain, double mass, double inertia) {
    return scene("joint_damping_n_m_s_per_rad: 0.3 force_feedback { gain: " + std::to_string(gain) +
                     " torque_gain: " + std::to_string(torque_gain) + " }",
                 "operator { hand { mass_kg: " + std::to_string(mass) +
                     " stiffness_n_per_m: 400 damping_n_s_per_m: 8 inertia_kg_m2: " + std::to_string(inertia) +
                     " rotational_stiffness_n_m_per_rad: 5 rotational_damping_n_m_s_per_rad: 0.05 } path { hold { "
                     "duration_s: 9 } } }");
  };
  const auto theory = [&](const Scene& s) { return radius(tick_with_hand(s, *s.operator_model->hand)); };
  const auto grows = [&](const Scene& s) {
    SimDevice<6> d{s, Seconds{kPeriod}};
    Vector6 dv;
    dv << 1e-4, 2e-4, -1e-4, 1e-3, -2e-3, 1e-3;
    d.kick(Velocity<6>{dv});
    for (int k = 0; k < 2000; ++k) d.advance();
    return d.v().vec().norm() > dv.norm();
  };
  // The hand of the tests above.
  const Scene used = with(19, 99, 0.1, 1e-4);
  std::printf("gains 19, 99: radius %.6f\n", theory(used));
  EXPECT_LT(theory(used), 1.0);
  EXPECT_FALSE(grows(used));
  // Up to which gain of torques a hand of ten times its inertia may hold it, and up to which gain of forces.
  for (const bool of_torques : {true, false}) {
    const auto at = [&](double gain) { return of_torques ? with(19, gain, 0.1, 1e-3) : with(gain, 99, 0.1, 1e-4); };
    const double known = boundary([&](double gain) { return theory(at(gain)) - 1.0; }, 1.0, 1000.0, 40);
    const double seen =
        boundary([&](double gain) { return grows(at(gain)) ? 1.0 : -1.0; }, 0.9 * known, 1.1 * known, 7);
    std::printf("%s up to %.2f by eigenvalues, %.2f simulated\n", of_torques ? "torque_gain" : "gain", known, seen);
    EXPECT_LT(known, 999.0);
    EXPECT_NEAR(seen, known, 1e-2 * known);
  }
}

TEST(ArmAtTheHand, AllocatesNothing) {
  SimDevice<6> d{scene("tool_mass_kg: 0.2 force_feedback { gain: 9 cutoff_hz: 300 }",
                       "operator { hand { mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 } path { move_to { "
                       "position_m: [0.2, 0, 0.3] duration_s: 1 } } }"),
                 Seconds{kPeriod}};
  NoAlloc guard;
  for (int k = 0; k < 100; ++k) d.advance();
  EXPECT_EQ(guard.seen(), 0);
}

}  // namespace
}  // namespace twoport::sim::arm_handle_test
