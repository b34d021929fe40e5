// Coulomb friction of a plane wall on a mass: rests, slides and stops as the closed forms say, and takes the energy that it should.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>

#include "common/scene/load.h"
#include "sim/plant/exact_wall.h"
#include "sim/sim_robot.h"
#include "tests/support/no_alloc.h"

namespace twoport::sim::wall_friction_test {
namespace {

using Eigen::Vector3d;
constexpr double kGravity = 9.81;

SimRobot<3> robot(const std::string& blocks, double period) {
  return {parse_scene("dof: 3 duration_s: 1 " + blocks, "test"), Seconds{period}};
}
void push(SimRobot<3>& r, const Vector3d& f) {
  r.actuate({.f = Force<3>{f}, .x_d = {}, .v_d = {}});
}

/// 0.2 kg at the depth at which it rests on a slope of `angle`, which falls towards +x.
struct Incline {
  double angle;
  Vector3d normal{std::sin(angle), 0, std::cos(angle)}, down{std::cos(angle), 0, -std::sin(angle)};
  Vector3d weight{0, 0, -0.2 * kGravity};
  [[nodiscard]] Vector3d start() const { return -0.2 * kGravity * std::cos(angle) / 5000 * normal; }
  [[nodiscard]] SimRobot<3> block(double friction, const Vector3d& v, double period) const {
    const auto list = [](const Vector3d& a) { return fmt::format("[{}, {}, {}]", a[0], a[1], a[2]); };
    auto r = robot("robot { mass_kg: 0.2 position_m: " + list(start()) + " velocity_m_per_s: " + list(v) +
                       " } environment { wall { normal: " + list(normal) +
                       " stiffness_n_per_m: 5000 friction: " + std::to_string(friction) + " } }",
                   period);
    push(r, weight);
    return r;
  }
};

TEST(BlockOnIncline, BelowTheAngleOfFrictionDoesNotMove) {
  const Incline slope{std::numbers::pi / 6};  // tan = 0.577
  auto r = slope.block(0.58, Vector3d::Zero(), 1e-3);
  double moved = 0.0;
  for (int k = 0; k < 100'000; ++k) {
    r.advance();
    moved = std::max(moved, (r.state().x.translation() - slope.start()).norm());
  }
  std::printf("moved %.2g m in 100 s\n", moved);
  EXPECT_LT(moved, 1e-14);
  EXPECT_LT(r.state().v.vec().norm(), 1e-13);
  // The slope carries the weight, friction its part along the slope.
  EXPECT_LT((r.environment_force().vec() + slope.weight).norm(), 1e-10);
}

TEST(BlockOnIncline, AboveItSlidesWithTheClosedForm) {
  const Incline slope{std::numbers::pi / 6};
  for (const double period : {1e-2, 1e-3}) {
    auto r = slope.block(0.5, Vector3d::Zero(), period);
    const double a = kGravity * (std::sin(slope.angle) - 0.5 * std::cos(slope.angle));
    for (int k = 1; k * period <= 1.0; ++k) {
      r.advance();
      const double t = k * period;
      ASSERT_LT((r.state().x.translation() - slope.start() - 0.5 * a * t * t * slope.down).norm(), 1e-12) << t;
    }
  }
}

TEST(BlockOnIncline, ThrownAlongAPlaneStopsWhereTheClosedFormSays) {
  const Incline plane{0.0};
  for (const double period : {1e-2, 1e-3, 1e-4}) {
    const Vector3d d{0.6, -0.8, 0};
    auto r = plane.block(0.3, 0.4 * d, period);
    const double a = 0.3 * kGravity, stop = 0.4 / a;
    double off = 0.0;
    for (int k = 1; k * period <= 0.5; ++k) {
      r.advance();
      const double t = std::min(stop, k * period);
      off = std::max(off, (r.state().x.translation() - plane.start() - (0.4 * t - 0.5 * a * t * t) * d).norm());
    }
    std::printf("%g s a tick: %.2g m\n", period, off);
    EXPECT_LT(off, 1e-14);
    EXPECT_LT(r.state().v.vec().norm(), 1e-14);
  }
}

TEST(BlockOnIncline, ThrownAcrossTheSlopeTurnsDownhill) {
  // v + v_down decays by friction alone where tan = μ: (v - v·down) is constant along the path (a block on a slope of the angle
  // of friction ends at half its speed, downhill).
  const Incline slope{std::atan(0.5)};
  auto r = slope.block(0.5, Vector3d{0, 0.3, 0}, 1e-3);
  const double g = kGravity * std::sin(slope.angle);
  double off = 0.0;
  for (int k = 0; k < 1000; ++k) {
    r.advance();
    const Vector3d v = r.state().v.vec();
    off = std::max(off, std::abs(v.norm() + v.dot(slope.down) - 0.3));
  }
  std::printf("|v| + v·down off by %.2g m/s, downhill %.9g m/s, across %.2g\n", off, r.state().v.vec().dot(slope.down),
              r.state().v.vec()[1]);
  EXPECT_LT(off, 1e-9);
  EXPECT_NEAR(r.state().v.vec().dot(slope.down), 0.15, 1e-6);
  (void)g;
}

TEST(BlockOnIncline, OnASpringLosesTheClosedFormsAmplitudeEachHalfTurn) {
  // Free of weight across: a spring of 200 N/m along x and y, pressed with 2 N, μ = 0.4: each half turn ends 2 f_c/k closer, until
  // the spring pulls with less than f_c.
  const double k = 200, fc = 0.8, m = 0.2, w = std::sqrt(k / m), half = std::numbers::pi / w;
  auto r = robot(
      "robot { mass_kg: 0.2 position_m: [0.03, 0, 0] } environment { wall { normal: [0, 0, 1] offset_m: 0.0004 "
      "stiffness_n_per_m: 5000 friction: 0.4 } } environment { spring { stiffness_n_per_m: 200 anchor_m: [0, 0, 0] } }",
      1e-3);
  push(r, Vector3d{0, 0, -2});
  double off = 0.0;
  for (int n = 1; n <= 800; ++n) {
    r.advance();
    const double t = 1e-3 * n;
    const int turn = static_cast<int>(t / half);
    double from = 0.03, sign = 1.0, x = 0.03;
    for (int i = 0; i <= turn; ++i) {
      if (k * from <= fc) {
        x = sign * from;
        break;
      }
      const double middle = fc / k, s = i < turn ? half : t - turn * half;
      x = sign * (middle + (from - middle) * std::cos(w * s));
      if (i < turn) from -= 2.0 * middle, sign = -sign;
    }
    off = std::max(off, std::abs(r.state().x.translation()[0] - x));
  }
  std::printf("%.2g m; rests at %.9f m\n", off, r.state().x.translation()[0]);
  EXPECT_LT(off, 1e-12);
  EXPECT_EQ(r.state().v.vec()[0], 0.0);
}

/// Bounces and turns on a damped wall: stick, slip and flight in turn.
const std::string kRestless =
    "robot { mass_kg: 0.1 damping_n_s_per_m: 0.2 position_m: [0, 0, -0.001] velocity_m_per_s: [0.1, 0.05, -0.1] } "
    "environment { wall { normal: [0, 0, 1] stiffness_n_per_m: 5000 damping_n_s_per_m: 1 friction: 0.4 } } environment "
    "{ spring { stiffness_n_per_m: 50 anchor_m: [0.01, 0, 0] } }";

TEST(WallFriction, DoesNotDependOnTheTick) {
  // The force is held, so that any tick has the same motion: every stop, release and bounce is located within it.
  for (const double along : {0.3, 1.2}) {
    auto coarse = robot(kRestless, 5e-3), fine = robot(kRestless, 5e-5);
    const Vector3d f{along, 0.4 * along, -4};
    push(coarse, f);
    push(fine, f);
    double off = 0.0, stuck = 0.0;
    for (int k = 0; k < 200; ++k) {
      coarse.advance();
      for (int i = 0; i < 100; ++i) fine.advance();
      off = std::max(off, (coarse.state().x.translation() - fine.state().x.translation()).norm());
      stuck += fine.state().v.vec().head<2>().isZero(0.0);
    }
    std::printf("%g N: %.2g m, at rest at %g of 200\n", along, off, stuck);
    EXPECT_LT(off, 1e-9);
  }
}

TEST(WallFriction, TakesTheEnergyThatItsForceDoes) {
  // 2 μs ticks: Simpson over pairs of them is the work of friction where it does not jump.
  auto r = robot(kRestless, 2e-6);
  const Vector3d f{1.2, 0.4, -4};
  push(r, f);
  const auto energy = [&] {
    const BodyState<3>& s = r.state();
    return 0.05 * s.v.vec().squaredNorm() + r.environment().potential(s.x).si() - f.dot(s.x.translation());
  };
  struct Powers {
    double friction, dampers;
  };
  const auto powers = [&]() -> Powers {
    const Vector3d v = r.state().v.vec(), force = r.environment_force().vec();
    const Vector3d spring = 50 * (Vector3d{0.01, 0, 0} - r.state().x.translation());
    const bool pressed = std::abs(force[2] - spring[2]) > 0.0;
    return {-(force - spring).head<2>().dot(v.head<2>()), 0.2 * v.squaredNorm() + (pressed ? v[2] * v[2] : 0.0)};
  };
  const double before = energy();
  double lost = 0.0, rubbed = 0.0, off = 0.0;
  for (int k = 0; k < 100'000; ++k) {
    const Powers a = powers();
    r.advance();
    const Powers b = powers();
    r.advance();
    const Powers c = powers();
    ASSERT_GE(c.friction, 0.0);
    lost += 2e-6 / 3 * (a.friction + a.dampers + 4 * (b.friction + b.dampers) + c.friction + c.dampers);
    rubbed += 2e-6 / 3 * (a.friction + 4 * b.friction + c.friction);
    off = std::max(off, std::abs(before - energy() - lost));
  }
  std::printf("friction took %.6g J; account off by %.2g J\n", rubbed, off);
  EXPECT_GT(rubbed, 1e-4);
  EXPECT_LT(off, 1e-8);
}

TEST(WallFriction, HoldsUntilTheLoadExceedsTheCone) {
  auto r = robot(
      "robot { mass_kg: 0.1 position_m: [0, 0, -0.001] } environment { wall { normal: [0, 0, 1] stiffness_n_per_m: "
      "5000 friction: 0.4 } }",
      1e-3);
  for (int k = 0; k < 1000; ++k) {
    push(r, Vector3d{2.0 * k / 1000, 0, -5});
    r.advance();
    ASSERT_EQ(r.state().x.translation()[0], 0.0) << k;
    ASSERT_NEAR(r.environment_force().vec()[0], -2.0 * k / 1000, 1e-15);
  }
  push(r, Vector3d{2.01, 0, -5});
  r.advance();
  EXPECT_NEAR(r.state().x.translation()[0], 0.5 * 0.1 * 1e-6, 1e-15);
}

TEST(WallFriction, AllocatesNothing) {
  auto r = robot(kRestless, 1e-3);
  int seen = 0;
  for (int k = 0; k < 500; ++k) {
    push(r, Vector3d{2 * std::sin(0.1 * k), std::cos(0.07 * k), -4});
    NoAlloc guard;
    r.advance();
    seen += guard.seen();
  }
  EXPECT_EQ(seen, 0);
}

}  // namespace
}  // namespace twoport::sim::wall_friction_test
