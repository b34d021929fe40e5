#include "lab/cli/robot_option.h"

#include <memory>
#include <string>

#include "common/base/built_for.h"
#include "common/base/check.h"
#include "drivers/drivers.h"

namespace twoport::lab {

CLI::Option* add_robot(CLI::App& command, std::string& robot) {
  return command.add_option(
      "--robot", robot,
      "mujoco:FILE.xml[,site=NAME][,key=NAME]: a world of MuJoCo in place of the scene's robot and environment");
}

std::optional<HostedRobot> open_robot(const std::string& choice, const Scene& scene) {
  if (choice.empty()) return {};
  // Others go by the clock.
  if (choice.substr(0, choice.find(':')) != "mujoco")
    throw ConfigError{"--robot " + choice +
                      ": does not run in virtual time; mujoco:FILE.xml[,site=NAME][,key=NAME] does"};
  return for_dof(scene.dof, [&]<int N>() -> std::optional<HostedRobot> {
    std::unique_ptr<Robot<N>> robot = all_drivers().robots.open<N>(choice, scene, Seconds{1.0 / scene.slave_rate_hz});
    HostedRobot hosted{choice, HostedRobot::Of<N>{&dynamic_cast<VirtualRobot<N>&>(*robot.release())}};
    static_cast<void>(make_simulation<N>(scene, hosted));  // refuses before anything runs
    return hosted;
  });
}

void refuse_replaced(const std::string& option, const std::vector<std::string>& paths) {
  for (const std::string& path : paths)
    for (const char* const field : {"environment", "robot.force_sensor", "robot.arm"})
      if (path.starts_with(field)) throw ConfigError{option + ": the world of --robot takes the place of " + field};
}

}  // namespace twoport::lab
