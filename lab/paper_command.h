#pragma once

#include "lab/search_commands.h"

namespace twoport::lab {

/// `paper`.
Subcommand add_paper_command(CLI::App& app);

}  // namespace twoport::lab
