#pragma once

#include "lab/cli/subcommand.h"

namespace twoport::lab {

/// `paper`.
Subcommand add_paper_command(CLI::App& app);

}  // namespace twoport::lab
