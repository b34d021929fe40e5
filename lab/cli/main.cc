#include <fmt/format.h>

#include "common/platform/arguments.h"
#include "common/wire/header.h"
#include "lab/cli/commands.h"

int main(int argc, char** argv) {
  using namespace twoport;
  using namespace twoport::lab;
  CLI::App app{"twoport-lab: scenes in virtual time"};
  app.set_version_flag("--version",
                       fmt::format("twoport-lab {} (wire protocol {})", TWOPORT_VERSION, kProtocolVersion & 0xffff));
  app.require_subcommand(1);
  Chosen chosen;
  for (const auto add :
       {add_run_command, add_boundary_command, add_sweep_commands, add_map_commands, add_zwidth_command,
        add_chart_command, add_impedance_command, add_paper_command, add_methods_command, add_arm_command,
        add_recording_commands, add_doctor_command, add_trim_commands})
    add(app, chosen);
  return run_program(app, "twoport-lab", argc, argv, [&] { return chosen(); });
}
