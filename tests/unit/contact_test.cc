#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

#include "common/contact/environment.h"
#include "tests/support/meshes.h"
#include "tests/support/source.h"

namespace twoport::contact_test {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using Vector6 = Eigen::Matrix<double, 6, 1>;

using Things = std::vector<EnvironmentSpec>;
using Points = std::vector<Vector3d>;

constexpr double kStiffness = 3000.0;
const Material kElastic{kStiffness, 0, 0, 0};

EnvironmentSpec elastic(const Shape& shape) {
  return Surface{shape, kElastic};
}
const EnvironmentSpec kSphere = elastic(Sphere{{0.1, 0.05, -0.02}, 0.06});
const EnvironmentSpec kCylinder = elastic(Cylinder{{0.1, 0, 0}, Vector3d{1, 2, 2} / 3, 0.05});
const EnvironmentSpec kBox = elastic(Box{{0.02, 0.01, 0}, {0.03, 0.05, 0.08}});
const EnvironmentSpec kWall = elastic(Wall{Vector3d{2, -1, 2} / 3, 0.01});
const EnvironmentSpec kSpring = Spring{kStiffness, 0, {0.01, 0.02, 0.03}};
const Things kAll = {kSphere, kCylinder, kBox, kWall, kSpring};
const Points kTool = {{0.02, 0.01, -0.03}, {-0.01, 0.02, 0.01}, {0, 0, 0}};

class Source : public test::Source {
 public:
  using test::Source::Source;
  Quaterniond attitude() { return Quaterniond{Eigen::Vector4d{vector<4>(1.0)}.normalized()}; }
  template <int N>
  Position<N> position(double size) {
    if constexpr (N == 6) {
      return {vector<3>(size), attitude()};
    } else {
      return Position<N>{vector<N>(size)};
    }
  }
};

// --- force and potential -------------------------------------------------------------------------

/// Wrench and gradient of the potential at many places, by central differences along every coordinate (N = 6: rotations
/// of the world's axes through the tool's origin). Places less than a step from an edge of the box or of contact are
/// left out. Returns how many had a force.
template <int N>
int expect_gradient(const Environment<N>& e, double size, std::uint64_t seed) {
  // The energy of up to 100 J is rounded to 1e-14, over 2 h; a curvature of up to K/r adds K h²/r².
  constexpr double h = 1e-6, tolerance = 1e-7;
  Source source{seed};
  int touched = 0;
  for (int i = 0; i < 2000 && !::testing::Test::HasFailure(); ++i) {
    const Position<N> x = source.position<N>(size);
    const auto moved = [&](int axis, double by) {
      typename Displacement<N>::Vector d = Displacement<N>::Vector::Zero();
      d[axis] = by;
      return x + Displacement<N>{d};
    };
    const auto f = e.force(x, Velocity<N>{}).vec();
    bool smooth = true;
    typename Force<N>::Vector gradient;
    for (int axis = 0; axis < N; ++axis) {
      const auto there = e.force(moved(axis, h), Velocity<N>{}).vec(),
                 back = e.force(moved(axis, -h), Velocity<N>{}).vec();
      smooth = smooth && (there - back).norm() < 0.1 * (1.0 + f.norm());
      gradient[axis] = (e.potential(moved(axis, h)) - e.potential(moved(axis, -h))).si() / (2 * h);
    }
    if (!smooth) continue;
    touched += f.norm() > 0.0;
    EXPECT_LT((f + gradient).norm(), tolerance * (1.0 + f.norm())) << "sample " << i << ", force " << f.transpose();
  }
  return touched;
}

TEST(Force, IsTheSlopeOfThePotentialOnALine) {
  EXPECT_GT(expect_gradient(Environment<1>{{elastic(Sphere{{0.1, 0, 0}, 0.06})}}, 0.2, 11), 300);
  EXPECT_GT(expect_gradient(Environment<1>{{elastic(Box{{0.02, 0, 0}, {0.03, 1, 1}})}}, 0.1, 12), 300);
  EXPECT_GT(expect_gradient(Environment<1>{{elastic(Wall{{-1, 0, 0}, 0.01})}}, 0.1, 13), 300);
  EXPECT_GT(expect_gradient(Environment<1>{{Spring{kStiffness, 0, {0.01, 0, 0}}}}, 0.1, 14), 300);
}
TEST(Force, IsTheSlopeOfThePotentialOfASphere) {
  EXPECT_GT(expect_gradient(Environment<3>{{kSphere}}, 0.15, 21), 30);
}
TEST(Force, IsTheSlopeOfThePotentialOfACylinder) {
  EXPECT_GT(expect_gradient(Environment<3>{{kCylinder}}, 0.15, 22), 30);
}
TEST(Force, IsTheSlopeOfThePotentialOfABox) {
  EXPECT_GT(expect_gradient(Environment<3>{{kBox}}, 0.1, 23), 100);
}
TEST(Force, IsTheSlopeOfThePotentialOfAWall) {
  EXPECT_GT(expect_gradient(Environment<3>{{kWall}}, 0.1, 24), 300);
}
TEST(Force, IsTheSlopeOfThePotentialOfASpring) {
  EXPECT_GT(expect_gradient(Environment<3>{{kSpring}}, 0.1, 25), 300);
}
TEST(Force, IsTheSlopeOfThePotentialOfAllTogether) {
  EXPECT_GT(expect_gradient(Environment<3>{kAll}, 0.1, 26), 300);
}

TEST(Wrench, IsTheSlopeOfThePotentialOfASphere) {
  EXPECT_GT(expect_gradient(Environment<6>{{kSphere}, kTool}, 0.15, 31), 30);
}
TEST(Wrench, IsTheSlopeOfThePotentialOfACylinder) {
  EXPECT_GT(expect_gradient(Environment<6>{{kCylinder}, kTool}, 0.15, 32), 30);
}
TEST(Wrench, IsTheSlopeOfThePotentialOfABox) {
  EXPECT_GT(expect_gradient(Environment<6>{{kBox}, kTool}, 0.1, 33), 100);
}
TEST(Wrench, IsTheSlopeOfThePotentialOfAWall) {
  EXPECT_GT(expect_gradient(Environment<6>{{kWall}, kTool}, 0.1, 34), 300);
}
TEST(Wrench, IsTheSlopeOfThePotentialOfASpring) {
  EXPECT_GT(expect_gradient(Environment<6>{{kSpring}, kTool}, 0.1, 35), 300);
}
TEST(Wrench, IsTheSlopeOfThePotentialOfAllTogether) {
  EXPECT_GT(expect_gradient(Environment<6>{kAll, kTool}, 0.1, 36), 300);
}

TEST(Depth, IsMeasuredAlongTheNormal) {
  const auto depth_and_force = [](const EnvironmentSpec& what, const Vector3d& p, const Vector3d& expected) {
    const Vector3d f = Environment<3>{{what}}.force(Position<3>{p}, {}).vec();
    EXPECT_LT((f - expected).norm(), 1e-10) << name(what);
  };
  depth_and_force(kWall, Vector3d{2, -1, 2} / 3 * 0.007, Vector3d{2, -1, 2} / 3 * (3000 * 0.003));
  depth_and_force(kSphere, {0.1, 0.05, 0.035}, {0, 0, 3000 * 0.005});
  depth_and_force(kCylinder, Vector3d{0.1, 0, 0} + Vector3d{1, 2, 2} * 7.0 + Vector3d{2, 1, -2} / 3 * 0.049,
                  Vector3d{2, 1, -2} / 3 * (3000 * 0.001));
  depth_and_force(kBox, {-0.009, 0.0, 0.0}, {-3000 * 0.001, 0, 0});
  depth_and_force(kBox, {0.02, 0.01, 0.0795}, {0, 0, 3000 * 0.0005});
}

TEST(Box, AnswersFromItsNearestFace) {
  const auto e = Environment<3>{{kBox}};
  Source source{41};
  for (int i = 0; i < 1000 && !::testing::Test::HasFailure(); ++i) {
    const Vector3d q = source.vector<3>(0.1), to_face = Vector3d{0.03, 0.05, 0.08} - q.cwiseAbs();
    const Vector3d f = e.force(Position<3>{Vector3d{0.02, 0.01, 0.0} + q}, {}).vec();
    int nearest = 0;
    const double depth = to_face.minCoeff(&nearest);
    Vector3d expected = Vector3d::Zero();
    if (depth > 0.0) expected[nearest] = std::copysign(3000 * depth, q[nearest]);
    EXPECT_LT((f - expected).norm(), 1e-10) << "sample " << i;
  }
}

TEST(Box, ContinuesAFacePastItsEdgesWhenAsked) {
  // What an integrator needs until it has found the edge.
  const Vector3d half_size{0.03, 0.05, 0.08};
  const Shape box = Box{Vector3d::Zero(), half_size};
  const Vector3d inside{0.029, 0.04, 0.0}, beyond{0.029, 0.0495, 0.0}, outside{0.031, 0.0495, 0.0};
  const SignedDistance<3> at = signed_distance<3>(box, inside);
  EXPECT_NEAR(at.distance, -0.001, 1e-15);
  EXPECT_EQ(at.normal, Vector3d::UnitX());
  EXPECT_EQ(signed_distance<3>(box, beyond).normal, Vector3d::UnitY());
  EXPECT_EQ(signed_distance<3>(box, beyond, at.feature).normal, Vector3d::UnitX());
  EXPECT_NEAR(signed_distance<3>(box, beyond, at.feature).distance, -0.001, 1e-15);
  EXPECT_NEAR(signed_distance<3>(box, outside, at.feature).distance, 0.001, 1e-15);
  std::set<int> faces;
  for (int axis = 0; axis < 3; ++axis)
    for (const double side : {-1.0, 1.0}) {
      Vector3d p = Vector3d::Zero();
      p[axis] = 0.99 * side * half_size[axis];
      const SignedDistance<3> near = signed_distance<3>(box, p), same = signed_distance<3>(box, p, near.feature);
      EXPECT_EQ(near.normal, side * Vector3d::Unit(axis));
      EXPECT_EQ(near.normal, same.normal);
      EXPECT_EQ(near.distance, same.distance);
      faces.insert(near.feature);
    }
  EXPECT_EQ(faces.size(), 6u);
}

// --- laws of contact -----------------------------------------------------------------------------

EnvironmentSpec with(const EnvironmentSpec& thing, const Material& material) {
  return Surface{std::get<Surface>(thing).shape, material};
}
EnvironmentSpec rough(const EnvironmentSpec& thing) {
  return with(thing, {kStiffness, 40, 0.4, 2});
}
EnvironmentSpec smooth_and_damped(const EnvironmentSpec& thing) {
  return with(thing, {kStiffness, 40, 0, 0});
}

// Each shape has an example here, found by its type.
EnvironmentSpec example(std::type_identity<Wall>) {
  return kWall;
}
EnvironmentSpec example(std::type_identity<Sphere>) {
  return kSphere;
}
EnvironmentSpec example(std::type_identity<Cylinder>) {
  return kCylinder;
}
EnvironmentSpec example(std::type_identity<Box>) {
  return kBox;
}
EnvironmentSpec example(std::type_identity<Torus>) {
  return elastic(Torus{{0.05, 0.02, 0}, Vector3d{1, 2, 2} / 3, 0.06, 0.03});
}
EnvironmentSpec example(std::type_identity<Capsule>) {
  return elastic(Capsule{{0.02, 0, 0}, {0.08, 0.04, 0.02}, 0.05});
}
EnvironmentSpec example(std::type_identity<Peg>) {
  return elastic(Peg::of({0.05, 0.02, 0}, Vector3d{1, 2, 2} / 3, 0.06, 0.09, 0.01));
}
EnvironmentSpec example(std::type_identity<Hole>) {
  return elastic(Hole::of({0.05, 0.02, 0}, Vector3d{1, 2, 2} / 3, 0.04, 0.05, 0.01));
}
EnvironmentSpec example(std::type_identity<Cone>) {
  return elastic(Cone::of({0.02, 0, 0}, Vector3d{1, 2, 2} / 3, 0.09, 0.1));
}
EnvironmentSpec example(std::type_identity<Plate>) {
  return elastic(Plate{{0.05, 0.02, 0},
                       Quaterniond{0.8, 0, 0.6, 0}.toRotationMatrix(),
                       {0.1, 0.07, 0.03},
                       std::make_shared<const std::vector<PlateHole>>(1, PlateHole{{0.02, 0.01}, 0.03})});
}
EnvironmentSpec example(std::type_identity<Mesh>) {
  static const auto field = std::make_shared<const DistanceField>(test::sphere_mesh(0.07, 3), 4e-3);
  return elastic(Mesh{{0.05, 0.02, 0}, Quaterniond{0.8, 0, 0.6, 0}.toRotationMatrix(), field});
}
Things examples() {
  Things all;
  for_each_shape([&](auto shape) { all.push_back(example(shape)); });
  return all;
}

class Surfaces : public ::testing::TestWithParam<EnvironmentSpec> {};
INSTANTIATE_TEST_SUITE_P(Every, Surfaces, ::testing::ValuesIn(examples()),
                         [](const auto& instance) { return std::string{name(instance.param)}; });

TEST_P(Surfaces, NeverPulls) {
  const auto damped = Environment<3>{{rough(GetParam())}}, plain = Environment<3>{{GetParam()}};
  Source source{51};
  int touched = 0, let_go = 0;
  for (int i = 0; i < 20'000 && !::testing::Test::HasFailure(); ++i) {
    const Position<3> x{source.vector<3>(0.15)};
    const Vector3d elastic = plain.force(x, {}).vec();  // along the outward normal
    bool visited = false;
    damped.for_each_contact(x, Velocity<3>{source.vector<3>(1.0)}, [&](const ContactPort<3>& c) {
      if (!c.presses) return;
      const Vector3d& n = c.normal;
      visited = true;
      EXPECT_GT(n.dot(elastic), 0.0) << "sample " << i;
      EXPECT_NEAR(n.dot(elastic), n.norm() * elastic.norm(), 1e-12 * n.norm() * elastic.norm()) << "sample " << i;
    });
    touched += visited;
    let_go += elastic.norm() > 0.0 && !visited;  // leaving faster than the spring follows
    EXPECT_FALSE(visited && elastic.norm() == 0.0) << "sample " << i;
  }
  EXPECT_GT(touched, 100);
  EXPECT_GT(let_go, 10);
}

TEST_P(Surfaces, DampTheNormalMotion) {
  if (std::holds_alternative<Mesh>(std::get<Surface>(GetParam()).shape))
    GTEST_SKIP() << "the length of an interpolated gradient differs from 1";
  const auto damped = Environment<3>{{smooth_and_damped(GetParam())}}, plain = Environment<3>{{GetParam()}};
  Source source{52};
  for (int i = 0; i < 5000 && !::testing::Test::HasFailure(); ++i) {
    const Position<3> x{source.vector<3>(0.15)};
    const Vector3d elastic = plain.force(x, {}).vec();
    if (elastic.norm() == 0.0) continue;
    const Vector3d n = elastic.normalized(), v = source.vector<3>(0.1);
    const Vector3d expected = std::max(0.0, elastic.norm() - 40 * n.dot(v)) * n;
    EXPECT_LT((damped.force(x, Velocity<3>{v}).vec() - expected).norm(), 1e-11 * (1.0 + elastic.norm()))
        << "sample " << i;
  }
}

TEST_P(Surfaces, DissipateBySliding) {
  if (std::holds_alternative<Mesh>(std::get<Surface>(GetParam()).shape))
    GTEST_SKIP() << "Mesh.HasFrictionThatDissipates has it: the length of an interpolated gradient differs from 1";
  const auto e = Environment<3>{{rough(GetParam())}};
  Source source{53};
  int slid = 0, crept = 0;
  for (int i = 0; i < 20'000 && !::testing::Test::HasFailure(); ++i) {
    const Position<3> x{source.vector<3>(0.15)};
    const Vector3d v = source.vector<3>(1.0) * std::pow(10.0, source.uniform(-5.0, 0.0));
    e.for_each_contact(x, Velocity<3>{v}, [&](const ContactPort<3>& c) {
      if (!c.presses) return;
      const Vector3d &n = c.normal, &t = c.tangential;
      const Vector3d normal = n.normalized(), sliding = v - normal.dot(v) * normal;
      const double speed = sliding.norm();
      if (speed < 1e-9) return;
      EXPECT_NEAR(t.dot(normal), 0.0, 1e-12 * (1.0 + t.norm())) << "sample " << i;
      EXPECT_LT(t.dot(v), 0.0) << "sample " << i;
      // Coulomb's share of the friction, whole above the stiction speed and in proportion below.
      const double share = std::min(1.0, speed / kStictionSpeed);
      EXPECT_LT((t + (0.4 * n.norm() * share / speed + 2.0) * sliding).norm(), 1e-12 * (1.0 + t.norm()))
          << "sample " << i;
      (share < 1.0 ? crept : slid) += 1;
    });
  }
  EXPECT_GT(slid, 100);
  EXPECT_GT(crept, 100);
}

// --- closed loops --------------------------------------------------------------------------------

/// Work of the environment along a closed loop that stays in contact, by the trapezoid rule: for a smooth periodic
/// integrand its error falls faster than any power, and is rounding with 2000 points. `stored` is the most that is
/// held.
template <int N, class Pose, class Twist>
double loop_work(const Environment<N>& e, Pose pose, Twist twist, double& stored, int& untouched) {
  constexpr int kPoints = 2000;
  double work = 0.0;
  stored = 0.0;
  for (int k = 0; k < kPoints; ++k) {
    const double s = 2 * std::numbers::pi * k / kPoints;
    const Force<N> f = e.force(pose(s), Velocity<N>{});
    work += dot(f, twist(s)).si() * 2 * std::numbers::pi / kPoints;
    stored = std::max(stored, e.potential(pose(s)).si());
    untouched += f.vec().norm() == 0.0;
  }
  return work;
}

void expect_no_work(const EnvironmentSpec& thing, const Vector3d& centre, double size) {
  const auto e = Environment<3>{{thing}};
  Source source{61};
  for (int i = 0; i < 50; ++i) {
    const Vector3d a = source.vector<3>(size), b = source.vector<3>(size), c = source.vector<3>(size);
    const auto pose = [&](double s) {
      return Position<3>{Vector3d{centre + a * std::cos(s) + b * std::sin(s) + c * std::sin(2 * s)}};
    };
    const auto twist = [&](double s) {
      return Velocity<3>{Vector3d{-a * std::sin(s) + b * std::cos(s) + 2 * c * std::cos(2 * s)}};
    };
    double stored = 0.0;
    int untouched = 0;
    const double work = loop_work(e, pose, twist, stored, untouched);
    EXPECT_NEAR(work, 0.0, 1e-12) << "loop " << i << ", of up to " << stored << " J";
    EXPECT_EQ(untouched, 0);
  }
}
TEST(LoopInContact, DoesNoWorkOnASphere) {
  expect_no_work(kSphere, {0.13, 0.05, -0.02}, 0.004);
}
TEST(LoopInContact, DoesNoWorkOnACylinder) {
  expect_no_work(kCylinder, Vector3d{0.1, 0, 0} + Vector3d{2, 1, -2} / 3 * 0.03, 0.004);
}
TEST(LoopInContact, DoesNoWorkOnABox) {
  expect_no_work(kBox, {0.04, 0.01, 0.0}, 0.002);
}
TEST(LoopInContact, DoesNoWorkOnAWall) {
  expect_no_work(kWall, {-0.02, 0.02, -0.02}, 0.005);
}

TEST(LoopInContact, OfAToolThatTurnsDoesNoWork) {
  // Three points of the tool in a wall and on a spring, through a loop of poses: R(s) = exp(α n) exp(β m).
  const auto e = Environment<6>{{kWall, kSpring}, kTool};
  Source source{62};
  for (int i = 0; i < 50; ++i) {
    const Vector3d centre = Vector3d{-0.06, 0.03, -0.06} + source.vector<3>(0.005), a = source.vector<3>(0.005),
                   b = source.vector<3>(0.005), n = source.vector<3>(1.0).normalized(),
                   m = source.vector<3>(1.0).normalized();
    const auto alpha = [&](double s) { return 0.3 * std::sin(s); };
    const auto beta = [&](double s) { return 0.4 * std::cos(s) + 0.1 * std::sin(2 * s); };
    const auto pose = [&](double s) {
      return Position<6>{centre + a * std::cos(s) + b * std::sin(s), rotation(alpha(s) * n) * rotation(beta(s) * m)};
    };
    const auto twist = [&](double s) {
      const double alpha_rate = 0.3 * std::cos(s), beta_rate = -0.4 * std::sin(s) + 0.2 * std::cos(2 * s);
      Vector6 v;
      v << -a * std::sin(s) + b * std::cos(s), alpha_rate * n + rotation(alpha(s) * n) * (beta_rate * m);
      return Velocity<6>{v};
    };
    double stored = 0.0;
    int untouched = 0;
    const double work = loop_work(e, pose, twist, stored, untouched);
    EXPECT_NEAR(work, 0.0, 1e-12) << "loop " << i << ", of up to " << stored << " J";
    EXPECT_GT(stored, 1.0);
    EXPECT_EQ(untouched, 0);
  }
}

/// Work along the straight line from p to q. It is cut where contact begins, ends or changes to another face, so that
/// Gauss' rule of five points on short pieces has smooth integrands.
double work_along(const Environment<3>& e, const Vector3d& p, const Vector3d& q) {
  constexpr double kAt[] = {-0.9061798459386640, -0.5384693101056831, 0.0, 0.5384693101056831, 0.9061798459386640};
  constexpr double kWeight[] = {0.2369268850561891, 0.4786286704993665, 0.5688888888888889, 0.4786286704993665,
                                0.2369268850561891};
  constexpr int kPieces = 1000;
  const Vector3d d = q - p;
  const auto force = [&](double s) { return Vector3d{e.force(Position<3>{Vector3d{p + s * d}}, {}).vec()}; };
  // Two forces of one face do not differ much in direction within a piece.
  const auto same_face = [](const Vector3d& f, const Vector3d& g) {
    return f.norm() == 0.0 ? g.norm() == 0.0 : f.dot(g) > 0.9 * f.norm() * g.norm() && g.norm() > 0.0;
  };
  const auto gauss = [&](double from, double to) {
    double sum = 0.0;
    for (int i = 0; i < 5; ++i)
      sum += 0.5 * (to - from) * kWeight[i] * force(0.5 * (from + to) + 0.5 * (to - from) * kAt[i]).dot(d);
    return sum;
  };
  double sum = 0.0;
  for (int k = 0; k < kPieces; ++k) {
    const double from = static_cast<double>(k) / kPieces, to = (k + 1.0) / kPieces;
    double lo = from, hi = to;
    const Vector3d first = force(from);
    if (!same_face(first, force(to)))
      for (int i = 0; i < 60; ++i) (same_face(first, force(0.5 * (lo + hi))) ? lo : hi) = 0.5 * (lo + hi);
    sum += lo == from ? gauss(from, to) : gauss(from, lo) + gauss(hi, to);
  }
  return sum;
}

TEST_P(Surfaces, GiveBackAlongAPolygonThroughThemWhatTheyTook) {
  const auto e = Environment<3>{{GetParam()}};
  // Where round and flat parts join, and at the planes of a mesh's grid, the force's slope jumps, which Gauss' rule misses.
  const Shape& shape = std::get<Surface>(GetParam()).shape;
  const bool smooth = std::holds_alternative<Wall>(shape) || std::holds_alternative<Sphere>(shape) ||
                      std::holds_alternative<Cylinder>(shape) || std::holds_alternative<Box>(shape);
  const double tolerance = smooth ? 1e-12 : 5e-6;
  Source source{63};
  double most = 0.0;
  for (int loop = 0; loop < 10; ++loop) {
    std::vector<Vector3d> corner;
    for (int i = 0; i < 4; ++i) corner.push_back(Vector3d{0.05, 0.02, 0.0} + source.vector<3>(0.12));
    double sum = 0.0;
    for (std::size_t i = 0; i < corner.size(); ++i) {
      const double edge = work_along(e, corner[i], corner[(i + 1) % corner.size()]);
      most = std::max(most, std::abs(edge));
      sum += edge;
    }
    EXPECT_NEAR(sum, 0.0, tolerance) << "loop " << loop;
  }
  EXPECT_GT(most, 0.05);
}

// --- wrenches ------------------------------------------------------------------------------------

TEST(Wrench, HasItsTorqueAboutTheToolsOrigin) {
  const auto e = Environment<6>{{Surface{Wall{{0, 0, 1}, 0}, {1000, 0, 0, 0}}}, {{0.03, 0, 0}}};
  // The tool is turned a quarter about z: its point is at y = 30 mm, 2 mm deep.
  const Position<6> x{Vector3d{0.5, 0.2, -0.002},
                      Quaterniond{Eigen::AngleAxisd{std::numbers::pi / 2, Vector3d::UnitZ()}}};
  Vector6 expected;
  expected << 0, 0, 2, 0.03 * 2, 0, 0;
  EXPECT_LT((e.force(x, {}).vec() - expected).norm(), 1e-12);
}

TEST(Wrench, IsTheSameWhereverTheWorldsOriginIs) {
  Source source{71};
  const Vector3d shift{3.0, -2.0, 1.0};
  const auto near = Environment<6>{{Surface{Sphere{{0, 0, 0}, 0.1}, {1000, 0, 0.2, 0}}}, kTool};
  const auto far = Environment<6>{{Surface{Sphere{{3, -2, 1}, 0.1}, {1000, 0, 0.2, 0}}}, kTool};
  for (int i = 0; i < 100 && !::testing::Test::HasFailure(); ++i) {
    const Vector3d p = source.vector<3>(0.06);
    const Quaterniond q = source.attitude();
    const Velocity<6> v{source.vector<6>(0.3)};
    const Vector6 here = near.force(Position<6>{p, q}, v).vec(), there = far.force(Position<6>{p + shift, q}, v).vec();
    EXPECT_LT((here - there).norm(), 1e-10 * (1.0 + here.norm())) << "sample " << i;  // 3 m are rounded to 4e-16
  }
}

TEST(Wrench, KnowsThatAPointOfATurningToolMoves) {
  const auto e = Environment<6>{{Surface{Wall{{0, 0, 1}, 0}, {1000, 50, 0.5, 0}}}, {{0.03, 0, 0}}};
  const Position<6> x{Vector3d{0, 0, -0.002}, Quaterniond::Identity()};
  Vector6 spin;
  spin << 0, 0, 0, 0, 0.5, 0;  // the point at +x goes down at 15 mm/s
  Vector6 expected;
  expected << 0, 0, 2.0 + 50 * 0.015, 0, -0.03 * 2.75, 0;
  EXPECT_LT((e.force(x, Velocity<6>{spin}).vec() - expected).norm(), 1e-12);
  spin << 0, 0, 0, 0, 0, 2.0;  // goes along +y at 60 mm/s
  expected << 0, -1.0, 2.0, 0, -0.06, -0.03;
  EXPECT_LT((e.force(x, Velocity<6>{spin}).vec() - expected).norm(), 1e-12);
}

TEST(Wrench, DissipatesAtEveryPoint) {
  const auto e = Environment<6>{{rough(kSphere), rough(kBox), rough(kWall)}, kTool};
  Source source{72};
  for (int i = 0; i < 5000 && !::testing::Test::HasFailure(); ++i) {
    const Velocity<6> v{source.vector<6>(1.0)};
    e.for_each_contact(source.position<6>(0.1), v, [&](const ContactPort<6>& c) {
      EXPECT_LE(dot(Force<6>{c.tangential}, v).si(), 0.0) << "sample " << i;
    });
  }
}

// --- contacts one by one -------------------------------------------------------------------------

TEST(Contacts, AddUpToTheWhole) {
  const auto e = Environment<6>{{rough(kSphere), rough(kBox), rough(kWall), kSpring}, kTool};
  EXPECT_EQ(e.contacts(), 12);  // three points, four things
  Source source{81};
  std::set<int> seen;
  for (int i = 0; i < 2000 && !::testing::Test::HasFailure(); ++i) {
    const Position<6> x = source.position<6>(0.1);
    const Velocity<6> v{source.vector<6>(0.2)};
    Vector6 sum = Vector6::Zero();
    double held = 0.0;
    int before = -1;
    e.for_each_contact(x, v, [&](const ContactPort<6>& c) {
      EXPECT_GT(c.index, before);
      EXPECT_LT(c.index, e.contacts());
      const Vector6 force = Force<6>{c.normal + c.tangential}.vec();
      EXPECT_TRUE(c.presses || force.isZero(0.0));
      before = c.index;
      if (c.presses) seen.insert(c.index);
      sum += force;
      held += c.potential.si();
    });
    EXPECT_LT((sum - e.force(x, v).vec()).norm(), 1e-12 * (1.0 + sum.norm()));
    double energy = 0.0;
    int next = 0;
    e.for_each_potential(x, [&](int index, Energy u) {
      EXPECT_EQ(index, next++);
      EXPECT_GE(u.si(), 0.0);
      energy += u.si();
    });
    EXPECT_EQ(next, e.contacts());
    EXPECT_NEAR(energy, e.potential(x).si(), 1e-13 * (1.0 + energy));
    EXPECT_EQ(held, energy) << "what a contact holds, whether it presses or not";
  }
  EXPECT_EQ(seen.size(), 12u);
}

TEST(Contacts, AreNoneInFreeSpace) {
  const auto e = Environment<3>{{}};
  EXPECT_TRUE(e.empty());
  EXPECT_EQ(e.contacts(), 0);
  EXPECT_EQ(e.force(Position<3>{Vector3d{1, 2, 3}}, {}).vec().norm(), 0.0);
  EXPECT_EQ(e.potential(Position<3>{Vector3d{1, 2, 3}}).si(), 0.0);
}

TEST(Spring, HoldsFromBothSidesAndDamps) {
  const auto e = Environment<1>{{Spring{100, 3, {0.01, 0, 0}}}};
  const auto at = [](double x) { return Position<1>{Eigen::Matrix<double, 1, 1>{x}}; };
  const auto moving = [](double v) { return Velocity<1>{Eigen::Matrix<double, 1, 1>{v}}; };
  EXPECT_NEAR(e.force(at(0.03), moving(0.0))[0], -2.0, 1e-14);
  EXPECT_NEAR(e.force(at(-0.01), moving(0.5))[0], 2.0 - 1.5, 1e-14);
}

}  // namespace
}  // namespace twoport::contact_test
