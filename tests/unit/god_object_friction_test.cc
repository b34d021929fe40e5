// Constraint-based rendering with Coulomb friction against closed forms.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>
#include <vector>

#include "common/contact/sample_shape.h"
#include "common/method/render/god_object.h"
#include "common/method/render/render.h"
#include "tests/support/meshes.h"
#include "tests/support/no_alloc.h"

namespace twoport::god_object_friction_test {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr double kStiffness = 2000.0, kTurning = 4.0, kFriction = 0.5;
const CouplingOptions kSpring{.stiffness_n_per_m = kStiffness,
                              .damping_n_s_per_m = 0,
                              .rotational_stiffness_n_m_per_rad = kTurning,
                              .rotational_damping_n_m_s_per_rad = 0};
const Material kRough{1, 0, kFriction, 0};

template <int N>
Position<N> at(const Vector3d& p) {
  if constexpr (N == 6)
    return Position<6>{p, Quaterniond::Identity()};
  else
    return Position<3>{p};
}
template <int N>
Vector3d translation(const PortVector<N>& w) {
  if constexpr (N == 6)
    return w.linear;
  else
    return w;
}
std::vector<Vector3d> corners() {
  std::vector<Vector3d> tool;
  for (const double x : {-0.03, 0.03})
    for (const double y : {-0.02, 0.02})
      for (const double z : {-0.01, 0.01}) tool.push_back({x, y, z});
  return tool;
}
template <int N>
double least_distance(const Environment<N>& e, const Position<N>& x) {
  double least = 1e9;
  const PoseWithRotation<N> pose{x};
  const auto look = [&](const Vector3d& p) {
    for (const Surface& s : e.world().surfaces) least = std::min(least, signed_distance<3>(s.shape, p).distance);
  };
  if constexpr (N == 6) {
    for (const Vector3d& p : e.tool()) look(x.translation() + pose.R * p);
  } else {
    look(x.translation());
  }
  return least;
}

/// Pressed `depth` deep on a plane at z = 0 and dragged to and fro along t: sticks while k u <= μ k depth, slides at exactly
/// μ k depth, and friction takes μ k depth times the way of the proxy.
template <int N>
void press_and_drag(const Vector3d& lowest, double allowed_n) {
  const Vector3d t = Vector3d{3, 4, 0} / 5;
  constexpr double kDepth = 0.003, kMost = kFriction * kStiffness * kDepth, kTick = 1e-5;
  const Environment<N> e{{Surface{Wall{Vector3d::UnitZ(), 0}, kRough}}, N == 6 ? corners() : std::vector<Vector3d>{}};
  GodObject<N> proxy{kSpring, e};
  for (int i = 0; i <= 100; ++i) proxy.follow(at<N>({0, 0, 0.002 - lowest.z() - (0.002 + kDepth) * i / 100}));
  EXPECT_NEAR(proxy.friction_energy().si(), 0.0, 1e-9);
  const Vector3d start{0, 0, -kDepth - lowest.z()};

  // 5 mm there, 8 mm back, 3 mm to the start.
  double u = 0.0, resting = 0.0, taken = 0.0, work = 0.0;
  Vector3d before = translation<N>(proxy.force(at<N>(start), {}));
  const double stored = proxy.potential(at<N>(start)).si();
  for (const auto& [direction, ticks] : {std::pair{1, 500}, {-1, 800}, {1, 300}})
    for (int i = 0; i < ticks; ++i) {
      u += direction * kTick;
      // Closed form: the proxy rests until the handle is μ depth away from it.
      const double moved = std::clamp(resting, u - kFriction * kDepth, u + kFriction * kDepth);
      taken += kMost * std::abs(moved - resting);
      resting = moved;
      const Position<N> handle = at<N>(start + u * t);
      proxy.follow(handle);
      const Vector3d f = translation<N>(proxy.force(handle, {}));
      ASSERT_NEAR(f.dot(t), kStiffness * (resting - u), allowed_n) << u;
      ASSERT_NEAR(f.z(), kStiffness * kDepth, allowed_n);
      ASSERT_NEAR(f.dot(t.cross(Vector3d::UnitZ())), 0.0, allowed_n);
      ASSERT_GE(least_distance(e, proxy.proxy()), -1e-9);
      ASSERT_NEAR(proxy.friction_energy().si(), taken, 1e-9) << u;
      work -= 0.5 * (before + f).dot(direction * kTick * t);
      before = f;
    }
  EXPECT_GT(taken, 0.02);
  // Into the network: what friction takes and what the spring holds more than at the start. Stick turns to slip on a tick here, so that
  // the trapezoid rule is exact.
  EXPECT_NEAR(work, taken + proxy.potential(at<N>(start + u * t)).si() - stored, 1e-8);
}

TEST(GodObjectFriction, APointSticksBelowTheConeAndSlidesOnIt) {
  press_and_drag<3>(Vector3d::Zero(), 4.1e-8);
}
TEST(GodObjectFriction, AToolSticksBelowTheConeAndSlidesOnIt) {
  press_and_drag<6>({0, 0, -0.01}, 4.1e-8);
}

TEST(GodObjectFriction, OnASlopeSticksExactlyBelowTheAngleOfFriction) {
  // A handle straight below a slope of angle a asks for tan(a) of tangential over normal force.
  for (const auto& [tangent, sticks] : {std::pair{0.999999 * kFriction, true}, {1.000001 * kFriction, false}}) {
    const double a = std::atan(tangent);
    const Environment<3> e{{Surface{Wall{{-std::sin(a), 0, std::cos(a)}, 0}, kRough}}};
    GodObject<3> proxy{kSpring, e};
    proxy.follow(at<3>({0, 0, 1e-9}));
    proxy.follow(at<3>({0, 0, 0}));
    const Vector3d start = proxy.proxy().translation();
    for (int i = 1; i <= 300; ++i) proxy.follow(at<3>({0, 0, -1e-5 * i}));
    const double moved = (proxy.proxy().translation() - start).norm();
    if (sticks)
      EXPECT_LT(moved, 1e-11) << tangent;
    else
      EXPECT_NEAR(moved, 0.003 * std::cos(a) * (tangent - kFriction), 1e-11) << tangent;
  }
}

TEST(GodObjectFriction, ATurnedToolSlipsAtTheTorqueOfItsCorners) {
  const Environment<6> e{{Surface{Wall{Vector3d::UnitZ(), 0}, kRough}}, corners()};
  GodObject<6> proxy{kSpring, e};
  for (int i = 0; i <= 100; ++i) proxy.follow(at<6>({0, 0, 0.012 - 0.004 * i / 100}));  // 2 mm
  // All corners are as far from the axis, so that the torque does not depend on how they share the press.
  const double most = kFriction * kStiffness * 0.002 * std::hypot(0.03, 0.02);
  for (int i = 1; i <= 400; ++i) {
    const double angle = 5e-5 * i;
    const Position<6> handle{{0, 0, 0.008}, rotation(Vector3d{0, 0, angle})};
    proxy.follow(handle);
    ASSERT_NEAR(proxy.force(handle, {}).angular.z(), -std::min(most, kTurning * angle), 1e-6) << angle;
  }
}

TEST(GodObjectFriction, OnACurvedMeshStaysInTheConeAndOutside) {
  const auto field = std::make_shared<const DistanceField>(test::torus_mesh(0.05, 0.02, 96, 48), 1e-3);
  const Shape shape = Mesh{Vector3d::Zero(), Eigen::Matrix3d::Identity(), field};
  const Environment<3> e{{Surface{shape, kRough}}};
  GodObject<3> proxy{kSpring, e};
  double most = 0.0, taken = 0.0, work = 0.0;
  int sliding = 0;
  Position<3> last;
  Vector3d before = Vector3d::Zero();
  for (int i = 0; i <= 20'000; ++i) {
    const double a = 2e-4 * i;
    const Position<3> handle{Vector3d{(0.05 + 0.01 * std::sin(7 * a)) * std::cos(a),
                                      (0.05 + 0.01 * std::sin(7 * a)) * std::sin(a),
                                      0.023 - std::min(0.008, 4e-6 * i)}};
    proxy.follow(handle);
    const Vector3d x = proxy.proxy().translation(), f = proxy.force(handle, {});
    ASSERT_GE(least_distance(e, proxy.proxy()), -1e-9) << i;
    const Vector3d n = signed_distance<3>(shape, x).normal.normalized();
    const double normal = f.dot(n), across = (f - normal * n).norm();
    ASSERT_LE(across, kFriction * normal + 1e-6) << i;
    sliding += normal > 0.1 && across > kFriction * normal - 1e-6;
    ASSERT_GE(proxy.friction_energy().si(), taken) << i;
    taken = proxy.friction_energy().si();
    if (i > 0) work -= 0.5 * (before + f).dot(handle.translation() - last.translation());
    last = handle, before = f;
    most = std::max(most, normal);
  }
  EXPECT_GT(most, 5.0);
  EXPECT_GT(sliding, 1000);
  // Of 1 J, in steps of 10 µm, each of which takes the friction of its end.
  EXPECT_NEAR(work, taken + proxy.potential(last).si(), 1e-4);
}

TEST(GodObjectFriction, OfAPegInAHoleNeverPenetrates) {
  const Environment<6> e{{Surface{Plate{Vector3d::Zero(),
                                        Eigen::Matrix3d::Identity(),
                                        {0.05, 0.05, 0.015},
                                        std::make_shared<const std::vector<PlateHole>>(1, PlateHole{{0, 0}, 0.0101})},
                                  kRough}},
                         sample(Peg::of(Vector3d::Zero(), Vector3d::UnitZ(), 0.01, 0.03, 0.001), 6e-3)};
  GodObject<6> proxy{kSpring, e};
  double deepest = 0.0, taken = 0.0;
  for (int i = 0; i <= 6000; ++i) {
    const double t = i / 2000.0;
    const Vector3d where{3e-4 * std::sin(9 * t), 3e-4 * std::cos(7 * t), std::max(-0.012, 0.025 - 0.02 * t)};
    proxy.follow({where, rotation(Vector3d{0.03 * std::sin(5 * t), 0.03 * std::sin(4 * t), 0})});
    ASSERT_GE(least_distance(e, proxy.proxy()), -1e-9) << i;
    ASSERT_GE(proxy.friction_energy().si(), taken) << i;
    taken = proxy.friction_energy().si();
    deepest = std::min(deepest, proxy.proxy().translation().z());
  }
  EXPECT_LT(deepest, -0.005) << "it did not enter the hole";
  EXPECT_GT(taken, 0.0);
}

/// A handle that springs and a damper pull along a path, 0.4 kg, at 2 kHz, exactly integrated in its force: pressed on a rough plane,
/// tilted and dragged about, with nothing that limits the force.
TEST(GodObjectFriction, UnderTheProjectedControllerNoForceIsMuchLargerThanWantedAndNoEnergyIsMade) {
  ControlOptions o;
  o.architecture = Architecture::render;
  o.rendering = RenderingAlgorithm::god_object;
  o.coupling = kSpring;
  o.controller.method = Method::force_projected;
  o.reference_energy = true;
  o.initial_energy = Energy{};
  constexpr double kT = 5e-4, kMass = 0.4, kInertia = 1.1e-3;
  double factor = 0.0, least = 0.0;
  for (const double friction : {0.2, 0.5, 1.0}) {
    const Environment<6> e{{Surface{Wall{Vector3d::UnitZ(), 0}, {1, 0, friction, 0}}}, corners()};
    Rendering<6> rendering{o, e};
    Position<6> x{Vector3d{0, 0, 0.02}, Quaterniond::Identity()};
    Eigen::Matrix<double, 6, 1> v = v.Zero();
    Force<6> applied;
    double port = 0.0;
    for (int i = 0; i < 14'000; ++i) {
      const double t = i * kT;
      const auto out = rendering.step({x, Velocity<6>{v}}, applied, Seconds{kT}, Seconds{kT});
      applied = out.command;
      // What is added for a new deficit is no more than the wanted force again; arrears add max_gain |v_p|.
      const double wanted = std::sqrt(out.wanted.squared_norm());
      const double arrears = o.controller.max_gain * v.norm();
      factor = std::max(factor, (std::sqrt(applied.squared_norm()) - arrears) / std::max(wanted, 1e-9));

      const double press = std::min(1.0, t);
      const Vector3d path{t < 5 ? 0.0 : 0.03 * std::sin(std::numbers::pi * (t - 5)), 0, 0.02 - 0.016 * press};
      const Quaterniond turn =
          rotation(Vector3d{0, t > 1 && t < 5 ? 0.2 * std::sin(std::numbers::pi * (t - 1)) : 0.0, 0});
      const Position<6> before = x;
      Eigen::Matrix<double, 6, 1> f = -applied.vec();
      f.head<3>() += 400.0 * (path - x.translation()) - 8.5 * v.head<3>();
      f.tail<3>() += 5.0 * rotation_vector(turn * x.attitude().conjugate()) - 0.05 * v.tail<3>();
      v.head<3>() += kT / kMass * f.head<3>();
      v.tail<3>() += kT / kInertia * f.tail<3>();
      x = x + Velocity<6>{v} * Seconds{kT};
      port += dot(applied, x - before).si();
      least = std::min(least, port);
    }
  }
  EXPECT_LT(factor, 2.0 + 1e-9);
  EXPECT_GT(least, -1e-6);
}

TEST(GodObjectFriction, FarInsideEndsAfterABoundedNumberOfStepsAndPenetratesNothing) {
  // Leaps to anywhere 5 to 15 cm inside a wedge, turned by up to a radian: the fixed point is not found in most of them.
  const Environment<6> e{{Surface{Wall{Vector3d{1, 0, 1}.normalized(), 0}, kRough},
                          Surface{Wall{Vector3d{-1, 0, 1}.normalized(), 0}, kRough}},
                         corners()};
  GodObject<6> proxy{kSpring, e};
  std::mt19937_64 random{5};
  std::uniform_real_distribution<double> any{-1.0, 1.0};
  proxy.follow({Vector3d{0, 0, 0.1}, Quaterniond::Identity()});
  int most = 0;
  for (int i = 0; i < 500; ++i) {
    const Vector3d where{0.1 * any(random), 0.1 * any(random), -0.1 + 0.05 * any(random)};
    proxy.follow({where, rotation(Vector3d{any(random), any(random), any(random)})});
    most = std::max(most, proxy.newton_steps());
    ASSERT_GE(least_distance(e, proxy.proxy()), -1e-9) << i;
  }
  EXPECT_GT(proxy.unfinished(), 0u);
  EXPECT_LT(proxy.unfinished(), 500u);
  EXPECT_LT(most, 290);
  // Drawn out again it is as good as new.
  const Position<6> above{Vector3d{0, 0, 0.1}, Quaterniond::Identity()};
  for (int i = 0; i < 50; ++i) proxy.follow(above);
  EXPECT_LT((proxy.proxy() - above).vec().norm(), 1e-9);
  EXPECT_FALSE(proxy.touching());
}

TEST(GodObjectFriction, UnderTheControllerThePortTakesWhatFrictionTakes) {
  // Pressed and dragged about, held for a tick: the energy at the port never falls below that of the spring and of friction by more than
  // the prediction's error of one tick.
  ControlOptions o;
  o.architecture = Architecture::render;
  o.rendering = RenderingAlgorithm::god_object;
  o.coupling = kSpring;
  o.controller.method = Method::force_projected;
  o.reference_energy = true;
  o.initial_energy = Energy{};
  const Environment<6> e{{Surface{Wall{Vector3d::UnitZ(), 0}, kRough}}, corners()};
  Rendering<6> rendering{o, e};
  GodObject<6> beside{kSpring, e};
  Position<6> x{Vector3d{0, 0, 0.012}, Quaterniond::Identity()};
  Velocity<6> v;
  Force<6> applied;
  double least = 0.0;
  int seen = 0;
  for (int i = 0; i < 8000; ++i) {
    const double t = i * 5e-4;
    const Position<6> next{Vector3d{0.01 * std::sin(3 * t), 0.004 * std::sin(5 * t), 0.010 - 0.002 * std::sin(2 * t)},
                           rotation(Vector3d{0.02 * std::sin(4 * t), 0.02 * std::sin(5 * t), 0.1 * std::sin(3 * t)})};
    v = (next - x) / Seconds{5e-4};
    x = next;
    {
      NoAlloc guard;
      applied = rendering.step({x, v}, applied, Seconds{5e-4}, Seconds{5e-4}).command;
      seen += guard.seen();
    }
    beside.follow(x);
    least = std::min(least, (rendering.observed() - beside.potential(x) - beside.friction_energy()).si());
  }
  EXPECT_EQ(seen, 0);
  EXPECT_GT(beside.friction_energy().si(), 0.01);
  EXPECT_GT(least, -1e-4);
}

}  // namespace
}  // namespace twoport::god_object_friction_test
