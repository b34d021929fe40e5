// Arms from URDF: against KDL on random trees, against closed forms, and what is said of files that are none.

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <tuple>
#include <vector>

#include "common/arm/arm_model.h"
#include "common/base/check.h"
#include "common/base/file.h"
#include "common/scene/arm.h"
#include "common/scene/load.h"
#include "common/scene/shown.h"
#include "tests/support/folder.h"

#ifdef TWOPORT_KDL
#include <kdl/tree.hpp>
#include <kdl/treefksolverpos_recursive.hpp>
#include <kdl/treeidsolver_recursive_newton_euler.hpp>
#include <kdl/treejnttojacsolver.hpp>
#endif

namespace twoport::urdf_test {
namespace {

using Eigen::Vector3d;
const Vector3d kGravity{0.0, 0.0, -9.81};

ArmParameters load(const std::string& urdf, const std::string& tip = "") {
  const std::string path = test::own_folder() / "arm_of_a_test.urdf";
  write_whole(path, urdf);
  return load_arm(path, tip);
}

// ---- against KDL

#ifdef TWOPORT_KDL
/// A random tree as the text of a URDF and as a tree of KDL: a chain of n moving joints with fixed ones between, and branches that hang on it.
class RandomTree {
 public:
  RandomTree(std::uint64_t seed, int n) : rng_{seed}, tree_{"root"} {
    text_ = "<?xml version='1.0'?>\n<robot name='random'>\n<link name='root'/>\n";
    std::string at = "root";
    for (int moving = 0; moving < n;) {
      if (draw() < 0.3) at = add(at, "fixed", false);
      if (draw() < 0.3) branch(at);
      static constexpr std::array<const char*, 3> kTypes{"revolute", "continuous", "prismatic"};
      at = add(at, kTypes[static_cast<std::size_t>(3.0 * draw())], true);
      ++moving;
      if (draw() < 0.3) branch(at);
    }
    if (draw() < 0.5) at = add(at, "fixed", false);
    tip_ = at;
    text_ += "</robot>\n";
  }
  [[nodiscard]] const std::string& text() const { return text_; }
  [[nodiscard]] const std::string& tip() const { return tip_; }
  [[nodiscard]] const KDL::Tree& tree() const { return tree_; }
  double draw() { return static_cast<double>(rng_() >> 11) * 0x1.0p-53; }
  double draw(double size) { return size * (2.0 * draw() - 1.0); }

 private:
  void branch(const std::string& from) {
    static constexpr std::array<const char*, 4> kTypes{"fixed", "revolute", "prismatic", "continuous"};
    std::string at = from;
    for (int i = 0; i < 2; ++i) at = add(at, kTypes[static_cast<std::size_t>(4.0 * draw())], false);
  }
  /// A link with its joint, which moves or is held.
  std::string add(const std::string& parent, const std::string& type, bool moves) {
    const std::string link = fmt::format("l{}", ++count_), joint = fmt::format("j{}", count_);
    const KDL::Vector xyz{draw(0.5), draw(0.5), draw(0.5)}, rpy{draw(3.0), draw(1.5), draw(3.0)},
        axis{draw(1.0), draw(1.0), 0.1 + draw()};
    const double lower = draw(2.0), upper = lower + 0.1 + 2.0 * draw();
    // A body of three pairs of points keeps the triangle inequality whatever the draw.
    const double m = 0.1 + 3.0 * draw(), a = 0.01 + draw(), b = 0.01 + draw(), c = 0.01 + draw();
    const KDL::Vector com{draw(0.2), draw(0.2), draw(0.2)}, turn{draw(3.0), draw(1.5), draw(3.0)};
    const double xy = 0.1 * draw() * a, ixx = b + c, iyy = a + c, izz = a + b;
    text_ += fmt::format(
        "<joint name='{}' type='{}'><parent link='{}'/><child link='{}'/><origin xyz='{}' rpy='{}'/><axis xyz='{}'/>"
        "<limit lower='{:.17g}' upper='{:.17g}' effort='10' velocity='2'/></joint>\n"
        "<link name='{}'><inertial><origin xyz='{}' rpy='{}'/><mass value='{:.17g}'/><inertia ixx='{:.17g}' "
        "ixy='{:.17g}' ixz='0' "
        "iyy='{:.17g}' iyz='0' izz='{:.17g}'/></inertial></link>\n",
        joint, type, parent, link, three(xyz), three(rpy), three(axis), lower, upper, link, three(com), three(turn), m,
        ixx, xy, iyy, izz);
    KDL::Frame frame{KDL::Rotation::RPY(rpy.x(), rpy.y(), rpy.z()), xyz};
    const KDL::RigidBodyInertia body =
        KDL::Frame{KDL::Rotation::RPY(turn.x(), turn.y(), turn.z()), com} *
        KDL::RigidBodyInertia{m, KDL::Vector::Zero(), KDL::RotationalInertia{ixx, iyy, izz, xy, 0.0, 0.0}};
    KDL::Joint of{joint, KDL::Joint::Fixed};
    if (moves)
      of =
          KDL::Joint{joint, frame.p, frame.M * axis, type == "prismatic" ? KDL::Joint::TransAxis : KDL::Joint::RotAxis};
    else {
      const double q = std::max(lower, std::min(0.0, upper));
      if (type == "revolute") frame = frame * KDL::Frame{KDL::Rotation::Rot(axis, q)};
      if (type == "prismatic") frame = frame * KDL::Frame{axis * (q / axis.Norm())};
    }
    tree_.addSegment(KDL::Segment{link, of, frame, body}, parent);
    return link;
  }
  static std::string three(const KDL::Vector& v) { return fmt::format("{:.17g} {:.17g} {:.17g}", v.x(), v.y(), v.z()); }

