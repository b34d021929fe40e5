#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/contact/environment.h"
#include "common/mesh/bounding_volume_tree.h"
#include "common/mesh/distance_field.h"
#include "common/mesh/joined.h"
#include "common/mesh/solids.h"
#include "common/mesh/triangle_mesh.h"
#include "tests/support/meshes.h"
#include "tests/support/no_alloc.h"
#include "tests/support/source.h"

namespace twoport::mesh_test {
namespace {

using Eigen::Vector3d;
using test::ascii_stl;
using test::binary_stl;
using test::box_mesh;
using test::obj;
using test::sphere_mesh;
using test::torus_mesh;

constexpr double kRadius = 0.05, kTube = 0.02;
const Torus kTorus{Vector3d::Zero(), Vector3d::UnitZ(), kRadius, kTube};

/// 100,320 triangles and nodes 1 mm apart: the figures of docs/reference/shapes.md.
const TriangleMesh& fine_torus() {
  static const TriangleMesh mesh = torus_mesh(kRadius, kTube, 330, 152);
  return mesh;
}
const std::shared_ptr<const DistanceField>& fine_field() {
  static const auto field = std::make_shared<const DistanceField>(fine_torus(), 1e-3);
  return field;
}
Surface fine_surface(double stiffness, double friction = 0.0) {
  return {Mesh{Vector3d::Zero(), Eigen::Matrix3d::Identity(), fine_field()}, {stiffness, 0, friction, 0}};
}

class Source : public test::Source {
 public:
  Source() : test::Source{17} {}
  /// At a signed distance of at most `off` from the torus.
  Vector3d near_torus(double off) {
    const double a = uniform(0, 2 * std::numbers::pi), b = uniform(0, 2 * std::numbers::pi);
    const double t = kTube + uniform(-off, off), r = kRadius + t * std::cos(b);
    return {r * std::cos(a), r * std::sin(a), t * std::sin(b)};
  }
};

// --- files ---------------------------------------------------------------------------------------

void expect_same_solid(const TriangleMesh& a, const TriangleMesh& b, double tolerance) {
  EXPECT_EQ(a.triangles.size(), b.triangles.size());
  EXPECT_EQ(a.vertices.size(), b.vertices.size());
  EXPECT_TRUE(faults_of(a).none());
  EXPECT_NEAR(faults_of(a).volume_m3, faults_of(b).volume_m3, tolerance * faults_of(b).volume_m3);
}

TEST(ReadMesh, ReadsWhatTheThreeFormatsHold) {
  const TriangleMesh torus = torus_mesh(kRadius, kTube, 24, 12);
  expect_same_solid(parse_mesh(binary_stl(torus), "part"), torus, 1e-6);  // coordinates of STL are floats
  expect_same_solid(parse_mesh(ascii_stl(torus), "part"), torus, 1e-14);
  expect_same_solid(parse_mesh(obj(torus), "part"), torus, 1e-14);
}

TEST(ReadMesh, ReadsABinaryStlWhoseHeaderBeginsWithSolid) {
  std::string stl = binary_stl(box_mesh({1, 2, 3}));
  stl.replace(0, 5, "solid");
  EXPECT_EQ(parse_mesh(stl, "part").triangles.size(), 12u);
}

TEST(ReadMesh, SplitsPolygonsAndCountsBackwards) {
  const TriangleMesh mesh = parse_mesh(
      "v 0 0 0\r\nv 1 0 0\r\nv 1 1 0\nv 0 1 0\nf 1/1/1 2/2/1 3/3/1 4/4/1\nv 0 0 1\nf -5 -4 -1\nusemtl x\ns off\n",
      "part");
  ASSERT_EQ(mesh.triangles.size(), 3u);
  EXPECT_EQ(mesh.triangles[1], (TriangleMesh::Triangle{0, 2, 3}));
  EXPECT_EQ(mesh.triangles[2], (TriangleMesh::Triangle{0, 1, 4}));
}

// --- what exporters write

/// Each face with corners of its own, moved by `moved`.
template <class Moved>
TriangleMesh exploded(const TriangleMesh& mesh, const Moved& moved) {
  TriangleMesh out;
  for (std::uint32_t k = 0; k < mesh.triangles.size(); ++k) {
    for (const std::uint32_t v : mesh.triangles[k]) out.vertices.push_back(moved(mesh.vertices[v]));
    out.triangles.push_back({3 * k, 3 * k + 1, 3 * k + 2});
  }
  return out;
}
TriangleMesh exploded(const TriangleMesh& mesh) {
  return exploded(mesh, [](const Vector3d& v) { return v; });
}
void append(TriangleMesh& mesh, const TriangleMesh& part, const Vector3d& at, bool cavity = false) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  for (const Vector3d& v : part.vertices) mesh.vertices.push_back(v + at);
  for (TriangleMesh::Triangle t : part.triangles) {
    for (std::uint32_t& v : t) v += first;
    if (cavity) std::swap(t[0], t[1]);
    mesh.triangles.push_back(t);
  }
}
/// A prism of n sides, its area and its volume in closed form.
struct Prism {
  double n, radius, height;
  [[nodiscard]] TriangleMesh mesh() const {
    return turned({{0, 0}, {radius, 0}, {radius, height}, {0, height}}, static_cast<std::uint32_t>(n));
  }
  [[nodiscard]] double base() const { return 0.5 * n * radius * radius * std::sin(2 * std::numbers::pi / n); }
  [[nodiscard]] double area() const { return 2 * base() + 2 * n * radius * std::sin(std::numbers::pi / n) * height; }
  [[nodiscard]] double volume() const { return base() * height; }
};

TEST(ReadMesh, ReadsEverySolidOfAnAsciiStl) {
  Source source;
  for (int solids = 1; solids <= 6; ++solids) {
    std::string text;
    double volume = 0.0, area = 0.0;
    Vector3d at = source.vector<3>(1.0);
    for (int i = 0; i < solids; ++i) {
      const Prism prism{static_cast<double>(3 + i), source.uniform(0.1, 0.2), source.uniform(0.1, 0.4)};
      TriangleMesh mesh;
      append(mesh, prism.mesh(), at);
      at.z() += prism.height;  // they stand on each other
      std::string part = ascii_stl(mesh);
      if (i % 2 == 1) std::ranges::transform(part, part.begin(), [](unsigned char c) { return std::toupper(c); });
      text += part + (i % 3 == 0 ? "\n \n" : "");
      volume += prism.volume(), area += prism.area();
    }
    const TriangleMesh mesh = parse_mesh(text, "parts");
    EXPECT_TRUE(faults_of(mesh).none()) << solids;
    EXPECT_EQ(shells_of(mesh).size(), static_cast<std::size_t>(solids));
    EXPECT_NEAR(volume_m3(mesh), volume, 1e-12 * volume);
    EXPECT_NEAR(area_of(mesh), area, 1e-12 * area);
  }
}

/// Around the edge that they share each begins within the other: only their names tell them apart.
TEST(ReadMesh, KeepsSolidsApartThatPierceEachOther) {
  TriangleMesh one, other;
  append(one, box_mesh({0.1, 0.2, 0.3}), {0.1, 0.2, 0.3});  // an edge on the z axis
  other = one;
  for (Vector3d& v : other.vertices) v = {0.6 * v.x() - 0.8 * v.y(), 0.8 * v.x() + 0.6 * v.y(), v.z()};
  const TriangleMesh mesh = parse_mesh(ascii_stl(one) + ascii_stl(other), "parts");
  EXPECT_TRUE(faults_of(mesh).none());
  ASSERT_EQ(shells_of(mesh).size(), 2U);
  for (const TriangleMesh& shell : shells_of(mesh)) EXPECT_NEAR(volume_m3(shell), 0.048, 1e-12);
}

/// Patches of one surface that have names of their own, as flow solvers write them.
TEST(ReadMesh, JoinsASurfaceOfSeveralSolids) {
  const Prism prism{12, 0.1, 0.3};
  const TriangleMesh whole = prism.mesh();
  TriangleMesh top = whole, sides = whole;
  const auto is_top = [&](const TriangleMesh::Triangle& t) {
    return std::ranges::all_of(t, [&](std::uint32_t v) { return whole.vertices[v].z() > 0.2; });
  };
  std::erase_if(top.triangles, [&](const auto& t) { return !is_top(t); });
  std::erase_if(sides.triangles, is_top);
  const TriangleMesh mesh = parse_mesh(ascii_stl(sides) + ascii_stl(top), "patches");
  EXPECT_TRUE(faults_of(mesh).none());
  EXPECT_EQ(shells_of(mesh).size(), 1U);
  EXPECT_NEAR(volume_m3(mesh), prism.volume(), 1e-12 * prism.volume());
}

TEST(ReadMesh, JoinsFacesThatHaveVerticesOfTheirOwn) {
  for (const TriangleMesh& whole : {box_mesh({0.1, 0.2, 0.3}), torus_mesh(kRadius, kTube, 24, 12), sphere_mesh(0.03, 3),
                                    Prism{7, 0.1, 0.2}.mesh()}) {
    const TriangleMesh mesh = parse_mesh(obj(exploded(whole)), "part");
    EXPECT_EQ(mesh.triangles.size(), whole.triangles.size());
    EXPECT_TRUE(faults_of(mesh).none());
    EXPECT_EQ(shells_of(mesh).size(), 1U);
    EXPECT_NEAR(volume_m3(mesh), volume_m3(whole), 1e-13 * volume_m3(whole));
    EXPECT_NEAR(area_of(mesh), area_of(whole), 1e-13 * area_of(whole));
  }
  // Seams: some triangles have corners of their own, others share theirs.
  Source source;
  const TriangleMesh torus = torus_mesh(kRadius, kTube, 24, 12);
  for (int trial = 0; trial < 20; ++trial) {
    TriangleMesh seamed = torus;
    for (TriangleMesh::Triangle& t : seamed.triangles)
      for (std::uint32_t& v : t)
        if (source.uniform(0, 1) < 0.1)
          seamed.vertices.push_back(torus.vertices[v]), v = static_cast<std::uint32_t>(seamed.vertices.size()) - 1;
    expect_same_solid(parse_mesh(obj(seamed), "part"), torus, 1e-13);
  }
}

/// Parts that touch at a corner, along an edge and at a face: where more than two faces meet, those of one part belong together.
TEST(ReadMesh, KeepsPartsApartThatTouch) {
  Source source;
  const Vector3d half{0.1, 0.2, 0.3};
  for (const Vector3d& off : {Vector3d{0.2, 0.4, 0.6}, Vector3d{0.2, 0.4, 0}, Vector3d{0, 0.4, 0.6},
                              Vector3d{0.2, 0, 0}, Vector3d{0, 0, 0.6}}) {
    TriangleMesh two = box_mesh(half);
    append(two, box_mesh(half), off);
    for (std::size_t i = two.triangles.size() - 1; i > 0; --i)  // in any order
      std::swap(two.triangles[i], two.triangles[static_cast<std::size_t>(source.uniform(0.0, static_cast<double>(i)))]);
    for (const std::string& file : {obj(exploded(two)), ascii_stl(two), binary_stl(two)}) {
      const TriangleMesh mesh = parse_mesh(file, "parts");
      EXPECT_TRUE(faults_of(mesh).none()) << off.transpose();
      EXPECT_EQ(shells_of(mesh).size(), 2U) << off.transpose();
      for (const TriangleMesh& shell : shells_of(mesh)) EXPECT_NEAR(volume_m3(shell), 0.048, 1e-7);
    }
  }
}

/// They share an edge, whatever its faces' directions.
TEST(ReadMesh, KeepsAPartApartThatLiesWithinAnother) {
  TriangleMesh two;
  append(two, box_mesh({0.1, 0.2, 0.3}), {0.1, 0.2, 0.3});  // an edge on the z axis
  TriangleMesh within = two;
  for (Vector3d& v : within.vertices) v = {0.5 * v.x() + 0.2 * v.y(), 0.2 * v.x() + 0.5 * v.y(), v.z()};
  append(two, within, Vector3d::Zero());
  for (int turn = 0; turn < 8; ++turn) {
    const TriangleMesh mesh = parse_mesh(obj(exploded(two)), "parts");
    EXPECT_TRUE(faults_of(mesh).none()) << turn;
    EXPECT_EQ(shells_of(mesh).size(), 2U) << turn;
    EXPECT_NEAR(volume_m3(mesh), 1.21 * 0.048, 1e-12) << turn;
    for (Vector3d& v : two.vertices) v = Vector3d{0.6 * v.x() - 0.8 * v.y(), 0.8 * v.x() + 0.6 * v.y(), v.z()};
  }
}

TEST(ReadMesh, JoinsCornersThatAnExporterHasRounded) {
  Source source;
  for (const double size : {1e-3, 0.1, 250.0})
    for (const double offset : {0.0, 3.0}) {
      const TriangleMesh whole = torus_mesh(size * kRadius, size * kTube, 40, 20);
      // Of each facet by itself, in float: into axes of its own and back.
      const TriangleMesh rounded = exploded(whole, [&](const Vector3d& v) {
        const float turn = static_cast<float>(source.uniform(-3, 3)), c = std::cos(turn), s = std::sin(turn);
        const Eigen::Vector3f p = (v + size * offset * kRadius * Vector3d::Ones()).cast<float>();
        const Eigen::Vector3f there{c * p.x() - s * p.y(), s * p.x() + c * p.y(), p.z()};
        return Vector3d{
            Eigen::Vector3f{c * there.x() + s * there.y(), c * there.y() - s * there.x(), p.z()}.cast<double>()};
      });
      for (const std::string& file : {binary_stl(rounded), ascii_stl(rounded), obj(rounded)}) {
        const TriangleMesh mesh = parse_mesh(file, "part");
        EXPECT_TRUE(faults_of(mesh).none()) << size << " at " << offset << ": " << faults_of(mesh).open_edges;
        EXPECT_EQ(mesh.vertices.size(), whole.vertices.size());
        EXPECT_NEAR(volume_m3(mesh), volume_m3(whole), 1e-5 * volume_m3(whole));
      }
    }
  // What no rounding explains stays open.
  const TriangleMesh box = box_mesh(Vector3d::Constant(0.05));
  const TriangleMesh loose = exploded(box, [&](const Vector3d& v) { return Vector3d{v + source.vector<3>(1e-6)}; });
  EXPECT_EQ(faults_of(parse_mesh(obj(loose), "part")).open_edges, 36U);
}

TEST(ReadMesh, LeavesAClosedMeshAsItIsToTheBit) {
  TriangleMesh two = torus_mesh(kRadius, kTube, 24, 12);
  append(two, box_mesh({0.1, 0.2, 0.3}), {0.2, 0, 0});
  append(two, box_mesh({0.1, 0.2, 0.3}), {0.4, 0, 0});  // shares the places of four corners
  two.vertices[0] += Vector3d{1e-9, 0, 0};              // near a place, and another one
  const TriangleMesh mesh = parse_mesh(obj(two), "parts");
  EXPECT_EQ(mesh.vertices, two.vertices);
  EXPECT_EQ(mesh.triangles, two.triangles);
}

/// A box of which a face has a corner more, on an edge of its neighbour: a triangle without area lies between.
TEST(ReadMesh, TakesInTrianglesWithoutArea) {
  const std::string corners =
      "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nv 0.25 0 0\nv 0.5 0 0\n";
  const std::string faces = "f 4 3 2\nf 4 2 1\nf 5 6 7 8\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
  std::string left_out;
  const auto read = [&](const std::string& more) {
    left_out.clear();
    return parse_mesh(corners + faces + more, "box", left_out);
  };
  for (const char* more :
       {"f 1 10 5\nf 10 2 5\nf 2 6 5\nf 1 2 10\n", "f 1 9 5\nf 9 10 5\nf 10 2 5\nf 2 6 5\nf 1 10 9\nf 1 2 10\n",
        "f 1 9 5\nf 9 10 5\nf 10 2 5\nf 2 6 5\nf 9 2 10\nf 1 2 9\n"}) {
    const TriangleMesh mesh = read(more);
    EXPECT_TRUE(faults_of(mesh).none()) << more << faults_of(mesh).open_edges;
    EXPECT_NEAR(volume_m3(mesh), 1.0, 1e-15);
    EXPECT_NEAR(area_of(mesh), 6.0, 1e-15);
    EXPECT_EQ(left_out, "") << "all of them hold it together";
    for (const TriangleMesh::Triangle& t : mesh.triangles) EXPECT_GT(area_of(TriangleMesh{mesh.vertices, {t}}), 0.01);
  }
  // These hold nothing together: a line, a point, and a fold over a whole edge.
  const TriangleMesh mesh = read("f 1 2 6 5\nf 1 2 2\nf 3 3 3\nf 9 10 1\n");
  EXPECT_TRUE(faults_of(mesh).none());
  EXPECT_EQ(left_out, "box: 3 triangles without area are left out");
  EXPECT_TRUE(faults_of(read("f 1 2 6 5\nf 1 2 2\n")).none());
  EXPECT_EQ(left_out, "box: 1 triangle without area is left out");
  EXPECT_TRUE(faults_of(read("f 1 2 6 5\n")).none());
  EXPECT_EQ(left_out, "");
}

TEST(ReadMesh, ReadsLinesThatGoOn) {
  const TriangleMesh mesh = parse_mesh("v 0 0 \\\n 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 \\\r\n3 4\n", "part");
  EXPECT_NEAR(area_of(mesh), 1.0, 1e-15);
}

TEST(Mesh, KnowsWhereItIsOpen) {
  TriangleMesh mesh = box_mesh({0.1, 0.2, 0.3});
  std::erase_if(mesh.triangles, [&](const TriangleMesh::Triangle& t) {
    return std::ranges::all_of(t, [&](std::uint32_t v) { return mesh.vertices[v].x() > 0.0; });
  });
  append(mesh, sphere_mesh(0.05, 2), {2, 0, 0});
  mesh.triangles.pop_back();
  const std::vector<Eigen::AlignedBox3d> gaps = gaps_of(mesh);
  ASSERT_EQ(gaps.size(), 2U);
  EXPECT_LT((gaps[0].center() - Vector3d{0.1, 0, 0}).norm(), 1e-15);
  EXPECT_LT((gaps[0].sizes() - Vector3d{0, 0.4, 0.6}).norm(), 1e-15);
  EXPECT_LT((gaps[1].center() - Vector3d{2, 0, 0}).norm(), 0.06);
  EXPECT_TRUE(gaps_of(box_mesh({1, 1, 1})).empty());
  TriangleMesh flipped = box_mesh({0.1, 0.2, 0.3});
  std::swap(flipped.triangles[0][0], flipped.triangles[0][1]);
  EXPECT_NEAR(odd_edge_of(flipped).z(), -0.3, 1e-15);
  EXPECT_EQ(faults_of(parse_mesh(obj(exploded(flipped)), "part")).odd_edges, 3U) << "turned, and no gap";
  EXPECT_EQ(faults_of(parse_mesh(obj(exploded(flipped)), "part")).open_edges, 0U);
}

std::string refusal(const std::string& content) {
  try {
    parse_mesh(content, "part");
    return "";
  } catch (const ConfigError& e) {
    return e.what();
  }
}

TEST(ReadMesh, RefusesInOneSentenceWhatIsNoMesh) {
  const std::string neither =
      "part: it is no triangle mesh that is read here: neither STL (a binary one is 84 + 50 n bytes long) nor "
      "Wavefront OBJ";
  EXPECT_EQ(refusal(""), neither);
  EXPECT_EQ(refusal(std::string(1000, '\0')), neither);
  const std::string stl = binary_stl(box_mesh({1, 1, 1}));
  EXPECT_EQ(refusal(stl.substr(0, stl.size() - 1)), neither);
  EXPECT_EQ(refusal(stl + "x"), neither);
  std::string many = stl;
  many[80] = many[81] = many[82] = many[83] = '\xff';  // 4 billion triangles
  EXPECT_EQ(refusal(many), neither);
  std::string none(84, '\0');
  EXPECT_EQ(refusal(none), "part: it has no triangle with an area");
  std::string nan = stl;
  for (std::size_t i = 0; i < 4; ++i) nan[84 + 50 + 12 + i] = '\xff';
  EXPECT_EQ(refusal(nan), "part: triangle 1 has a coordinate -nan; it must be a number of at most 1e+06");
  EXPECT_EQ(refusal("solid\nfacet normal 0 0 1 outer loop vertex 0 0 x"),
            "part: line 2: \"x\" stands where a coordinate is expected");
  EXPECT_EQ(refusal("solid\nfacet normal 0 0 1\nouter ring"),
            "part: line 3: \"ring\" stands where \"loop\" is expected");
  EXPECT_EQ(refusal("solid\n"), "part: line 2: \"\" stands where \"facet\" or \"endsolid\" is expected");
  EXPECT_EQ(refusal("v 0 0 0\nv 1 0 0\nf 1 2 3"), "part: line 3: \"3\" names no vertex; there are 2 so far");
  EXPECT_EQ(refusal("v 0 0 0\nf 1 1 0"), "part: line 2: \"0\" names no vertex; there are 1 so far");
  EXPECT_EQ(refusal("v 0 0 0\nf 1 1 -9223372036854775808"),
            "part: line 2: \"-9223372036854775808\" names no vertex; there are 1 so far");
  EXPECT_EQ(refusal("v 0 0 0\nf 1 1"), "part: line 2: a face has fewer than three vertices");
  EXPECT_EQ(refusal("v 0 0"), "part: line 1: \"\" stands where a coordinate is expected");
  EXPECT_EQ(refusal("v 0 0 1e300"), "part: line 1 has a coordinate 1e+300; it must be a number of at most 1e+06");
  EXPECT_EQ(refusal("v 0 0 0\n"), "part: it has no triangle with an area");
  const std::string solid = ascii_stl(box_mesh({1, 1, 1}));
  EXPECT_EQ(refusal(solid + "facet"),
            "part: line 87: \"facet\" stands where \"solid\" or the end of the file is expected");
  EXPECT_EQ(refusal(solid + "solid b\nfacet normal 0 0 1\n"), "part: line 89: \"\" stands where \"outer\" is expected");
  EXPECT_EQ(refusal("ply\nformat ascii 1.0\n"), neither + "; MeshLab and Blender export both");
  std::string named = stl;
  named.replace(0, 5, "solid");
  EXPECT_EQ(refusal(named + "x"),
            "part: it is 685 bytes long, and a binary STL of 12 triangles, as its header says, is 684");
  std::string wide;
  for (const char c : solid) wide += c, wide += '\0';
  EXPECT_EQ(refusal(wide), "part: it is in UTF-16; save it as UTF-8");
}

TEST(Mesh, TellsWhatKeepsItFromBeingASolid) {
  TriangleMesh mesh = box_mesh({1, 2, 3});
  EXPECT_TRUE(faults_of(mesh).none());
  EXPECT_NEAR(faults_of(mesh).volume_m3, 48.0, 1e-12);
  TriangleMesh open = mesh;
  open.triangles.pop_back();
  EXPECT_EQ(faults_of(open).open_edges, 3u);
  TriangleMesh turned = mesh;
  std::swap(turned.triangles[0][0], turned.triangles[0][1]);
  EXPECT_EQ(faults_of(turned).odd_edges, 3u);
  for (TriangleMesh::Triangle& t : mesh.triangles) std::swap(t[0], t[1]);
  EXPECT_NEAR(faults_of(mesh).volume_m3, -48.0, 1e-12);
}

// --- solids --------------------------------------------------------------------------------------

double box_distance(const Vector3d& p, const Vector3d& half) {
  const Vector3d q = p.cwiseAbs() - half;
  return q.maxCoeff() < 0.0 ? q.maxCoeff() : q.cwiseMax(0.0).norm();
}
const Vector3d kCube = Vector3d::Constant(0.01);

TEST(Mesh, OfTwoOverlappingCubesPushesOutOfBoth) {
  TriangleMesh mesh = box_mesh(kCube);
  append(mesh, box_mesh(kCube), {0.01, 0.004, 0.002});
  const DistanceField field{mesh, 1e-3};
  // Into the first cube through the face at -x, on through the hidden face of the second and through the middle.
  for (double x = -0.0095; x < 0.0095; x += 2.5e-4) {
    const Vector3d p{x, 0.002, 0.001}, off{0.01, 0.004, 0.002};
    EXPECT_NEAR(field.at(p).distance, std::min(box_distance(p, kCube), box_distance(p - off, kCube)), 3e-4) << x;
    EXPECT_LT(field.at(p).distance, -1e-4) << x;
  }
  EXPECT_NEAR(field.at({-0.007, 0.0, 0.001}).gradient.x(), -1.0, 1e-3) << "at 3 mm";
}

TEST(Mesh, OfACubeWithANestedOneIsTheCube) {
  TriangleMesh mesh = box_mesh(2.0 * kCube);
  append(mesh, box_mesh(kCube), {0.001, 0.0, 0.002});
  const DistanceField field{mesh, 1e-3}, alone{box_mesh(2.0 * kCube), 1e-3};
  Source source;
  for (int i = 0; i < 5000; ++i) {
    const Vector3d p = source.vector<3>(0.025);
    ASSERT_EQ(field.at(p).distance, alone.at(p).distance);
    ASSERT_EQ(field.at(p).gradient, alone.at(p).gradient);
  }
}

TEST(Mesh, OfRandomBoxesSpheresAndCavitiesNeverTakesTheWrongSide) {
  Source source;
  double worst = 0.0;
  for (int trial = 0; trial < 12; ++trial) {
    struct Part {
      Vector3d at, half;  // a box; a sphere: its radius
      bool sphere, cavity;
      [[nodiscard]] double distance(const Vector3d& p) const {
        return sphere ? (p - at).norm() - half[0] : box_distance(p - at, half);
      }
    };
    std::vector<Part> parts;
    TriangleMesh mesh;
    for (int i = 0; i < 2 + trial % 4; ++i) {
      const bool sphere = source.uniform(0, 1) < 0.5;
      Vector3d half{source.uniform(0.008, 0.02), source.uniform(0.008, 0.02), source.uniform(0.008, 0.02)};
      if (sphere) half.setConstant(half[0]);
      parts.push_back({source.vector<3>(0.015), half, sphere, false});
      append(mesh, sphere ? sphere_mesh(half[0], 3) : box_mesh(half), parts.back().at);
      if (trial % 3 != 0) continue;
      parts.push_back({parts.back().at, Vector3d::Constant(0.005), true, true});
      append(mesh, sphere_mesh(0.005, 3), parts.back().at, true);
    }
    const auto exact = [&](const Vector3d& p) {
      double least = 1e9;
      for (std::size_t i = 0; i < parts.size(); ++i) {
        if (parts[i].cavity) continue;
        double d = parts[i].distance(p);
        if (i + 1 < parts.size() && parts[i + 1].cavity) d = std::max(d, -parts[i + 1].distance(p));
        least = std::min(least, d);
      }
      return least;
    };
    EXPECT_FALSE(solids_of(mesh).inward);
    const DistanceField field{mesh, 1.5e-3};
    for (int i = 0; i < 2000; ++i) {
      const Vector3d p = source.vector<3>(0.035);
      const double d = field.at(p).distance;
      // Rounded by the grid where surfaces meet.
      if (std::abs(exact(p)) > 8e-4) {
        ASSERT_EQ(d < 0.0, exact(p) < 0.0) << p.transpose() << " in trial " << trial;
      }
      if (std::abs(exact(p)) < 0.004) worst = std::max(worst, std::abs(d - exact(p)));
    }
  }
  std::printf("at most %.0f µm off\n", 1e6 * worst);
  EXPECT_LT(worst, 1e-3);
}

TEST(Mesh, KnowsASurfaceThatCrossesItselfAndOneThatFacesInwardsInNoOther) {
  EXPECT_FALSE(BoundingVolumeTree{fine_torus()}.crossing());
  EXPECT_FALSE(BoundingVolumeTree{box_mesh(kCube)}.crossing());
  EXPECT_FALSE(BoundingVolumeTree{sphere_mesh(0.03, 4)}.crossing());
  TriangleMesh pulled = box_mesh(kCube);
  pulled.vertices[0] = {0.03, 0.002, 0.003};  // a corner, through the opposite face
  const auto where = BoundingVolumeTree{pulled}.crossing();
  ASSERT_TRUE(where);
  EXPECT_NEAR(where->x(), 0.01, 1e-6);
  TriangleMesh mesh = box_mesh(2.0 * kCube);
  append(mesh, box_mesh(kCube), {0.05, 0.0, 0.0}, true);
  EXPECT_TRUE(faults_of(mesh).none());
  EXPECT_TRUE(solids_of(mesh).inward);
}

/// An L of 6 by 6 cm, 3 cm high, its arms 2 cm wide: corners of its floor, from corner `first` on.
TriangleMesh l_shaped(std::size_t first) {
  const std::array<std::array<double, 2>, 6> corner{{{0, 0}, {6, 0}, {6, 2}, {2, 2}, {2, 6}, {0, 6}}};
  std::string text;
  for (const int z : {0, 3})
    for (const auto& [x, y] : corner) text += fmt::format("v {} {} {}\n", x, y, z);
  text += "f";
  for (std::size_t i = 0; i < 6; ++i) text += fmt::format(" {}", 1 + (first + 6 - i) % 6);
  text += "\nf";
  for (std::size_t i = 0; i < 6; ++i) text += fmt::format(" {}", 7 + (first + i) % 6);
  for (std::size_t i = 0; i < 6; ++i)
    text += fmt::format("\nf {} {} {} {}", 1 + i, 1 + (i + 1) % 6, 7 + (i + 1) % 6, 7 + i);
  return parse_mesh(text, "L");
}

TEST(ReadMesh, TrianglesOfAPolygonThatIsNotConvexLieInIt) {
  for (std::size_t first = 0; first < 6; ++first) {
    const TriangleMesh mesh = l_shaped(first);
    EXPECT_TRUE(faults_of(mesh).none());
    EXPECT_NEAR(faults_of(mesh).volume_m3, 60.0, 1e-12);
    double area = 0.0;  // a triangle beyond the polygon would add to it
    for (const TriangleMesh::Triangle& t : mesh.triangles)
      area += 0.5 * (mesh.vertices[t[1]] - mesh.vertices[t[0]]).cross(mesh.vertices[t[2]] - mesh.vertices[t[0]]).norm();
    EXPECT_NEAR(area, 2.0 * 20.0 + 3.0 * 24.0, 1e-12) << first;
    EXPECT_FALSE(misplaced(mesh)) << first;
    EXPECT_LT(BoundingVolumeTree{mesh}.nearest({1, 5, 2.5}).signed_distance({1, 5, 2.5}), 0.0);
    EXPECT_GT(BoundingVolumeTree{mesh}.nearest({3, 3, 2.5}).signed_distance({3, 3, 2.5}), 0.0);
  }
}

TEST(Mesh, KnowsTrianglesThatLieOnOthersAndPartsThatAreInsideOut) {
  EXPECT_FALSE(misplaced(fine_torus()));
  EXPECT_FALSE(misplaced(box_mesh(kCube)));
  TriangleMesh cavity = box_mesh(kCube);
  for (TriangleMesh::Triangle& t : cavity.triangles) std::swap(t[0], t[1]);
  EXPECT_FALSE(misplaced(cavity));
  // The fan from a corner of the floor that does not see all of it: a triangle covers the notch, and another one there faces back.
  TriangleMesh fan = l_shaped(0);
  std::erase_if(fan.triangles, [](const TriangleMesh::Triangle& t) { return std::max({t[0], t[1], t[2]}) < 6; });
  for (const std::uint32_t i : {0u, 5u, 4u, 3u}) fan.triangles.push_back({1, i, (i + 5) % 6});
  EXPECT_TRUE(faults_of(fan).none());
  EXPECT_FALSE(BoundingVolumeTree{fan}.crossing());
  EXPECT_TRUE(misplaced(fan));
  // A prism over a bow tie, whose diagonals meet edge on edge: one wing is inside out.
  const TriangleMesh bow = parse_mesh(
      "v -1 -1 0\nv 2 2 0\nv -2 2 0\nv 1 -1 0\nv -1 -1 3\nv 2 2 3\nv -2 2 3\nv 1 -1 3\nf 5 6 7\nf 3 2 1\nf 5 7 8\n"
      "f 4 3 1\nf 1 2 5\nf 2 6 5\nf 2 3 7\nf 2 7 6\nf 3 4 8\nf 3 8 7\nf 4 1 5\nf 4 5 8\n",
      "bow");
  EXPECT_TRUE(faults_of(bow).none());
  EXPECT_FALSE(BoundingVolumeTree{bow}.crossing());
  EXPECT_TRUE(misplaced(bow));
}

TEST(Mesh, KnowsWhichWayItFacesFarFromTheOrigin) {
  for (const double far_m : {1e2, 1e4, 9e5}) {
    TriangleMesh mesh = box_mesh(kCube);
    for (Vector3d& v : mesh.vertices) v += Vector3d{far_m, -far_m, 0.7 * far_m};
    EXPECT_GT(faults_of(mesh).volume_m3, 0.0) << far_m;
    for (TriangleMesh::Triangle& t : mesh.triangles) std::swap(t[0], t[1]);
    EXPECT_LT(faults_of(mesh).volume_m3, 0.0) << far_m;
  }
}

// --- nearest point -------------------------------------------------------------------------------

TEST(BoundingVolumeTree, FindsTheNearestOfAllTriangles) {
  // Against a search of all triangles, each of them a tree of its own.
  const TriangleMesh mesh = torus_mesh(kRadius, kTube, 20, 10);
  const BoundingVolumeTree tree{mesh};
  std::vector<BoundingVolumeTree> single;
  for (const TriangleMesh::Triangle& t : mesh.triangles) single.emplace_back(TriangleMesh{mesh.vertices, {t}});
  Source source;
  std::uint32_t near = 0;
  for (int i = 0; i < 2000; ++i) {
    const Vector3d p = source.vector<3>(0.1);
    double least = 1e9;
    for (const BoundingVolumeTree& each : single) least = std::min(least, each.nearest(p).squared_distance);
    const auto cold = tree.nearest(p), warm = tree.nearest(p, near);
    near = cold.triangle;
    ASSERT_EQ(cold.squared_distance, least);
    ASSERT_EQ(warm.squared_distance, least);
    ASSERT_EQ((p - cold.point).squaredNorm(), least);
  }
}

TEST(BoundingVolumeTree, KnowsTheInsideOfABoxExactly) {
  // Most nearest points lie on edges and corners, where a triangle's own normal tells nothing.
  const Vector3d half{0.01, 0.02, 0.03};
  const BoundingVolumeTree tree{box_mesh(half)};
  Source source;
  for (int i = 0; i < 20'000; ++i) {
    const Vector3d p = source.vector<3>(0.06), q = p.cwiseAbs() - half;
    const double exact = q.maxCoeff() < 0.0 ? q.maxCoeff() : q.cwiseMax(0.0).norm();
    ASSERT_NEAR(tree.nearest(p).signed_distance(p), exact, 1e-15) << p.transpose();
  }
}

TEST(BoundingVolumeTree, IsAsNearTheTorusAsItsFacets) {
  // A facet of an edge e on a circle of radius 20 mm is e²/(8 r) = 4 µm behind it, twice that for the diagonal.
  const BoundingVolumeTree tree{fine_torus()};
  Source source;
  for (int i = 0; i < 2000; ++i) {
    const Vector3d p = source.near_torus(3e-3);
    ASSERT_NEAR(tree.nearest(p).signed_distance(p), kTorus.signed_distance<3>(p, kNearest).distance, 10e-6);
  }
}

// --- sampled distance ----------------------------------------------------------------------------

TEST(DistanceField, IsExactForAPlane) {
  // A flat face away from its edges: the interpolant reproduces what is linear. Samples are floats: 6e-8 of 20 mm.
  const DistanceField field{box_mesh({0.02, 0.02, 0.02}), 1e-3};
  Source source;
  for (int i = 0; i < 500; ++i) {
    const Vector3d p{source.uniform(-3e-3, 3e-3), source.uniform(-3e-3, 3e-3), 0.02 + source.uniform(-3e-3, 3e-3)};
    const auto at = field.at(p);
    ASSERT_NEAR(at.distance, p.z() - 0.02, 2e-9);
    ASSERT_LT((at.gradient - Vector3d::UnitZ()).norm(), 2e-6);
  }
}

TEST(DistanceField, KnowsTheTorusTo16MicrometresAndAQuarterOfADegree) {
  Source source;
  double depth = 0.0, depth_squared = 0.0, angle = 0.0, angle_squared = 0.0;
  constexpr int kCount = 20'000;
  for (int i = 0; i < kCount; ++i) {
    const Vector3d p = source.near_torus(3e-3);
    const auto at = fine_field()->at(p);
    const auto exact = kTorus.signed_distance<3>(p, kNearest);
    const double off = std::abs(at.distance - exact.distance);
    const double turn = std::atan2(at.gradient.cross(exact.normal).norm(), at.gradient.dot(exact.normal));
    depth = std::max(depth, off), depth_squared += off * off;
    angle = std::max(angle, turn), angle_squared += turn * turn;
  }
  const double degrees = 180 / std::numbers::pi;
  std::printf("depth %.2f µm rms, %.2f µm max; normal %.3f° rms, %.3f° max\n", 1e6 * std::sqrt(depth_squared / kCount),
              1e6 * depth, degrees * std::sqrt(angle_squared / kCount), degrees * angle);
  EXPECT_LT(depth, 16e-6);
  EXPECT_LT(degrees * angle, 0.25);
}

TEST(DistanceField, KnowsASphere) {
  const TriangleMesh mesh = sphere_mesh(0.03, 7);  // 131,072 triangles
  const DistanceField field{mesh, 1e-3};
  Source source;
  double depth = 0.0, angle = 0.0;
  for (int i = 0; i < 5000; ++i) {
    const Vector3d n = source.vector<3>(1.0).normalized();
    const double r = 0.03 + source.uniform(-3e-3, 3e-3);
    const auto at = field.at(r * n);
    depth = std::max(depth, std::abs(at.distance - (r - 0.03)));
    angle = std::max(angle, std::atan2(at.gradient.cross(n).norm(), at.gradient.dot(n)));
  }
  std::printf("depth %.2f µm, normal %.3f° max\n", 1e6 * depth, angle * 180 / std::numbers::pi);
  EXPECT_LT(depth, 16e-6);
  EXPECT_LT(angle * 180 / std::numbers::pi, 0.25);
}

TEST(DistanceField, HasItsOwnGradient) {
  Source source;
  constexpr double h = 1e-7;  // the second derivative jumps by up to 1/h of the grid at its nodes: error below 1e-4
  for (int i = 0; i < 2000; ++i) {
    const Vector3d p = source.near_torus(2.9e-3);
    const auto at = fine_field()->at(p);
    for (int axis = 0; axis < 3; ++axis) {
      const Vector3d by = h * Vector3d::Unit(axis);
      ASSERT_NEAR((fine_field()->at(p + by).distance - fine_field()->at(p - by).distance) / (2 * h), at.gradient[axis],
                  1e-5);
    }
  }
}

TEST(DistanceField, IsALowerBoundBeyondItsGrid) {
  Source source;
  for (int i = 0; i < 2000; ++i) {
    const Vector3d p = source.vector<3>(0.3);
    const double exact = kTorus.signed_distance<3>(p, kNearest).distance;
    if (exact < 5e-3) continue;
    const double found = fine_field()->at(p).distance;
    ASSERT_GT(found, 2e-3);
    ASSERT_LT(found, exact + 20e-6);
  }
  const double nan = std::nan("");
  EXPECT_FALSE(fine_field()->at({nan, 0, 0}).distance < 0.0);
  EXPECT_GT(fine_field()->at({1e300, 0, 0}).distance, 1.0);
}

TEST(DistanceField, GivesBackAroundALoopWhatItTook) {
  // 8 mm along and 2 mm into the torus with 5 kN/m, around a smooth loop. The trapezoid rule: the integrand's second derivative
  // jumps at the grid's planes, so its error falls as 1/n²: 1e-9 J of 12 mJ with 20,000 points.
  const Environment<3> environment{{fine_surface(5000.0)}};
  Source source;
  for (int loop = 0; loop < 20; ++loop) {
    const double a0 = source.uniform(0, 6.28), b0 = source.uniform(0, 6.28), turn = source.uniform(0, 6.28);
    const auto at = [&](double s) {
      const double a = a0 + 0.06 * std::cos(s) * std::cos(turn), b = b0 + 0.2 * std::cos(s) * std::sin(turn);
      const double t = kTube - 1.2e-3 + 1e-3 * std::sin(s), r = kRadius + t * std::cos(b);
      return Vector3d{r * std::cos(a), r * std::sin(a), t * std::sin(b)};
    };
    constexpr int kPoints = 20'000;
    double work = 0.0, stored = 0.0;
    for (int k = 0; k < kPoints; ++k) {
      const Vector3d p = at(2 * std::numbers::pi * k / kPoints), q = at(2 * std::numbers::pi * (k + 1) / kPoints);
      const Vector3d middle = 0.5 * (p + q);
      work += environment.force(Position<3>{middle}, {}).vec().dot(q - p);
      stored = std::max(stored, environment.potential(Position<3>{middle}).si());
    }
    ASSERT_NEAR(work, 0.0, 1e-8) << "loop " << loop;
    ASSERT_GT(stored, 8e-3);
  }
}

TEST(Mesh, HasFrictionThatDissipates) {
  // The gradient's length differs from 1, so that the part of the velocity across it is not v - (n·v) n.
  const Environment<3> rough{{fine_surface(3000.0, 0.4)}};
  Source source;
  int slid = 0;
  for (int i = 0; i < 20'000; ++i) {
    const Velocity<3> v{source.vector<3>(0.2)};
    rough.for_each_contact(Position<3>{source.near_torus(5e-3)}, v, [&](const ContactPort<3>& c) {
      ASSERT_LE(c.tangential.dot(v.vec()), 0.0);
      ASSERT_NEAR(c.tangential.dot(c.normal), 0.0, 1e-12 * c.normal.norm() * (1 + c.tangential.norm()));
      slid += c.presses;
    });
  }
  EXPECT_GT(slid, 1000);
}

TEST(Mesh, IsQueriedWithoutAllocation) {
  const BoundingVolumeTree tree{fine_torus()};
  const DistanceField& field = *fine_field();
  Source source;
  double sum = 0.0;
  int seen = 0;
  {
    NoAlloc guard;
    for (int i = 0; i < 1000; ++i) {
      const Vector3d p = source.near_torus(3e-3);
      sum += tree.nearest(p).squared_distance + field.at(p).distance;
    }
    seen = guard.seen();
  }
  EXPECT_EQ(seen, 0);
  EXPECT_TRUE(std::isfinite(sum));
}

// --- points of a tool ----------------------------------------------------------------------------

void expect_spacing(const std::vector<Vector3d>& points, const TriangleMesh& mesh, double spacing, double apart) {
  for (std::size_t i = 0; i < points.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) ASSERT_GE((points[i] - points[j]).norm(), apart * (1 - 1e-12));
  Source source;
  for (int i = 0; i < 3000; ++i) {
    const TriangleMesh::Triangle& t =
        mesh.triangles[static_cast<std::size_t>(source.uniform(0, static_cast<double>(mesh.triangles.size())))];
    double u = source.uniform(0, 1), v = source.uniform(0, 1);
    if (u + v > 1) u = 1 - u, v = 1 - v;
    const Vector3d p = mesh.vertices[t[0]] + u * (mesh.vertices[t[1]] - mesh.vertices[t[0]]) +
                       v * (mesh.vertices[t[2]] - mesh.vertices[t[0]]);
    double least = 1e9;
    for (const Vector3d& each : points) least = std::min(least, (each - p).norm());
    ASSERT_LE(least, spacing);
  }
}

TEST(SampleSurface, LeavesNoPlaceFartherThanTheSpacing) {
  const TriangleMesh torus = torus_mesh(kRadius, kTube, 48, 24), box = box_mesh({0.02, 0.03, 0.01});
  expect_spacing(sample_surface(torus, 8e-3), torus, 8e-3, 6e-3);
  const std::vector<Vector3d> points = sample_surface(box, 7e-3);
  expect_spacing(points, box, 7e-3, 5.25e-3);
  int corners = 0;
  for (const Vector3d& p : points) corners += (p.cwiseAbs() - Vector3d{0.02, 0.03, 0.01}).norm() < 1e-12;
  EXPECT_EQ(corners, 8);
}

TEST(Decimated, KeepsToItsLimitAndNearTheSurface) {
  const TriangleMesh few = decimated(fine_torus(), 5000);
  EXPECT_LE(few.triangles.size(), 5000U);
  EXPECT_GT(few.triangles.size(), 1500U);
  for (const Vector3d& v : few.vertices) EXPECT_LT(std::abs(kTorus.signed_distance<3>(v, kNearest).distance), 0.5e-3);
  EXPECT_NEAR(area_of(few), area_of(fine_torus()), 0.03 * area_of(fine_torus()));
  const TriangleMesh box = box_mesh({0.02, 0.03, 0.01});
  EXPECT_EQ(decimated(box, 12).triangles, box.triangles);
  EXPECT_LE(decimated(box, 3).triangles.size(), 3U);
  EXPECT_TRUE(decimated(box, 0).triangles.empty());
}

}  // namespace
}  // namespace twoport::mesh_test
