#include "common/method/transparency/surface/surface_estimator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace twoport {
namespace {

using Eigen::Vector3d;

/// Stiffness that is estimated of a surface of 3 kN/m, pressed by 1 mm and 0.5 mm at 10 Hz, while the contact moves over the robot by 3 mm
/// at 17 Hz along the normal. `follows`: the moving contact is taken for the robot's point.
double stiffness(bool follows) {
  constexpr double kStiffness = 3000.0;
  const Seconds dt{5e-4};
  const Vector3d n = Vector3d{1.0, 2.0, -2.0} / 3.0;
  SurfaceEstimator<3> estimator;
  for (int k = 0; k < 6000; ++k) {
    const double t = 2.0 * std::numbers::pi * k * dt.si();
    const double press = 1e-3 + 5e-4 * std::sin(10.0 * t), moves = 3e-3 * std::sin(17.0 * t);
    const Vector3d s = press * n, x = s + moves * n, v = 2.0 * std::numbers::pi * 10.0 * 5e-4 * std::cos(10.0 * t) * n;
    estimator.step(x, follows ? x : s, v, kStiffness * press * n, dt);
  }
  EXPECT_TRUE(estimator.contact());
  return estimator.patch().stiffness;
}

// The prior of 2 kN/m is left with a weight of (30 um)² against (0.4 mm)².
TEST(SurfaceEstimator, StiffnessIsFittedToTheRobotsPointNotToTheMovingContact) {
  EXPECT_NEAR(stiffness(false), 3000.0, 30.0);
  EXPECT_LT(stiffness(true), 1000.0);
}

}  // namespace
}  // namespace twoport