  std::mt19937_64 rng_;
  KDL::Tree tree_;
  std::string text_, tip_;
  int count_ = 0;
};

void compare_with_kdl(std::uint64_t seed, int n) {
  RandomTree of{seed, n};
  const ArmParameters arm = load(of.text(), of.tip());
  ASSERT_EQ(arm.joints.size(), static_cast<std::size_t>(n)) << of.text();
  const KDL::Tree& tree = of.tree();
  ASSERT_EQ(tree.getNrOfJoints(), static_cast<unsigned>(n));
  // KDL numbers joints as they were added: from the root to the tip.
  const auto rows = static_cast<unsigned>(n);
  KDL::JntArray q{rows};
  for (int i = 0; i < n; ++i) q(static_cast<unsigned>(i)) = of.draw(3.0);
  const ArmModel model{arm};
  const auto pose = model.pose(q.data);

  KDL::TreeFkSolverPos_recursive forward{tree};
  KDL::Frame frame;
  ASSERT_GE(forward.JntToCart(q, frame, of.tip()), 0);
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(frame.p(i), pose.tool[i], 1e-11);
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(frame.M(i, k), pose.tool_rotation(i, k), 1e-11);
  }
  KDL::Jacobian jacobian{rows};
  KDL::TreeJntToJacSolver to_jacobian{tree};
  ASSERT_GE(to_jacobian.JntToJac(q, jacobian, of.tip()), 0);
  EXPECT_LT((jacobian.data - model.jacobian(pose)).cwiseAbs().maxCoeff(), 1e-11);

  const KDL::JntArray rest{rows};
  const KDL::WrenchMap none;
  KDL::JntArray torque{rows};
  KDL::TreeIdSolver_RNE weighs{tree, KDL::Vector{0.0, 0.0, -9.81}}, floats{tree, KDL::Vector::Zero()};
  ASSERT_GE(weighs.CartToJnt(q, rest, rest, none, torque), 0);
  EXPECT_LT((torque.data - model.gravity_torque(pose, kGravity)).cwiseAbs().maxCoeff(), 1e-10);
  const auto M = model.inertia(pose);
  for (int i = 0; i < n; ++i) {
    KDL::JntArray along{rows};
    along(static_cast<unsigned>(i)) = 1.0;
    ASSERT_GE(floats.CartToJnt(q, rest, along, none, torque), 0);
    EXPECT_LT((torque.data - M.col(i)).cwiseAbs().maxCoeff(), 1e-10);
  }
}
#endif

TEST(UrdfAgainstKdl, RandomTreesHaveTheSameKinematicsAndDynamics) {
#ifdef TWOPORT_KDL
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE(seed);
    compare_with_kdl(seed, static_cast<int>(1 + seed % 8));
    if (HasFailure()) break;
  }
#else
  GTEST_SKIP() << "liborocos-kdl-dev is not installed";
#endif
}

// ---- closed forms

std::string two_links(
    const std::string& more = "",
    const std::string& inertia = "<inertia ixx='0.02' iyy='0.03' izz='0.02' ixy='0' ixz='0' iyz='0'/>") {
  return "<robot name='two links'><link name='base'/>"
         "<link name='upper'><inertial><origin xyz='0.2 0 0'/><mass value='2'/>" +
         inertia +
         "</inertial></link>"
         "<link name='lower'><inertial><origin xyz='0.1 0 0'/><mass value='1.5'/>" +
         inertia +
         "</inertial></link>"
         "<link name='tool'/>"
         "<joint name='a' type='revolute'><parent link='base'/><child link='upper'/><origin xyz='0 0 0.7'/><axis "
         "xyz='0 -1 0'/>"
         "<limit lower='-3' upper='3' effort='50' velocity='2'/><dynamics damping='0.7' friction='0.2'/></joint>"
         "<joint name='b' type='continuous'><parent link='upper'/><child link='lower'/><origin xyz='0.5 0 0'/><axis "
         "xyz='0 -1 0'/></joint>"
         "<joint name='c' type='fixed'><parent link='lower'/><child link='tool'/><origin xyz='0.3 0 0'/></joint>" +
         more + "</robot>";
}

// x to the front, z up, angles from the horizontal.
TEST(Urdf, OfTwoLinksFollowsTheClosedForm) {
  const ArmParameters of = load(two_links());
  const ArmModel arm{of};
  for (const auto& [a, b] : {std::pair{0.3, 0.8}, {-1.2, 2.1}, {2.5, -0.4}}) {
    const auto pose = arm.pose(joint_vector({a, b}));
    const double l1 = 0.5, l2 = 0.3, c1 = 0.2, c2 = 0.1, m1 = 2.0, m2 = 1.5, I = 0.03, g = 9.81;
    EXPECT_LT((pose.tool -
               Vector3d{l1 * std::cos(a) + l2 * std::cos(a + b), 0.0, 0.7 + l1 * std::sin(a) + l2 * std::sin(a + b)})
                  .norm(),
              1e-15);
    const double h = m2 * l1 * c2 * std::cos(b);
    Eigen::Matrix2d M;
    M << 2.0 * I + m1 * c1 * c1 + m2 * (l1 * l1 + c2 * c2) + 2.0 * h, I + m2 * c2 * c2 + h, I + m2 * c2 * c2 + h,
        I + m2 * c2 * c2;
    EXPECT_LT((arm.inertia(pose) - M).cwiseAbs().maxCoeff(), 1e-14);
    const double lower = m2 * c2 * g * std::cos(a + b);
    const Eigen::Vector2d weight{(m1 * c1 + m2 * l1) * g * std::cos(a) + lower, lower};
    EXPECT_LT((arm.gravity_torque(pose, kGravity) - weight).cwiseAbs().maxCoeff(), 1e-13);
  }
}

