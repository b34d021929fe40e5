// The work of a contact around a closed loop, for every shape: the elastic force has a potential.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include "common/contact/environment.h"
#include "tests/support/meshes.h"
#include "tests/support/source.h"

namespace twoport::loop_work_test {
namespace {

using Eigen::Vector3d;
using test::Source;

const Vector3d kAxis = Vector3d{1, 2, 2} / 3;

/// One of every shape, about the origin and some centimetres large.
std::vector<Shape> shapes() {
  const auto holes = std::make_shared<const std::vector<PlateHole>>(
      std::vector<PlateHole>{{{-0.02, 0.0}, 0.012}, {{0.02, 0.005}, 0.006}});
  const auto field = std::make_shared<const DistanceField>(test::torus_mesh(0.03, 0.012, 60, 24), 1e-3);
  const Eigen::Matrix3d turned = Eigen::Quaterniond{0.8, 0.2, -0.4, 0.4}.normalized().toRotationMatrix();
  return {Wall{kAxis, 0.0},
          Sphere{Vector3d::Zero(), 0.03},
          Cylinder{Vector3d::Zero(), kAxis, 0.02},
          Box{Vector3d::Zero(), {0.03, 0.02, 0.025}},
          Torus{Vector3d::Zero(), kAxis, 0.03, 0.012},
          Capsule{-0.02 * kAxis, 0.02 * kAxis, 0.015},
          Peg::of(-0.025 * kAxis, kAxis, 0.02, 0.05, 0.004),
          Hole::of(Vector3d::Zero(), kAxis, 0.01, 0.02, 0.002),
          Cone::of(-0.025 * kAxis, kAxis, 0.025, 0.05),
          Plate{Vector3d::Zero(), turned, {0.04, 0.03, 0.008}, holes},
          Mesh{Vector3d::Zero(), turned, field}};
}

/// ∫ f ds from 0 to 1 by Simpson's rule, halved where that changes it: jumps of f are closed in on.
double integral(const std::function<double(double)>& f, double tolerance) {
  const auto part = [&](const auto& self, double a, double fa, double m, double fm, double b, double fb, double whole,
                        double allowed, int depth) -> double {
    const double l = 0.5 * (a + m), r = 0.5 * (m + b), fl = f(l), fr = f(r);
    const double left = (m - a) / 6 * (fa + 4 * fl + fm), right = (b - m) / 6 * (fm + 4 * fr + fb);
    const double off = left + right - whole;
    if (depth == 0 || std::abs(off) < allowed) return left + right + off / 15;
    return self(self, a, fa, l, fl, m, fm, left, 0.5 * allowed, depth - 1) +
           self(self, m, fm, r, fr, b, fb, right, 0.5 * allowed, depth - 1);
  };
  constexpr int kParts = 64;
  double sum = 0.0;
  for (int i = 0; i < kParts; ++i) {
    const double a = static_cast<double>(i) / kParts, b = static_cast<double>(i + 1) / kParts, m = 0.5 * (a + b);
    const double fa = f(a), fm = f(m), fb = f(b);
    sum += part(part, a, fa, m, fm, b, fb, (b - a) / 6 * (fa + 4 * fm + fb), tolerance / kParts, 40);
  }
  return sum;
}

constexpr double kStiffness = 5000.0, kAllowed_j = 1e-8;

TEST(WorkAroundALoop, IsNothingForAPointAndEveryShape) {
  // Ellipses of up to 50 mm through surfaces, edges and corners, and past where another face becomes the nearest.
  std::set<std::size_t> covered;
  for (const Shape& shape : shapes()) {
    covered.insert(shape.index());
    const Environment<3> environment{{Surface{shape, {kStiffness, 0, 0, 0}}}};
    Source source{31};
    double most = 0.0, stored = 0.0;
    for (int loop = 0; loop < 12; ++loop) {
      const Vector3d center = source.vector<3>(0.02), a = source.vector<3>(0.015), b = source.vector<3>(0.015);
      const double work = integral(
          [&](double s) {
            const double angle = 2 * std::numbers::pi * s;
            const Position<3> p{Vector3d{center + std::cos(angle) * a + std::sin(angle) * b}};
            const Vector3d rate = 2 * std::numbers::pi * (std::cos(angle) * b - std::sin(angle) * a);
            stored = std::max(stored, environment.potential(p).si());
            return environment.force(p, {}).vec().dot(rate);
          },
          1e-10);
      most = std::max(most, std::abs(work));
    }
    std::printf("%-9s %.2g J around a loop, %.2g J stored\n", name(shape), most, stored);
    EXPECT_LT(most, kAllowed_j) << name(shape);
    EXPECT_GT(stored, 0.05) << name(shape);
  }
  EXPECT_EQ(covered.size(), std::variant_size_v<Shape>);
}

TEST(WorkAroundALoop, IsNothingForAToolThatTurnsToo) {
  // Five points of a tool; the attitude goes around a loop as well. Power is w·(v, ω).
  const std::vector<Vector3d> tool{{0.01, 0, 0}, {-0.01, 0, 0}, {0, 0.012, 0}, {0, 0, 0.009}, {0, -0.006, -0.01}};
  for (const Shape& shape : shapes()) {
    const Environment<6> environment{{Surface{shape, {kStiffness, 0, 0, 0}}}, tool};
    Source source{31};
    double most = 0.0, stored = 0.0;
    for (int loop = 0; loop < 6; ++loop) {
      const Vector3d center = source.vector<3>(0.02), a = source.vector<3>(0.01), b = source.vector<3>(0.01),
                     axis = source.vector<3>(1.0).normalized(), other = source.vector<3>(1.0).normalized();
      const auto pose = [&](double s) {
        const double angle = 2 * std::numbers::pi * s;
        return Position<6>{center + std::cos(angle) * a + std::sin(angle) * b,
                           Eigen::AngleAxisd{0.5 * std::sin(angle), axis} *
                               Eigen::Quaterniond{Eigen::AngleAxisd{0.3 * std::cos(angle), other}}};
      };
      const double work = integral(
          [&](double s) {
            const double angle = 2 * std::numbers::pi * s;
            const Position<6> x = pose(s);
            const Vector3d v = 2 * std::numbers::pi * (std::cos(angle) * b - std::sin(angle) * a);
            const Vector3d w = 2 * std::numbers::pi *
                               (0.5 * std::cos(angle) * axis -
                                0.3 * std::sin(angle) * (Eigen::AngleAxisd{0.5 * std::sin(angle), axis} * other));
            stored = std::max(stored, environment.potential(x).si());
            const Force<6>::Vector f = environment.force(x, {}).vec();
            return f.head<3>().dot(v) + f.tail<3>().dot(w);
          },
          1e-10);
      most = std::max(most, std::abs(work));
    }
    std::printf("%-9s %.2g J around a loop, %.2g J stored\n", name(shape), most, stored);
    EXPECT_LT(most, kAllowed_j) << name(shape);
    EXPECT_GT(stored, 0.05) << name(shape);
  }
}

TEST(LoopWork, HasItsOwnGradientBeyondItsGridToo) {
  // Beyond a face, an edge and a corner of the grid. Its second derivative is at most 1/distance there.
  const DistanceField field{test::torus_mesh(0.03, 0.012, 60, 24), 1e-3};
  Source source{31};
  constexpr double h = 1e-6;
  int beyond = 0;
  for (int i = 0; i < 2000; ++i) {
    const Vector3d p = source.vector<3>(0.08);
    const auto at = field.at(p);
    if (at.distance < 2e-3) continue;
    ++beyond;
    for (int axis = 0; axis < 3; ++axis) {
      const Vector3d by = h * Vector3d::Unit(axis);
      ASSERT_NEAR((field.at(p + by).distance - field.at(p - by).distance) / (2 * h), at.gradient[axis], 1e-3)
          << p.transpose();
    }
  }
  EXPECT_GT(beyond, 1000);
}

}  // namespace
}  // namespace twoport::loop_work_test
