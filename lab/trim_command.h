#pragma once

#include <vector>

#include "lab/search_commands.h"

namespace twoport::lab {

/// `trim` and `blocks`.
std::vector<Subcommand> add_trim_commands(CLI::App& app);

}  // namespace twoport::lab