TEST(Urdf, KeepsNamesLimitsAndFriction) {
  const ArmParameters of = load(two_links());
  EXPECT_EQ(of.name, "two links");
  EXPECT_EQ(of.joints[0].name, "a");
  EXPECT_EQ(of.joints[0].lower, -3.0);
  EXPECT_EQ(of.joints[0].upper, 3.0);
  EXPECT_EQ(of.joints[0].max_effort, 50.0);
  EXPECT_EQ(of.joints[0].max_speed, 2.0);
  EXPECT_EQ(of.joints[0].damping, 0.7);
  EXPECT_EQ(of.joints[0].coulomb_friction, 0.2);
  EXPECT_TRUE(std::isinf(of.joints[1].lower) && std::isinf(of.joints[1].upper));
  EXPECT_FALSE(of.joints[1].damping || of.joints[1].coulomb_friction);
}

TEST(Urdf, HoldsPointsAsMassesAndEndsAtTheTip) {
  const ArmParameters of = load(two_links("", "<inertia ixx='0' iyy='0' izz='0' ixy='0' ixz='0' iyz='0'/>"), "upper");
  ASSERT_EQ(of.joints.size(), 1U);
  const ArmModel arm{of};
  const auto pose = arm.pose(joint_vector({0.0}));
  EXPECT_LT((pose.tool - Vector3d{0.0, 0.0, 0.7}).norm(), 1e-15);
  EXPECT_NEAR(arm.inertia(pose)(0, 0), 2.0 * 0.04 + 1.5 * 0.36, 1e-14);  // the second link is held
}

// A carriage that slides along x below the second link: M and weight in closed form.
TEST(Urdf, OfALinkOnASlideFollowsTheClosedForm) {
  std::string text = two_links();
  const std::string turns = "type='revolute'", about = "<axis xyz='0 -1 0'/>";
  text.replace(text.find(turns), turns.size(), "type='prismatic'");
  text.replace(text.find(about), about.size(), "<axis xyz='-2 0 0'/>");
  const ArmParameters of = load(text);
  EXPECT_EQ(of.joints[0].type, JointType::prismatic);
  EXPECT_EQ(of.joints[1].type, JointType::continuous);
  const ArmModel arm{of};
  for (const auto& [x, b] : {std::pair{0.3, 0.8}, {-1.2, 2.1}}) {
    const ArmModel::Pose pose = arm.pose(joint_vector({-x, b}));
    EXPECT_LT((pose.tool - Vector3d{x + 0.5 + 0.3 * std::cos(b), 0.0, 0.7 + 0.3 * std::sin(b)}).norm(), 1e-13);
    Eigen::Matrix2d M;
    M << 3.5, 1.5 * 0.1 * std::sin(b), 1.5 * 0.1 * std::sin(b), 0.03 + 1.5 * 0.01;
    EXPECT_LT((arm.inertia(pose) - M).cwiseAbs().maxCoeff(), 1e-13);
    EXPECT_LT((arm.gravity_torque(pose, kGravity) - Eigen::Vector2d{0.0, 1.5 * 0.1 * 9.81 * std::cos(b)}).norm(),
              1e-13);
  }
}

/// n links, each on a slide or a turning joint along x, y or z, there or back; `side` -1: the mirror image in the plane y = 0.
std::string on_rails(int n, double side = 1.0) {
  std::string text = "<robot name='rails'><link name='l0'/>";
  for (int i = 1; i <= n; ++i) {
    const bool slides = i % 3 == 1;
    Vector3d axis = (i % 2 == 0 ? -1.0 : 1.0) * Vector3d::Unit(i % 3);
    // A mirror turns rotations the other way round.
    axis.y() *= side;
    if (!slides) axis *= side;
    text += fmt::format(
        "<link name='l{}'><inertial><origin xyz='0.1 {} 0.05'/><mass value='{}'/><inertia ixx='0.02' iyy='0.03' "
        "izz='0.04' "
        "ixy='{}' ixz='0.002' iyz='{}'/></inertial></link><joint name='j{}' type='{}'><parent link='l{}'/><child "
        "link='l{}'/>"
        "<origin xyz='0.2 {} 0.3' rpy='{} 0.5 {}'/><axis xyz='{} {} {}'/><limit lower='-3' upper='3' effort='1' "
        "velocity='1'/>"
        "</joint>",
        i, side * 0.07, 1 + i, side * 0.003, side * 0.001, i, slides ? "prismatic" : "revolute", i - 1, i, side * 0.1,
        side * 0.4, side * 0.3 * i, axis.x(), axis.y(), axis.z());
  }
  return text + "</robot>";
}

