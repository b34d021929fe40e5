#include "tests/theory/sampled_contact.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "common/contact/environment.h"
#include "tests/arm/contact_cases.h"

namespace twoport::lab::sampled_contact_test {
namespace {

using Eigen::Vector3d;

// Printed with two digits after the point, from an independent program that simulated the non-linear motion, too.
TEST(SampledContact, LosesStabilityAtTheKnownStiffnesses) {
  for (const test::ContactCase& c : test::contact_cases()) {
    const double found = critical_contact_stiffness(c.contact);
    // The known figures of D and E are linear about the body that is not tilted: the press tilts it by up to 0.01 rad.
    EXPECT_NEAR(found, c.known_n_per_m, c.symmetric ? 0.05 : 4e-3 * c.known_n_per_m) << c.name;
  }
}

TEST(SampledContact, HeaveIsTheClosedForm) {
  SampledContact c;
  c.points_m = test::corners(0.0, 0.01);
  // Four corners share the mass. A radius up to 1 + 1e-12 counts as stable, and grows by 1e-6 per N/m: 1e-6 N/m.
  EXPECT_NEAR(critical_contact_stiffness(c), 0.25 * critical_modal_stiffness(0.3, 1.0, 5e-4), 1e-5);
  EXPECT_NEAR(critical_modal_stiffness(0.075, 0.5, 5e-4), 2001.1117, 1e-4);
}

TEST(SampledContact, TheRuleHoldsForSmallDamping) {
  for (const int delay : {0, 1, 3}) {
    SampledContact c;
    c.points_m = test::corners(0.0, 0.01);
    c.delay_ticks = delay;
    c.press_n = 0.1;  // 5 N would tip it over at such stiffnesses
    c.damping_n_s_per_m *= 0.1;
    c.rotational_damping_n_m_s_per_rad *= 0.5;
    EXPECT_NEAR(critical_contact_stiffness(c) / rule_contact_stiffness(c), 1.0, 1e-3);
  }
}

TEST(SampledContact, APressTipsTheBodyOverBelowTheStaticLimit) {
  SampledContact c;
  c.points_m = test::corners(0.0, 0.01);
  // Tilting about x is the softest: K Σ y² = F0 h.
  const double limit = 5.0 * 0.01 / (4.0 * 0.02 * 0.02);
  c.stiffness_n_per_m = 0.99 * limit;
  EXPECT_GT(spectral_radius(c), 1.0 + 1e-6);
  c.stiffness_n_per_m = 1.01 * limit;
  EXPECT_LT(spectral_radius(c), 1.0 - 1e-9);
}

/// The wrench of the points as the renderer computes it, at the equilibrium moved by d.
Vector6 rendered(const SampledContact& c, const Vector6& d) {
  std::vector<EnvironmentSpec> world{
      Surface{Wall{Vector3d::UnitZ(), c.points_m[0].z()}, {c.stiffness_n_per_m, 0, 0, 0}}};
  for (std::size_t i = 0; i < c.points_m.size() && c.tangential_ratio > 0.0; ++i) {
    Spring spring{c.tangential_ratio * c.stiffness_n_per_m, 0.0, c.points_m[i]};
    spring.contact_point = static_cast<int>(i);
    world.emplace_back(spring);
  }
  if (c.tangential_ratio > 0.0) std::get<Surface>(world[0]).material.stiffness_n_per_m *= 1.0 - c.tangential_ratio;
  const Environment<6> environment{world, c.points_m};
  const Vector6 at = equilibrium(c).displacement;
  const Position<6> start = Position<6>{}.moved(at.head<3>(), at.tail<3>());
  return environment.force(start.moved(d.head<3>(), d.tail<3>()), Velocity<6>{}).vec();
}

TEST(SampledContact, ItsStiffnessIsTheSlopeOfTheRenderedWrench) {
  for (const test::ContactCase& each : test::contact_cases()) {
    SampledContact c = each.contact;
    c.stiffness_n_per_m = 0.9 * each.known_n_per_m;
    const Matrix6 K = contact_stiffness(c);
    Matrix6 slope;
    constexpr double h = 1e-6;
    for (int i = 0; i < 6; ++i)
      slope.col(i) = -(rendered(c, h * Vector6::Unit(i)) - rendered(c, -h * Vector6::Unit(i))) / (2.0 * h);
    // The slope is in axes of the world, K in those of the body.
    const Vector3d turn = equilibrium(c).displacement.tail<3>();
    const Eigen::Matrix3d R = turn.norm() > 0.0 ? Eigen::AngleAxisd{turn.norm(), turn.normalized()}.toRotationMatrix()
                                                : Eigen::Matrix3d::Identity();
    Matrix6 both = Matrix6::Zero();
    both << R, Eigen::Matrix3d::Zero(), Eigen::Matrix3d::Zero(), R;
    const Matrix6 in_body = both.transpose() * slope * both;
    EXPECT_LT((in_body - K).cwiseAbs().maxCoeff(), 1e-6 * K.cwiseAbs().maxCoeff()) << each.name;
  }
}

}  // namespace
}  // namespace twoport::lab::sampled_contact_test
