#include "lab/search_commands.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>

#include "common/base/check.h"
#include "common/scene/load.h"
#include "common/scene/summary.h"
#include "lab/boundary.h"
#include "lab/cells.h"
#include "lab/chart.h"
#include "lab/parallel.h"
#include "lab/peers/peers.h"
#include "lab/plot.h"
#include "lab/sweep.h"
#include "lab/zwidth.h"

namespace twoport::lab {
namespace {

struct Arguments {
  BoundaryOptions boundary;
  SweepOptions sweep;
  ZWidthOptions z_width;
  ChartOptions chart;
  double for_error = 0.0;
  std::string interval, shard, plot = "stable";
  std::vector<std::string> axes, parts;
  int jobs = all_cores();
};

CLI::Option* add_list(CLI::App* command, const std::string& name, std::vector<std::string>& into,
                      const std::string& words) {
  return command->add_option(name, into, words)->allow_extra_args(false)->take_all();
}

int boundary_command(Arguments& a) {
  a.boundary.vary = parse_interval(a.interval);
  a.boundary.jobs = a.jobs;
  const Boundary found = find_boundary(a.boundary, [](const Trial& t) {
    fmt::print("{:<14} {:<9} {}\n", t.value, t.stable ? "stable" : "unstable", t.verdict);
    std::fflush(stdout);
  });
  if (found.stable > found.unstable) fmt::print("stable from here up:\n");
  fmt::print("{} = {}\n", a.boundary.vary.path, found.stable);
  return 0;
}

/// One line on stderr that is written over, where somebody watches it.
void show(const Progress& p) {
  static const bool watched = ::isatty(STDERR_FILENO) == 1;
  if (!watched) return;
  const std::size_t run = p.done - p.kept, left = p.count - p.done;
  std::string line = fmt::format("\r{} of {} cells", p.done, p.count);
  if (p.kept > 0) line += fmt::format(" ({} kept)", p.kept);
  line += fmt::format(", {:.0f} s", p.spent_s);
  if (run > 0 && left > 0)
    line += fmt::format(", {:.0f} s left", p.spent_s / static_cast<double>(run) * static_cast<double>(left));
  fmt::print(stderr, "{}\033[K{}", line, left == 0 ? "\n" : "");
}

void check_picture(const Arguments& a) {
  if (a.plot != "none") check_key(a.plot);
}

void finish(const Table& table, const Arguments& a) {
  fmt::print("{}/table.csv: {} cells\n", a.sweep.out, table.rows.size());
  if (a.plot != "none") fmt::print("{}\n", draw(table, a.plot, a.sweep.out));
}

int sweep_command(Arguments& a) {
  check_picture(a);
  if (a.jobs < 1) throw ConfigError{fmt::format("--jobs is {}; it must be at least 1", a.jobs)};
  for (const std::string& axis : a.axes) a.sweep.axes.push_back(parse_axis(axis));
  if (!a.shard.empty()) a.sweep.shard = parse_shard(a.shard);
  a.sweep.jobs = a.jobs;
  const Table table = sweep(a.sweep, show);
  if (a.sweep.out.empty()) {
    std::fputs(to_csv(table).c_str(), stdout);
    return 0;
  }
  if (a.sweep.shard.count > 1) a.plot = "none";  // merge draws the whole
  finish(table, a);
  return 0;
}

int zwidth_command(Arguments& a) {
  if (a.jobs < 1) throw ConfigError{fmt::format("--jobs is {}; it must be at least 1", a.jobs)};
  a.z_width.jobs = a.jobs;
  const ZWidth z = z_width(a.z_width, show);
  std::fputs(to_text(z).c_str(), stdout);
  if (a.z_width.out.empty()) return 0;
  fmt::print("{}\n", draw(z.table, "stable", a.z_width.out, {{"border by eigenvalues, no controller", z.border}}));
  return 0;
}

int chart_command(Arguments& a) {
  static const bool watched = ::isatty(STDERR_FILENO) == 1;
  const Scene scene = load_scene(a.chart.scene, a.chart.set);
  const std::vector<Peer> peers = peers_for(scene);
  const Chart c = chart(a.chart, peers, [](const std::string& what) {
    if (watched) fmt::print(stderr, "\r{}\033[K", what);
  });
  if (watched) fmt::print(stderr, "\r\033[K");
  std::fputs(to_text(c).c_str(), stdout);
  if (peers.empty() && absent_peers().empty()) fmt::print("other engines: not for a scene of this kind\n");
  if (!absent_peers().empty()) fmt::print("other engines not installed: {}\n", fmt::join(absent_peers(), ", "));
  if (!a.sweep.out.empty()) {
    make_folder(a.sweep.out);
    write_whole(a.sweep.out + "/chart.csv", to_csv(c));
    fmt::print("{}\n", draw(c, scene.name, a.sweep.out));
  }
  if (a.for_error > 0.0) {
    const Point* best = cheapest(c.points, a.for_error, c.floor.position_rms_m);
    if (best == nullptr)
      throw ConfigError{
          fmt::format("--for-error {}: no point is known to come that near; the reference itself is "
                      "uncertain by {:.1g} m",
                      a.for_error, c.floor.position_rms_m)};
    fmt::print("for {} m: {}, {:.4g} ns a tick, {:.2g} m\n", a.for_error, best->name, best->ns_per_tick,
               std::max(best->error.position_rms_m, c.floor.position_rms_m));
  }
  return 0;
}

int merge_command(Arguments& a) {
  check_picture(a);
  finish(merge(a.parts, a.sweep.out), a);
  return 0;
}

}  // namespace

std::vector<Subcommand> add_search_commands(CLI::App& app) {
  const auto a = std::make_shared<Arguments>();
  const char* const set = "Override, PATH=VALUE, e.g. control.passivity.method=NONE";
  const char* const plot = "Number of the summary that the picture shows, or none";

  CLI::App* boundary = app.add_subcommand("boundary", "Find where a scene stops being stable along one number");
  boundary->add_option("scene", a->boundary.scene, "Scene file (.textproto)")->required();
  boundary->add_option("--vary", a->interval, "PATH=LO:HI, LO < HI; stable at one end and unstable at the other")
      ->required();
  add_list(boundary, "--set", a->boundary.set, set);
  boundary->add_option("--tolerance", a->boundary.tolerance, "Relative width to which it is found")
      ->capture_default_str();
  boundary->add_option("--scan", a->boundary.scan, "Values between the ends tried first; the first change counts")
      ->capture_default_str();
  boundary->footer(
      "Every run is a line: value, verdict. The last line is PATH = VALUE, the largest value up to which the run is\n"
      "stable (the smallest from which it is, where it is stable at HI). Exit status 2 when both ends agree.\n"
      "The verdict is the summary's `stable`: something must set the loop in motion, or nothing grows; near a "
      "boundary\n"
      "growth is slow, so give the run time after the operator's path has ended.");

  CLI::App* sweep = app.add_subcommand("sweep", "Run a scene over a grid of values; table.csv, one row per cell");
  sweep->add_option("scene", a->sweep.scene, "Scene file (.textproto)")->required();
  add_list(sweep, "--vary", a->axes,
           "PATH=a,b,c or PATH=start:stop:count or PATH=start:stop:count:log; the last varies fastest")
      ->required();
  add_list(sweep, "--set", a->sweep.set, set);
  sweep->add_option("--jobs", a->jobs, "Threads")->capture_default_str();
  sweep->add_option("--shard", a->shard, "I/N, I from 1: this part of the cells only, to be merged");
  sweep->add_option("--out", a->sweep.out, "Folder for table.csv, pictures, and the cells finished so far");
  sweep->add_option("--plot", a->plot, plot)->capture_default_str();
  sweep->footer(
      "table.csv holds the varied paths, then every number of the summary except step_ns (wall-clock time, which "
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

  CLI::App* zwidth = app.add_subcommand("zwidth", "Which stiffness and damping a scene displays stably, beside theory");
  zwidth->add_option("scene", a->z_width.scene, "Scene file (.textproto): one axis, RENDER, one wall or spring")
      ->required();
  zwidth->add_option("--damping", a->z_width.damping, "Values of B [N s/m], as --vary takes them")
      ->capture_default_str();
  zwidth->add_option("--stiffness", a->z_width.stiffness, "Values of K [N/m], from small to large")
      ->capture_default_str();
  zwidth->add_option("--methods", a->z_width.methods, "Controllers, one map each")->capture_default_str();
  add_list(zwidth, "--set", a->z_width.set, set);
  zwidth->add_option("--jobs", a->jobs, "Threads")->capture_default_str();
  zwidth->add_option("--out", a->z_width.out, "Folder for table.csv, the map, and the cells finished so far");

  CLI::App* chart = app.add_subcommand("chart", "What each way to step a scene costs, against how far off it is");
  chart->add_option("scene", a->chart.scene, "Scene file (.textproto)")->required();
  add_list(chart, "--vary", a->chart.vary, "PATH=a,b,c; integrators and substeps unless given");
  add_list(chart, "--set", a->chart.set, set);
  chart->add_option("--boundary", a->chart.boundary, "PATH=LO:HI: also where each point changes the verdict");
  chart->add_option("--for-error", a->for_error, "Recommend the cheapest with a position error up to this [m]")
      ->check(CLI::PositiveNumber);
  chart->add_option("--repetitions", a->chart.repetitions, "Timed rounds; the median counts")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  chart->add_option("--reference-substeps", a->chart.reference_substeps, "Of the reference, Runge-Kutta 4")
      ->check(CLI::Range(2, 10000))
      ->capture_default_str();
  chart->add_option("--out", a->sweep.out, "Folder for chart.csv and the picture");

  return {{boundary, [a] { return boundary_command(*a); }},
          {sweep, [a] { return sweep_command(*a); }},
          {chart, [a] { return chart_command(*a); }},
          {zwidth, [a] { return zwidth_command(*a); }},
          {merge, [a] { return merge_command(*a); }}};
}

}  // namespace twoport::lab
