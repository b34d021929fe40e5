#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "common/base/check.h"
#include "common/base/print_error.h"
#include "common/base/text.h"
#include "common/scene/load.h"
#include "lab/cli/commands.h"
#include "lab/lanes/lanes.h"
#include "lab/plot/pictures.h"
#include "lab/study/sweep.h"

namespace twoport::lab {
namespace {

struct Arguments {
  SweepOptions sweep;
  std::optional<int> lanes;
  std::string shard, plot = "stable", verdict = "tail", robot;
  std::vector<std::string> axes, parts;
};

/// Throws ConfigError, with the nearest names, unless --plot is "none" or a figure of the table.
void check_plot(const std::string& plot, bool with_spread) {
  if (plot == "none") return;
  std::vector<std::string> known = figures();
  for (std::size_t i = 0, plain = known.size(); with_spread && i < plain; ++i)
    for (const char* ending : {"_sd", "_worst"}) known.push_back(known[i] + ending);
  if (std::find(known.begin(), known.end(), plot) != known.end()) return;
  const std::vector<std::string> nearest = nearest_names(plot, known, 3);
  throw ConfigError{fmt::format(
      "--plot {}: no such figure; the nearest are {}, {} and {}, and twoport-lab sweep --list-figures prints all", plot,
      nearest[0], nearest[1], nearest[2])};
}

void list_figures() {
  for (const std::string& name : figures()) fmt::print("{}\n", name);
}

void finish(const Table& table, const std::string& plot, const std::string& out) {
  fmt::print("{}/table.csv: {} cells\n", out, table.rows.size());
  if (plot != "none") fmt::print("{}\n", draw(table, plot, out));
}

/// "64 of 1024 cells: 40 stable", and on a terminal where, of two axes: the first across, # where it is not.
std::string words_of(const Table& known) {
  const std::size_t stable = *known.find(known.seeds > 0 ? "stable_worst" : "stable");
  const auto is_stable = [&](const Values& row) { return row[stable].number() == 1.0; };
  std::string words = fmt::format("{} of {} cells: {} stable", known.rows.size(), known.grid.cells(),
                                  std::count_if(known.rows.begin(), known.rows.end(), is_stable));
  const std::optional<Table> all = filled(known);
  if (!progress_is_shown() || !all || all->grid.axes.size() != 2) return words;
  const std::size_t across = all->grid.axes[0].values.size(), up = all->grid.axes[1].values.size();
  const std::size_t every_x = (across + 71) / 72, every_y = (up + 19) / 20;
  for (std::size_t line = (up - 1) / every_y + 1; line-- > 0;) {
    words += "\n  ";
    for (std::size_t x = 0; x < across; x += every_x)
      words += is_stable(all->rows[x * up + line * every_y]) ? '.' : '#';
  }
  return words;
}

std::string draw_known(const Table& known, const std::string& plot, const std::string& out) {
  const std::optional<Table> all = filled(known);
  return all ? draw(*all, plot, out) : "no picture: too few cells";
}

int sweep_command(Arguments& a) {
  check_plot(a.plot, a.sweep.seeds > 0);
  for (const std::string& axis : a.axes) a.sweep.axes.push_back(parse_axis(axis));
  for (const Axis& axis : a.sweep.axes) warn_if_lost(a.sweep.set, axis.paths);
  a.sweep.verdict = verdict_from(a.verdict);
  if (!a.shard.empty()) a.sweep.shard = parse_shard(a.shard);
  if (!a.sweep.out.empty()) a.sweep.returned = columns_of_picture(a.plot);
  a.sweep.lanes = checked_lanes(a.lanes.value_or(0));
  if (!a.robot.empty())
    for (const Axis& axis : a.sweep.axes) refuse_replaced("--vary " + axis.name(), axis.paths);
  const std::optional<HostedRobot> robot = open_robot(a.robot, a.sweep.scene, a.sweep.set);
  if (robot) a.sweep.robot = &*robot;
  a.sweep.stop = &stop_by_user();
  Sketch sketch{a.plot == "none" ? std::string{} : a.sweep.out, a.plot + ".png"};
  a.sweep.coarse = [&](const Table& known) {
    if (!sketch.is_due()) return;
    sketch.tell(words_of(known), [&] {
      if (!a.sweep.out.empty() && a.plot != "none") draw_known(known, a.plot, a.sweep.out);
    });
  };
  const Table table = sweep(a.sweep, show_progress);
  if (table.stopped)
    print_error("{}stopped: {} of {} cells{}\n", progress_is_shown() ? "\n" : "", table.rows.size(),
                (table.grid.cells() - a.sweep.shard.index) / a.sweep.shard.count + 1,
                a.sweep.out.empty() ? "" : "; the same command goes on from there");
  if (a.lanes || progress_is_shown()) say_lanes(table.use);
  if (a.sweep.out.empty()) {
    std::fputs(to_csv(table).c_str(), stdout);
    return table.stopped ? kStoppedStatus : 0;
  }
  const bool plots = a.sweep.shard.count == 1 && a.plot != "none";  // merge plots all parts
  finish(table, plots && !table.stopped ? a.plot : "none", a.sweep.out);
  if (!table.stopped) return 0;
  if (plots) fmt::print("{}\n", draw_known(table, a.plot, a.sweep.out));
  return kStoppedStatus;
}

int merge_command(const Arguments& a) {
  check_plot(a.plot, true);
  finish(merge(a.parts, a.sweep.out, columns_of_picture(a.plot)), a.plot, a.sweep.out);
  return 0;
}

}  // namespace

void add_sweep_commands(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<Arguments>();
  const char* const plot = "Figure to plot (--list-figures), or none";

  CLI::App& sweep = *app.add_subcommand("sweep", "Run a scene over a grid of values; table.csv, one row per cell");
  add_scene(sweep, a->sweep.scene, a->sweep.set);
  add_list(sweep, "--vary", a->axes,
           "PATH=a,b,c or PATH=start:stop:count or PATH=start:stop:count:log; A,B=... links the paths A and B; the "
           "last --vary varies fastest")
      ->required();
  add_robot(sweep, a->robot);
  sweep
      .add_option("--seeds", a->sweep.seeds, "Runs per cell, with the scene's seed, seed + 1, ...: mean, sd and worst")
      ->check(CLI::Range(1, 1'000'000));
  add_jobs(sweep, a->sweep.jobs);
  add_lanes(sweep, a->lanes);
  sweep
      .add_option(
          "--verdict", a->verdict,
          "tail: left alone after the scene's end, beside a twin, as run does; lean: with the twin only where a "
          "passivity controller acts; plain: from the scene's own run, fastest, and UNDECIDED more often")
      ->check(CLI::IsMember({"tail", "lean", "plain"}))
      ->capture_default_str();
  sweep.add_option("--shard", a->shard, "I/N, I from 1: run only this part of the cells, for merge");
  sweep.add_option("--out", a->sweep.out, "Folder for table.csv, pictures, and the cells finished so far");
  sweep.add_option("--plot", a->plot, plot)->capture_default_str();
  sweep.add_flag_callback(
      "--list-figures",
      [] {
        list_figures();
        throw CLI::Success{};
      },
      "Print the figures of a table and exit");
  sweep.footer(
      R"(table.csv holds a column for each varied path, then the figures of the summary (all its numbers except step_ns, the
processor time of a tick), then its texts: scene, architecture, method, verdict. It is bit-identical for any --jobs and --lanes.
Without --out it goes to stdout.

With --seeds N each figure KEY has three columns: KEY is the mean over the seeds (for `stable`: the fraction of stable
seeds), KEY_sd the sample standard deviation (0 for N = 1), KEY_worst the worst value. The smallest value is the
worst of stable (0 if any seed is unstable), min_*, *_min_energy_j, *_share except muted_share, held_force_ratio, contact_s,
environment_force_mean_n, steps, duration_s, packets.*.sent and packets.*.received; of all other figures the largest is.
With a gripper `stable` and the verdict are of both couplings, gripper.stable is the gripper's alone.
The verdict is that of the worst seed, given in worst_seed: an unstable one before a stable one, then the one with the
smallest min_port_energy_j.

Finished cells are kept in OUT/cells.jsonl: a stopped sweep resumes from there if scene, overrides, axes, seeds
and verdict are unchanged. Cells run from coarse to fine; Ctrl-C leaves table and picture of those that have run. Memory holds only the figure to plot, without --out all (about 10 kB a cell). Expectations of the scene (expect) are not checked.
gnuplot draws up to three axes: a curve, a map, a map for each value of the third.)");

  sweep.callback([a, &chosen] { chosen = [a] { return sweep_command(*a); }; });

  CLI::App& merge = *app.add_subcommand("merge", "Combine the parts of sweep --shard I/N");
  merge.add_option("folders", a->parts, "The --out of each part")->required();
  merge.add_option("--out", a->sweep.out, "Folder for table.csv, cells.jsonl and pictures")->required();
  merge.add_option("--plot", a->plot, plot)->capture_default_str();

  merge.callback([a, &chosen] { chosen = [a] { return merge_command(*a); }; });
}

}  // namespace twoport::lab
