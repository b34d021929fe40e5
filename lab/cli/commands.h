#pragma once

#include <vector>

#include "lab/cli/subcommand.h"

namespace twoport::lab {

Subcommand add_run_command(CLI::App& app);
Subcommand add_methods_command(CLI::App& app);
Subcommand add_boundary_command(CLI::App& app);
/// `sweep` and `merge`.
std::vector<Subcommand> add_sweep_commands(CLI::App& app);
Subcommand add_zwidth_command(CLI::App& app);
Subcommand add_chart_command(CLI::App& app);
Subcommand add_doctor_command(CLI::App& app);
Subcommand add_impedance_command(CLI::App& app);
/// `compare`, `gallery`, `map` and `recommend`.
std::vector<Subcommand> add_map_commands(CLI::App& app);
/// `replay` and `export`.
std::vector<Subcommand> add_recording_commands(CLI::App& app);
/// `trim` and `blocks`.
std::vector<Subcommand> add_trim_commands(CLI::App& app);

}  // namespace twoport::lab
