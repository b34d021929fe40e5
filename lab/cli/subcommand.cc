#include "lab/cli/subcommand.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>

#include "common/base/print_error.h"
#include "common/scene/load.h"
#include "lab/lanes/lanes.h"

namespace twoport::lab {

void add_scene(CLI::App* command, std::string& scene, std::vector<std::string>& set) {
  command->add_option("scene", scene, "Scene file (.textproto)")->required();
  add_list(command, "--set", set, "Override, PATH=VALUE, e.g. control.passivity.method=NONE")
      ->check(CLI::Validator{[](const std::string& text) { return assignment_error(text); }, "PATH=VALUE"});
}

void add_lanes(CLI::App* command, std::optional<int>& lanes) {
  command->add_option(
      "--lanes", lanes,
      "Simulations that a thread steps at once: 1, 2, 4 or 8; 0, the default: as many as the processor can. Says "
      "which runs ran alone, and why");
}

void say_lanes(const LaneUse& use) {
  if (use.together > 0) print_error("{} runs, {} at once ({})\n", use.together, use.lanes, name_of_lanes(use.lanes));
  for (const auto& [why, count] : use.alone) print_error("{} runs alone: {}\n", count, why);
}

void add_jobs(CLI::App* command, int& jobs) {
  const auto at_least_one = [](const std::string& text) {
    int value = 0;
    if (CLI::detail::lexical_cast(text, value) && value >= 1) return std::string{};
    return fmt::format("\"{}\"; it must be a whole number, at least 1", text);
  };
  command->add_option("--jobs", jobs, "Threads")->check(CLI::Validator{at_least_one, "N"})->capture_default_str();
}

CLI::Option* add_list(CLI::App* command, const std::string& name, std::vector<std::string>& into,
                      const std::string& help) {
  return command->add_option(name, into, help)->allow_extra_args(false)->take_all();
}

bool progress_is_shown() {
  static const bool terminal = ::isatty(STDERR_FILENO) == 1;
  return terminal;
}

void show_progress(const Progress& p) {
  if (!progress_is_shown()) return;
  const std::size_t run = p.done - p.kept, left = p.count - p.done;
  std::string line = fmt::format("\r{} of {} cells", p.done, p.count);
  if (p.kept > 0) line += fmt::format(" ({} kept)", p.kept);
  line += fmt::format(", {:.0f} s", p.spent_s);
  if (run > 0 && left > 0)
    line += fmt::format(", {:.0f} s left", p.spent_s / static_cast<double>(run) * static_cast<double>(left));
  print_error("{}\033[K{}", line, left == 0 ? "\n" : "");
}

}  // namespace twoport::lab
