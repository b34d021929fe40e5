#include "sim/sim_robot.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "common/scene/load.h"

namespace twoport::sim::sim_robot_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr double kPeriod = 5e-4;

Scene scene(int dof, const std::string& blocks) {
  return parse_scene("dof: " + std::to_string(dof) + " duration_s: 1 " + blocks, "test");
}
template <int N>
SimRobot<N> robot(const std::string& blocks, double period = kPeriod) {
  return {scene(N, blocks), Seconds{period}};
}
template <int N>
void push(SimRobot<N>& r, const typename Force<N>::Vector& f) {
  r.actuate({.f = Force<N>{f}, .x_d = {}, .v_d = {}});
}
double x_of(const SimRobot<1>& r) {
  return r.state().x.translation()[0];
}
double v_of(const SimRobot<1>& r) {
  return r.state().v[0];
}

/// Kinetic energy and what the environment holds.
template <int N>
double energy(const SimRobot<N>& r, double mass, const Vector3d& inertia = Vector3d::Zero()) {
  const auto v = r.state().v.vec();
  double kinetic = 0.0;
  if constexpr (N == 6) {
    const Vector3d w = r.state().x.attitude().conjugate() * Vector3d{v.template tail<3>()};
    kinetic = 0.5 * mass * v.template head<3>().squaredNorm() + 0.5 * w.cwiseAbs2().dot(inertia);
  } else {
    kinetic = 0.5 * mass * v.squaredNorm();
  }
  return kinetic + r.environment().potential(r.state().x).si();
}

/// Largest relative departure of the energy from where it starts.
template <int N>
double energy_drift(SimRobot<N>& r, int ticks, double mass, const Vector3d& inertia = Vector3d::Zero()) {
  const double before = energy(r, mass, inertia);
  double worst = 0.0;
  for (int k = 0; k < ticks; ++k) {
    r.advance();
    worst = std::max(worst, std::abs(energy(r, mass, inertia) / before - 1.0));
  }
  return worst;
}

// --- a mass and a wall, exactly ------------------------------------------------------------------

// The case of the peers: 0.1 kg from -5 mm, a hand of 300 N/m and 3 N s/m towards +20 mm, an elastic wall from 0.
const std::string kMassOnAWall =
    "robot { mass_kg: 0.1 position_m: -0.005 } "
    "environment { spring { stiffness_n_per_m: 300 damping_n_s_per_m: 3 anchor_m: 0.02 } } ";
const std::string kElastic = "environment { wall { normal: -1 stiffness_n_per_m: 5000 } }";

TEST(MassOnAWall, IsExactAtTwoKilohertz) {
  auto r = robot<1>(kMassOnAWall + kElastic);
  // Runge-Kutta at 1 us: its own error is 6e-12 m.
  double x = -0.005, v = 0.0, sum = 0.0, peak = 0.0;
  const auto a = [](double at, double speed) {
    return (300 * (0.02 - at) - 3 * speed - 5000 * std::max(0.0, at)) / 0.1;
  };
  for (int k = 0; k < 2000; ++k) {
    for (int i = 0; i < 500; ++i) {
      constexpr double h = 1e-6;
      const double a1 = a(x, v), v2 = v + 0.5 * h * a1, a2 = a(x + 0.5 * h * v, v2), v3 = v + 0.5 * h * a2,
                   a3 = a(x + 0.5 * h * v2, v3), v4 = v + h * a3, a4 = a(x + h * v3, v4);
      x += h / 6 * (v + 2 * v2 + 2 * v3 + v4);
      v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4);
      peak = std::max(peak, 5000 * x);
    }
    r.advance();
    sum += (x_of(r) - x) * (x_of(r) - x);
  }
  EXPECT_LT(std::sqrt(sum / 2000), 1e-11);  // asked for: 1e-9. The best of the peers has 7e-10
  EXPECT_NEAR(x_of(r), 1.132075e-3, 2e-9);
  EXPECT_NEAR(peak, 20.12, 0.005);  // the same scene as theirs
}

