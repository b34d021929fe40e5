#include <initializer_list>
#include <string>
#include <vector>

#include "tests/unit/scene/scenes.h"

namespace twoport::test::gripper_test {

TEST(SceneGripper, ReadsAsASceneOfOneAxis) {
  const Scene scene = scene_of(kGripper);
  ASSERT_TRUE(scene.gripper);
  EXPECT_EQ(scene.gripper->dof, 1);
  EXPECT_FALSE(scene_of(kStiffWall).gripper);
}

TEST(SceneGripper, RefusesEveryNumberThatIsNotFinite) {
  std::vector<std::string> paths{"force_scale",
                                 "motion_scale",
                                 "initial_energy_j",
                                 "object.width_m",
                                 "object.stiffness_n_per_m",
                                 "object.damping_n_s_per_m"};
  const auto add = [&](const std::string& block, std::initializer_list<const char*> names) {
    for (const char* name : names) paths.push_back(block + "." + name);
  };
  add("operator.hand", {"mass_kg", "stiffness_n_per_m", "damping_n_s_per_m", "force_n"});
  add("device", {"mass_kg", "damping_n_s_per_m", "position_m", "velocity_m_per_s", "coulomb_friction_n",
                 "position_resolution_m", "max_force_n", "velocity_filter_hz"});
  add("robot", {"mass_kg", "damping_n_s_per_m", "position_m", "velocity_m_per_s"});
  add("robot.force_sensor", {"noise_n", "bias_n", "latency_ms"});
  add("virtual_coupling", {"stiffness_n_per_m", "damping_n_s_per_m", "catch_up_m_per_s"});
  for (const char* limits : {"device_limits", "robot_limits"})
    add(limits, {"force_n", "force_rate_n_per_s", "power_w", "speed_m_per_s", "workspace_m"});
  paths.push_back("robot_limits.set_point_step_m");
  for (const std::string& path : paths)
    for (const std::string value : {"nan", "inf"}) {
      const bool list = path.ends_with("position_m") || path.ends_with("velocity_m_per_s") ||
                        path.ends_with("hand.force_n") || path.ends_with("bias_n");
      EXPECT_TRUE(says(error_of(kGripper, {"gripper." + path + "=" + (list ? "[" + value + "]" : value)}),
                       {": gripper." + path + " is ", value, "finite number"}))
          << path;
    }
}

}  // namespace twoport::test::gripper_test