TEST(Urdf, OfMirroredArmsMovesAndWeighsAsMirrored) {
  const ArmModel left{load(on_rails(8))}, right{load(on_rails(8, -1.0))};
  const Eigen::Matrix3d mirror = Vector3d{1, -1, 1}.asDiagonal();
  std::mt19937_64 rng{1};
  for (int k = 0; k < 20; ++k) {
    ArmModel::Joints q{8}, v{8};
    for (int i = 0; i < 8; ++i)
      q[i] = 1e-19 * static_cast<double>(rng() >> 2), v[i] = 1e-19 * static_cast<double>(rng() >> 2);
    const ArmModel::Pose l = left.pose(q), r = right.pose(q);
    EXPECT_LT((r.tool - mirror * l.tool).norm(), 1e-13);
    EXPECT_LT((r.tool_rotation - mirror * l.tool_rotation * mirror).norm(), 1e-13);
    const ArmModel::Jacobian a = left.jacobian(l), b = right.jacobian(r);
    EXPECT_LT((b.topRows<3>() - mirror * a.topRows<3>()).norm(), 1e-12);
    EXPECT_LT((b.bottomRows<3>() + mirror * a.bottomRows<3>()).norm(), 1e-13);
    EXPECT_LT((right.inertia(r) - left.inertia(l)).cwiseAbs().maxCoeff(), 1e-10);
    EXPECT_LT((right.bias_torque(r, v, kGravity) - left.bias_torque(l, v, kGravity)).cwiseAbs().maxCoeff(), 1e-10);
  }
}

// ---- in a scene

std::string scene_of(const std::string& file, const std::string& more) {
  return "dof: 6 duration_s: 1 robot { arm { file: \"" + file + "\" " + more + " } }";
}
const std::string kSix = TWOPORT_ARMS "/six_joints.urdf", kStart = "joint_position_rad: [0, -0.6, 1.6, 0.6, -1.5, 0] ";

TEST(SceneOfAUrdf, TakesFrictionOfTheFileUnlessItGivesItsOwn) {
  const auto joints = [](const std::string& more) {
    return parse_scene(scene_of(kSix, kStart + more), "scene").robot.value().arm.value().parameters->joints;
  };
  EXPECT_EQ(joints("")[0].damping, 2.0);
  EXPECT_EQ(joints("")[5].coulomb_friction, 0.2);
  EXPECT_EQ(joints("joint_damping_n_m_s_per_rad: 3")[5].damping, 3.0);
  EXPECT_EQ(joints("joint_coulomb_friction_n_m: [0, 0, 0, 0, 0, 4]")[5].coulomb_friction, 4.0);
}

// ---- shapes

/// <visual>, or what `element` says, of a link; the place as "x y z", then rolls, pitches and yaws.
std::string drawn(const std::string& geometry, const std::string& xyz = "0 0 0", const std::string& rpy = "0 0 0",
                  const std::string& element = "visual") {
  return fmt::format("<{0}><origin xyz='{1}' rpy='{2}'/><geometry>{3}</geometry></{0}>", element, xyz, rpy, geometry);
}
/// Two links whose `base`, `upper` and `tool` are drawn.
std::string drawn_links(const std::string& base, const std::string& upper, const std::string& tool) {
  std::string text = two_links();
  const auto put = [&](const std::string& into, const std::string& what, const std::string& end) {
    const std::size_t at = text.find(into);
    text.replace(at, into.size(), into.substr(0, into.size() - end.size()) + ">" + what + "</link>");
  };
  put("<link name='base'/>", base, "/>");
  put("<link name='tool'/>", tool, "/>");
  const std::string in = "<link name='upper'>";
  return text.insert(text.find(in) + in.size(), upper);
}
Vector3d mean(const TriangleMesh& mesh) {
  Vector3d sum = Vector3d::Zero();
  for (const Vector3d& v : mesh.vertices) sum += v / static_cast<double>(mesh.vertices.size());
  return sum;
}
constexpr const char* kTetrahedron = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";

TEST(ShapesOfAUrdf, StandInTheAxesOfTheirLinks) {
  const test::Folder folder;
  write_whole(folder / "pack/meshes/part.obj", kTetrahedron);
  write_whole(folder / "pack/urdf/arm.urdf",
              drawn_links(drawn("<box size='0.1 0.2 0.3'/>", "1 2 3", "0 0 1.5707963267948966"),
                          drawn("<cylinder radius='0.1' length='0.4'/>", "0.2 0 0.05"),
                          drawn("<mesh filename='package://pack/meshes/part.obj' scale='0.1 0.1 -0.2'/>", "0 0 0.01")));
  const std::string file = folder / "pack/urdf/arm.urdf";
  const ShownArm shapes = load_arm_shapes(file);
  const ArmParameters arm = load_arm(file);
  ASSERT_EQ(shapes.links.size(), 3U);
  EXPECT_TRUE(shapes.left_out.empty());
  for (const TriangleMesh& mesh : shapes.links) EXPECT_TRUE(faults_of(mesh).none());
  EXPECT_NEAR(faults_of(shapes.links[0]).volume_m3, 0.006, 1e-15);
  EXPECT_NEAR(faults_of(shapes.links[1]).volume_m3, 0.004 * std::numbers::pi, 1e-4);
  EXPECT_NEAR(faults_of(shapes.links[2]).volume_m3, 0.002 / 6, 1e-15);
  // At joint positions 0, in axes of the base.
  const auto& [a, b] = std::tie(arm.joints[0], arm.joints[1]);
  EXPECT_LT((mean(shapes.links[0]) - Vector3d{1, 2, 3}).norm(), 1e-12);
  Eigen::AlignedBox3d box;
  for (const Vector3d& v : shapes.links[0].vertices) box.extend(v);
  EXPECT_LT((box.sizes() - Vector3d{0.2, 0.1, 0.3}).norm(), 1e-12);  // turned by a right angle
  const auto upper = [&, a = a](const Vector3d& p) { return Vector3d{a.origin_m + a.rotation * p}; };
  EXPECT_LT((upper(mean(shapes.links[1])) - Vector3d{0.2, 0, 0.75}).norm(), 1e-12);
  const auto lower = [&, b = b](const Vector3d& p) { return upper(b.origin_m + b.rotation * p); };
  // The tool is fixed to the lower link, 0.3 before it.
  EXPECT_LT((lower(mean(shapes.links[2])) - Vector3d{0.8 + 0.025, 0.025, 0.71 - 0.05}).norm(), 1e-12);
}

