// Hardware as people own it: devices with fewer motors than axes, robots that obey positions only.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/scene/load.h"
#include "lab/engine/simulation.h"
#include "lab/run.h"

namespace twoport::own_hardware_test {
namespace {

/// Six axes: the hand presses a plate and turns the handle there.
std::string handle(const std::string& device, const std::string& robot, const std::string& passivity = "") {
  return "dof: 6 rate_hz: 1000 duration_s: 6 operator { hand { mass_kg: 0.1 inertia_kg_m2: 1e-4 stiffness_n_per_m: 400 "
         "damping_n_s_per_m: 8 rotational_stiffness_n_m_per_rad: 2 rotational_damping_n_m_s_per_rad: 0.02 } path { "
         "move_to "
         "{ position_m: [0.04, 0, 0] duration_s: 1 } } path { sine { axis: 4 amplitude_m: 0.3 frequency_hz: 0.5 "
         "duration_s: "
         "2 } } path { hold { duration_s: 3 } } } device { mass_kg: 0.1 inertia_kg_m2: 1e-4 damping_n_s_per_m: 0.5 "
         "rotational_damping_n_m_s_per_rad: 1e-3 " +
         device + " } control { architecture: POSITION_FORCE " + passivity +
         " } to_slave { delay_ms: 20 loss: 0.02 } to_master { delay_ms: 20 loss: 0.02 } robot { " + robot +
         " } tool { contact_point { position_m: [0, 0.02, 0] } } environment { wall { normal: [-1, 0, 0] offset_m: "
         "-0.02 "
         "stiffness_n_per_m: 5000 friction: 0.3 } }";
}
constexpr const char* kBody =
    "mass_kg: 1 inertia_kg_m2: 3e-3 damping_n_s_per_m: 4 rotational_damping_n_m_s_per_rad: 0.02";

TEST(Motors, DisplayTheirPartOfTheForceWithinTheClaim) {
  for (const char* passivity : {"", "passivity { layer: ENERGY_SPRING_TWO_PORT }", "passivity { method: CLASSIC }",
                                "passivity { method: ENERGY_TANK }"}) {
    const Summary all = lab::run(parse_scene(handle("", kBody, passivity), "all motors"), {});
    const Summary some = lab::run(parse_scene(handle("motors: [0, 1, 2]", kBody, passivity), "three motors"), {});
    EXPECT_GT(some.max_force_n(), 0.5 * all.max_force_n()) << passivity;
    EXPECT_EQ(some.axes_without_motor(), "3, 4, 5");
    EXPECT_GT(some.not_displayed_max_n_m(), 0.01) << passivity;
    EXPECT_EQ(some.not_displayed_max_n(), 0.0);
    EXPECT_FALSE(all.has_axes_without_motor());
    if (std::string{passivity}.find("CLASSIC") == std::string::npos) {
      EXPECT_GE(some.hand_min_energy_j(), -some.initial_energy_j() - 1e-9) << passivity;
    }
  }
}
TEST(Motors, AreAxesOfTheDeviceEachOnce) {
  for (const char* motors : {"motors: [6]", "motors: [-1]", "motors: [0, 0]"})
    EXPECT_THROW(parse_scene(handle(motors, kBody), "test"), ConfigError) << motors;
}

TEST(PositionServo, HoldsWallsQuietly) {
  for (const char* servo :
       {"rate_hz: 125 lag_ms: 20", "rate_hz: 125 lag_ms: 40", "rate_hz: 500 lag_ms: 5", "rate_hz: 500 lag_ms: 12"})
    for (const char* wall : {"3000", "20000"}) {
      const std::string text =
          "dof: 3 rate_hz: 1000 duration_s: 12 operator { hand { mass_kg: 0.1 stiffness_n_per_m: 400 "
          "damping_n_s_per_m: 8 } "
          "path { move_to { position_m: [0.04, 0, 0] duration_s: 2 } } path { hold { duration_s: 10 } } } device { "
          "mass_kg: "
          "0.1 damping_n_s_per_m: 0.5 } to_slave { delay_ms: 5 } to_master { delay_ms: 5 } robot { servo { delay_ms: "
          "4 " +
          std::string{servo} +
          " } force_sensor { } } environment { wall { normal: [-1, 0, 0] offset_m: -0.02 "
          "stiffness_n_per_m: " +
          wall + " } }";
      const Summary s = lab::run(parse_scene(text, "servo"), {});
      EXPECT_EQ(s.verdict_kind(), "STABLE") << servo << ", " << wall << " N/m: " << s.verdict();
      EXPECT_GE(s.held_force_ratio(), 0.8) << servo << ", " << wall;
      EXPECT_LE(s.held_force_ratio(), 1.2) << servo << ", " << wall;
    }
  EXPECT_THROW(parse_scene("dof: 3 duration_s: 1 robot { servo { rate_hz: 0 } }", "test"), ConfigError);
}

/// What follows late is the tool, not the body that the coupling moves.
TEST(PositionServo, IsBehindByItsLag) {
  const Scene scene = parse_scene(
      "dof: 1 rate_hz: 1000 duration_s: 2 operator { path { move_to { position_m: [0.1] duration_s: 1 } } path { hold "
      "{ "
      "duration_s: 1 } } } device { } to_slave { delay_ms: 5 } to_master { delay_ms: 5 } robot { servo { rate_hz: 500 "
      "delay_ms: 4 lag_ms: 30 } force_sensor { } }",
      "servo");
  std::vector<double> master;
  double most = 0.0;
  lab::make_simulation<1>(scene)->run([&](const Row<1>& row) {
    master.push_back(row.master_x.translation()[0]);
    if (!row.following || master.size() < 20) return true;
    const double behind = row.slave_x.translation()[0] - master[master.size() - 6];
    EXPECT_NEAR(row.position_error[0], behind, 1e-3) << row.t_s;
    most = std::max(most, std::abs(behind));
    return true;
  });
  EXPECT_GT(most, 5e-3);
}

}  // namespace
}  // namespace twoport::own_hardware_test