TEST(MassOnAWall, IsTheSameWhateverTheTick) {
  // Beginnings and ends of contact are met inside the tick, so only rounding depends on where ticks fall.
  auto coarse = robot<1>(kMassOnAWall + kElastic, 1e-3), fine = robot<1>(kMassOnAWall + kElastic, 1e-3 / 37);
  for (int k = 0; k < 1000; ++k) {
    coarse.advance();
    for (int i = 0; i < 37; ++i) fine.advance();
    ASSERT_NEAR(x_of(coarse), x_of(fine), 1e-13) << "tick " << k;
  }
}

TEST(Bounce, OnAnElasticWallKeepsItsEnergyForTenSeconds) {
  // 43 bounces a spring throws back; 86 cuts.
  auto r = robot<1>(
      "robot { mass_kg: 0.1 position_m: -0.01 velocity_m_per_s: 0.3 } environment { spring { "
      "stiffness_n_per_m: 100 } } " +
      kElastic);
  EXPECT_LT(energy_drift(r, 20'000, 0.1), 1e-10);
}

TEST(Bounce, ShorterThanATickIsStillSeen) {
  // On 40 MN/m 0.1 kg stay 0.16 ms: a third of a tick, ten radians of the wall's oscillation in one.
  const std::string stiff =
      "robot { mass_kg: 0.1 position_m: -0.01 velocity_m_per_s: 0.3 } environment { spring { "
      "stiffness_n_per_m: 100 } } environment { wall { normal: -1 stiffness_n_per_m: 4e7 } }";
  auto coarse = robot<1>(stiff), fine = robot<1>(stiff, kPeriod / 64);
  for (int k = 0; k < 2000; ++k) {
    coarse.advance();
    for (int i = 0; i < 64; ++i) fine.advance();
    ASSERT_NEAR(x_of(coarse), x_of(fine), 1e-11) << "tick " << k;
  }
}

TEST(Bounce, OnADampedWallEndsWhereTheWallWouldPull) {
  // Free flight, half a damped oscillation, and free flight again from where K d = B v, which is inside the wall.
  const double m = 0.1, k = 5000, b = 12, v0 = 0.3, start = 0.004321;
  const double sigma = b / (2 * m), wd = std::sqrt(k / m - sigma * sigma);
  const double enter = start / v0, leave = enter + std::atan2(2 * sigma * wd, sigma * sigma - wd * wd) / wd;
  const auto depth = [&](double t) { return v0 / wd * std::exp(-sigma * t) * std::sin(wd * t); };
  const auto speed = [&](double t) {
    return v0 * std::exp(-sigma * t) * (std::cos(wd * t) - sigma / wd * std::sin(wd * t));
  };
  auto r = robot<1>(
      "robot { mass_kg: 0.1 position_m: -0.004321 velocity_m_per_s: 0.3 } environment { wall { normal: -1 "
      "stiffness_n_per_m: 5000 damping_n_s_per_m: 12 } }");
  ASSERT_GT(depth(leave - enter), 1e-4);
  int pressed = 0;
  for (int tick = 1; tick <= 200; ++tick) {
    r.advance();
    const double t = tick * kPeriod;
    const double in = std::min(t, leave) - enter;
    const double x = t < enter ? -start + v0 * t : depth(in) + (t > leave ? speed(leave - enter) * (t - leave) : 0.0);
    ASSERT_NEAR(x_of(r), x, 1e-14) << "tick " << tick;
    ASSERT_LE(r.environment_force()[0], 0.0) << "tick " << tick;  // outwards or nothing
    ASSERT_EQ(r.environment_force()[0] == 0.0, t < enter || t > leave) << "tick " << tick;
    pressed += r.environment_force()[0] < 0.0;
  }
  EXPECT_GT(pressed, 20);
}

TEST(Bounce, AsideKeepsWhatIsAcrossTheWall) {
  // A tilted elastic wall turns the normal velocity around and leaves the rest.
  auto r = robot<3>(
      "robot { mass_kg: 0.1 position_m: [0.01, 0, 0] velocity_m_per_s: [-0.3, 0.1, 0.2] } "
      "environment { wall { normal: [2, -1, 2] stiffness_n_per_m: 5000 } }");
  const Vector3d n = Vector3d{2, -1, 2} / 3, v{-0.3, 0.1, 0.2};
  for (int k = 0; k < 400; ++k) r.advance();
  EXPECT_LT((r.state().v.vec() - (v - 2 * n.dot(v) * n)).norm(), 1e-13);
}

TEST(SpringOfARobot, IsExactInSpace) {
  auto r = robot<3>(
      "robot { mass_kg: 0.4 damping_n_s_per_m: 0.7 position_m: [0.01, -0.02, 0] velocity_m_per_s: [0, 0.1, 0.2] } "
      "environment { spring { stiffness_n_per_m: 250 damping_n_s_per_m: 1.3 anchor_m: [0.01, 0.02, 0.03] } }");
  push<3>(r, Vector3d{1, -2, 0.5});
  for (int k = 0; k < 1000; ++k) r.advance();
  const double sigma = 2.0 / 0.8, w = std::sqrt(250 / 0.4 - sigma * sigma), t = 0.5, e = std::exp(-sigma * t);
  const Vector3d rest = Vector3d{0.01, 0.02, 0.03} + Vector3d{1, -2, 0.5} / 250, y = Vector3d{0.01, -0.02, 0} - rest,
                 v{0, 0.1, 0.2};
  const Vector3d x = rest + e * (std::cos(w * t) * y + std::sin(w * t) / w * (v + sigma * y));
  EXPECT_LT((r.state().x.translation() - x).norm(), 1e-13);
}

// --- the general plant ---------------------------------------------------------------------------

TEST(RungeKutta, AgreesWithTheExactPlantOnAWallAndConvergesToIt) {
  const Scene s =
      scene(1, kMassOnAWall + "environment { wall { normal: -1 stiffness_n_per_m: 5000 damping_n_s_per_m: 4 } }");
  const auto e = std::make_shared<const Environment<1>>(s.environment);
  ASSERT_TRUE(ExactPlant<1>::fits(e->world()));
  const auto error = [&](int per_ms) {
    const double period = 1e-3 / per_ms;
    BodyState<1> y{position<1>(s.robot->position_m), {}};
    SimRobot<1> exact{s, Seconds{period}};
    const auto general = make_body_plant<1>(*s.robot, e, period, y, s.simulation);
    double worst = 0.0;
    for (int k = 0; k < 500 * per_ms; ++k) {
      exact.advance();
      y = general->advance(Force<1>{});
      worst = std::max(worst, std::abs((exact.state().x - y.x).vec()[0]));
    }
    return worst;
  };
  EXPECT_LT(error(2), 1e-8);
  EXPECT_NEAR(error(5) / error(10), 16.0, 4.0);  // fourth order once a step is a tick
  EXPECT_LT(error(40), 1e-12);
}

TEST(RungeKutta, LosesNoTimeToContactsThatBeginTogether) {
  // Twelve faint walls, all entered within a tick: each is a cut.
  std::string walls;
  for (int i = 0; i < 12; ++i)
    walls += "environment { wall { normal: -1 offset_m: " + std::to_string(-1e-5 * i) + " stiffness_n_per_m: 1e-9 } } ";
  auto r = robot<1>("robot { mass_kg: 0.1 position_m: -1e-5 velocity_m_per_s: 1 } " + walls);
  for (int k = 1; k <= 10; ++k) {
    r.advance();
    ASSERT_NEAR(x_of(r), k * kPeriod - 1e-5, 1e-12) << "tick " << k;
  }
}

/// A mass that a spring holds on a surface, sliding: it swings through the surface as well.
double slide_drift(const std::string& surface, const std::string& start, int ticks) {
  auto r =
      robot<3>("robot { mass_kg: 0.2 " + start + " } environment { spring { stiffness_n_per_m: 100 } } " + surface);
  return energy_drift(r, ticks, 0.2);
}
constexpr double kSlide = 1e-8;  // two seconds of steps of 0.1 rad of the contact, each right to (0.1)⁵/120

TEST(Slide, AroundASphereKeepsItsEnergy) {
  EXPECT_LT(slide_drift("environment { sphere { radius_m: 0.06 stiffness_n_per_m: 4000 } }",
                        "position_m: [0.0585, 0, 0] velocity_m_per_s: [0, 0.3, 0.2]", 4000),
            kSlide);
}
TEST(Slide, AroundACylinderKeepsItsEnergy) {
  EXPECT_LT(slide_drift("environment { cylinder { axis: [0, 0, 1] radius_m: 0.06 stiffness_n_per_m: 4000 } }",
                        "position_m: [0.0585, 0, 0] velocity_m_per_s: [0, 0.3, 0.1]", 4000),
            kSlide);
}
TEST(Slide, AlongAFaceOfABoxKeepsItsEnergy) {
  EXPECT_LT(slide_drift("environment { box { half_size_m: [0.06, 0.2, 0.2] stiffness_n_per_m: 4000 } }",
                        "position_m: [0.0585, 0, 0] velocity_m_per_s: [0, 0.3, 0.1]", 4000),
            kSlide);
}
TEST(Slide, OverTheEdgesOfABoxKeepsItsEnergy) {
  // Five times around an edge at up to 2 m/s, where the force turns by 90° within the contact.
  auto r = robot<3>(
      "robot { mass_kg: 0.2 position_m: [0.0585, 0.15, 0] velocity_m_per_s: [0, 0.3, 0] } environment { spring { "
      "stiffness_n_per_m: 100 anchor_m: [0, 0.25, 0] } } environment { box { half_size_m: [0.06, 0.2, 0.2] "
      "stiffness_n_per_m: 4000 } }");
  EXPECT_LT(energy_drift(r, 1200, 0.2), 3e-7);
}
TEST(Slide, BouncingOnASphereKeepsItsEnergy) {
  EXPECT_LT(slide_drift("environment { sphere { radius_m: 0.06 stiffness_n_per_m: 4000 } }",
                        "position_m: [0.07, 0, 0] velocity_m_per_s: [-0.5, 0.3, 0.2]", 4000),
            2e-6);  // each of ten bounces is 44 steps of 0.07 rad, which lose (0.07)⁶/72 each
}

// --- friction ------------------------------------------------------------------------------------

TEST(CoulombSlide, DeceleratesByTheFrictionalLoad) {
  // Pressed with 4 N from equilibrium, μ = 0.3: a = μN/m = 6 m/s², from 0.3 m/s for 48 ms.
  auto r = robot<3>(
      "robot { mass_kg: 0.2 position_m: [0, 0, -0.0008] velocity_m_per_s: [0.18, -0.24, 0] } "
      "environment { wall { normal: [0, 0, 1] stiffness_n_per_m: 5000 friction: 0.3 } }");
  push<3>(r, Vector3d{0, 0, -4});
  const Vector3d n{0.6, -0.8, 0};
  for (int k = 1; k <= 96; ++k) {
    r.advance();
    const double t = k * kPeriod;
    ASSERT_LT((r.state().v.vec() - (0.3 - 6 * t) * n).norm(), 1e-12) << "tick " << k;
    ASSERT_LT((r.state().x.translation() - Vector3d{(0.3 * t - 3 * t * t) * n - Vector3d{0, 0, 0.0008}}).norm(), 1e-12);
    ASSERT_NEAR(r.environment_force().vec().head<2>().norm(), 1.2, 1e-12);
  }
  for (int k = 0; k < 200; ++k) r.advance();
  EXPECT_LT(r.state().v.vec().norm(), 1e-12);
  EXPECT_NEAR(r.state().x.translation().norm(), std::hypot(0.0075, 0.0008), 1e-15);
}

TEST(CoulombSlide, UnderALoadBelowFrictionCreepsSlowerThanTheStictionSpeed) {
  // Two walls: only that of a single one sticks.
  auto r = robot<3>(
      "robot { mass_kg: 0.2 position_m: [0, 0, -0.0008] } "
      "environment { wall { normal: [0, 0, 1] stiffness_n_per_m: 5000 friction: 0.3 } } "
      "environment { wall { normal: [0, 0, -1] offset_m: -1 stiffness_n_per_m: 5000 } }");
  push<3>(r, Vector3d{0.6, 0, -4});
  for (int k = 0; k < 200; ++k) r.advance();
  EXPECT_NEAR(r.state().v[0], kStictionSpeed * 0.6 / 1.2, 1e-9);
}

TEST(CoulombSlide, OfAThrownMassStopsWithoutChatter) {
  // Nothing presses but the impact itself, of up to 7 N: half of which stops 0.05 m/s before the mass leaves again.
  const std::string thrown =
      "robot { mass_kg: 0.1 position_m: [0, 0, 0.0001] velocity_m_per_s: [0.05, 0, -0.3] } "
      "environment { wall { normal: [0, 0, 1] stiffness_n_per_m: 5000 friction: 0.5 } }";
  auto coarse = robot<3>(thrown), fine = robot<3>(thrown, kPeriod / 20);
  for (int k = 1; k <= 60; ++k) {
    coarse.advance();
    for (int i = 0; i < 20; ++i) fine.advance();
    ASSERT_LT((coarse.state().x - fine.state().x).vec().norm(), 1e-8) << "tick " << k;
    ASSERT_TRUE(k < 12 || std::abs(coarse.state().v[0]) < 1e-6) << "tick " << k;
  }
  EXPECT_NEAR(coarse.state().v[2], 0.3, 1e-8);
}

// --- rigid bodies --------------------------------------------------------------------------------

const std::string kBody = "robot { mass_kg: 0.5 inertia_kg_m2: [1e-3, 2e-3, 2.5e-3] ";
const Vector3d kInertia{1e-3, 2e-3, 2.5e-3};

Vector3d momentum(const BodyState<6>& s) {
  const Matrix3d R = s.x.attitude().toRotationMatrix();
  return R * kInertia.cwiseProduct(R.transpose() * s.v.vec().tail<3>());
}

TEST(RigidBody, TumblesForTenSecondsWithItsEnergyAndMomentum) {
  // 15 rad/s, mostly about the middle axis, about which a rotation is unstable.
  const std::string tumbling = kBody + "velocity_m_per_s: [0.1, 0, 0, 1, 14.9, 1.5] }";
  auto r = robot<6>(tumbling), fine = robot<6>(tumbling, kPeriod / 10);
  const Vector3d before = momentum(r.state());
  const double kinetic = energy(r, 0.5, kInertia);
  double momentum_error = 0.0, energy_error = 0.0, attitude_error = 0.0, unit_error = 0.0;
  for (int k = 0; k < 20'000; ++k) {
    r.advance();
    for (int i = 0; i < 10; ++i) fine.advance();
    momentum_error = std::max(momentum_error, (momentum(r.state()) - before).norm() / before.norm());
    energy_error = std::max(energy_error, std::abs(energy(r, 0.5, kInertia) / kinetic - 1.0));
    attitude_error = std::max(attitude_error, (r.state().x - fine.state().x).vec().tail<3>().norm());
    unit_error = std::max(unit_error, std::abs(r.state().x.attitude().norm() - 1.0));
  }
  EXPECT_LT(momentum_error, 2e-11);  // carried, so only rounded: 2e4 times 1e-16 at least
  EXPECT_LT(energy_error, 1e-10);
  EXPECT_LT(attitude_error, 1e-8);  // [rad], after 24 turns of an unstable motion
  EXPECT_LT(unit_error, 1e-14);
  EXPECT_NEAR(r.state().x.translation().x(), 1.0, 1e-12);
}

TEST(RigidBody, GainsTheEnergyOfItsHeldWrench) {
  // f·Δp + τ·(log ΔR + T²/12 ω0×ω1), as both observers book it.
  auto r = robot<6>(kBody + "velocity_m_per_s: [0.1, -0.2, 0.3, 5, -7, 4] }");
  double exact_error = 0.0, naive_error = 0.0, exact_sum = 0.0, naive_sum = 0.0;
  for (int k = 0; k < 2000; ++k) {
    Vector6 f;
    f << std::sin(0.1 * k), std::cos(0.07 * k), 0.2, 0.03 * std::sin(0.05 * k), 0.02 * std::cos(0.11 * k), -0.025;
    push<6>(r, f);
    const BodyState<6> s = r.state();
    const double before = energy(r, 0.5, kInertia);
    r.advance();
    const double gain = energy(r, 0.5, kInertia) - before;
    const double exact = held_energy(ObserverRule::exact, Force<6>{f}, Interval<6>{r.state().x - s.x, s.v, r.state().v},
                                     Seconds{kPeriod})
                             .si();
    const double naive = f.dot((r.state().x - s.x).vec());
    exact_sum += exact - gain;
    naive_sum += naive - gain;
    exact_error = std::max(exact_error, std::abs(exact - gain));
    naive_error = std::max(naive_error, std::abs(naive - gain));
  }
  EXPECT_LT(exact_error, 1e-13);  // of 1e-4 J a tick
  EXPECT_LT(std::abs(exact_sum), 1e-11);
  EXPECT_GT(naive_error, 1e-10);  // what T²/12 ω0×ω1 is there for
  EXPECT_GT(std::abs(naive_sum), 10 * std::abs(exact_sum));
}

std::string square_tool(double half) {
  std::string points;
  for (const double x : {-half, half})
    for (const double y : {-half, half})
      points += "contact_point { position_m: [" + std::to_string(x) + ", " + std::to_string(y) + ", -0.02] } ";
  return "tool { " + points + "}";
}

TEST(RigidBody, OnFourPointsSettlesWhereTheyCarryIt) {
  auto r = robot<6>(kBody +
                    "position_m: [0.1, 0.2, 0.03, 0.999, 0.03, -0.02, 0.01] } environment { wall { normal: [0, 0, 1] "
                    "stiffness_n_per_m: 2000 damping_n_s_per_m: 20 friction: 0.4 } } " +
                    square_tool(0.03));
  const double weight = 0.5 * 9.81;
  Vector6 f;
  f << 0, 0, -weight, 0, 0, 0;
  push<6>(r, f);
  for (int k = 0; k < 3000; ++k) r.advance();
  EXPECT_NEAR(r.state().x.translation().z(), 0.02 - weight / (4 * 2000), 1e-9);
  const Vector3d up = r.state().x.attitude() * Vector3d::UnitZ();
  EXPECT_LT((up - Vector3d::UnitZ()).norm(), 1e-9);
  EXPECT_LT(r.state().v.vec().norm(), 1e-8);  // its rocking halves in 30 ms
  EXPECT_NEAR(r.environment_force()[2], weight, 1e-6);
  EXPECT_NEAR(r.sense().f_environment[2], -weight, 1e-6);  // the sensor: the robot presses down
}

TEST(RigidBody, OnManyPointsKeepsItsEnergy) {
  // Sixteen springs at once are four times as fast as one: the steps are as short as that asks for.
  std::string points;
  for (int i = 0; i < 16; ++i) {
    const double a = 2 * std::numbers::pi * i / 16;
    points += "contact_point { position_m: [" + std::to_string(0.1 * std::cos(a)) + ", " +
              std::to_string(0.1 * std::sin(a)) + ", 0] } ";
  }
  auto r = robot<6>(kBody +
                    "position_m: [0, 0, 0.01, 0.999, 0.03, 0.03, 0] velocity_m_per_s: [0, 0, -0.2, 0, 0, 0] } "
                    "environment { wall { normal: [0, 0, 1] stiffness_n_per_m: 5000 } } environment { spring { "
                    "stiffness_n_per_m: 2 } } tool { " +
                    points + "}");
  EXPECT_LT(energy_drift(r, 1000, 0.5, kInertia), 1e-7);
}

TEST(RigidBody, WithOnePointAtItsOriginMovesAsAMass) {
  const std::string environment =
      "environment { wall { normal: [0, 0, 1] stiffness_n_per_m: 5000 damping_n_s_per_m: 10 } }";
  auto body = robot<6>(kBody + "position_m: [0, 0, 0.01] velocity_m_per_s: [0.1, 0, -0.3, 0, 0, 0] } " + environment);
  auto mass =
      robot<3>("robot { mass_kg: 0.5 position_m: [0, 0, 0.01] velocity_m_per_s: [0.1, 0, -0.3] } " + environment);
  for (int k = 0; k < 400; ++k) {
    body.advance();
    mass.advance();
    // The mass goes by exact maps, the body by Runge-Kutta steps.
    ASSERT_LT((body.state().x.translation() - mass.state().x.translation()).norm(), 5e-9) << "tick " << k;
  }
}

TEST(RigidBody, IsSlowedByItsRotationalDamping) {
  auto r = robot<6>(
      "robot { mass_kg: 0.5 inertia_kg_m2: 1e-3 damping_n_s_per_m: 2 rotational_damping_n_m_s_per_rad: 3e-3 "
      "velocity_m_per_s: [0.2, 0, 0, 0, 0, 2] }");
  for (int k = 0; k < 400; ++k) r.advance();
  EXPECT_NEAR(r.state().v[0], 0.2 * std::exp(-2 / 0.5 * 0.2), 1e-12);
  EXPECT_NEAR(r.state().v[5], 2 * std::exp(-3e-3 / 1e-3 * 0.2), 1e-12);
}

// --- the seam ------------------------------------------------------------------------------------

TEST(ForceSensor, ShowsTheForceOnTheEnvironment) {
  auto r = robot<3>(
      "robot { mass_kg: 0.2 position_m: [0, 0, -0.001] force_sensor { } } "
      "environment { wall { normal: [0, 0, 1] stiffness_n_per_m: 5000 } }");
  EXPECT_NEAR(r.sense().f_environment[2], -5.0, 1e-14);
  EXPECT_NEAR(r.environment_force()[2], 5.0, 1e-14);
}

TEST(ForceSensor, HasTheNoiseAndTheBiasOfItsScene) {
  auto r = robot<3>("robot { mass_kg: 0.2 force_sensor { noise_n: 0.05 bias_n: [0.3, -0.2, 0.1] } }");
  constexpr int kSamples = 50'000;
  Vector3d sum = Vector3d::Zero(), squares = Vector3d::Zero(), products = Vector3d::Zero(), before = Vector3d::Zero();
  const Vector3d bias{0.3, -0.2, 0.1};
  for (int k = 0; k < kSamples; ++k) {
    r.advance();
    const Vector3d e = r.sense().f_environment.vec() - bias;
    sum += e;
    squares += e.cwiseAbs2();
    products += e.cwiseProduct(before);
    before = e;
  }
  // Five standard errors: σ/√n, σ/√(2n) and σ²/√n.
  const double n = kSamples;
  EXPECT_LT((sum / n).cwiseAbs().maxCoeff(), 5 * 0.05 / std::sqrt(n));
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(std::sqrt(squares[i] / n), 0.05, 5 * 0.05 / std::sqrt(2 * n));
  EXPECT_LT((products / n).cwiseAbs().maxCoeff(), 5 * 0.05 * 0.05 / std::sqrt(n));  // white
}

TEST(ForceSensor, RepeatsItsNoiseWithItsSeed) {
  const std::string noisy = "robot { mass_kg: 0.2 force_sensor { noise_n: 0.05 } }";
  auto a = robot<3>(noisy + " seed: 5"), b = robot<3>(noisy + " seed: 5"), c = robot<3>(noisy + " seed: 6");
  int same = 0;
  for (int k = 0; k < 100; ++k) {
    ASSERT_EQ(a.sense().f_environment.vec(), b.sense().f_environment.vec());
    same += a.sense().f_environment.vec() == c.sense().f_environment.vec();
    a.advance(), b.advance(), c.advance();
  }
  EXPECT_EQ(same, 0);
}

TEST(ForceSensor, IsLateByItsLatencyInTicks) {
  const auto lag = [](double latency_ms) {
    auto r = robot<1>(kMassOnAWall + kElastic, kPeriod);
    auto late = robot<1>(
        "robot { mass_kg: 0.1 position_m: -0.005 force_sensor { latency_ms: " + std::to_string(latency_ms) +
        " } } environment { spring { stiffness_n_per_m: 300 damping_n_s_per_m: 3 anchor_m: 0.02 } } " + kElastic);
    std::vector<double> true_force;
    for (int k = 0; k < 300; ++k) {
      true_force.push_back(r.sense().f_environment[0]);
      for (std::size_t d = 0; k == 299 && d < 100; ++d)
        if (late.sense().f_environment[0] == true_force[true_force.size() - 1 - d]) return static_cast<int>(d);
      r.advance();
      late.advance();
    }
    return -1;
  };
  EXPECT_EQ(lag(0.0), 0);
  EXPECT_EQ(lag(0.5), 1);
  EXPECT_EQ(lag(5.0), 10);
  EXPECT_EQ(lag(5.2), 10);  // to the nearest tick
}

TEST(ForceSensor, ShowsNothingBeforeItsLatencyIsOver) {
  auto r = robot<1>(
      "robot { mass_kg: 0.2 position_m: -0.001 force_sensor { latency_ms: 2 } } "
      "environment { wall { normal: 1 stiffness_n_per_m: 1000 } }");
  for (int k = 0; k < 4; ++k, r.advance()) EXPECT_EQ(r.sense().f_environment[0], 0.0) << "tick " << k;
  EXPECT_NEAR(r.sense().f_environment[0], -1.0, 1e-14);
}

TEST(WithoutRobot, TheIdealOneIsWhereItIsTold) {
  auto r = robot<3>("environment { wall { normal: [0, 0, 1] stiffness_n_per_m: 1000 damping_n_s_per_m: 10 } }");
  EXPECT_TRUE(r.sense().ideal);
  r.actuate({.f = Force<3>{Vector3d{9, 9, 9}},
             .x_d = Position<3>{Vector3d{0.1, 0.2, -0.003}},
             .v_d = Velocity<3>{Vector3d{0, 0, -0.1}}});
  r.advance();
  EXPECT_EQ(r.sense().x.translation(), Vector3d(0.1, 0.2, -0.003));
  EXPECT_EQ(r.sense().v.vec(), Vector3d(0, 0, -0.1));
  EXPECT_NEAR(r.sense().f_environment[2], -4.0, 1e-14);
}

TEST(Release, LetsTheRobotGo) {
  auto r = robot<1>("robot { mass_kg: 0.2 }");
  push<1>(r, Eigen::Matrix<double, 1, 1>{3.0});
  r.advance();
  const double v = v_of(r);
  EXPECT_NEAR(v, 3.0 / 0.2 * kPeriod, 1e-17);
  r.release();
  r.advance();
  EXPECT_EQ(v_of(r), v);
}

// Steady oscillation of a mass on a spring whose anchor swings: |X| = A |K + iBω| / |K - mω² + i(B + b)ω|.
TEST(SimRobot, IsShakenByAnAnchorThatMoves) {
  const Scene scene = parse_scene(
      "dof: 1 duration_s: 1 rate_hz: 1000 robot { mass_kg: 0.5 damping_n_s_per_m: 3 } environment { spring { "
      "stiffness_n_per_m: 200 damping_n_s_per_m: 4 anchor_m: [0.1] anchor_motion { amplitude_m: 0.01 frequency_hz: 2 } "
      "} }",
      "anchor");
  sim::SimRobot<1> robot{scene, Seconds{1e-3}};
  double most = 0.0, work = 0.0;
  for (int k = 0; k < 20000; ++k) {
    robot.advance();
    if (k > 15000) most = std::max(most, std::abs(robot.state().x.translation()[0] - 0.1));
    work += std::abs(robot.environment_force()[0]);
  }
  const std::complex<double> i{0.0, 1.0};
  const double w = 4.0 * std::numbers::pi;
  const double expected = 0.01 * std::abs((200.0 + 4.0 * w * i) / (200.0 - 0.5 * w * w + 7.0 * w * i));
  EXPECT_NEAR(most, expected, 0.01 * expected);  // the anchor moves in steps of a tick
  EXPECT_GT(work, 0.0);
  robot.silence();
  for (int k = 0; k < 20000; ++k) robot.advance();
  EXPECT_LT(std::abs(robot.state().v[0]), 1e-9) << "an anchor at rest";
}

// A body too heavy to move: wrench K (anchor + a(t) - p) at the point p that the spring acts on.
TEST(SimRobot, IsTurnedByAnAnchorThatMovesOffItsOrigin) {
  const Scene scene = parse_scene(
      "dof: 6 duration_s: 1 rate_hz: 1000 robot { mass_kg: 1e9 inertia_kg_m2: 1e9 force_sensor { } } tool { "
      "contact_point { "
      "position_m: [0.3, 0, 0] } contact_point { position_m: [0, 0.2, 0.1] } } environment { spring { "
      "stiffness_n_per_m: 500 anchor_m: [0, 0.2, 0] contact_point: 1 anchor_motion { axis: 0 amplitude_m: 0.01 "
      "frequency_hz: 4 } } }",
      "anchor");
  sim::SimRobot<6> robot{scene, Seconds{1e-3}};
  const Vector3d p{0.0, 0.2, 0.1};
  for (int k = 0; k < 300; ++k) {
    robot.advance();
    const Vector3d f{5.0 * std::sin(8.0 * std::numbers::pi * 1e-3 * k), 0.0, -50.0};
    Eigen::Matrix<double, 6, 1> wrench;
    wrench << f, p.cross(f);
    ASSERT_LT((robot.environment_force().vec() - wrench).norm(), 1e-5) << k;  // it has moved by 50 N/1e9 kg (0.3 s)²/2
  }
}

}  // namespace
}  // namespace twoport::sim::sim_robot_test