TEST(ShapesOfAUrdf, AreFoundWhereTheUrdfSays) {
  const test::Folder folder;
  const auto found = [&](const std::string& at, const std::string& named) {
    write_whole(folder / at, kTetrahedron);
    write_whole(folder / "some_robot/urdf/arm.urdf", drawn_links("", drawn("<mesh filename='" + named + "'/>"), ""));
    const ShownArm shapes = load_arm_shapes(folder / "some_robot/urdf/arm.urdf");
    std::filesystem::remove(folder / at);
    return shapes.left_out.empty() && shapes.links[1].triangles.size() == 4;
  };
  EXPECT_TRUE(found("some_robot/meshes/a.obj", "package://some_robot/meshes/a.obj"));
  EXPECT_TRUE(found("other/meshes/a.obj", "package://other/meshes/a.obj"));
  EXPECT_TRUE(found("some_robot/urdf/meshes/a.obj", "package://elsewhere/meshes/a.obj"));
  EXPECT_TRUE(found("some_robot/urdf/a.OBJ", "package://elsewhere/meshes/a.OBJ"));
  EXPECT_TRUE(found("some_robot/meshes/a.obj", "../meshes/a.obj"));
  EXPECT_TRUE(found("some_robot/a.obj", "file://" + folder / "some_robot/a.obj"));
  EXPECT_FALSE(found("some_robot/meshes/a.obj", "package://other/meshes/a.obj"));
}

TEST(ShapesOfAUrdf, AreSaidToBeLeftOut) {
  const test::Folder folder;
  write_whole(folder / "broken.stl", "solid");
  write_whole(folder / "good.obj", kTetrahedron);
  const auto left_out = [&](const std::string& upper) {
    write_whole(folder / "arm.urdf", drawn_links("", upper, ""));
    const ShownArm shapes = load_arm_shapes(folder / "arm.urdf");
    return fmt::format("{} {}", shapes.links[1].triangles.size(), fmt::join(shapes.left_out, "|"));
  };
  const std::string dae = drawn("<mesh filename='a.dae'/>"), ball = "<sphere radius='1'/>";
  EXPECT_EQ(left_out(dae), "0 Link \"upper\" is drawn without its shape: a.dae is neither STL nor OBJ.");
  EXPECT_EQ(left_out(dae + drawn(ball, "0 0 0", "0 0 0", "collision")),
            "528 Link \"upper\" is drawn by its collision shape: a.dae is neither STL nor OBJ.");
  EXPECT_EQ(left_out(dae + drawn("<mesh filename='b.dae'/>", "0 0 0", "0 0 0", "collision")),
            "0 Link \"upper\" is drawn without its shape: a.dae is neither STL nor OBJ.");
  EXPECT_NE(left_out(drawn("<mesh filename='nowhere.stl'/>")).find("nowhere.stl: no such file"), std::string::npos);
  EXPECT_NE(left_out(drawn("<mesh filename='broken.stl'/>")).find("broken.stl"), std::string::npos);
  EXPECT_NE(left_out(drawn("<mesh filename='good.obj' scale='1 0 1'/>")).find("the scale 1 0 1; none may be 0"),
            std::string::npos);
  EXPECT_NE(left_out(drawn("<sphere radius='1e9'/>")).find("reaches beyond 1e6 m"), std::string::npos);
  for (const char* odd :
       {"package:///.stl", "package://a.stl", "model://../../a.stl", "file://.stl", "x://a.stl", "a.stl/"})
    EXPECT_EQ(left_out(drawn(fmt::format("<mesh filename='{}'/>", odd))).substr(0, 8), "0 Link \"") << odd;
}

/// Those with many triangles share what the others leave.
TEST(ShapesOfAUrdf, HaveSoManyTrianglesAsAPictureTakes) {
  const ShownArm arm = shown_arm(parse_scene(scene_of(TWOPORT_ARMS "/../tests/page/arm.urdf", kStart), "scene"));
  ASSERT_EQ(arm.links.size(), 7U);
  std::size_t all = 0;
  for (const TriangleMesh& mesh : arm.links) all += mesh.triangles.size();
  EXPECT_LE(all, kMostShownTriangles);
  EXPECT_GT(arm.links[0].triangles.size(), 3000U);
  EXPECT_TRUE(shown_arm(parse_scene(scene_of(kSix, kStart), "scene")).links.at(1).triangles.empty());
}

// ---- in an arm's file

ArmParameters described(const std::string& text) {
  const std::string path = test::own_folder() / "described.textproto";
  write_whole(path, text);
  return load_arm(path);
}
const std::string kSeven =
    "urdf: \"" TWOPORT_ARMS "/seven_joints.urdf\" ready_position_rad: [0, 0.6, 0, -1.4, 0, 1.1, 0] ";

