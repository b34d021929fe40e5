// Space has no directions of its own: a world that is turned and moved as a whole gives the same figures.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <string>
#include <vector>

#include "common/scene/load.h"
#include "lab/run.h"

namespace twoport::lab::turned_world_test {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

std::string text(const Vector3d& v) {
  return fmt::format("[{:.17g}, {:.17g}, {:.17g}]", v.x(), v.y(), v.z());
}

std::string over_a_link(const std::string& rotation) {
  return fmt::format(R"(
  to_slave {{ delay_ms: 20 loss: 0.02 }} to_master {{ delay_ms: 20 loss: 0.02 }}
  control {{
    architecture: POSITION_FORCE
    virtual_coupling {{ stiffness_n_per_m: 1000 damping_n_s_per_m: 30 {} }}
  }})",
                     rotation);
}

/// A plate with four corners and a capsule in its way.
std::string plate(const Isometry3d& world) {
  std::string s = fmt::format(R"(
  dof: 6 duration_s: 3 rate_hz: 2000 seed: 7
  operator {{
    hand {{ mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8
           inertia_kg_m2: 1e-4 rotational_stiffness_n_m_per_rad: 5 rotational_damping_n_m_s_per_rad: 0.05 }}
    path {{ move_to {{ position_m: {} duration_s: 1 }} }} path {{ move_to {{ position_m: {} duration_s: 1 }} }}
  }}
  device {{ position_m: {} mass_kg: 0.3 damping_n_s_per_m: 0.1 max_force_n: 20
           inertia_kg_m2: 1e-3 rotational_damping_n_m_s_per_rad: 1e-3 }}
  robot {{ position_m: {} mass_kg: 1 damping_n_s_per_m: 4 inertia_kg_m2: 3e-3 rotational_damping_n_m_s_per_rad: 0.02
          force_sensor {{ }} }}
  environment {{ capsule {{ start_m: {} end_m: {} radius_m: 0.02 stiffness_n_per_m: 3000 friction: 0.2 }} }})",
                              text(world * Vector3d{0.03, 0, 0}), text(world * Vector3d{0.035, 0.02, 0.01}),
                              text(world * Vector3d::Zero()), text(world * Vector3d::Zero()),
                              text(world * Vector3d{0.09, -0.05, 0.03}), text(world * Vector3d{0.09, 0.05, 0.02}));
  s += "\n  tool {";
  for (const double y : {0.03, -0.03})
    for (const double z : {0.03, -0.03})
      s += fmt::format(" contact_point {{ position_m: {} }}", text(world.linear() * Vector3d{0.05, y, z}));
  s += " }\n";
  return s + over_a_link("rotational_stiffness_n_m_per_rad: 10 rotational_damping_n_m_s_per_rad: 0.3");
}
/// A point on a rough wall.
std::string point(const Isometry3d& world) {
  const Vector3d into = world.linear() * Vector3d{0.6, 0.8, 0};
  return fmt::format(R"(
  dof: 3 duration_s: 3 rate_hz: 2000 seed: 7
  operator {{
    hand {{ mass_kg: 0.1 stiffness_n_per_m: 400 damping_n_s_per_m: 8 }}
    path {{ move_to {{ position_m: {} duration_s: 1 }} }} path {{ move_to {{ position_m: {} duration_s: 1 }} }}
  }}
  device {{ position_m: {} mass_kg: 0.3 damping_n_s_per_m: 0.1 max_force_n: 20 }}
  robot {{ position_m: {} mass_kg: 1 damping_n_s_per_m: 4 force_sensor {{ }} }}
  environment {{ wall {{ normal: {} offset_m: {:.17g} stiffness_n_per_m: 3000 friction: 0.2 }} }})",
                     text(world * Vector3d{0.03, 0.01, 0}), text(world * Vector3d{0.02, 0.03, 0.01}),
                     text(world * Vector3d::Zero()), text(world * Vector3d::Zero()), text(-into),
                     -0.01 - into.dot(world.translation())) +
         over_a_link("");
}

class TurnedWorld : public testing::TestWithParam<const char*> {};

// CLASSIC and NONE are left out: they chatter or are unstable, and rounding decides the moments of their ticks.
TEST_P(TurnedWorld, GivesTheSameFigures) {
  Isometry3d cycled = Isometry3d::Identity(), turned = Isometry3d::Identity();
  cycled.linear().col(0) = Vector3d::UnitY(), cycled.linear().col(1) = Vector3d::UnitZ(),
  cycled.linear().col(2) = Vector3d::UnitX();
  turned.linear() = Eigen::AngleAxisd{0.7, Vector3d{1, 2, 3}.normalized()}.toRotationMatrix();
  turned.translation() = Vector3d{0.1, -0.2, 0.3};
  for (const auto& scene : {plate, point}) {
    const auto figures = [&](const Isometry3d& world) {
      const std::vector<std::string> method{std::string{"control.passivity.method="} + GetParam()};
      return run(parse_scene(scene(world), "turned world", method));
    };
    const Summary straight = figures(Isometry3d::Identity());
    ASSERT_GT(straight.touching_share(), 0.2);
    for (const Isometry3d& world : {cycled, turned}) {
      const Summary other = figures(world);
      // Where friction sticks and slips, rounding grows: 1e-9 is seen.
      const auto same = [](double a, double b) { EXPECT_NEAR(a, b, 1e-6 * std::abs(a) + 1e-9); };
      same(straight.felt_force_error_rms_n(), other.felt_force_error_rms_n());
      same(straight.max_force_n(), other.max_force_n());
      same(straight.position_error_rms_m(), other.position_error_rms_m());
      same(straight.drift_m(), other.drift_m());
      same(straight.robot_max_force_n(), other.robot_max_force_n());
      same(straight.dissipated_j(), other.dissipated_j());
      same(straight.min_port_energy_j(), other.min_port_energy_j());
    }
  }
}

INSTANTIATE_TEST_SUITE_P(EveryMethod, TurnedWorld,
                         testing::Values("FORCE_PROJECTED", "FIXED_DAMPING", "WAVE_VARIABLES",
                                         "SET_POSITION_MODULATION", "ENERGY_TANK", "ENERGY_BOUNDING", "FOUR_CHANNEL",
                                         "MODEL_MEDIATED", "FRACTAL_IMPEDANCE", "INTERNAL_MODEL"),
                         [](const auto& of) { return std::string{of.param}; });

}  // namespace
}  // namespace twoport::lab::turned_world_test
