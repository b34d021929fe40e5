// Cost of a query of each shape, of a mesh beside CGAL and Embree, of a tick among many parts, and of one of the god-object; one thread,
// nanoseconds.
//
//   bench_shapes

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>
#include <vector>

#include "common/contact/environment.h"
#include "common/contact/sample_shape.h"
#include "common/mesh/bounding_volume_tree.h"
#include "common/method/render/god_object.h"
#include "common/scene/load.h"
#include "sim/plant/body_plant.h"
#include "tests/support/mesh_peers.h"
#include "tests/support/meshes.h"

namespace {

using namespace twoport;
using Eigen::Vector3d;

volatile double sink;

/// Nanoseconds of one of `count` calls, the least of five rounds.
template <class Call>
double ns(int count, Call call) {
  double least = 1e18;
  for (int round = 0; round < 5; ++round) {
    const auto start = std::chrono::steady_clock::now();
    double sum = 0.0;
    for (int i = 0; i < count; ++i) sum += call(i);
    const std::chrono::duration<double, std::nano> took = std::chrono::steady_clock::now() - start;
    sink = sum;
    least = std::min(least, took.count() / count);
  }
  return least;
}
void line(const std::string& what, double value) {
  fmt::print("{:58} {:10.0f}\n", what, value);
}

/// Within 3 mm of the torus; `steps` of them go around it.
std::vector<Vector3d> path(int steps) {
  std::vector<Vector3d> points;
  for (int i = 0; i < steps; ++i) {
    const double a = 2 * std::numbers::pi * i / steps, b = 7 * a, t = 0.02 + 3e-3 * std::sin(31 * a);
    const double r = 0.05 + t * std::cos(b);
    points.push_back({r * std::cos(a), r * std::sin(a), t * std::sin(b)});
  }
  return points;
}

void parts() {
  const auto holes = std::make_shared<const std::vector<PlateHole>>(
      std::vector<PlateHole>{{{-0.02, 0.0}, 0.012}, {{0.02, 0.005}, 0.006}});
  const std::vector<Vector3d> points = path(4096);
  for (const Shape& shape : std::vector<Shape>{
           Wall{Vector3d::UnitZ(), 0}, Sphere{Vector3d::Zero(), 0.05}, Box{Vector3d::Zero(), {0.05, 0.05, 0.02}},
           Torus{Vector3d::Zero(), Vector3d::UnitZ(), 0.05, 0.02}, Capsule{{-0.05, 0, 0}, {0.05, 0, 0}, 0.02},
           Peg::of(Vector3d::Zero(), Vector3d::UnitZ(), 0.05, 0.02, 0.002),
           Hole::of(Vector3d::Zero(), Vector3d::UnitZ(), 0.05, 0.02, 0.002),
           Cone::of(Vector3d::Zero(), Vector3d::UnitZ(), 0.05, 0.05),
           Plate{Vector3d::Zero(), Eigen::Matrix3d::Identity(), {0.06, 0.06, 0.02}, holes}})
    line(fmt::format("distance and normal, {}", name(shape)), ns(200'000, [&](int i) {
           const auto at = signed_distance<3>(shape, points[static_cast<std::size_t>(i) % points.size()]);
           return at.distance + at.normal.x();
         }));
}

