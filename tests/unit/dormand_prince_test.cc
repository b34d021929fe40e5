// Bodies stepped by the method of Dormand and Prince against closed forms and against fine solutions by other integrators.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "common/scene/load.h"
#include "sim/sim_robot.h"
#include "tests/support/no_alloc.h"

namespace twoport::sim::dormand_prince_test {
namespace {

using Eigen::Vector3d;

template <int N>
SimRobot<N> robot(const std::string& blocks, double period, const std::string& integrator = "DORMAND_PRINCE") {
  return {parse_scene(
              "dof: " + std::to_string(N) + " duration_s: 1 simulation { integrator: " + integrator + " } " + blocks,
              "test"),
          Seconds{period}};
}
template <int N>
void push(SimRobot<N>& r, const typename Force<N>::Vector& f) {
  r.actuate({.f = Force<N>{f}, .x_d = {}, .v_d = {}});
}

const Vector3d kInertia{1e-3, 2e-3, 2.6e-3};
double kinetic(const BodyState<6>& s) {
  const Vector3d w = s.x.attitude().conjugate() * Vector3d{s.v.vec().tail<3>()};
  return 0.5 * w.cwiseAbs2().dot(kInertia);
}
Vector3d angular_momentum(const BodyState<6>& s) {
  const Eigen::Matrix3d R = s.x.attitude().toRotationMatrix();
  return R * kInertia.cwiseProduct(R.transpose() * Vector3d{s.v.vec().tail<3>()});
}

TEST(DormandPrince, FreeBodyKeepsEnergyAndAngularMomentum) {
  // 15 rad/s for 10 s, mostly about the middle axis. Angular momentum is a state: what is left is the rounding of v = J⁻¹ L and of
  // this test. Attitude against steps of a fiftieth.
  const std::string body =
      "robot { mass_kg: 0.5 inertia_kg_m2: [1e-3, 2e-3, 2.6e-3] velocity_m_per_s: [0, 0, 0, 1, 14.9, 1] }";
  auto r = robot<6>(body, 5e-4), fine = robot<6>(body, 1e-5);
  const double energy = kinetic(r.state());
  const Vector3d momentum = angular_momentum(r.state());
  double energy_off = 0.0, momentum_off = 0.0, attitude_off = 0.0;
  for (int k = 0; k < 20'000; ++k) {
    r.advance();
    energy_off = std::max(energy_off, std::abs(kinetic(r.state()) / energy - 1.0));
    momentum_off = std::max(momentum_off, (angular_momentum(r.state()) - momentum).norm() / momentum.norm());
    for (int i = 0; i < 50; ++i) fine.move();
    attitude_off = std::max(attitude_off, r.state().x.attitude().angularDistance(fine.state().x.attitude()));
  }
  std::printf("energy %.2g, angular momentum %.2g, attitude %.2g rad\n", energy_off, momentum_off, attitude_off);
  EXPECT_LT(energy_off, 1e-10);
  EXPECT_LT(momentum_off, 1e-14);
  EXPECT_LT(attitude_off, 1e-8);
}

TEST(DormandPrince, HeldWrenchMakesMomentaLinearInTime) {
  auto r = robot<6>(
      "robot { mass_kg: 0.5 inertia_kg_m2: [1e-3, 2e-3, 2.6e-3] velocity_m_per_s: [0.1, 0, 0, 5, 17, 4] }", 1e-2);
  const Vector3d before = angular_momentum(r.state());
  Force<6>::Vector f;
  f << 1, -2, 3, 0.03, -0.02, 0.01;
  push<6>(r, f);
  for (int k = 1; k <= 100; ++k) {
    r.advance();
    const double t = 1e-2 * k;
    ASSERT_LT((angular_momentum(r.state()) - before - t * f.tail<3>()).norm(), 1e-13) << k;
    ASSERT_LT((r.state().x.translation() - Vector3d{0.1 * t, 0, 0} - f.head<3>() * t * t / (2 * 0.5)).norm(), 1e-12)
        << k;
  }
}

/// 0.5 kg and the corners of 60 × 40 × 20 mm.
const std::string kBox =
    "robot { mass_kg: 0.5 inertia_kg_m2: [1e-3, 2e-3, 2.6e-3] position_m: [0, 0, 0.06, 0.8, 0.4, 0.4, 0.2] "
    "velocity_m_per_s: [0.1, 0, -0.5, 3, -2, 5] } tool { contact_point { position_m: [0.03, 0.02, 0.01] } "
    "contact_point "
    "{ position_m: [0.03, 0.02, -0.01] } contact_point { position_m: [0.03, -0.02, 0.01] } contact_point { position_m: "
    "[0.03, -0.02, -0.01] } contact_point { position_m: [-0.03, 0.02, 0.01] } contact_point { position_m: [-0.03, "
    "0.02, "
    "-0.01] } contact_point { position_m: [-0.03, -0.02, 0.01] } contact_point { position_m: [-0.03, -0.02, -0.01] } "
    "} ";

TEST(DormandPrince, ElasticBounceKeepsEnergy) {
  // 1e5 N/m at each corner, pulled down by 5 N, ten seconds at 2 kHz.
  auto r = robot<6>(kBox + "environment { wall { normal: [0, 0, 1] stiffness_n_per_m: 1e5 } }", 5e-4);
  Force<6>::Vector f = Force<6>::Vector::Zero();
  f[2] = -5;
  push<6>(r, f);
  const auto energy = [&] {
    const BodyState<6>& s = r.state();
    return kinetic(s) + 0.25 * s.v.vec().head<3>().squaredNorm() + 5 * s.x.translation().z() +
           r.environment().potential(s.x).si();
  };
  const double before = energy();
  double off = 0.0;
  int touched = 0;
  for (int k = 0; k < 20'000; ++k) {
    r.advance();
    off = std::max(off, std::abs(energy() / before - 1.0));
    touched += r.environment_force().squared_norm() > 0.0;
  }
  std::printf("energy %.2g, in contact at %d of 20000 ticks\n", off, touched);
  EXPECT_GT(touched, 200);
  EXPECT_LT(off, 1e-6);
}

TEST(DormandPrince, RoughBoxIsTheFineSolution) {
  // Lands with a tilt, slides, sticks. Against Runge-Kutta 4 in 4000 steps a tick, which meets contacts at steps only: itself
  // uncertain by 2e-9 m, the difference to 2000.
  const std::string world =
      "robot { mass_kg: 1 position_m: [0, 0, 0.055, 0.9987502603949663, 0.04997916927067833, 0, 0] velocity_m_per_s: "
      "[0.05, 0, 0, 0, 0, 0] inertia_kg_m2: [1.6667e-3, 1.6667e-3, 1.6667e-3] rotational_damping_n_m_s_per_rad: 1e-3 } "
      "environment { wall { normal: [0, 0, 1] stiffness_n_per_m: 20000 damping_n_s_per_m: 60 friction: 0.3 } } tool { "
      "contact_point { position_m: [0.05, 0.05, -0.05] } contact_point { position_m: [0.05, -0.05, -0.05] } "
      "contact_point { position_m: [-0.05, 0.05, -0.05] } contact_point { position_m: [-0.05, -0.05, -0.05] } } ";
  auto r = robot<6>(world, 5e-4), fine = robot<6>(world, 5e-4, "RK4 substeps: 4000"),
       now = robot<6>(world, 5e-4, "EXACT");
  Force<6>::Vector f = Force<6>::Vector::Zero();
  f[2] = -9.81;
  push<6>(r, f);
  push<6>(fine, f);
  push<6>(now, f);
  double off = 0.0, exact_off = 0.0;
  for (int k = 0; k < 400; ++k) {
    r.advance();
    fine.advance();
    now.advance();
    off = std::max(off, (r.state().x.translation() - fine.state().x.translation()).norm());
    exact_off = std::max(exact_off, (now.state().x.translation() - fine.state().x.translation()).norm());
  }
  std::printf("%.2g m; EXACT %.2g m\n", off, exact_off);
  EXPECT_LT(off, 5e-9);
}

TEST(DormandPrince, StickingIsTheClosedForm) {
  // Below 1 mm/s friction is a damper c = μ f_n / 1 mm/s: m v̇ = f - c v. Pulled with half of what makes it slide.
  const double m = 0.1, c = 0.4 * 5 / kStictionSpeed, f = 1.0;
  auto r = robot<3>(
      "robot { mass_kg: 0.1 position_m: [0, 0, -0.001] } environment { wall { normal: [0, 0, 1] stiffness_n_per_m: "
      "5000 "
      "friction: 0.4 } }",
      1e-3);
  push<3>(r, Vector3d{f, 0, -5});
  for (int k = 1; k <= 800; ++k) {
    r.advance();
    const double t = 1e-3 * k, exact = f / c * (t + m / c * std::expm1(-c / m * t));
    ASSERT_NEAR(r.state().x.translation().x(), exact, 2e-11) << "tick " << k;
  }
}

TEST(DormandPrince, SlidingStopsWhenTheClosedFormDoes) {
  // Decelerates by μ f_n / m down to 1 mm/s, then exponentially: the distance is the sum of both.
  const double m = 0.1, fn = 5.0, mu = 0.4, v0 = 0.1, a = mu * fn / m, v1 = kStictionSpeed;
  auto r = robot<3>(
      "robot { mass_kg: 0.1 position_m: [0, 0, -0.001] velocity_m_per_s: [0.06, 0.08, 0] } environment { wall { "
      "normal: "
      "[0, 0, 1] stiffness_n_per_m: 5000 friction: 0.4 } }",
      1e-3);
  push<3>(r, Vector3d{0, 0, -fn});
  const double slides = (v0 - v1) / a;
  for (int k = 1; k <= 50; ++k) {
    r.advance();
    const double t = 1e-3 * k, late = std::max(0.0, t - slides), early = std::min(t, slides), tau = v1 / a;
    const double exact = v0 * early - 0.5 * a * early * early - v1 * tau * std::expm1(-late / tau);
    ASSERT_LT((r.state().x.translation() - Vector3d{0.6 * exact, 0.8 * exact, -0.001}).norm(), 2e-11) << "tick " << k;
  }
}

TEST(DormandPrince, SeesAContactThatBeginsAndEndsWithinATick) {
  // 10 µm above the wall, towards it at 0.1 m/s and pulled away by 60 N: inside from 0.1 to 3.2 ms of a tick of 10 ms.
  const std::string world =
      "robot { mass_kg: 1 position_m: [0, 0, 1e-5] velocity_m_per_s: [0, 0, -0.1] } environment { wall { normal: [0, "
      "0, 1] "
      "stiffness_n_per_m: 1e5 friction: 0.1 } }";
  auto r = robot<3>(world, 0.01), fine = robot<3>(world, 0.01, "RK4 substeps: 10000");
  push<3>(r, Vector3d{0, 0, 60});
  push<3>(fine, Vector3d{0, 0, 60});
  r.advance();
  fine.advance();
  const double free = 1e-5 - 0.1 * 0.01 + 30 * 1e-4;
  EXPECT_GT(std::abs(r.state().x.translation().z() - free), 1e-5);
  EXPECT_NEAR(r.state().x.translation().z(), fine.state().x.translation().z(), 1e-8);
}

TEST(DormandPrince, StiffFrictionIsHandedToTheImplicitMethod) {
  // 10 g under 20 N: friction decays at 1.6e6 per second.
  auto r = robot<3>(
      "robot { mass_kg: 0.01 position_m: [0, 0, -0.004] } environment { wall { normal: [0, 0, 1] stiffness_n_per_m: "
      "5000 "
      "friction: 0.8 } }",
      1e-3);
  push<3>(r, Vector3d{6, -8, -20});
  int seen = 0;
  for (int k = 1; k <= 100; ++k) {
    {
      NoAlloc guard;
      r.advance();
      seen += guard.seen();
    }
    const double c = 16 / kStictionSpeed, t = 1e-3 * k, x = 10 / c * (t + 0.01 / c * std::expm1(-c / 0.01 * t));
    ASSERT_LT((r.state().x.translation() - Vector3d{0.6 * x, -0.8 * x, -0.004}).norm(), 1e-12) << "tick " << k;
  }
  EXPECT_EQ(seen, 0);
}

TEST(DormandPrince, StepsWithoutAllocation) {
  auto r = robot<6>(kBox +
                        "environment { wall { normal: [0, 0, 1] stiffness_n_per_m: 1e4 friction: 0.3 } } environment { "
                        "box { center_m: [0.05, 0, 0] half_size_m: [0.02, 0.1, 0.03] stiffness_n_per_m: 1e4 } }",
                    5e-4);
  Force<6>::Vector f = Force<6>::Vector::Zero();
  f[0] = 1, f[2] = -5;
  push<6>(r, f);
  int seen = 0;
  {
    NoAlloc guard;
    for (int k = 0; k < 4000; ++k) r.advance();
    seen = guard.seen();
  }
  EXPECT_EQ(seen, 0);
  EXPECT_TRUE(r.state().x.finite());
}

TEST(DormandPrince, ErrorFollowsTheTolerance) {
  const std::string world =
      "robot { mass_kg: 0.5 inertia_kg_m2: [1e-3, 2e-3, 2.6e-3] velocity_m_per_s: [0.1, 0, 0, 3, 15, 1] } environment "
      "{ "
      "spring { stiffness_n_per_m: 2000 anchor_m: [0, 0, 0.02] } } tool { contact_point { position_m: [0.02, 0, 0.01] "
      "} }";
  const auto end = [&](const std::string& tolerance) {
    auto r = robot<6>(world, 1e-2, "DORMAND_PRINCE tolerance_m: " + tolerance);
    for (int k = 0; k < 100; ++k) r.advance();
    return r.state().x;
  };
  const Position<6> exact = end("1e-14");
  double last = 1.0;
  for (const char* tolerance : {"1e-6", "1e-8", "1e-10", "1e-12"}) {
    const double off = (end(tolerance) - exact).vec().norm();
    std::printf("%s: %.2g\n", tolerance, off);
    EXPECT_LT(off, 3e3 * std::stod(tolerance));
    EXPECT_LT(off, 0.5 * last);
    last = off;
  }
}

}  // namespace
}  // namespace twoport::sim::dormand_prince_test
