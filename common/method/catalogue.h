#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/coupling/layers.h"
#include "common/coupling/options.h"

namespace twoport {

/// Names of all methods, in the order of kMethods.
std::vector<std::string> method_names();
/// Does a controller at the master keep an account of energy, so that a deficit is known? Under any of these controls.
bool keeps_account(const ControlOptions& first, std::span<const ScheduledControl> schedule);
/// What hand and robot together may give back at most under a passivity layer that claims both, in E(0): that of each side, or one for
/// both. 0: the layer does not bound the robot's port.
double two_port_grants(std::string_view passivity_layer);

}  // namespace twoport
