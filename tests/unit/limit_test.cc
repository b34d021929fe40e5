#include "common/runtime/limit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace twoport {
namespace {

TEST(ForceLimit, BoundsTheNormAndKeepsTheDirection) {
  const ForceLimit<3> limit{8.5};
  std::mt19937_64 random{5};
  std::normal_distribution<double> normal{0.0, 6.0};
  for (int k = 0; k < 1000; ++k) {
    const Eigen::Vector3d asked{normal(random), normal(random), normal(random)};
    const Eigen::Vector3d kept = limit(Force<3>{asked}).vec();
    if (asked.norm() <= 8.5) {
      ASSERT_EQ(kept, asked);
    } else {
      // A product and a norm, each rounded.
      ASSERT_NEAR(kept.norm(), 8.5, 1e-14);
      ASSERT_LT((kept / 8.5 - asked / asked.norm()).norm(), 1e-15);
    }
  }
}

TEST(ForceLimit, OfAWrenchBoundsItsForceAndScalesItsTorqueWithIt) {
  Eigen::Matrix<double, 6, 1> asked;
  asked << 6, 0, 8, 0.1, 0.2, 0.3;
  EXPECT_LT((ForceLimit<6>{5.0}(Force<6>{asked}).vec() - 0.5 * asked).norm(), 1e-15);
  asked << 3, 0, 4, 100, 200, 300;
  EXPECT_EQ(ForceLimit<6>{5.0}(Force<6>{asked}).vec(), asked);
}

}  // namespace
}  // namespace twoport