TEST(ArmFileOfAUrdf, AddsWhatAUrdfCannotSay) {
  const ArmParameters arm = described(kSeven +
                                      "tip: \"grasp\" joint_rotor_inertia_kg_m2: [1, 2, 3, 4, 5, 6, 7] "
                                      "joint_max_torque_n_m: [7, 6, 5, 4, 3, 2, 1]"),
                      bare = load_arm(TWOPORT_ARMS "/seven_joints.urdf", "grasp");
  ASSERT_EQ(arm.joints.size(), 7U);
  for (std::size_t i = 0; i < 7; ++i) {
    EXPECT_EQ(arm.joints[i].rotor_inertia, static_cast<double>(i + 1));
    EXPECT_EQ(bare.joints[i].rotor_inertia, 0.0);
    EXPECT_EQ(arm.joints[i].max_effort, static_cast<double>(7 - i));
    EXPECT_EQ(arm.joints[i].inertia, bare.joints[i].inertia);
  }
  EXPECT_EQ(arm.flange_m, bare.flange_m);
  EXPECT_EQ(arm.ready_position[3], -1.4);
  EXPECT_EQ(
      parse_scene(scene_of(TWOPORT_ARMS "/seven_joints.textproto", ""), "scene").robot->arm->joint_position_rad[3],
      -1.4);
}

// ---- what is said of files

std::string error_of(const std::function<void()>& what) {
  try {
    what();
  } catch (const ConfigError& e) {
    return e.what();
  }
  return "";
}
std::string changed(const std::string& from, const std::string& to, const std::string& more = "") {
  std::string text = two_links(more);
  const std::size_t at = text.find(from);
  EXPECT_NE(at, text.npos) << from;
  return text.replace(at, from.size(), to);
}
constexpr const char* kLimit = "<limit lower='-3' upper='3' effort='50' velocity='2'/>";

std::string nested(int levels) {
  std::string all;
  for (int i = 0; i < levels; ++i) all += "<a>";
  for (int i = 0; i < levels; ++i) all += "</a>";
  return all + "</robot>";
}

/// Shapes with errors are no matter of kinematics.
TEST(Urdf, ReadsAnArmWhoseShapesAreBroken) {
  const ArmParameters whole = load(two_links()),
                      broken = load(changed("<link name='tool'/>",
                                            "<link name='tool'><visual><geometry/></visual><visual/><collision>"
                                            "<geometry><sphere radius='a'/></geometry></collision></link>"));
  EXPECT_EQ(broken.joints.size(), whole.joints.size());
  EXPECT_EQ(broken.joints.back().mass_kg, whole.joints.back().mass_kg);
  // Words of comments, quoted text and character data are no elements, and take nothing with them.
  std::string many = "<!-- ";
  for (int i = 0; i < 200; ++i) many += "<p> a < b ";
  const ArmParameters commented = load(
      changed("<link name='tool'/>",
              many + "<visual> --><link name='tool'><!-- <collision> is coarse --><inertial><mass value='5'/><inertia "
                     "ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial><visual name='a/>b'><visual/>"
                     "</visual><![CDATA[ <visual> ]]></link><!-- </visual> -->"));
  EXPECT_EQ(commented.joints.back().mass_kg, whole.joints.back().mass_kg + 5.0);
}

