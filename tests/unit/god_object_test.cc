#include "common/method/render/god_object.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "common/contact/sample_shape.h"
#include "common/method/render/render.h"
#include "tests/support/meshes.h"
#include "tests/support/no_alloc.h"
#include "tests/support/source.h"

namespace twoport::god_object_test {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using test::Source;
using Vector6 = Eigen::Matrix<double, 6, 1>;

const Material kAny{1, 0, 0, 0};
constexpr double kStiffness = 2000.0, kTurning = 4.0;
const CouplingOptions kSpring{.stiffness_n_per_m = kStiffness,
                              .damping_n_s_per_m = 0,
                              .rotational_stiffness_n_m_per_rad = kTurning,
                              .rotational_damping_n_m_s_per_rad = 0};

// --- nearest point of a polyhedron ---------------------------------------------------------------

TEST(LeastDistance, KeepsTheConditionsOfOptimality) {
  // Up to 300 conditions, most of them redundant, all met at the origin.
  Source source{5};
  LeastDistance<6> solver;
  int active = 0;
  for (int trial = 0; trial < 2000; ++trial) {
    std::vector<HalfSpace<6>> rows(static_cast<std::size_t>(source.uniform(1, 300)));
    for (auto& row : rows) {
      row.a = source.vector<6>(1.0);
      if (trial % 3 == 0 && &row != rows.data() && source.uniform(0, 1) < 0.5) row.a = rows[0].a;  // again
      row.b = trial % 2 == 0 ? 0.0 : -source.uniform(0, 0.3);  // through the origin: degenerate
    }
    const Vector6 wanted = source.vector<6>(2.0);
    Vector6 y = wanted;
    ASSERT_TRUE(solver.solve(rows, y, 1e-13)) << trial;
    ASSERT_LE(solver.active(), 6u);
    Vector6 sum = wanted;
    for (std::size_t j = 0; j < solver.active(); ++j) {
      const auto& row = rows[solver.index(j)];
      ASSERT_GE(solver.lambda(j), -1e-12);
      ASSERT_NEAR(row.a.dot(y) - row.b, 0.0, 1e-10);
      sum += solver.lambda(j) * row.a;
    }
    ASSERT_LT((sum - y).norm(), 1e-10) << trial;
    for (const auto& row : rows) ASSERT_GE(row.a.dot(y) - row.b, -1e-10) << trial;
    active += solver.active() > 3;
  }
  EXPECT_GT(active, 500);
}

TEST(LeastDistance, TellsThatThereIsNoPoint) {
  LeastDistance<1> solver;
  const std::vector<HalfSpace<1>> rows{{Eigen::Matrix<double, 1, 1>{1.0}, 1.0},
                                       {Eigen::Matrix<double, 1, 1>{-1.0}, 1.0}};
  Eigen::Matrix<double, 1, 1> y{0.0};
  EXPECT_FALSE(solver.solve(rows, y, 1e-12));
}

// --- proxy of a point ----------------------------------------------------------------------------

template <int N>
double least_distance(const Environment<N>& e, const Position<N>& x) {
  double least = 1e9;
  const PoseWithRotation<N> at{x};
  const auto look = [&](const Point<kAxes<N>>& p) {
    for (const Surface& s : e.world().surfaces) least = std::min(least, signed_distance<kAxes<N>>(s.shape, p).distance);
  };
  if constexpr (N == 6) {
    for (const Vector3d& p : e.tool()) look(x.translation() + at.R * p);
  } else {
    look(x.translation());
  }
  return least;
}

TEST(GodObject, OfAPointStaysOnTheSurfaceWithTheSpringsForce) {
  const struct {
    const char* name;
    Shape shape;
    Vector3d start, end;
    double depth;
  } cases[] = {
      {"wall", Wall{Vector3d{2, -1, 2} / 3, 0.0}, Vector3d{2, -1, 2} * 0.01, Vector3d{2, -1, 2} / 3 * -0.004, 0.004},
      {"sphere", Sphere{Vector3d::Zero(), 0.03}, {0.02, 0.03, 0.01}, Vector3d{2, 1, 2} / 3 * 0.026, 0.004},
      {"torus", Torus{Vector3d::Zero(), Vector3d::UnitZ(), 0.05, 0.02}, {0.05, 0, 0.04}, {0.05, 0, 0.015}, 0.005},
      {"hole, its wall",
       Hole::of(Vector3d::Zero(), Vector3d::UnitZ(), 0.01, 0.03, 0),
       {0, 0, -0.01},
       {0.012, 0, -0.01},
       0.002},
  };
  for (const auto& each : cases) {
    const Environment<3> e{{Surface{each.shape, kAny}}};
    GodObject<3> proxy{kSpring, e};
    for (int i = 0; i <= 400; ++i) {
      const Position<3> handle{Vector3d{each.start + std::min(1.0, i / 300.0) * (each.end - each.start)}};
      proxy.follow(handle);
      ASSERT_GE(least_distance(e, proxy.proxy()), -1e-9) << each.name << " tick " << i;
    }
    const Position<3> handle{each.end};
    const Vector3d n = signed_distance<3>(each.shape, proxy.proxy().translation()).normal;
    const Vector3d f = proxy.force(handle, {});
    EXPECT_LT((f - kStiffness * each.depth * n).norm(), 1e-9 * kStiffness * each.depth + 1e-9) << each.name;
    // Away from the surface it is the handle.
    proxy.follow(Position<3>{each.start});
    EXPECT_EQ(proxy.proxy().translation(), each.start) << each.name;
    EXPECT_EQ(proxy.force(Position<3>{each.start}, {}).norm(), 0.0);
  }
}

TEST(GodObject, StopsInAConcaveCorner) {
  // At the bottom edge of a hole only one of two faces is the nearest one.
  const Environment<3> e{{Surface{Hole::of(Vector3d::Zero(), Vector3d::UnitZ(), 0.01, 0.03, 0), kAny}}};
  GodObject<3> proxy{kSpring, e};
  for (int i = 0; i <= 500; ++i) {
    proxy.follow(Position<3>{Vector3d{0.013, 0, -0.034} * std::min(1.0, i / 400.0)});
    ASSERT_GE(least_distance(e, proxy.proxy()), -1e-9) << i;
  }
  EXPECT_LT((proxy.proxy().translation() - Vector3d{0.01, 0, -0.03}).norm(), 1e-8);
}

TEST(GodObject, DoesNotPassThroughAThinPlate) {
  // 2 mm of material, a handle that moves 15 mm in a tick.
  const Environment<3> e{{Surface{Box{Vector3d::Zero(), {0.05, 0.05, 0.001}}, kAny}}};
  GodObject<3> proxy{kSpring, e};
  proxy.follow(Position<3>{Vector3d{0, 0, 0.01}});
  proxy.follow(Position<3>{Vector3d{0.003, 0, -0.005}});
  EXPECT_NEAR(proxy.proxy().translation().z(), 0.001, 1e-9);
  EXPECT_NEAR(proxy.proxy().translation().x(), 0.003, 1e-6);
}

TEST(GodObject, OfALine) {
  const Environment<1> e{{Surface{Wall{{-1, 0, 0}, -0.02}, kAny}}};
  GodObject<1> proxy{kSpring, e};
  const auto at = [](double x) { return Position<1>{Eigen::Matrix<double, 1, 1>{x}}; };
  for (const double x : {0.0, 0.019, 0.021, 0.023}) proxy.follow(at(x));
  EXPECT_NEAR(proxy.proxy().translation()[0], 0.02, 1e-12);
  EXPECT_NEAR(proxy.force(at(0.023), {})[0], -kStiffness * 0.003, 1e-9);
}

TEST(GodObject, OnAMeshNeverEntersIt) {
  const auto field = std::make_shared<const DistanceField>(test::torus_mesh(0.05, 0.02, 96, 48), 1e-3);
  const Environment<3> e{{Surface{Mesh{Vector3d::Zero(), Eigen::Matrix3d::Identity(), field}, kAny}}};
  GodObject<3> proxy{kSpring, e};
  double most = 0.0;
  for (int i = 0; i <= 4000; ++i) {
    const double a = 1e-3 * i;
    const Position<3> handle{
        Vector3d{(0.05 + 0.01 * std::sin(7 * a)) * std::cos(a), 0.05 * std::sin(a), 0.023 - std::min(0.006, 1e-5 * i)}};
    proxy.follow(handle);
    ASSERT_GE(least_distance(e, proxy.proxy()), -1e-9) << i;
    most = std::max(most, proxy.force(handle, {}).norm());
  }
  EXPECT_GT(most, 5.0);
}

// --- proxy of a tool -----------------------------------------------------------------------------

Environment<6> box_on_box() {
  std::vector<Vector3d> tool;
  for (const double x : {-0.03, 0.03})
    for (const double y : {-0.02, 0.02})
      for (const double z : {-0.01, 0.01}) tool.push_back({x, y, z});
  return Environment<6>{
      {Surface{Box{{0, 0, -0.05}, {0.1, 0.1, 0.05}}, kAny}, Surface{Wall{Vector3d::UnitX(), -0.08}, kAny}}, tool};
}

/// What is left of the balance of the spring's wrench and the contacts' at the proxy, relative; and the sign and complementarity
/// of the contacts.
void expect_balance(GodObject<6>& proxy, const Environment<6>& e, const Position<6>& handle, double tolerance) {
  const SpatialVector w = proxy.force(handle, {});
  Vector6 sum = Vector6::Zero();
  for (const auto& c : proxy.contacts()) {
    EXPECT_GE(c.force_n, 0.0);
    const std::size_t surfaces = e.world().surfaces.size(), i = static_cast<std::size_t>(c.index);
    const Vector3d p = proxy.proxy().translation() + proxy.proxy().attitude() * e.tool()[i / surfaces];
    EXPECT_NEAR(c.force_n * signed_distance<3>(e.world().surfaces[i % surfaces].shape, p).distance, 0.0, 1e-8);
    sum.head<3>() += c.force_n * c.normal;
    sum.tail<3>() += c.force_n * c.arm.cross(c.normal);
  }
  EXPECT_LT((sum.head<3>() - w.linear).norm(), tolerance * (1.0 + w.linear.norm()));
  EXPECT_LT((sum.tail<3>() - w.angular).norm(), tolerance * (1.0 + w.angular.norm()));
}

TEST(GodObject, OfAToolIsInBalanceAndNeverPenetrates) {
  const Environment<6> e = box_on_box();
  GodObject<6> proxy{kSpring, e};
  Source source{7};
  int many = 0;
  for (int loop = 0; loop < 40; ++loop) {
    proxy.release();
    const Position<6> start{Vector3d{0, 0, 0.06}, Quaterniond::Identity()};
    const Vector3d by = Vector3d{0, 0, -0.053} + source.vector<3>(0.004), turn = source.vector<3>(0.15);
    Position<6> handle;
    for (int i = 0; i <= 260; ++i) {
      const double share = std::min(1.0, i / 200.0);
      handle = start.moved(share * by, share * turn);
      proxy.follow(handle);
      ASSERT_GE(least_distance(e, proxy.proxy()), -1e-9) << "loop " << loop << " tick " << i;
    }
    if (!proxy.touching()) continue;
    expect_balance(proxy, e, handle, 1e-10);
    many += proxy.contacts().size() >= 2;
  }
  EXPECT_GT(many, 5);
}

TEST(GodObject, PressedFlatHasTheDepthTimesTheStiffness) {
  const Environment<6> e = box_on_box();
  GodObject<6> proxy{kSpring, e};
  Position<6> handle;
  for (int i = 0; i <= 300; ++i) {
    handle = Position<6>{Vector3d{0.001, 0.002, 0.02 - 0.013 * std::min(1.0, i / 250.0)}, Quaterniond::Identity()};
    proxy.follow(handle);
  }
  const SpatialVector w = proxy.force(handle, {});
  EXPECT_LT((w.linear - Vector3d{0, 0, kStiffness * 0.003}).norm(), 1e-9);
  EXPECT_LT(w.angular.norm(), 1e-9);
}

TEST(GodObject, HasAForceWithAPotential) {
  // Work of the held forces around a loop of the handle in contact. The trapezoid rule on a curve with kinks, where contacts begin
  // and end: 1e-6 J of 60 mJ with 20,000 points.
  const Environment<6> e = box_on_box();
  GodObject<6> proxy{kSpring, e};
  const auto at = [&](double s) {
    return Position<6>{Vector3d{0.004 * std::cos(s), 0.003 * std::sin(s), 0.006 + 0.0015 * std::sin(2 * s)},
                       rotation(Vector3d{0.05 * std::sin(s), 0.06 * std::cos(s), 0.02})};
  };
  proxy.follow(Position<6>{Vector3d{0.004, 0, 0.05}, Quaterniond::Identity()});
  for (int i = 0; i <= 1000; ++i) {
    const double left = 1 - i / 1000.0;
    proxy.follow(Position<6>{at(0).translation() + left * Vector3d{0, 0, 0.03}, at(0).attitude()});
  }
  constexpr int kPoints = 20'000;
  double work = 0.0, stored = 0.0;
  SpatialVector before = proxy.force(at(0), {});
  const double start = proxy.potential(at(0)).si();
  for (int k = 1; k <= kPoints; ++k) {
    const Position<6> from = at(2 * std::numbers::pi * (k - 1) / kPoints), to = at(2 * std::numbers::pi * k / kPoints);
    proxy.follow(to);
    const SpatialVector w = proxy.force(to, {}), d = difference(to, from);
    work += 0.5 * ((before.linear + w.linear).dot(d.linear) + (before.angular + w.angular).dot(d.angular));
    stored = std::max(stored, proxy.potential(to).si());
    before = w;
  }
  EXPECT_NEAR(proxy.potential(at(0)).si(), start, 1e-9);
  EXPECT_NEAR(work, 0.0, 1e-6) << "of " << stored << " J";
  EXPECT_GT(stored, 5e-3);
}

TEST(GodObject, OfAPegInAHoleNeverPenetrates) {
  const Environment<6> e{{Surface{Plate{Vector3d::Zero(),
                                        Eigen::Matrix3d::Identity(),
                                        {0.05, 0.05, 0.015},
                                        std::make_shared<const std::vector<PlateHole>>(1, PlateHole{{0, 0}, 0.0101})},
                                  kAny}},
                         sample(Peg::of(Vector3d::Zero(), Vector3d::UnitZ(), 0.01, 0.03, 0.001), 6e-3)};
  GodObject<6> proxy{kSpring, e};
  Source source{9};
  double deepest = 0.0;
  for (int i = 0; i <= 6000; ++i) {
    const double t = i / 2000.0;
    const Vector3d at{3e-4 * std::sin(9 * t), 3e-4 * std::cos(7 * t), std::max(-0.012, 0.025 - 0.02 * t)};
    const Position<6> handle{at, rotation(Vector3d{0.03 * std::sin(5 * t), 0.03 * std::sin(4 * t), 0})};
    proxy.follow(handle);
    ASSERT_GE(least_distance(e, proxy.proxy()), -1e-9) << i;
    deepest = std::min(deepest, proxy.proxy().translation().z());
  }
  EXPECT_LT(deepest, -0.005) << "it did not enter the hole";
}

// --- as a rendering ------------------------------------------------------------------------------

TEST(GodObject, UnderTheControllerKeepsItsDirectionAndDoesNotAllocate) {
  ControlOptions o;
  o.architecture = Architecture::render;
  o.rendering = RenderingAlgorithm::god_object;
  o.coupling = kSpring;
  o.controller.method = Method::force_projected;
  o.reference_energy = true;
  o.initial_energy = Energy{};
  Rendering<6> rendering{o, box_on_box()};
  Position<6> x{Vector3d{0, 0, 0.02}, Quaterniond::Identity()};
  Velocity<6> v;
  Force<6> applied;
  double most = 0.0, worst = 0.0;
  int seen = 0;
  {
    NoAlloc guard;
    for (int i = 0; i < 4000; ++i) {
      const double t = i * 5e-4;
      const Position<6> next{Vector3d{0.004 * std::sin(3 * t), 0.002 * t, 0.011 - 0.004 * std::sin(2 * t)},
                             rotation(Vector3d{0.1 * std::sin(4 * t), 0.1 * std::sin(5 * t), 0})};
      v = (next - x) / Seconds{5e-4};
      x = next;
      const auto out = rendering.step({x, v}, applied, Seconds{5e-4}, Seconds{5e-4});
      applied = out.command;
      const double size = out.wanted.vec().norm() * out.command.vec().norm();
      if (size > 1e-6) worst = std::max(worst, 1.0 - out.wanted.vec().dot(out.command.vec()) / size);
      most = std::max(most, out.wanted.vec().norm());
    }
    seen = guard.seen();
  }
  EXPECT_EQ(seen, 0);
  EXPECT_GT(most, 2.0);
  EXPECT_LT(worst, 1e-12);
  EXPECT_GT(rendering.observed().si(), -1e-3);
}

}  // namespace
}  // namespace twoport::god_object_test
