#pragma once

#include <span>
#include <string>
#include <vector>

#include "common/coupling/layers.h"
#include "common/coupling/options.h"

namespace twoport {

/// Names of all methods, in the order of kMethods.
std::vector<std::string> method_names();
/// Does a controller at the master keep an account of energy, so that a deficit is known? Under any of these controls.
bool keeps_account(const ControlOptions& first, std::span<const ScheduledControl> schedule);

}  // namespace twoport
