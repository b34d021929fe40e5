#pragma once

#include "lab/cli/subcommand.h"

namespace twoport::lab {

/// `arm`: kinematics and dynamics of an arm at one position, as JSON.
Subcommand add_arm_command(Command app);

}  // namespace twoport::lab