void meshes() {
  for (const auto& [around, across] : {std::pair{105u, 48u}, {330u, 152u}}) {
    const TriangleMesh mesh = test::torus_mesh(0.05, 0.02, around, across);
    const std::string of = fmt::format(", {} triangles", mesh.triangles.size());
    const BoundingVolumeTree tree{mesh};
    const std::vector<Vector3d> slow = path(100'000), far = [&] {
      std::vector<Vector3d> points = path(4096), apart;
      for (std::size_t i = 0; i < points.size(); ++i) apart.push_back(points[i * 1031 % points.size()]);
      return apart;
    }();
    const auto at = [](const std::vector<Vector3d>& points, int i) -> const Vector3d& {
      return points[static_cast<std::size_t>(i) % points.size()];
    };
    line("nearest point, own tree, places far apart" + of,
         ns(20'000, [&](int i) { return tree.nearest(at(far, i)).squared_distance; }));
    std::uint32_t near = 0;
    line("nearest point, own tree, along a path, warm" + of, ns(100'000, [&](int i) {
           const auto found = tree.nearest(at(slow, i), near);
           near = found.triangle;
           return found.squared_distance;
         }));
#ifdef TWOPORT_EMBREE
    const test::EmbreeTree embree{mesh};
    line("nearest point, Embree, places far apart" + of,
         ns(20'000, [&](int i) { return embree.distance(at(far, i)); }));
#endif
#ifdef TWOPORT_CGAL
    const test::CgalTree cgal{mesh};
    line("nearest point, CGAL, places far apart" + of, ns(5'000, [&](int i) { return cgal.distance(at(far, i)); }));
#endif
    const auto start = std::chrono::steady_clock::now();
    const DistanceField field{mesh, 1e-3};
    const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - start;
    fmt::print("{:58} {:10.0f} ms, {:.1f} MB\n", "field of 1 mm, build" + of, took.count(),
               1e-6 * static_cast<double>(field.bytes()));
    line("distance and gradient, field of 1 mm" + of, ns(200'000, [&](int i) {
           const auto found = field.at(at(slow, i));
           return found.distance + found.gradient.x();
         }));
  }
}

void tools() {
  const auto field = std::make_shared<const DistanceField>(test::torus_mesh(0.05, 0.02, 330, 152), 1e-3);
  std::vector<Vector3d> tool = sample(Torus{Vector3d::Zero(), Vector3d::UnitZ(), 0.04, 0.015}, 8.6e-3);
  tool.resize(300);
  const Environment<6> environment{
      {Surface{Mesh{Vector3d::Zero(), Eigen::Matrix3d::Identity(), field}, {1000, 0, 0, 0}}}, tool};
  line("force, 300 points in the field of a mesh", ns(2'000, [&](int i) {
         const Position<6> x{Vector3d{0.02, 0, 0.01 + 1e-6 * i}, Eigen::Quaterniond::Identity()};
         return environment.force(x, Velocity<6>{})[2];
       }));
}

const CouplingOptions kSpring{.stiffness_n_per_m = 2000,
                              .damping_n_s_per_m = 0,
                              .rotational_stiffness_n_m_per_rad = 4,
                              .rotational_damping_n_m_s_per_rad = 0};
const std::vector<Vector3d> kPeg = sample(Peg::of(Vector3d::Zero(), Vector3d::UnitZ(), 0.01, 0.03, 0.001), 8e-3);
const auto kHole = std::make_shared<const std::vector<PlateHole>>(1, PlateHole{{0, 0}, 0.0101});
const std::vector<Vector3d> kCorners = [] {
  std::vector<Vector3d> corners;
  for (int i = 0; i < 8; ++i) corners.push_back({i & 1 ? 0.03 : -0.03, i & 2 ? 0.02 : -0.02, i & 4 ? 0.01 : -0.01});
  return corners;
}();

/// 1 kg pushed through spheres of 8 mm in a cube of 20 cm; `few`: up to so many are all asked.
template <int N>
double tick_among(int count, const std::vector<Vector3d>& tool, const char* integrator, std::size_t few, int ticks) {
  std::mt19937_64 random{7};
  std::uniform_real_distribution<double> any{-0.1, 0.1};
  std::vector<EnvironmentSpec> spheres;
  for (int i = 0; i < count; ++i) {
    const Vector3d center{any(random), any(random), any(random)};
    spheres.emplace_back(Surface{Sphere{center, 0.004}, {1000, 0, 0.3, 0}});
  }
  const Scene scene = parse_scene(
      fmt::format("dof: {} duration_s: 1 control {{ architecture: UNCONTROLLED }} robot {{ mass_kg: 1 {} }} simulation "
                  "{{ integrator: {} }}",
                  N, N == 6 ? "inertia_kg_m2: [2e-3, 2e-3, 2e-3]" : "", integrator),
      "bench");
  const auto environment = std::make_shared<const Environment<N>>(spheres, tool);
  const auto plant = sim::make_body_plant<N>(*scene.robot, environment, 5e-4, {}, scene.simulation, few);
  return ns(ticks, [&](int k) {
    typename Force<N>::Vector f = Force<N>::Vector::Zero();
    f[0] = 20 * std::sin(0.02 * k), f[1] = 10, f[2] = -10;
    return plant->advance(Force<N>{f}).x.translation()[0];
  });
}
void many_parts() {
  for (const int count : {8, 16, 3000})
    for (const char* integrator : {"EXACT", "DORMAND_PRINCE"}) {
      const auto both = [&](const std::string& what, auto tick_of) {
        const double found = tick_of(0, 200), all = tick_of(10'000, count > 16 ? 1 : 200);
        line(fmt::format("{} among {} spheres, {}", what, count, integrator), found);
        line(fmt::format("the same, all asked: {:.2f} times as long", all / found), all);
      };
      both("point", [&](std::size_t few, int ticks) { return tick_among<3>(count, {}, integrator, few, ticks); });
      both(fmt::format("peg of {} points", kPeg.size()),
           [&](std::size_t few, int ticks) { return tick_among<6>(count, kPeg, integrator, few, ticks); });
    }
}

template <int N>
void god_object(const std::string& what, const Environment<N>& environment, const Position<N>& start,
                const Position<N>& end, double aside) {
  using Vector = typename Displacement<N>::Vector;
  GodObject<N> proxy{kSpring, environment};
  for (int i = 0; i <= 400; ++i) proxy.follow(start + Displacement<N>{Vector{i / 400.0 * (end - start).vec()}});
  line("god-object at rest, " + what, ns(50'000, [&](int) {
         proxy.follow(end);
         return proxy.potential(end).si();
       }));
  Vector way = Vector::Zero();
  way[0] = 1, way[1] = 0.5;
  if constexpr (N == 6) way[3] = 1, way[4] = 3;
  line("god-object sliding, " + what, ns(50'000, [&](int i) {
         const Position<N> x = end + Displacement<N>{Vector{aside * std::sin(1e-3 * i) * way}};
         proxy.follow(x);
         return proxy.potential(x).si();
       }));
}

void god_objects() {
  const Material any{1, 0, 0, 0};
  const auto at = [](double z) { return Position<3>{Vector3d{0.001, 0.002, z}}; };
  const auto pose = [](double z) { return Position<6>{Vector3d{0.001, 0.002, z}, Eigen::Quaterniond::Identity()}; };
  const Surface box{Box{{0, 0, -0.05}, {0.05, 0.05, 0.05}}, any};
  god_object<3>("point on a plane", Environment<3>{{Surface{Wall{Vector3d::UnitZ(), 0}, any}}}, at(0.01), at(-0.003),
                0.01);
  god_object<3>("point on a box", Environment<3>{{box}}, at(0.01), at(-0.003), 0.01);
  const auto sphere = std::make_shared<const DistanceField>(test::sphere_mesh(0.03, 5), 1e-3);
  god_object<3>("point on a sphere of 8192 triangles",
                Environment<3>{{Surface{Mesh{Vector3d::Zero(), Eigen::Matrix3d::Identity(), sphere}, any}}}, at(0.04),
                at(0.027), 0.005);
  god_object<6>("box of 8 corners on a box", Environment<6>{{box}, kCorners}, pose(0.02), pose(0.007), 0.01);
  const Plate plate{{0.001, 0.002, 0}, Eigen::Matrix3d::Identity(), {0.05, 0.05, 0.015}, kHole};
  god_object<6>(fmt::format("peg of {} points in a plate's hole", kPeg.size()),
                Environment<6>{{Surface{plate, any}}, kPeg}, pose(0.02), pose(-0.005), 0.002);
}

/// The slowest of ticks in which a handle is put anywhere 5 to 15 cm inside a rough shape, of each tick the least of several rounds: what
/// the limit of Newton's steps leaves. Its number of steps, and how often the friction was not solved for.
void worst_tick(const std::string& what, const std::vector<Shape>& shapes, const std::vector<Vector3d>& tool) {
  constexpr int kTicks = 3000, kRounds = 5;
  double most = 0.0;
  std::uint64_t unfinished = 0;
  int steps = 0;
  for (const double friction : {0.3, 1.0}) {
    std::vector<EnvironmentSpec> surfaces;
    for (const Shape& shape : shapes) surfaces.emplace_back(Surface{shape, {1, 0, friction, 0}});
    const Environment<6> environment{surfaces, tool};
    std::vector<double> least(kTicks, 1e18);
    for (int round = 0; round < kRounds; ++round) {
      std::mt19937_64 random{5};
      std::uniform_real_distribution<double> any{-1.0, 1.0};
      GodObject<6> proxy{kSpring, environment};
      proxy.follow({Vector3d{0, 0, 0.2}, Eigen::Quaterniond::Identity()});
      for (double& each : least) {
        const Vector3d where{0.1 * any(random), 0.1 * any(random), -0.1 + 0.05 * any(random)};
        const Vector3d turn{any(random), any(random), any(random)};
        const Position<6> handle{where, rotation(turn)};
        const auto start = std::chrono::steady_clock::now();
        proxy.follow(handle);
        const std::chrono::duration<double, std::nano> took = std::chrono::steady_clock::now() - start;
        each = std::min(each, took.count());
        steps = std::max(steps, proxy.newton_steps());
      }
      if (round == 0) unfinished += proxy.unfinished();
    }
    most = std::max(most, *std::max_element(least.begin(), least.end()));
  }
  fmt::print("{:58} {:10.0f}, {} steps, {} of {} ticks unfinished\n", "god-object, slowest tick, " + what, most, steps,
             unfinished, 2 * kTicks);
}

void worst_ticks() {
  const auto torus = std::make_shared<const DistanceField>(test::torus_mesh(0.05, 0.02, 105, 48), 2e-3);
  const std::vector<std::pair<const char*, std::vector<Shape>>> all{
      {"plane", {Wall{Vector3d::UnitZ(), 0}}},
      {"wedge", {Wall{Vector3d{1, 0, 1}.normalized(), 0}, Wall{Vector3d{-1, 0, 1}.normalized(), 0}}},
      {"box", {Box{{0, 0, -0.1}, {0.1, 0.1, 0.1}}}},
      {"sphere", {Sphere{{0, 0, -0.15}, 0.15}}},
      {"torus", {Torus{{0, 0, -0.1}, Vector3d::UnitZ(), 0.08, 0.06}}},
      {"hole", {Hole::of({0, 0, -0.1}, Vector3d::UnitZ(), 0.05, 0.02, 0.002)}},
      {"cone", {Cone::of({0, 0, 0}, Vector3d::UnitZ(), 0.15, 0.1)}},
      {"plate", {Plate{{0, 0, -0.1}, Eigen::Matrix3d::Identity(), {0.1, 0.1, 0.05}, kHole}}},
      {"mesh", {Mesh{{0, 0, -0.1}, Eigen::Matrix3d::Identity(), torus}}}};
  for (const auto& [name, shapes] : all) {
    worst_tick(fmt::format("box of 8 corners in a {}", name), shapes, kCorners);
    worst_tick(fmt::format("peg of {} points in a {}", kPeg.size(), name), shapes, kPeg);
  }
}

}  // namespace

int main() {
  parts();
  meshes();
  tools();
  many_parts();
  god_objects();
  worst_ticks();
}
