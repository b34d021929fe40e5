#pragma once

#include "lab/cli/subcommand.h"

namespace twoport::lab {

/// `paper`.
Subcommand add_paper_command(Command app);

}  // namespace twoport::lab