TEST(Urdf, SaysWhatIsWrongWithAFile) {
  struct Wrong {
    std::string text, tip, words;
  };
  const std::string branch =
      "<link name='camera'/><joint name='mount' type='fixed'><parent link='upper'/><child link='camera'/></joint>";
  for (const auto& [text, tip, words] : std::vector<Wrong>{
           {"<robot name='x'>\n<link name='a'>\n</robot>", "", ":3: no well-formed XML"},
           {"name: \"fr3\"", "", "no well-formed XML"},
           {"<mujoco/>", "", "obot"},
           {"<robot name='x' xmlns:xacro='y'><xacro:arm/></robot>", "", "these are macros; expand them first"},
           {two_links(branch), "", "2 links have no children: camera, tool; name the tip by --tip"},
           {two_links(branch + "<link name='world_frame'/><joint name='w' type='fixed'><parent link='base'/><child "
                               "link='world_frame'/></joint>"),
            "", "2 links have no children: camera, tool; name the tip by --tip"},
           {two_links(), "toll", "the tip is \"toll\", but there is no link of this name; did you mean tool"},
           {two_links(), "base", "link \"base\" is the tip, but no joint moves it"},
           {changed("type='revolute'", "type='floating'"), "",
            "joint \"a\" is floating; an arm has revolute, continuous, prismatic and fixed joints"},
           {on_rails(9), "",
            "link \"l9\" is the tip, and 9 joints move it: j1, j2, j3, j4, j5, j6, j7, j8, j9; an arm must have 1 to "
            "8"},
           {changed("type='revolute'", "type='planar'"), "", "joint \"a\" is planar"},
           {changed("type='revolute'", "type='ball'"), "", "ball"},
           {changed(kLimit, ""), "", "[a]"},
           {changed(kLimit, "<limit lower='3' upper='-3' effort='50' velocity='2'/>"), "",
            "joint \"a\" has the limits 3 and -3; lower must be < upper"},
           {changed("effort='50'", "effort='-1'"), "", "joint \"a\" has the effort -1; it must be >= 0"},
           {changed("velocity='2'", "velocity='-2'"), "", "joint \"a\" has the velocity -2; it must be >= 0"},
           {changed("damping='0.7'", "damping='-0.7'"), "", "joint \"a\" has the damping -0.7; it must be >= 0"},
           {changed("friction='0.2'", "friction='-2'"), "", "joint \"a\" has the friction -2; it must be >= 0"},
           {changed("<axis xyz='0 -1 0'/>", "<axis xyz='0 0 0'/>"), "",
            "joint \"a\" has the axis 0 0 0; it must have a direction"},
           {changed(kLimit, std::string{kLimit} + "<mimic joint='b'/>"), "", "joint \"a\" mimics joint \"b\""},
           {changed("<mass value='1.5'/>", "<mass value='-1.5'/>"), "",
            "link \"lower\" has the mass -1.5; it must be >= 0"},
           {changed("<mass value='1.5'/>", "<mass value='0'/>"), "",
            "link \"lower\" moves with joint \"b\" and has no mass"},
           {changed("<link name='tool'/>", "<link name='tool'/>")
                .replace(two_links().find("<link name='lower'>"),
                         two_links().find("<link name='tool'/>") - two_links().find("<link name='lower'>"),
                         "<link name='lower'/>"),
            "",
            "link \"lower\" moves with joint \"b\" and has no mass: neither it nor a link fixed to it has an "
            "<inertial>"},
           {changed("izz='0.02'", "izz='2'"), "",
            "link \"upper\" has, with what is fixed to it, an inertia that must keep the triangle inequality: no "
            "principal moment exceeds the sum of the other two by more than 5 %, and 2 exceeds 0.02 + 0.03 kg m² by "
            "3.9e+03 %"},
           {changed("ixx='0.02'", "ixx='-0.02'"), "",
            "link \"upper\" has, with what is fixed to it, an inertia that must be positive definite: no principal "
            "moment "
            "is below 0, and one is -0.02 kg m²"},
           {changed("<child link='upper'/>", "<child link='uper'/>"), "", "uper"},
           {changed("<parent link='base'/>", "<parent link='bass'/>"), "", "bass"},
           {changed("<parent link='base'/>", ""), "", "a"},
           {changed("<link name='base'/>", "<link name='base'/><link name='base'/>"), "", "base"},
           {changed("joint name='b'", "joint name='a'"), "", "'a'"},
           {two_links("<link name='lone'/>"), "", "lone"},
           {two_links("<joint name='d' type='fixed'><parent link='base'/><child link='lower'/></joint>"), "",
            "joint \"d\" and joint \"b\" both move link \"lower\"; an arm has no loops"},
           {two_links("<link name='x'/><link name='y'/><joint name='d' type='fixed'><parent link='x'/><child "
                      "link='y'/></joint>"
                      "<joint name='e' type='fixed'><parent link='y'/><child link='x'/></joint>"),
            "tool", "hangs on a loop of joints; an arm has no loops"},
           {two_links("<joint name='d' type='fixed'><parent link='tool'/><child link='base'/></joint>"), "",
            "no one link is the root"},
           {"<robot><!-- </a></a> -->" + nested(20000), "", "has elements in more than 100 levels"},
           {changed("xyz='0 0 0.7'", "xyz='0 0 zero'"), "", "zero"},
           {changed("xyz='0 0 0.7'", "xyz='0 0 nan'"), "", "a"},
           {two_links("<link name='f'/><joint name='d' type='prismatic'><parent link='lower'/><child link='f'/><mimic "
                      "joint='nobody'/>" +
                      std::string{kLimit} + "</joint>"),
            "tool", "joint \"d\" mimics joint \"nobody\", which there is not"},
       }) {
    const std::string error = error_of([&, text = text, tip = tip] { load(text, tip); });
    EXPECT_NE(error.find(words), std::string::npos) << words << "\nsays\n" << error << "\nof\n" << text;
    EXPECT_NE(error.find("arm_of_a_test.urdf"), std::string::npos) << error;
  }
  // The line of the element that is named.
  std::string lines = changed("type='revolute'", "type='planar'");
  for (std::size_t at = lines.find("><"); at != lines.npos; at = lines.find("><")) lines.replace(at, 2, ">\n<");
  const std::size_t joint = lines.find("<joint name='a'");
  const auto line = 1 + std::count(lines.begin(), lines.begin() + static_cast<std::ptrdiff_t>(joint), '\n');
  EXPECT_NE(error_of([&] { load(lines); }).find(fmt::format("arm_of_a_test.urdf:{}: joint \"a\" is planar", line)),
            std::string::npos)
      << error_of([&] { load(lines); });
}

/// The second finger of a gripper whose first one is a joint of the arm.
TEST(Urdf, HoldsAMimicBesideThePathWhereItsJointIsHeld) {
  const auto finger = [](const std::string& mimic) {
    return load(
        two_links("<link name='f'><inertial><mass value='0.3'/><inertia ixx='1e-3' iyy='1e-3' izz='1e-3' ixy='0' "
                  "ixz='0' iyz='0'/></inertial></link><joint name='d' type='prismatic'><parent link='lower'/><child "
                  "link='f'/><axis xyz='1 0 0'/>" +
                  mimic + std::string{kLimit} + "</joint>"),
        "tool");
  };
  const ArmParameters arm = finger("<mimic joint='b' multiplier='-1' offset='0.02'/>"), still = finger("");
  EXPECT_EQ(arm.joints.size(), still.joints.size());
  const double moved_m = 0.02 * 0.3 / arm.joints.back().mass_kg;
  EXPECT_NEAR((arm.joints.back().center_m - still.joints.back().center_m).norm(), moved_m, 1e-12);
}

