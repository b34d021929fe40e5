// Simulated plants against closed forms and against motions by other integrators (tests/reference/plants.py).

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <fstream>
#include <limits>
#include <numbers>
#include <sstream>
#include <string>
#include <vector>

#include "common/scene/load.h"
#include "sim/sim_device.h"
#include "sim/sim_robot.h"
#include "tests/support/no_alloc.h"

namespace twoport::sim::plant_reference_test {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

Scene scene(int dof, const std::string& blocks) {
  return parse_scene("dof: " + std::to_string(dof) + " duration_s: 1 " + blocks, "test");
}
template <int N>
SimRobot<N> robot(const std::string& blocks, double period) {
  return {scene(N, blocks), Seconds{period}};
}
template <int N>
void push(SimRobot<N>& r, const typename Force<N>::Vector& f) {
  r.actuate({.f = Force<N>{f}, .x_d = {}, .v_d = {}});
}

/// The rows of a table of tests/reference, without its header.
std::vector<std::vector<double>> table(const std::string& name) {
  std::ifstream file{TWOPORT_SOURCE "/tests/reference/" + name + ".csv"};
  std::vector<std::vector<double>> rows;
  std::string line, cell;
  std::getline(file, line);
  while (std::getline(file, line)) {
    std::istringstream cells{line};
    rows.emplace_back();
    while (std::getline(cells, cell, ',')) rows.back().push_back(std::stod(cell));
  }
  EXPECT_FALSE(rows.empty()) << name;
  return rows;
}

// --- sticking and creeping -----------------------------------------------------------------------

/// m v̇ = f - c v - k x, overdamped, from rest at 0: how far after t.
double overdamped(double m, double c, double k, double f, double t) {
  const double root = std::sqrt(c * c - 4 * m * k), fast = (c + root) / (2 * m), slow = 2 * k / (c + root);
  return f / k * (1 - (fast * std::exp(-slow * t) - slow * std::exp(-fast * t)) / (fast - slow));
}
/// The same without a spring.
double creep(double m, double c, double f, double t) {
  return f / c * (t + m / c * std::expm1(-c / m * t));
}

/// Out of reach: with a second wall the law of friction is the smooth one, and steps are numerical.
const std::string kFarWall = " environment { wall { normal: [0, 0, -1] offset_m: -1 stiffness_n_per_m: 1 } }";

TEST(Friction, InASlotWhoseWallsBalanceIsTheClosedForm) {
  // Two walls press with 5 N each, so that friction is 6 N and the net force nothing; pulled with 0.3 N.
  auto r = robot<3>(
      "robot { mass_kg: 0.1 } environment { wall { normal: [0, 0, 1] offset_m: 0.001 stiffness_n_per_m: 5000 "
      "friction: 0.6 } } environment { wall { normal: [0, 0, -1] offset_m: 0.001 stiffness_n_per_m: 5000 friction: 0.6 "
      "} }",
      1e-3);
  push<3>(r, Vector3d{0.3, 0, 0});
  for (int k = 1; k <= 800; ++k) {
    r.advance();
    ASSERT_NEAR(r.state().x.translation().x(), creep(0.1, 6 / kStictionSpeed, 0.3, k * 1e-3), 1e-13) << "tick " << k;
  }
}

TEST(Friction, OfAMassThatASpringPressesOnAWallIsTheClosedForm) {
  // The spring's 5 N and the wall's cancel; the spring pulls back along the wall as well.
  auto r = robot<3>(
      "robot { mass_kg: 0.1 position_m: [0, 0, -0.001] } environment { wall { normal: [0, 0, 1] stiffness_n_per_m: "
      "5000 "
      "friction: 0.8 } } environment { spring { stiffness_n_per_m: 100 anchor_m: [0, 0, -0.051] } }" +
          kFarWall,
      1e-3);
  push<3>(r, Vector3d{0.2, 0, 0});
  for (int k = 1; k <= 800; ++k) {
    r.advance();
    ASSERT_NEAR(r.state().x.translation().x(), overdamped(0.1, 4 / kStictionSpeed, 100, 0.2, k * 1e-3), 1e-13)
        << "tick " << k;
  }
}

TEST(Friction, OfALightRoughMassIsTheClosedForm) {
  // It decays at 1.6e6 per second: 1600 time constants in a tick.
  const std::string pressed =
      "robot { mass_kg: 0.01 position_m: [0, 0, -0.004] } environment { wall { normal: [0, 0, 1] stiffness_n_per_m: "
      "5000 friction: 0.8 } }" +
      kFarWall;
  for (const double period : {1e-2, 1e-3, 1e-4}) {
    auto r = robot<3>(pressed, period);
    push<3>(r, Vector3d{6, -8, -20});
    for (int k = 1; k * period < 0.3; ++k) {
      r.advance();
      const double x = creep(0.01, 16 / kStictionSpeed, 10, k * period);
      ASSERT_LT((r.state().x.translation() - Vector3d{0.6 * x, -0.8 * x, -0.004}).norm(), 1e-13) << "tick " << k;
      ASSERT_LT((r.state().v.vec() - kStictionSpeed * 10 / 16 * Vector3d{0.6, -0.8, 0}).norm(), 1e-9) << "tick " << k;
    }
  }
}

TEST(Friction, OfALightRoughMassThatIsThrownIsTheReference) {
  auto r = robot<3>(
      "robot { mass_kg: 0.01 position_m: [0, 0, 0.0005] velocity_m_per_s: [0.3, 0, -0.4] } environment { wall { "
      "normal: "
      "[0, 0, 1] stiffness_n_per_m: 5000 damping_n_s_per_m: 5 friction: 0.8 } }" +
          kFarWall,
      1e-3);
  int k = 0;
  for (const auto& row : table("rough_impact")) {
    push<3>(r, Vector3d{25 * std::sin(0.9 * k++), 0, -20});
    r.advance();
    EXPECT_LT((r.state().x.translation() - Vector3d{row[1], 0, row[2]}).norm(), 1e-9) << "tick " << k;
    EXPECT_LT((r.state().v.vec() - Vector3d{row[3], 0, row[4]}).norm(), 1e-6) << "tick " << k;
  }
}

TEST(Friction, OfALightRoughBodyOnFourPointsIsTheClosedForm) {
  // As the mass: the points carry 5 N each and lie at the height of the centre, so that nothing turns it.
  const std::string points =
      "tool { contact_point { position_m: [0.01, 0.01, 0] } contact_point { position_m: [-0.01, 0.01, 0] } "
      "contact_point { position_m: [0.01, -0.01, 0] } contact_point { position_m: [-0.01, -0.01, 0] } }";
  auto r = robot<6>(
      "robot { mass_kg: 0.01 inertia_kg_m2: [2e-6, 2e-6, 3e-6] position_m: [0, 0, -0.001] } environment { wall { "
      "normal: [0, 0, 1] stiffness_n_per_m: 5000 damping_n_s_per_m: 1 friction: 0.8 } } " +
          points,
      1e-3);
  Force<6>::Vector f;
  f << 10, 0, -20, 0, 0, 0;
  push<6>(r, f);
  int seen = 0;
  for (int k = 1; k <= 100; ++k) {
    {
      NoAlloc guard;
      r.advance();
      seen += guard.seen();
    }
    const double x = creep(0.01, 16 / kStictionSpeed, 10, k * 1e-3);
    ASSERT_LT((r.state().x.translation() - Vector3d{x, 0, -0.001}).norm(), 1e-12) << "tick " << k;
  }
  EXPECT_EQ(seen, 0);
}

// --- the device's friction -----------------------------------------------------------------------

template <int N>
using Load = typename HandlePlant<N>::Vector;

/// Largest distance to a table [m] of a handle under load(t), linear within ticks of 1 ms.
template <int N, class LoadAt>
double handle_error(const std::string& name, const DeviceSpec& device, const HandSpec& hand, const Load<N>& v,
                    const LoadAt& load) {
  HandlePlant<N> handle{device, hand, {}, 1e-3, {{}, v}};
  double worst = 0.0;
  int k = 0;
  for (const auto& row : table(name)) {
    const Load<N> u = load(1e-3 * k), w = (load(1e-3 * (k + 1)) - u) / 1e-3;
    ++k;
    // The handle's own spring pulls towards where the tick begins.
    handle.advance(u - hand.stiffness_n_per_m * handle.state().x.translation(), w);
    for (int i = 0; i < N; ++i) {
      const auto at = static_cast<std::size_t>(1 + i);
      worst = std::max(worst, std::abs(handle.state().x.translation()[i] - row[at]));
    }
  }
  return worst;
}

TEST(HandleWithFriction, OnALineStopsAndBreaksAwayWhenTheReferenceDoes) {
  DeviceSpec device{};
  device.mass_kg = 0.075;
  device.coulomb_friction_n = 0.3;
  HandSpec hand{};
  hand.mass_kg = 0.02;
  hand.stiffness_n_per_m = 300;
  hand.damping_n_s_per_m = 1;
  const auto load = [](double t) {
    constexpr double kTurn = 2 * std::numbers::pi;
    return Load<1>{0.6 * std::sin(kTurn * 40 * t) + 0.2 * std::sin(kTurn * 93 * t)};
  };
  EXPECT_LT(handle_error<1>("handle_on_a_line", device, hand, Load<1>{0.0}, load), 1e-14);
}

TEST(HandleWithFriction, InSpaceTurnsWithItsVelocity) {
  DeviceSpec device{};
  device.mass_kg = 0.075;
  device.damping_n_s_per_m = 0.02;
  device.coulomb_friction_n = 0.04;
  HandSpec hand{};
  hand.stiffness_n_per_m = 20;
  const auto load = [](double t) {
    constexpr double kTurn = 2 * std::numbers::pi;
    return Load<3>{0.08 * std::sin(kTurn * 9 * t), 0.07 * std::sin(kTurn * 7 * t + 1.0), 0.05 * std::cos(30 * t)};
  };
  EXPECT_LT(handle_error<3>("handle_in_space", device, hand, Load<3>{0.1, 0, 0.02}, load), 1e-10);
}

// --- bounces within a tick -----------------------------------------------------------------------

/// A mass pressed by a force f on an elastic wall, bouncing: its velocity into the wall and depth after t from a touch at
/// v0. In contact k d = f + (...) as an oscillator about f/k, in flight a parabola.
struct Bouncing {
  double m, k, f, v0;
  [[nodiscard]] std::pair<double, double> at(double t) const {
    const double w = std::sqrt(k / m), rest = f / k, amplitude = std::hypot(rest, v0 / w);
    const double begin = std::atan2(-rest, v0 / w);  // depth = rest + amplitude sin(phase)
    const double contact = (std::numbers::pi - 2 * begin) / w, flight = 2 * v0 * m / f;
    t = std::fmod(t, contact + flight);
    if (t < contact) return {rest + amplitude * std::sin(begin + w * t), amplitude * w * std::cos(begin + w * t)};
    t -= contact;
    return {-v0 * t + 0.5 * f / m * t * t, -v0 + f / m * t};
  }
};

TEST(Bounces, ManyInATickAreTheClosedForm) {
  // 20 g on 1 MN/m, pressed with 60 N, touch every millisecond: ten times in a tick of 100 Hz.
  const Bouncing exact{0.02, 1e6, 60.0, 0.5};
  auto r = robot<1>(
      "robot { mass_kg: 0.02 velocity_m_per_s: 0.5 } environment { wall { normal: -1 stiffness_n_per_m: 1e6 } }", 0.01);
  push<1>(r, Force<1>::Vector{60.0});
  for (int k = 1; k <= 100; ++k) {
    r.advance();
    const auto [x, v] = exact.at(0.01 * k);
    ASSERT_NEAR(r.state().x.translation()[0], x, 1e-12) << "tick " << k;
    ASSERT_NEAR(r.state().v[0], v, 1e-8) << "tick " << k;  // turns at 3e3 m/s² and more
  }
}

TEST(Bounces, OfABodyOnManyPointsAreTheClosedForm) {
  // 64 points touch at once, 35 steps long: each may turn the phase by (0.1)^5/120. With steps for the stiffness of one point the
  // velocity would err by 4e-5 m/s.
  std::string points = "tool {";
  for (int i = 0; i < 64; ++i)
    points += " contact_point { position_m: [" + std::to_string(0.01 * (i % 8) - 0.035) + ", " +
              std::to_string(0.01 * (i / 8) - 0.035) + ", 0] }";
  const Bouncing exact{1.0, 64 * 2000.0, 10.0, 0.1};
  auto r = robot<6>(
      "robot { mass_kg: 1 inertia_kg_m2: [1e-2, 1e-2, 1e-2] velocity_m_per_s: [0, 0, -0.1, 0, 0, 0] } environment { "
      "wall { normal: [0, 0, 1] stiffness_n_per_m: 2000 } } " +
          points + " }",
      1e-3);
  Force<6>::Vector f;
  f << 0, 0, -10, 0, 0, 0;
  push<6>(r, f);
  for (int k = 1; k <= 100; ++k) {
    r.advance();
    const auto [depth, v] = exact.at(1e-3 * k);
    ASSERT_NEAR(-r.state().x.translation().z(), depth, 3e-8) << "tick " << k;
    ASSERT_NEAR(-r.state().v[2], v, 1e-6) << "tick " << k;
  }
}

TEST(Bounces, ABodyThatTipsOverOnManyDampersGainsNoEnergy) {
  // Of 100 points, 1000 N s/m each, one after the other touches at 1 m/s and less: its force begins with a jump.
  std::string points = "tool {";
  for (int i = 0; i < 100; ++i)
    points += " contact_point { position_m: [" + std::to_string(0.06 * (i / 10) / 9 - 0.03) + ", " +
              std::to_string(0.06 * (i % 10) / 9 - 0.03) + ", -0.01] }";
  auto r = robot<6>(
      "robot { mass_kg: 0.5 inertia_kg_m2: [8.3e-5, 1.67e-4, 2.17e-4] position_m: [0, 0, 0.03] velocity_m_per_s: [0.1, "
      "0, -1, "
      "0.1, 0.3, 0.2] } environment { wall { normal: [0, 0, 1] stiffness_n_per_m: 1e4 damping_n_s_per_m: 1000 } } " +
          points + " }",
      1e-3);
  const auto kinetic = [&] {
    const Vector3d w = r.state().x.attitude().conjugate() * Vector3d{r.state().v.vec().tail<3>()};
    return 0.25 * r.state().v.vec().head<3>().squaredNorm() +
           0.5 * w.cwiseAbs2().dot(Vector3d{8.3e-5, 1.67e-4, 2.17e-4});
  };
  const double before = kinetic();
  for (int k = 1; k <= 19; ++k) r.advance();
  EXPECT_NEAR(kinetic(), before, 1e-12);
  for (int k = 20; k <= 60; ++k) {
    r.advance();
    ASSERT_LT(kinetic(), before) << "tick " << k;
  }
  EXPECT_LT(kinetic(), 0.02 * before);
}

TEST(Bounces, BetweenTwoTicksAreSeen) {
  // Pulled away by 4 N it reaches the wall 1 ms after the first tick and is back before the second.
  const double m = 0.02, k = 1e6, v0 = 0.5, w = std::sqrt(k / m), enter = 0.0011, pull = 4.0;
  auto r = robot<1>("robot { mass_kg: 0.02 position_m: " + std::to_string(-0.00055 + 0.5 * pull / m * enter * enter) +
                        " velocity_m_per_s: 0.5 } environment { wall { normal: -1 stiffness_n_per_m: 1e6 } }",
                    0.01);
  const double x0 = r.state().x.translation()[0];
  push<1>(r, Force<1>::Vector{-pull});
  // When it touches, and how fast.
  const double touch = (v0 - std::sqrt(v0 * v0 + 2 * pull / m * x0)) / (pull / m), v1 = v0 - pull / m * touch;
  ASSERT_GT(v1, 0.1);
  // In contact about -pull/k; leaves with -v1.
  const double begin = std::atan2(pull / k, v1 / w), contact = (std::numbers::pi - 2 * begin) / w;
  const double rest = 0.01 - touch - contact;
  r.advance();
  EXPECT_NEAR(r.state().x.translation()[0], -v1 * rest - 0.5 * pull / m * rest * rest, 1e-12);
  EXPECT_NEAR(r.state().v[0], -v1 - pull / m * rest, 1e-10);
}

// --- tumbling ------------------------------------------------------------------------------------

TEST(TumblingBody, IsTheReferenceForTwentySeconds) {
  // 40 rad/s at 100 Hz, mostly about the middle axis, about which a rotation is unstable: what is rounded grows by 1e6.
  const Vector3d inertia{1e-3, 2e-3, 2.5e-3};
  auto r = robot<6>(
      "robot { mass_kg: 0.5 inertia_kg_m2: [1e-3, 2e-3, 2.5e-3] velocity_m_per_s: [0, 0, 0, 2, 39.9, 2] }", 0.01);
  const auto kinetic = [&] {
    const Vector3d w = r.state().x.attitude().conjugate() * Vector3d{r.state().v.vec().tail<3>()};
    return 0.5 * w.cwiseAbs2().dot(inertia);
  };
  const double before = kinetic();
  for (const auto& row : table("tumbling")) {
    for (int k = 0; k < 100; ++k) r.advance();
    const Quaterniond q{row[1], row[2], row[3], row[4]};
    EXPECT_LT(q.angularDistance(r.state().x.attitude()), 1e-7) << row[0] << " s";
    EXPECT_NEAR(kinetic(), before, 1e-12 * before) << row[0] << " s";
  }
}

TEST(TumblingBody, UnderAHeldWrenchIsTheSameWhateverTheTick) {
  const std::string body =
      "robot { mass_kg: 0.5 damping_n_s_per_m: 0.7 rotational_damping_n_m_s_per_rad: 1e-3 inertia_kg_m2: [1e-3, 2e-3, "
      "2.5e-3] velocity_m_per_s: [0.1, -0.2, 0.3, 5, -17, 4] }";
  auto coarse = robot<6>(body, 0.01), fine = robot<6>(body, 0.01 / 64);
  for (int k = 0; k < 100; ++k) {
    Force<6>::Vector f;
    f << std::sin(0.1 * k), std::cos(0.07 * k), 0.2, 0.3 * std::sin(0.05 * k), 0.2 * std::cos(0.11 * k), -0.025;
    push<6>(coarse, f);
    push<6>(fine, f);
    coarse.advance();
    for (int i = 0; i < 64; ++i) fine.advance();
    ASSERT_LT((coarse.state().x - fine.state().x).vec().norm(), 1e-11) << "tick " << k;
    ASSERT_LT((coarse.state().v.vec() - fine.state().v.vec()).norm(), 1e-9) << "tick " << k;
  }
}

}  // namespace
}  // namespace twoport::sim::plant_reference_test
