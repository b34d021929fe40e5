#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>

#include "common/base/check.h"
#include "common/scene/load.h"
#include "lab/paper_command.h"
#include "lab/run.h"
#include "lab/search_commands.h"
#include "lab/trim_command.h"

namespace {

using namespace twoport;

struct RunArguments {
  std::string scene, out, trace = "csv";
  std::vector<std::string> set;
};

int run_command(const RunArguments& a) {
  const Scene scene = load_scene(a.scene, a.set);
  std::string trace;
  if (!a.out.empty()) {
    std::error_code error;
    std::filesystem::create_directories(a.out, error);
    if (error) throw ConfigError(fmt::format("--out {}: cannot be created: {}", a.out, error.message()));
    if (a.trace == "csv") trace = a.out + "/trace.csv";
  }
  const Summary summary = lab::run(scene, trace);
  const std::string json = to_json(summary);
  if (a.out.empty()) {
    std::fputs(json.c_str(), stdout);
  } else {
    write_whole(a.out + "/summary.json", json);
    fmt::print("{}: {}\n", scene.name, summary.verdict);
  }
  const std::vector<std::string> broken = broken_promises(scene.expect, summary);
  for (const std::string& sentence : broken) fmt::print(stderr, "{}: {}\n", a.scene, sentence);
  return broken.empty() ? 0 : 3;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"twoport-lab: scenes in virtual time"};
  app.set_version_flag("--version", "twoport-lab " TWOPORT_VERSION);
  app.require_subcommand(1);

  RunArguments a;
  CLI::App* run = app.add_subcommand("run", "Run one scene; summary and trace into --out, or the summary on stdout");
  run->add_option("scene", a.scene, "Scene file (.textproto)")->required();
  run->add_option("--set", a.set, "Override, PATH=VALUE, e.g. control.passivity.method=NONE")
      ->allow_extra_args(false)
      ->take_all();
  run->add_option("--out", a.out, "Folder for summary.json and trace.csv");
  run->add_option("--trace", a.trace, "none or csv")->check(CLI::IsMember({"none", "csv"}))->capture_default_str();

  std::vector<lab::Subcommand> search = lab::add_search_commands(app);
  search.push_back(lab::add_paper_command(app));
  for (lab::Subcommand& each : lab::add_trim_commands(app)) search.push_back(std::move(each));

  try {
    app.parse(argc, argv);
    int status = -1;
    for (const lab::Subcommand& each : search)
      if (each.app->parsed()) status = each.run();
    if (status < 0) status = run_command(a);
    if (std::fflush(stdout) != 0) throw IoError(fmt::format("standard output: {}", std::strerror(errno)));
    return status;
  } catch (const CLI::ParseError& e) {
    if (e.get_exit_code() == 0) return app.exit(e);  // --help, --version
    fmt::print(stderr, "twoport-lab: {}\n", e.what());
    return 2;
  } catch (const ConfigError& e) {
    fmt::print(stderr, "twoport-lab: {}\n", e.what());
    return 2;
  } catch (const std::exception& e) {
    fmt::print(stderr, "twoport-lab: {}\n", e.what());
    return 1;
  }
}