/// As base beside tool0 in the descriptions of industrial arms.
TEST(Urdf, TakesNoFrameAtTheBaseForTheTip) {
  const ArmParameters alone = load(two_links());
  for (const char* chain : {"base", "frame"}) {
    const std::string frame =
        std::string{
            "<link name='frame'/><joint name='f' type='fixed'><parent link='base'/><child "
            "link='frame'/></joint>"} +
        "<link name='end'/><joint name='e' type='fixed'><parent link='" + chain + "'/><child link='end'/></joint>";
    const ArmParameters arm = load(two_links(frame));
    EXPECT_EQ(arm.joints.size(), alone.joints.size());
    EXPECT_EQ(arm.flange_m, alone.flange_m);
  }
}

/// The line of a number with a comma, or a word.
TEST(Urdf, NamesTheLineOfWhatIsNoNumber) {
  for (const auto& [from, to] : {std::pair{"ixx='0.02'", "ixx='0,02'"},
                                 {"<mass value='1.5'/>", "<mass value='1,5'/>"},
                                 {"effort='50'", "effort='fifty'"},
                                 {"xyz='0 0 0.7'", "xyz='0 0 0,7'"}}) {
    std::string lines = changed(from, to);
    for (std::size_t at = lines.find("><"); at != lines.npos; at = lines.find("><")) lines.replace(at, 2, ">\n<");
    const auto line = 1 + std::count(lines.begin(), lines.begin() + static_cast<std::ptrdiff_t>(lines.find(to)), '\n');
    const std::string error = error_of([&] { load(lines); });
    EXPECT_NE(error.find(fmt::format("arm_of_a_test.urdf:{}: ", line)), std::string::npos) << to << ": " << error;
  }
}

TEST(ArmFileOfAUrdf, SaysWhatIsWrong) {
  const auto expect = [](const std::string& text, const std::string& words) {
    const std::string error = error_of([&] { described(text); });
    EXPECT_NE(error.find(words), std::string::npos) << error;
  };
  const std::string with = kSeven + "tip: \"grasp\" ";
  expect(kSeven, "3 links have no children: finger_left, finger_right, grasp");
  expect(kSeven + "tip: \"hnd\"", "the tip is \"hnd\", but there is no link of this name; did you mean hand");
  expect(with + "flange_m: [0, 0, 1]", "flange_m is given, but so is urdf, which has it");
  expect(with +
             "joint { origin_m: [0, 0, 1] mass_kg: 1 center_m: [0, 0, 0] inertia_kg_m2: [1, 1, 1] max_torque_n_m: 1 "
             "max_speed_rad_per_s: 1 lower_rad: 0 upper_rad: 1 }",
         "joint is given, but so is urdf");
  expect(with + "joint_rotor_inertia_kg_m2: [1]", "joint_rotor_inertia_kg_m2 is [1]; it must hold 7 numbers");
  expect(with + "joint_rotor_inertia_kg_m2: [1, 1, 1, 1, 1, 1, -1]", "joint_rotor_inertia_kg_m2");
  expect("urdf: \"nowhere.urdf\"", "nowhere.urdf");
  expect("tip: \"x\"", "the tip \"x\" is named, but only links of a URDF have names");
  expect("joint_rotor_inertia_kg_m2: [1]", "joint_rotor_inertia_kg_m2 is given without urdf");
  expect(with + "joint_max_torque_n_m: [1]", "joint_max_torque_n_m is [1]; it must hold 7 numbers");
  expect(with + "joint_max_torque_n_m: [1, 1, 1, 1, 1, 1, 0]", "joint_max_torque_n_m");
  expect("joint_max_torque_n_m: [1]", "joint_max_torque_n_m is given without urdf");
}

TEST(SceneOfAUrdf, SaysWhatItLacks) {
  const auto error = [](const std::string& file, const std::string& more) {
    return error_of([&] { parse_scene(scene_of(file, more), "scene"); });
  };
  EXPECT_EQ(error(kSix, kStart), "");
  const std::string beside = test::own_folder() / "beside.textproto";
  write_whole(beside, "urdf: \"" + kSix + "\"");
  for (const std::string& file : {kSix, beside}) {
    EXPECT_EQ(error(file, kStart), "");
    EXPECT_NE(error(file, "").find(
                  "robot.arm.joint_position_rad is missing; it must hold 6 numbers: the arm's file names none"),
              std::string::npos)
        << error(file, "");
  }
  EXPECT_NE(error("pandda", "").find("pandda: no such file, and no arm of this name; did you mean panda"),
            std::string::npos)
      << error("pandda", "");
  const auto arm = [&](const std::string& text) {
    const std::string path = test::own_folder() / "other.urdf";
    write_whole(path, text);
    return error(path, kStart);
  };
  EXPECT_NE(arm(two_links()).find("an arm must have 6 to 8 joints, or the scene space JOINTS; this one has 2"),
            std::string::npos)
      << arm(two_links());
  std::string weak = read_whole(kSix), damped = weak;
  weak.replace(weak.find("effort=\"150\""), 12, "effort=\"0\"");
  damped.replace(damped.find("damping=\"2\""), 11, "damping=\"301\"");
  EXPECT_NE(
      arm(weak).find(
          "joint \"shoulder_pan\" has the effort 0; in a scene it must be > 0: give joint_max_torque_n_m in a file "
          "beside the URDF that names it"),
      std::string::npos)
      << arm(weak);
  EXPECT_NE(arm(damped).find("joint \"shoulder_pan\" has the damping 301; in a scene it must be at most 300"),
            std::string::npos)
      << arm(damped);
}

}  // namespace
}  // namespace twoport::urdf_test
