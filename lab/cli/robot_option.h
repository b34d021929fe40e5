#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/scene/scene.h"
#include "lab/cli/subcommand.h"
#include "lab/engine/hosted.h"

namespace twoport::lab {

/// --robot mujoco:FILE.xml[,site=NAME][,key=NAME].
CLI::Option* add_robot(CLI::App& command, std::string& robot);
/// The robot of that option; nothing where it was not given. Throws ConfigError where it cannot be opened or the scene cannot have it.
std::optional<HostedRobot> open_robot(const std::string& choice, const Scene& scene);

/// Throws ConfigError, which begins with `option`, where one of the paths is what the world of --robot takes the place of.
void refuse_replaced(const std::string& option, const std::vector<std::string>& paths);

}  // namespace twoport::lab
