#include "common/method/transparency/surface/surface_estimator.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <utility>

#include "common/method/transparency/surface/surface_model.h"

namespace twoport::surface_estimator_test {
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

// A weight that is lifted presses by 2 N wherever it is: the least stiffness of a surface, 100 N/m, after 25 mm at 50 mm/s.
TEST(SurfaceEstimator, AWeightThatIsLiftedIsNoStiffSurface) {
  const Seconds dt{1e-3};
  const Vector3d up = Vector3d::UnitZ();
  SurfaceEstimator<3> estimator;
  for (int k = 0; k < 500; ++k) estimator.step(5e-5 * k * up, 0.05 * up, 2.0 * up, dt);
  ASSERT_TRUE(estimator.contact());
  EXPECT_LE(estimator.patch().stiffness, 110.0);
}

// The robot leaves what it has lifted and goes on through the place where that was: after 20 mm, and the 2 mm and 20 ms that the model is
// behind, there is no surface, and on the way it grows weaker. One that it leaves backwards stays.
TEST(SurfaceModel, IsForgottenWhereTheRobotIsFree) {
  const Seconds dt{1e-3};
  const Vector3d up = Vector3d::UnitZ();
  SurfacePatch<3> estimate;
  estimate.normal = up, estimate.stiffness = 1000.0;
  for (const double speed_m_per_s : {0.1, -0.1}) {
    SurfaceModel<3> model;
    for (int k = 0; k < 200; ++k) model.step(true, estimate, Vector3d::Zero(), dt);
    ASSERT_EQ(model.ramp(), 1.0);
    int last = 0;
    double before = 1.0;
    for (int k = 1; k <= 500; ++k) {
      model.step(false, estimate, speed_m_per_s * k * dt.si() * up, dt);
      EXPECT_LE(model.ramp(), before);
      before = model.ramp();
      if (model.exists()) last = k;
    }
    if (speed_m_per_s > 0.0) {
      EXPECT_NEAR(last, (20e-3 + 2e-3) / speed_m_per_s / dt.si() + 20.0, 5.0);
    } else {
      EXPECT_EQ(model.ramp(), 1.0);
    }
  }
}

/// Ticks of contact in 10 s of noise of 0.02 N m about each axis, where a torque counts ten times, then until `torque_n` is a contact.
std::pair<int, int> contact_of_torque(double torque_n) {
  const Seconds dt{1e-3};
  std::mt19937 random{7};
  std::normal_distribution<double> noise{0.0, 0.2};
  TorqueContact contact;
  int in_noise = 0, late = 0;
  for (int k = 0; k < 10'500 && !(k >= 10'000 && contact.contact()); ++k, late += k > 10'000) {
    contact.step(Vector3d{noise(random), noise(random), noise(random) + (k < 10'000 ? 0.0 : torque_n)}, dt);
    in_noise += k < 10'000 && contact.contact();
  }
  return {in_noise, late};
}

// LP_11ms of a step of 1 N passes 0.3 N after 11 ms ln(1/0.7) = 4 ms; of 0.1 N never.
TEST(TorqueContact, BeginsByATorqueAndNotByNoise) {
  EXPECT_EQ(contact_of_torque(1.0).first, 0);
  EXPECT_LE(contact_of_torque(1.0).second, 10);
  EXPECT_EQ(contact_of_torque(0.1).second, 500);
}

TEST(SensorBias, OfAWrenchIsLearnedUpTo300Millinewtons) {
  for (const double torque_n_m : {0.02, 0.04}) {  // counts ten times
    SensorBias<6> bias{1.0, 100.0};
    const Force<6> f{torque_n_m * Force<6>::Vector::Unit(4)};
    for (int k = 0; k < 3000; ++k) bias.learn(f, Seconds{1e-3});
    EXPECT_NEAR(bias.value().vec()(4), std::min(torque_n_m, 0.03), 1e-4);
  }
}

// What is left by an identification from six readings, 18 mN m, under noise of 20 mN m about each axis: in 1 s its mean, to 2.5 of its standard
// deviations of 20/sqrt(2000) mN m; and no contact.
TEST(SensorBias, OfATorqueIsLearnedFromItsNoiseAndBeginsNoContact) {
  const Seconds dt{5e-4};
  for (unsigned seed = 1; seed <= 20; ++seed) {
    std::mt19937 random{seed};
    std::normal_distribution<double> noise{0.0, 0.02};
    SensorBias<6> bias{1.0, 100.0};
    TorqueContact contact;
    for (int k = 0; k < 2000; ++k) {
      Force<6>::Vector reading;
      for (double& each : reading) each = noise(random);
      reading[4] -= 0.018;
      contact.step(10.0 * (reading - bias.value().vec()).tail<3>(), dt);
      EXPECT_FALSE(contact.contact()) << seed << ' ' << k;
      if (!contact.contact()) bias.learn(Force<6>{reading}, dt);
    }
    EXPECT_NEAR(bias.value().vec()[4], -0.018, 1.5e-3) << seed;
  }
}

}  // namespace
}  // namespace twoport::surface_estimator_test
