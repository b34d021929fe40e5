#pragma once

#include <vector>

#include "lab/cli/subcommand.h"

namespace twoport::lab {

Subcommand add_run_command(Command app);
Subcommand add_methods_command(Command app);
Subcommand add_boundary_command(Command app);
/// `sweep` and `merge`.
std::vector<Subcommand> add_sweep_commands(Command app);
Subcommand add_zwidth_command(Command app);
Subcommand add_chart_command(Command app);
Subcommand add_doctor_command(Command app);
Subcommand add_impedance_command(Command app);
/// `adversary`, `compare`, `gallery`, `map`, `matrix` and `recommend`.
std::vector<Subcommand> add_map_commands(Command app);
/// `replay` and `export`.
std::vector<Subcommand> add_recording_commands(Command app);
/// `trim` and `blocks`.
std::vector<Subcommand> add_trim_commands(Command app);

/// `arm`: kinematics and dynamics of an arm at one position, as JSON.
Subcommand add_arm_command(Command app);

/// `paper`.
Subcommand add_paper_command(Command app);

}  // namespace twoport::lab
