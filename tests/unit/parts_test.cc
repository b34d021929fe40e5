#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "common/contact/environment.h"
#include "common/contact/sample_shape.h"
#include "tests/support/source.h"

namespace twoport::parts_test {
namespace {

using Eigen::Vector3d;
using test::Source;

const Vector3d kPlace{0.01, -0.02, 0.005}, kAxis = Vector3d{1, 2, 2} / 3;

struct Part {
  const char* name;
  Shape shape;
  std::function<bool(const Vector3d&)> inside;  ///< of the definition, not of the distance
};
/// r and z about the axis through kPlace.
Eigen::Vector2d cylindrical(const Vector3d& p) {
  const double z = kAxis.dot(p - kPlace);
  return {(p - kPlace - z * kAxis).norm(), z};
}
Eigen::Matrix3d turned() {
  return Eigen::Quaterniond{0.8, 0.2, -0.4, 0.4}.normalized().toRotationMatrix();
}
std::vector<Part> parts() {
  const auto holes = std::make_shared<const std::vector<PlateHole>>(
      std::vector<PlateHole>{{{-0.02, 0.0}, 0.012}, {{0.02, 0.005}, 0.006}});
  return {
      {"torus", Torus{kPlace, kAxis, 0.03, 0.01},
       [](const Vector3d& p) {
         const auto q = cylindrical(p);
         return std::hypot(q.x() - 0.03, q.y()) < 0.01;
       }},
      {"capsule", Capsule{kPlace, kPlace + 0.04 * kAxis, 0.015},
       [](const Vector3d& p) {
         const auto q = cylindrical(p);
         return std::hypot(q.x(), q.y() - std::min(std::max(q.y(), 0.0), 0.04)) < 0.015;
       }},
      {"peg", Peg::of(kPlace, kAxis, 0.02, 0.05, 0.004),
       [](const Vector3d& p) {
         const auto q = cylindrical(p);
         return q.y() > 0 && q.y() < 0.05 && q.x() < 0.02 && q.x() < 0.016 + q.y();
       }},
      {"hole", Hole::of(kPlace, kAxis, 0.02, 0.03, 0.003),
       [](const Vector3d& p) {
         const auto q = cylindrical(p);
         return q.y() < 0 && !(q.x() < 0.02 && q.y() > -0.03) && !(q.x() < 0.023 + q.y());
       }},
      {"cone", Cone::of(kPlace, kAxis, 0.03, 0.05),
       [](const Vector3d& p) {
         const auto q = cylindrical(p);
         return q.y() < 0.05 && q.x() < 0.6 * q.y();
       }},
      {"plate", Plate{kPlace, turned(), {0.05, 0.03, 0.01}, holes},
       [](const Vector3d& p) {
         const Vector3d q = turned().transpose() * (p - kPlace);
         return std::abs(q.x()) < 0.05 && std::abs(q.y()) < 0.03 && std::abs(q.z()) < 0.01 &&
                (q.head<2>() - Eigen::Vector2d{-0.02, 0}).norm() > 0.012 &&
                (q.head<2>() - Eigen::Vector2d{0.02, 0.005}).norm() > 0.006;
       }},
  };
}

TEST(Part, IsInsideWhereItsDefinitionSaysSo) {
  for (const Part& part : parts()) {
    Source source{23};
    int inside = 0;
    for (int i = 0; i < 20'000; ++i) {
      const Vector3d p = kPlace + source.vector<3>(0.08);
      const double d = signed_distance<3>(part.shape, p).distance;
      if (std::abs(d) < 1e-12) continue;
      ASSERT_EQ(d < 0.0, part.inside(p)) << part.name << " at " << (p - kPlace).transpose() << ", distance " << d;
      inside += d < 0.0;
    }
    EXPECT_GT(inside, 50) << part.name;
  }
}

TEST(Part, HasADistanceOfUnitSlopeWithItsGradient) {
  // Where the nearest part of the surface is the same on both sides of the difference, h²/r² of a radius r of 1 mm: 1e-8.
  constexpr double h = 1e-7;
  for (const Part& part : parts()) {
    Source source{23};
    int compared = 0;
    for (int i = 0; i < 5000; ++i) {
      const Vector3d p = kPlace + source.vector<3>(0.08);
      const auto at = signed_distance<3>(part.shape, p);
      ASSERT_NEAR(at.normal.norm(), 1.0, 1e-12) << part.name;
      Vector3d slope;
      bool same = true;
      for (int axis = 0; axis < 3; ++axis) {
        const auto ahead = signed_distance<3>(part.shape, p + h * Vector3d::Unit(axis)),
                   back = signed_distance<3>(part.shape, p - h * Vector3d::Unit(axis));
        same = same && (ahead.normal - back.normal).norm() < 1e-3;
        slope[axis] = (ahead.distance - back.distance) / (2 * h);
      }
      if (!same) continue;
      ++compared;
      ASSERT_LT((slope - at.normal).norm(), 1e-6) << part.name << " at " << (p - kPlace).transpose();
    }
    EXPECT_GT(compared, 4500) << part.name;
  }
}

TEST(Part, HasItsDistanceToTheNearestPointOfItsSurface) {
  // From p by the distance against the normal lies a point of the surface: exact distances only have that everywhere.
  for (const Part& part : parts()) {
    Source source{23};
    for (int i = 0; i < 20'000; ++i) {
      const Vector3d p = kPlace + source.vector<3>(0.08);
      const auto at = signed_distance<3>(part.shape, p);
      ASSERT_NEAR(signed_distance<3>(part.shape, p - at.distance * at.normal).distance, 0.0, 1e-12)
          << part.name << " at " << (p - kPlace).transpose();
      // and none nearer: a distance changes by at most the way.
      const Vector3d q = kPlace + source.vector<3>(0.08);
      ASSERT_LE(std::abs(at.distance - signed_distance<3>(part.shape, q).distance), (p - q).norm() * (1 + 1e-12))
          << part.name;
    }
  }
}

TEST(Part, ContinuesAFeatureWhenAsked) {
  for (const Part& part : parts()) {
    Source source{23};
    for (int i = 0; i < 2000; ++i) {
      const Vector3d p = kPlace + source.vector<3>(0.06);
      const auto at = signed_distance<3>(part.shape, p);
      if (at.distance > 0.0) continue;
      const auto same = signed_distance<3>(part.shape, p, at.feature);
      ASSERT_EQ(at.feature, same.feature) << part.name;
      ASSERT_NEAR(at.distance, same.distance, 1e-15) << part.name;
      ASSERT_LT((at.normal - same.normal).norm(), 1e-12) << part.name;
    }
  }
}

TEST(Part, GivesBackAroundALoopWhatItTook) {
  // Through edges too: the potential K d²/2 is continuous there although the normal jumps. The midpoint rule errs by half the jump
  // of the force, up to 60 N, times a step, 1 µm, in each crossing; the work of one piece of a loop is up to 1 J.
  for (const Part& part : parts()) {
    const Environment<3> environment{{Surface{part.shape, {3000, 0, 0, 0}}}};
    Source source{23};
    double touched = 0.0;
    for (int loop = 0; loop < 5; ++loop) {
      const Vector3d a = source.vector<3>(0.02), b = source.vector<3>(0.02), c = source.vector<3>(0.01),
                     center = kPlace + source.vector<3>(0.02);
      constexpr int kPoints = 200'000;
      double work = 0.0;
      for (int k = 0; k < kPoints; ++k) {
        const auto at = [&](double s) {
          return Vector3d{center + a * std::cos(s) + b * std::sin(s) + c * std::sin(2 * s)};
        };
        const Vector3d p = at(2 * std::numbers::pi * k / kPoints), q = at(2 * std::numbers::pi * (k + 1) / kPoints);
        const double piece = environment.force(Position<3>{Vector3d{0.5 * (p + q)}}, {}).vec().dot(q - p);
        work += piece, touched += std::abs(piece);
      }
      ASSERT_NEAR(work, 0.0, 1e-4) << part.name << " loop " << loop;
    }
    EXPECT_GT(touched, 1e-3) << part.name;
  }
}

// --- peg in hole ---------------------------------------------------------------------------------

/// Largest tilt about an axis across the peg at which no point of it is inside the hole's material.
double largest_free_tilt(const std::vector<Vector3d>& peg, const Shape& hole, double inserted) {
  const auto is_free = [&](double tilt, double aside) {
    for (const Vector3d& p : peg) {
      if (p.z() > inserted) continue;
      const Vector3d q = Eigen::AngleAxisd{tilt, Vector3d::UnitX()} * Vector3d{p - Vector3d{0, 0, 0.5 * inserted}};
      if (signed_distance<3>(hole, Vector3d{q + Vector3d{0, aside, 0.5 * inserted}}).distance < -1e-12) return false;
    }
    return true;
  };
  double lo = 0.0, hi = 0.1;
  while (hi - lo > 1e-9) {
    const double mid = 0.5 * (lo + hi);
    (is_free(mid, 0.0) ? lo : hi) = mid;
  }
  return lo;
}

TEST(PegInHole, TiltsByTheClearanceOverTheDepth) {
  // Two-point contact: tilt_max = (D - d)/depth = 0.2 mm/30 mm = 6.67 mrad, to first order; the next term is d tilt²/2 of the
  // clearance, 0.2 %. The peg's points 1 mm apart leave out up to 25 µm/30 mm of the circle.
  constexpr double kPegRadius = 0.01, kHoleRadius = 0.0101, kDepth = 0.03;
  const std::vector<Vector3d> peg =
      sample(Peg::of(Vector3d::Zero(), Vector3d::UnitZ(), kPegRadius, kDepth, 0.0), 0.2e-3);
  // The hole is deeper than the peg goes in; its mouth is at z = kDepth.
  const Shape hole = Hole::of({0, 0, kDepth}, Vector3d::UnitZ(), kHoleRadius, 2 * kDepth, 0.0);
  const double expected = 2 * (kHoleRadius - kPegRadius) / kDepth;
  EXPECT_NEAR(largest_free_tilt(peg, hole, kDepth), expected, 0.01 * expected);
  // In a hole of a plate the same.
  const Shape plate = Plate{{0, 0, 0},
                            Eigen::Matrix3d::Identity(),
                            {0.05, 0.05, kDepth},
                            std::make_shared<const std::vector<PlateHole>>(1, PlateHole{{0, 0}, kHoleRadius})};
  EXPECT_NEAR(largest_free_tilt(peg, plate, kDepth), expected, 0.01 * expected);
}

// --- points of a tool ----------------------------------------------------------------------------

TEST(SampleShape, LeavesNoPlaceFartherThanTheSpacing) {
  struct Sampled {
    const char* name;
    Shape shape;
    std::vector<Vector3d> points;
  };
  constexpr double kSpacing = 5e-3;
  const Torus torus{kPlace, kAxis, 0.03, 0.01};
  const Capsule capsule{kPlace, kPlace + 0.04 * kAxis, 0.015};
  const Peg peg = Peg::of(kPlace, kAxis, 0.02, 0.05, 0.004);
  const Cone cone = Cone::of(kPlace, kAxis, 0.03, 0.05);
  for (const Sampled& each : {Sampled{"torus", torus, sample(torus, kSpacing)},
                              {"capsule", capsule, sample(capsule, kSpacing)},
                              {"peg", peg, sample(peg, kSpacing)},
                              {"cone", cone, sample(cone, kSpacing)}}) {
    for (const Vector3d& p : each.points)
      ASSERT_NEAR(signed_distance<3>(each.shape, p).distance, 0.0, 1e-12) << each.name;
    Source source{23};
    for (int i = 0; i < 3000; ++i) {
      const Vector3d p = kPlace + source.vector<3>(0.08);
      const auto at = signed_distance<3>(each.shape, p);
      const Vector3d on_surface = p - at.distance * at.normal;
      double least = 1e9;
      for (const Vector3d& q : each.points) least = std::min(least, (q - on_surface).norm());
      ASSERT_LE(least, kSpacing / std::numbers::sqrt2 * 1.05) << each.name;
    }
  }
}

}  // namespace
}  // namespace twoport::parts_test
