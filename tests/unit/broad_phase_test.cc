#include "common/contact/broad_phase.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "common/contact/environment.h"
#include "common/scene/load.h"
#include "sim/plant/body_plant.h"
#include "tests/support/meshes.h"
#include "tests/support/source.h"

namespace twoport::broad_phase_test {
namespace {

using Eigen::Vector3d;
using test::Source;

constexpr std::size_t kAll = std::numeric_limits<std::size_t>::max();

Vector3d direction(Source& random) {
  // At times along an axis, or nearly.
  const Vector3d d = random.vector<3>(1.0);
  const double kind = random.uniform(0, 1);
  if (kind < 0.2) return Vector3d::Unit(static_cast<int>(random.uniform(0, 3)));
  if (kind < 0.4) return (Vector3d::UnitZ() + 1e-8 * d).normalized();
  return d.normalized();
}
Eigen::Matrix3d rotation_of(Source& random) {
  return Eigen::AngleAxisd{random.uniform(-3, 3), direction(random)}.toRotationMatrix();
}

/// Kind 0 to 2 also exist in one dimension, kinds from 8 on have no end.
Shape part(Source& random, int kind, const Vector3d& at, double size) {
  static const auto kTorus = std::make_shared<const DistanceField>(test::torus_mesh(0.03, 0.01, 30, 12), 3e-3);
  const auto some = [&] { return size * random.uniform(0.2, 1.0); };
  switch (kind) {
    case 0:
    case 1:
      return Sphere{at, some()};
    case 2:
      return Box{at, {some(), some(), some()}};
    case 3:
      return Torus{at, direction(random), size, 0.5 * some()};
    case 4:
      return Capsule{at, at + some() * direction(random), some()};
    case 5:
      return Peg::of(at, direction(random), size, some(), 0.1 * size);
    case 6:
      return Cone::of(at, direction(random), some(), some());
    case 7: {
      const double half = some();
      return Plate{at,
                   rotation_of(random),
                   {half, some(), some()},
                   std::make_shared<const std::vector<PlateHole>>(1, PlateHole{{0.0, 0.0}, 0.1 * half})};
    }
    case 8:
      return Wall{direction(random), -0.3};
    case 9:
      return Cylinder{at, direction(random), some()};
    case 10:
      return Hole::of(at - Vector3d{0, 0, 0.5}, Vector3d::UnitZ(), 0.05, 0.1, 0.0);
    default:
      return Mesh{at, rotation_of(random), kTorus};
  }
}

/// Parts in a cube of 40 cm about `middle`, with a share of those that have no end, and springs.
template <int N>
std::vector<EnvironmentSpec> scatter(Source& random, int count, const Vector3d& middle = Vector3d::Zero()) {
  std::vector<EnvironmentSpec> specs;
  const double size = 0.2 / std::cbrt(count);
  for (int i = 0; i < count; ++i) {
    const bool endless = random.uniform(0, 1) < 3.0 / (3 + count);
    const int kind = N == 1 ? (endless ? 8 : static_cast<int>(random.uniform(0, 3)))
                            : static_cast<int>(endless ? random.uniform(8, 12) : random.uniform(0, 8));
    Shape shape = part(random, kind, middle + random.vector<3>(0.2), size);
    if (auto* wall = std::get_if<Wall>(&shape); wall && N == 1) wall->normal = Vector3d::UnitX();
    specs.push_back(Surface{shape, {random.uniform(100, 5000), random.uniform(0, 10), i % 3 ? 0.2 : 0.0, 0.0}});
  }
  if (count % 2) specs.push_back(Spring{100, 1, {0, 0, 0.1}, {}, N == 6 ? count % 3 - 1 : -1});
  return specs;
}

/// All numbers of all contacts, in order. `how`: as for_each_contact takes it between velocity and visit.
template <int N, class How>
std::vector<double> numbers(const Environment<N>& e, const Position<N>& x, const Velocity<N>& v, const How& how) {
  std::vector<double> all;
  e.for_each_contact(x, port_vector<N>(v.vec()), how, [&](const ContactPort<N>& c) {
    all.insert(all.end(), {static_cast<double>(c.index), static_cast<double>(c.feature), c.presses ? 1.0 : 0.0,
                           c.potential.si(), c.coulomb_damping});
    const auto normal = Force<N>{c.normal}.vec(), tangential = Force<N>{c.tangential}.vec();
    for (int i = 0; i < N; ++i) all.insert(all.end(), {normal[i], tangential[i]});
  });
  return all;
}

template <int N>
void expect_the_same(std::uint64_t seed) {
  Source random{seed};
  std::size_t touched = 0;
  for (const int count : {1, 2, 3, 5, 9, 17, 40, 120, 500, 3000}) {
    const std::vector<EnvironmentSpec> specs = scatter<N>(random, count);
    std::vector<Vector3d> tool;
    for (int i = 0; N == 6 && i < 5; ++i) tool.push_back(random.vector<3>(0.05));
    const Environment<N> environment{specs, tool};
    const BroadPhase<kAxes<N>> near{environment.world().surfaces}, none;
    for (int k = 0; k < 300; ++k) {
      const Vector3d where = random.vector<3>(k % 10 ? 0.2 : 2.0), turn = random.vector<3>(2.0);
      Position<N> x;
      Velocity<N> v;
      if constexpr (N == 6)
        x = Position<6>{where, rotation(turn)}, v = Velocity<6>{SpatialVector{random.vector<3>(0.2), turn}};
      else
        x = Position<N>{where.head<N>()}, v = Velocity<N>{random.vector<N>(0.2)};
      const std::vector<double> expected = numbers<N>(environment, x, v, [](int) { return kNearest; });
      touched += expected.size();
      ASSERT_EQ(numbers<N>(environment, x, v, near), expected) << count << " parts, pose " << k;
      ASSERT_EQ(numbers<N>(environment, x, v, none), expected) << count << " parts, pose " << k;
    }
  }
  EXPECT_GT(touched, 5000u);
}

TEST(BroadPhase, ContactsAreThoseOfAllPartsToTheBit) {
  expect_the_same<1>(1);
  expect_the_same<3>(2);
  expect_the_same<6>(3);
}

TEST(BroadPhase, BoundsHoldEveryPointThatIsInside) {
  Source random{4};
  std::vector<int> inside(8);
  for (int i = 0; i < 4000; ++i) {
    const Vector3d middle = i % 3 ? Vector3d{random.vector<3>(0.2)} : Vector3d{random.vector<3>(1e4)};
    const double size = i % 7 ? 0.1 : 100.0;
    const Shape shape = part(random, i % 8, middle, size);
    const Eigen::AlignedBox3d box = bounds(shape);
    EXPECT_LT(box.diagonal().norm(), 8.0 * size) << name(shape);
    for (int k = 0; k < 200; ++k) {
      Vector3d p = middle + random.vector<3>(1.6 * size);
      // To the boundary of its bounds, from either side.
      if (k % 2) p[k % 3] = (k % 4 == 1 ? box.min() : box.max())[k % 3] + (k % 5 - 2) * 1e-9 * size;
      if (!(signed_distance<3>(shape, p).distance < 0.0)) continue;
      ++inside[static_cast<std::size_t>(i % 8)];
      ASSERT_TRUE(box.contains(p)) << name(shape) << " " << p.transpose();
    }
  }
  for (const int count : inside) EXPECT_GT(count, 100);
}

TEST(BroadPhase, ListsFewOfManyPartsAndAllThatHaveNoEnd) {
  Source random{5};
  std::vector<Surface> surfaces{{Wall{Vector3d::UnitZ(), 0.0}, {}}};
  for (int i = 0; i < 3000; ++i) surfaces.push_back({Sphere{random.vector<3>(0.2), 0.005}, {}});
  surfaces.push_back({Cylinder{{5, 0, 0}, Vector3d::UnitZ(), 0.1}, {}});
  const BroadPhase<3> tree{surfaces};
  std::size_t listed = 0, most = 0;
  for (int k = 0; k < 10'000; ++k) {
    const auto near = tree.at(random.vector<3>(0.2));
    ASSERT_EQ(near.front(), 0);
    ASSERT_EQ(near.back(), 3001);
    ASSERT_TRUE(std::is_sorted(near.begin(), near.end()));
    listed += near.size(), most = std::max(most, near.size());
  }
  EXPECT_LT(listed, 10'000u * 10);
  EXPECT_LT(most, 30u);
  // A part that is as large as all others together, and parts in one place.
  surfaces.push_back({Sphere{Vector3d::Zero(), 1.0}, {}});
  EXPECT_EQ(BroadPhase<3>{surfaces}.at(Vector3d::Constant(0.5)).back(), 3002);
  const std::vector<Surface> one_place(100, surfaces[1]);
  EXPECT_EQ(BroadPhase<3>{one_place}.at(std::get<Sphere>(surfaces[1].shape).center_m).size(), 100u);
}

/// Among parts that it hits, slides along, sticks to and leaves.
template <int N>
void expect_the_same_motion(const std::string& integrator) {
  Source random{6};
  const std::string robot = N == 6 ? "inertia_kg_m2: [2e-4, 3e-4, 2e-4]" : "";
  const Scene scene =
      parse_scene(fmt::format("dof: {} duration_s: 1 control {{ architecture: UNCONTROLLED }} robot {{ mass_kg: 0.4 "
                              "damping_n_s_per_m: 1 {} }} simulation {{ integrator: {} }}",
                              N, robot, integrator),
                  "test");
  const std::vector<EnvironmentSpec> specs = scatter<N>(random, 61);
  std::vector<Vector3d> tool;
  for (int i = 0; N == 6 && i < 6; ++i) tool.push_back(random.vector<3>(0.03));
  constexpr double kPeriod = 1e-3;
  const sim::BodyState<N> start{{}, Velocity<N>{Velocity<N>::Vector::Constant(N == 6 ? 4.0 : 7.0)}};
  const auto plant = [&](std::size_t few) {
    return sim::make_body_plant<N>(*scene.robot, std::make_shared<const Environment<N>>(specs, tool), kPeriod, start,
                                   scene.simulation, few);
  };
  const auto all = plant(kAll), found = plant(0);
  double changes = 0.0, last = 0.0;
  for (int k = 0; k < 600; ++k) {
    typename Force<N>::Vector f = Force<N>::Vector::Zero();
    for (int i = 0; i < kAxes<N>; ++i) f[i] = 4.0 * std::sin(0.02 * (i + 1) * k);
    const sim::BodyState<N> a = all->advance(Force<N>{f}), b = found->advance(Force<N>{f});
    ASSERT_EQ(a.x.translation(), b.x.translation()) << integrator << ", tick " << k;
    ASSERT_EQ(a.v.vec(), b.v.vec()) << integrator << ", tick " << k;
    ASSERT_EQ(all->environment_force().vec(), found->environment_force().vec());
    const double force = all->environment_force().squared_norm();
    changes += (force > 0.0) != (last > 0.0);
    last = force;
  }
  EXPECT_GT(last + changes, 0.0) << integrator << ": nothing was touched";
}

TEST(BroadPhase, MotionIsThatAmongAllPartsToTheBit) {
  for (const char* integrator : {"EXACT", "RK4", "DORMAND_PRINCE"}) {
    expect_the_same_motion<1>(integrator);
    expect_the_same_motion<3>(integrator);
    expect_the_same_motion<6>(integrator);
  }
}

}  // namespace
}  // namespace twoport::broad_phase_test
