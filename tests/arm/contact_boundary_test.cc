#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include "lab/study/boundary.h"
#include "tests/arm/contact_cases.h"
#include "tests/theory/sampled_contact.h"

// Where `boundary` finds that a rendered contact of a rigid body stops being stable, and where the eigenvalues of the same loop
// leave the unit circle.
namespace twoport::lab::contact_boundary_test {
namespace {

using Eigen::Vector3d;
using Words = std::vector<std::string>;

constexpr const char* kScene = TWOPORT_SCENES "/box_on_plane.textproto";

std::string list(const Vector3d& v) {
  return fmt::format("[{}, {}, {}]", v.x(), v.y(), v.z());
}

/// The scene's overrides for a contact. The run begins at the equilibrium of the critical stiffness.
Words overrides(const SampledContact& c, double critical) {
  SampledContact there = c;
  there.stiffness_n_per_m = critical;
  const Vector6 at = equilibrium(there).displacement;
  const Vector3d turn = at.tail<3>();
  const Eigen::Quaterniond q{turn.norm() > 0.0 ? Eigen::AngleAxisd{turn.norm(), turn.normalized()}
                                               : Eigen::AngleAxisd{0.0, Vector3d::UnitX()}};
  Words all{
      fmt::format("rate_hz={}", 1.0 / c.period_s),
      fmt::format("operator.hand.force_n=[0, 0, {}]", -c.press_n),
      fmt::format("device.mass_kg={}", c.mass_kg),
      fmt::format("device.damping_n_s_per_m={}", c.damping_n_s_per_m),
      "device.principal_inertia_kg_m2=" + list(c.inertia_kg_m2),
      "device.principal_rotational_damping_n_m_s_per_rad=" + list(c.rotational_damping_n_m_s_per_rad),
      fmt::format("device.force_latency_ms={}", 1e3 * c.delay_ticks * c.period_s),
      fmt::format("device.position_m=[{}, {}, {}, {}, {}, {}, {}]", at[0], at[1], at[2], q.w(), q.x(), q.y(), q.z()),
      fmt::format("environment[0].wall.offset_m={}", c.points_m[0].z()),
      fmt::format("environment[0].wall.damping_n_s_per_m={}", c.contact_damping_n_s_per_m)};
  for (std::size_t i = 0; i < c.points_m.size(); ++i) {
    all.push_back(fmt::format("tool.contact_point[{}].position_m={}", i, list(c.points_m[i])));
    if (c.tangential_ratio == 0.0) continue;
    all.push_back(fmt::format("environment[{}].spring.anchor_m={}", i + 1, list(c.points_m[i])));
    all.push_back(fmt::format("environment[{}].spring.contact_point={}", i + 1, i));
  }
  return all;
}

/// Relative distance of the theory from the bracket that the search ends with.
double off(const Boundary& found, double theory) {
  if (theory < found.stable) return found.stable / theory - 1.0;
  if (theory > found.unstable) return found.unstable / theory - 1.0;
  return 0.0;
}

void expect_boundary(const std::string& what, const SampledContact& c) {
  SCOPED_TRACE(what);
  const double theory = critical_contact_stiffness(c);
  // A point that sticks by half of its stiffness: a spring of K/2 in every direction and a wall of K/2.
  ASSERT_TRUE(c.tangential_ratio == 0.0 || c.tangential_ratio == 0.5);
  const double shown = c.tangential_ratio == 0.0 ? theory : 0.5 * theory;
  std::vector<std::string> paths{"environment[0].wall.stiffness_n_per_m"};
  if (c.tangential_ratio > 0.0)
    for (std::size_t i = 0; i < c.points_m.size(); ++i)
      paths.push_back(fmt::format("environment[{}].spring.stiffness_n_per_m", i + 1));
  const Boundary found = find_boundary({.scene = kScene,
                                        .set = overrides(c, theory),
                                        .vary = {paths, 0.9 * shown, 1.1 * shown},
                                        .tolerance = 1e-3,
                                        .scan = 0});
  fmt::print("    {:<86} theory {:<10.6g} laboratory {:<10.6g} to {:<10.6g} off by {:.1e}\n", what, shown, found.stable,
             found.unstable, off(found, shown));
  EXPECT_LT(found.stable, found.unstable);
  EXPECT_LE(std::abs(off(found, shown)), 5e-3);
}

TEST(ContactBoundary, OfThePublishedCases) {
  for (const test::ContactCase& each : test::contact_cases())
    if (each.name[0] != 'B' && each.name[0] != 'E' && each.name[0] != 'H') expect_boundary(each.name, each.contact);
}

TEST(ContactBoundary, OfTenSetsFromASeed) {
  std::mt19937_64 rng{20261123};
  const auto between = [&](double low, double high) {
    return low + (high - low) * (static_cast<double>(rng() >> 11) * 0x1.0p-53);
  };
  const auto about = [&](double low, double high) { return low * std::pow(high / low, between(0.0, 1.0)); };
  for (int sets = 0; sets < 10;) {
    SampledContact c;
    c.mass_kg = about(0.1, 1.0);
    const double radius = between(0.025, 0.05);
    for (int i = 0; i < 3; ++i) c.inertia_kg_m2[i] = c.mass_kg * radius * radius * between(0.8, 1.2);
    c.damping_n_s_per_m = about(0.5, 5.0);
    for (int i = 0; i < 3; ++i) c.rotational_damping_n_m_s_per_rad[i] = about(5e-4, 1e-2);
    const double x = between(-0.01, 0.01), h = between(0.005, 0.05), a = between(0.02, 0.05), b = between(0.015, 0.04);
    const auto corner = [&](double i, double k) { return Vector3d{x + i * a, k * b, -h}; };
    c.points_m = {corner(1, 1), corner(1, -1), corner(-1, 1), corner(-1, -1)};
    if (sets % 3 == 1) c.points_m.insert(c.points_m.end(), {corner(1, 0), corner(0, 1)});
    if (sets % 3 == 2) c.contact_damping_n_s_per_m = between(0.1, 1.0);
    if (sets % 4 == 3) c.tangential_ratio = 0.5;
    c.press_n = between(1.0, 6.0);
    c.period_s = 1.0 / (1000.0 * (1 << (rng() % 3)));
    c.delay_ticks = static_cast<int>(rng() % 3);
    const double critical = critical_contact_stiffness(c);
    const auto radius_at = [&](double factor) {
      SampledContact at = c;
      at.stiffness_n_per_m = factor * critical;
      return spectral_radius(at);
    };
    // With a press that tips it over, or stable again beyond, there is nothing to bracket; and every point must stay in contact.
    if (!(critical > 0.0) || !std::isfinite(critical) || radius_at(0.9) > 1.0 || radius_at(1.1) < 1.0) continue;
    SampledContact there = c;
    there.stiffness_n_per_m = critical;
    const ContactEquilibrium e = equilibrium(there);
    if (*std::min_element(e.forces_n.begin(), e.forces_n.end()) < 0.05 * c.press_n ||
        e.displacement.tail<3>().norm() > 0.05)
      continue;
    ++sets;
    expect_boundary(fmt::format("m {:.3g} b {:.3g} h {:.3g} points {} B {:.2g} k_t {} F0 {:.2g} 1/T {:.0f} d {}",
                                c.mass_kg, c.damping_n_s_per_m, h, c.points_m.size(), c.contact_damping_n_s_per_m,
                                c.tangential_ratio, c.press_n, 1.0 / c.period_s, c.delay_ticks),
                    c);
  }
}

}  // namespace
}  // namespace twoport::lab::contact_boundary_test
