#include <fmt/format.h>

#include <cstdio>
#include <memory>
#include <string>

#include "lab/cli/commands.h"
#include "lab/plot/sweep_picture.h"
#include "lab/study/parallel.h"
#include "lab/study/sweep.h"

namespace twoport::lab {
namespace {

struct Arguments {
  SweepOptions sweep;
  std::string shard, plot = "stable";
  std::vector<std::string> axes, parts;
};

void finish(const Table& table, const std::string& plot, const std::string& out) {
  fmt::print("{}/table.csv: {} cells\n", out, table.rows.size());
  if (plot != "none") fmt::print("{}\n", draw(table, plot, out));
}

int sweep_command(Arguments& a) {
  if (a.plot != "none") check_key(a.plot);
  for (const std::string& axis : a.axes) a.sweep.axes.push_back(parse_axis(axis));
  if (!a.shard.empty()) a.sweep.shard = parse_shard(a.shard);
  const Table table = sweep(a.sweep, show_progress);
  if (a.sweep.out.empty()) {
    std::fputs(to_csv(table).c_str(), stdout);
    return 0;
  }
  const bool whole = a.sweep.shard.count == 1;  // merge draws the parts together
  finish(table, whole ? a.plot : "none", a.sweep.out);
  return 0;
}

int merge_command(const Arguments& a) {
  if (a.plot != "none") check_key(a.plot);
  finish(merge(a.parts, a.sweep.out), a.plot, a.sweep.out);
  return 0;
}

}  // namespace

std::vector<Subcommand> add_sweep_commands(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  a->sweep.jobs = all_cores();
  const char* const plot = "Number of the summary that the picture shows, or none";

  CLI::App* sweep = app.add_subcommand("sweep", "Run a scene over a grid of values; table.csv, one row per cell");
  add_scene(sweep, a->sweep.scene, a->sweep.set);
  add_list(
      sweep, "--vary", a->axes,
      "PATH=a,b,c or PATH=start:stop:count or PATH=start:stop:count:log; A,B=... moves the paths A and B together; "
      "the last --vary varies fastest")
      ->required();
  add_jobs(sweep, a->sweep.jobs);
  sweep->add_option("--shard", a->shard, "I/N, I from 1: this part of the cells only, to be merged");
  sweep->add_option("--out", a->sweep.out, "Folder for table.csv, pictures, and the cells finished so far");
  sweep->add_option("--plot", a->plot, plot)->capture_default_str();
  sweep->footer(
      "table.csv holds a column for each varied path, then every number of the summary except step_ns (wall-clock "
      "time, which "
      "would\n"
      "make two tables differ), then its words: scene, architecture, method, verdict. It is the same to the bit for "
      "any\n"
      "--jobs. Without --out it goes to stdout.\n"
      "Finished cells are kept in OUT/cells.jsonl: a sweep that was killed goes on where it was when the scene, the\n"
      "overrides and the axes are the same. What the scene promises (expect) is not checked: the sweep varies it.\n"
      "Up to three axes are drawn by gnuplot: a curve, a map, a map for each value of the third.");

  CLI::App* merge = app.add_subcommand("merge", "Put the parts of sweep --shard I/N together");
  merge->add_option("folders", a->parts, "The --out of each part")->required();
  merge->add_option("--out", a->sweep.out, "Folder for table.csv, cells.jsonl and pictures")->required();
  merge->add_option("--plot", a->plot, plot)->capture_default_str();

  return {{sweep, [a] { return sweep_command(*a); }}, {merge, [a] { return merge_command(*a); }}};
}

}  // namespace twoport::lab
