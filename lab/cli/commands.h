#pragma once

#include "lab/cli/subcommand.h"

namespace twoport::lab {

void add_run_command(CLI::App& app, Chosen& chosen);
void add_methods_command(CLI::App& app, Chosen& chosen);
void add_boundary_command(CLI::App& app, Chosen& chosen);
/// `sweep` and `merge`.
void add_sweep_commands(CLI::App& app, Chosen& chosen);
void add_zwidth_command(CLI::App& app, Chosen& chosen);
void add_chart_command(CLI::App& app, Chosen& chosen);
void add_doctor_command(CLI::App& app, Chosen& chosen);
void add_impedance_command(CLI::App& app, Chosen& chosen);
/// `adversary`, `compare`, `gallery`, `map`, `matrix` and `recommend`.
void add_map_commands(CLI::App& app, Chosen& chosen);
/// `replay` and `export`.
void add_recording_commands(CLI::App& app, Chosen& chosen);
/// `trim` and `blocks`.
void add_trim_commands(CLI::App& app, Chosen& chosen);

/// `arm`: kinematics and dynamics of an arm at one position, as JSON.
void add_arm_command(CLI::App& app, Chosen& chosen);

/// `paper`.
void add_paper_command(CLI::App& app, Chosen& chosen);

}  // namespace twoport::lab
