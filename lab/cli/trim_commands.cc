#include <fmt/format.h>

#include <cstdio>
#include <memory>
#include <string>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/scene/load.h"
#include "lab/cli/commands.h"
#include "lab/plot/pictures.h"
#include "lab/study/cells.h"
#include "lab/study/trim.h"

namespace twoport::lab {
namespace {

struct Arguments {
  std::string scene, out;
  std::vector<std::string> set;
  double tolerance = 1e-3;
  int repetitions = 2;
};

Scene prepared(const Arguments& a) {
  if (a.repetitions < 1) throw ConfigError{fmt::format("--repetitions is {}; it must be at least 1", a.repetitions)};
  Scene scene = load_scene(a.scene, a.set);
  if (!a.out.empty()) make_folder(a.out);
  return scene;
}

int trim_command(const Arguments& a) {
  const Trim found = trim(prepared(a), a.tolerance, a.repetitions, show_runs);
  std::fputs(to_text(found, a.tolerance).c_str(), stdout);
  if (!a.out.empty()) write_whole(a.out + "/trim.csv", to_csv(found));
  return 0;
}

int blocks_command(const Arguments& a) {
  const Scene scene = prepared(a);
  const std::vector<BlockCost> costs = block_costs(scene, a.repetitions, show_runs);
  std::fputs(to_text(costs).c_str(), stdout);
  if (a.out.empty()) return 0;
  write_whole(a.out + "/blocks.csv", to_csv(costs));
  fmt::print("{}\n", draw(costs, scene.name, a.out));
  return 0;
}

CLI::App& add(CLI::App& app, const char* name, const char* words, const char* out, Arguments& a) {
  CLI::App& command = *app.add_subcommand(name, words);
  add_scene(command, a.scene, a.set);
  command.add_option("--out", a.out, out);
  command.add_option("--repetitions", a.repetitions, "Timed repetitions of the eight runs")->capture_default_str();
  return command;
}

}  // namespace

void add_trim_commands(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<Arguments>();
  CLI::App& trim = add(app, "trim", "Find blocks of a scene that change its summary by less than a tolerance",
                       "Folder for trim.csv", *a);
  trim.add_option("--tolerance", a->tolerance, "Relative change of each number")->capture_default_str();
  trim.footer(
      "Each block is left out alone, everything else equal. A number changes by |a - b| / max(|a|, |b|, floor), with\n"
      "floors of 1e-6 J (1e-3 J for *_min_energy_j), 1e-6 m, 1e-3 N, 0.01 deg, 1e-3 s and 1 for counts; all numbers\n"
      "of the summary except step_ns.\n"
      "A change of the verdict or of a met expectation always counts. Each variant is run eight times: with the "
      "scene's\n"
      "seed, and with the next seven seeds and stiffnesses changed in the twelfth digit. A change within the range of\n"
      "these runs is within the scatter, and the block is not proposed.\n"
      "saved: relative reduction of the cost of a tick, median of interleaved runs; a few per cent are noise.");
  CLI::App& blocks = add(app, "blocks", "Measure the cost of a tick as blocks are added to a scene one at a time",
                         "Folder for blocks.csv and the chart", *a);
  trim.callback([a, &chosen] { chosen = [a] { return trim_command(*a); }; });
  blocks.callback([a, &chosen] { chosen = [a] { return blocks_command(*a); }; });
}

}  // namespace twoport::lab
