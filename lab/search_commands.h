#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <vector>

namespace twoport::lab {

/// A subcommand and what it does once its arguments are read: returns the exit status.
struct Subcommand {
  CLI::App* app;
  std::function<int()> run;
};

/// `boundary`, `sweep` and `merge`.
std::vector<Subcommand> add_search_commands(CLI::App& app);

}  // namespace twoport::lab
