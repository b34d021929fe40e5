#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "common/contact/environment.h"
#include "tests/support/meshes.h"
#include "tests/support/source.h"

namespace twoport::clearance_test {
namespace {

using Eigen::Vector3d;
using test::Source;

std::vector<Shape> shapes() {
  const Vector3d place{0.01, -0.02, 0.005}, axis = Vector3d{1, 2, 2} / 3;
  const Eigen::Matrix3d turned = Eigen::Quaterniond{0.8, 0.2, -0.4, 0.4}.normalized().toRotationMatrix();
  const auto holes = std::make_shared<const std::vector<PlateHole>>(
      std::vector<PlateHole>{{{-0.02, 0.0}, 0.012}, {{0.02, 0.005}, 0.006}});
  return {Wall{axis, 0.01},
          Sphere{place, 0.03},
          Cylinder{place, axis, 0.02},
          Box{place, {0.02, 0.03, 0.01}},
          Torus{place, axis, 0.03, 0.01},
          Capsule{place, place + 0.04 * axis, 0.015},
          Peg::of(place, axis, 0.02, 0.05, 0.004),
          Hole::of(place, axis, 0.02, 0.03, 0.003),
          Cone::of(place, axis, 0.03, 0.05),
          Plate{place, turned, {0.05, 0.03, 0.01}, holes},
          Mesh{place, turned, std::make_shared<const DistanceField>(test::torus_mesh(0.03, 0.01, 40, 16), 2e-3)}};
}

/// A tool that wanders: slowly, with turns about its origin, at times back to where it was, at times far away at once.
class Wandering {
 public:
  explicit Wandering(Source& random) : random_{random} {}
  Position<6> next() {
    if (random_.uniform(0, 1) < 0.02)
      x_ = random_.vector<3>(0.06), way_ = random_.vector<3>(2e-3), turn_ = random_.vector<3>(0.05);
    if (random_.uniform(0, 1) < 0.1) way_ = random_.vector<3>(2e-3), turn_ = random_.vector<3>(0.05);
    if (random_.uniform(0, 1) < 0.1) way_ = -way_, turn_ = -turn_;
    const Position<6> to = Position<6>{x_, q_}.moved(way_, turn_);
    x_ = to.translation(), q_ = to.attitude();
    return to;
  }

 private:
  Source& random_;
  Vector3d x_ = Vector3d::Zero(), way_ = Vector3d::Zero(), turn_ = Vector3d::Zero();
  Eigen::Quaterniond q_ = Eigen::Quaterniond::Identity();
};

class ClearanceOf : public ::testing::TestWithParam<std::size_t> {};

TEST_P(ClearanceOf, ForceIsThatOfAllContactsToTheBit) {
  Source random{41};
  const Shape shape = shapes()[GetParam()];
  int touched = 0;
  for (int tool = 0; tool < 20; ++tool) {
    std::vector<Vector3d> points;
    for (int i = 0; i < 1 + tool; ++i) points.push_back(random.vector<3>(0.03));
    std::vector<EnvironmentSpec> things{Surface{shape, {3000, 10, 0.3, 0}}};
    if (tool % 4 == 1) things.push_back(Surface{Wall{Vector3d::UnitZ(), -0.03}, {2000, 0, 0, 0}});
    if (tool % 4 == 2) things.push_back(Spring{100, 1, {0, 0, 0.1}, {}, tool % 3 - 1});
    const Environment<6> environment{things, points};
    Clearance clearance = environment.clearance();
    Wandering wandering{random};
    for (int k = 0; k < 2000; ++k) {
      const Position<6> x = wandering.next();
      const Velocity<6> v{SpatialVector{random.vector<3>(0.1), random.vector<3>(0.5)}};
      const Force<6> all = environment.force(x, v);
      SpatialVector sum = SpatialVector::Zero();
      environment.for_each_contact(x, port_vector<6>(v.vec()), clearance, [&](const ContactPort<6>& c) {
        if (c.presses) sum += c.normal + c.tangential;
      });
      touched += all.squared_norm() > 0.0;
      ASSERT_EQ(Force<6>{sum}.vec(), all.vec()) << name(shape) << ", tool " << tool << ", step " << k;
    }
  }
  EXPECT_GT(touched, 2000);
}

INSTANTIATE_TEST_SUITE_P(Shapes, ClearanceOf, ::testing::Range<std::size_t>(0, shapes().size()),
                         [](const auto& of) { return std::string{name(shapes()[of.param])}; });

TEST(Clearance, HoldsForTheWholeDistanceAndNoFurther) {
  const std::vector<Vector3d> tool{{0.3, 0, 0}, {0, 0.1, 0}};
  Clearance clearance{tool, 2};
  clearance.move_to(Vector3d::Zero(), Eigen::Matrix3d::Identity());
  EXPECT_FALSE(clearance.open(0, 1));  // not measured
  clearance.measured(0, 0.01);
  clearance.measured(1, 0.02);
  clearance.move_to({0, 0.00999, 0}, Eigen::Matrix3d::Identity());
  EXPECT_TRUE(clearance.open(0, 2));
  clearance.move_to({0, 0.01001, 0}, Eigen::Matrix3d::Identity());
  EXPECT_FALSE(clearance.open(0, 1));
  EXPECT_TRUE(clearance.open(1, 1));
  EXPECT_FALSE(clearance.open(0, 2));
  // A turn moves the outermost point by the chord.
  clearance.measured(0, 0.03);
  const double angle = 2.0 * std::asin(0.5 * 0.03 / 0.3);
  clearance.move_to({0, 0.01001, 0}, Eigen::AngleAxisd{0.999 * angle, Vector3d::UnitZ()}.toRotationMatrix());
  EXPECT_TRUE(clearance.open(0, 1));
  clearance.move_to({0, 0.01001, 0}, Eigen::AngleAxisd{1.001 * angle, Vector3d::UnitZ()}.toRotationMatrix());
  EXPECT_FALSE(clearance.open(0, 1));
}
TEST(Clearance, IsForgottenAtAPoseThatIsNotFinite) {
  Clearance clearance{{{0.1, 0, 0}}, 1};
  clearance.move_to(Vector3d::Zero(), Eigen::Matrix3d::Identity());
  clearance.measured(0, 1.0);
  clearance.move_to(Vector3d::Constant(std::nan("")), Eigen::Matrix3d::Identity());
  EXPECT_FALSE(clearance.open(0, 1));
  clearance.measured(0, std::nan(""));
  EXPECT_FALSE(clearance.open(0, 1));
}

}  // namespace
}  // namespace twoport::clearance_test
