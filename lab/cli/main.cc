#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "common/base/check.h"
#include "common/platform/arguments.h"
#include "common/wire/header.h"
#include "lab/cli/commands.h"

namespace {

using namespace twoport;

std::vector<lab::Subcommand> add_commands(lab::Command app) {
  std::vector<lab::Subcommand> all{lab::add_run_command(app), lab::add_boundary_command(app)};
  for (lab::Subcommand& each : lab::add_sweep_commands(app)) all.push_back(std::move(each));
  for (lab::Subcommand& each : lab::add_map_commands(app)) all.push_back(std::move(each));
  all.push_back(lab::add_zwidth_command(app));
  all.push_back(lab::add_chart_command(app));
  all.push_back(lab::add_impedance_command(app));
  all.push_back(lab::add_paper_command(app));
  all.push_back(lab::add_methods_command(app));
  all.push_back(lab::add_arm_command(app));
  for (lab::Subcommand& each : lab::add_recording_commands(app)) all.push_back(std::move(each));
  all.push_back(lab::add_doctor_command(app));
  for (lab::Subcommand& each : lab::add_trim_commands(app)) all.push_back(std::move(each));
  return all;
}

int run_given(const std::vector<lab::Subcommand>& commands) {
  for (const lab::Subcommand& each : commands)
    if (each.command.given()) return each.run();
  throw ConfigError{"a command is missing"};
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"twoport-lab: scenes in virtual time"};
  app.set_version_flag("--version",
                       fmt::format("twoport-lab {} (wire protocol {})", TWOPORT_VERSION, kProtocolVersion & 0xffff));
  app.require_subcommand(1);
  const std::vector<lab::Subcommand> commands = add_commands(lab::Command{app});
  return run_program(app, "twoport-lab", argc, argv, [&] { return run_given(commands); });
}
