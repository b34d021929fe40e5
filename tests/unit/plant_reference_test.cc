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

namespace twoport::sim {
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
  std::ifstream file{TWOPORT_REFERENCE "/" + name + ".csv"};
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
      "friction: 0.8 } } environment { spring { stiffness_n_per_m: 100 anchor_m: [0, 0, -0.051] } }",
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
      "5000 friction: 0.8 } }";
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
      "[0, 0, 1] stiffness_n_per_m: 5000 damping_n_s_per_m: 5 friction: 0.8 } }",
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

}  // namespace
}  // namespace twoport::sim
