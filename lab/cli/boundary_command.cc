#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "common/base/file.h"
#include "common/base/print_error.h"
#include "lab/cli/commands.h"
#include "lab/lanes/lanes.h"
#include "lab/plot/pictures.h"
#include "lab/study/boundary.h"
#include "lab/study/cells.h"

namespace twoport::lab {
namespace {

struct Arguments {
  BoundaryOptions boundary;
  std::optional<int> lanes;
  std::string interval, along, out;
};

int curve_command(Arguments& a) {
  const Axis along = parse_axis(a.along, "--along");
  warn_if_lost(a.boundary.set, along.paths);
  if (!a.out.empty()) make_folder(a.out);
  a.boundary.stop = &stop_by_user();
  Sketch sketch{a.out, "boundary.png"};
  const BoundaryCurve curve = boundary_curve(a.boundary, along, show_runs, [&](const BoundaryCurve& known) {
    const auto is_open = [](const BoundarySearch& each) { return each.open; };
    const auto open = std::count_if(known.found.begin(), known.found.end(), is_open);
    if (open > 0 && sketch.is_due())
      sketch.tell(fmt::format("{} of {} boundaries within --tolerance",
                              known.found.size() - static_cast<std::size_t>(open), known.found.size()),
                  [&] {
                    if (!a.out.empty()) draw(known, a.out);
                  });
  });
  const int status = curve.stopped ? kStoppedStatus : 0;
  if (curve.stopped) print_error("{}stopped\n", progress_is_shown() ? "\n" : "");
  if (curve.found.empty()) return status;
  if (a.lanes) say_lanes(curve.use);
  const std::string csv = to_csv(to_table(curve));
  if (a.out.empty()) {
    std::fputs(csv.c_str(), stdout);
    return status;
  }
  write_whole(a.out + "/boundary.csv", csv);
  fmt::print("{}/boundary.csv: {} rows\n{}\n", a.out, along.values.size(), draw(curve, a.out));
  return status;
}

int boundary_command(Arguments& a) {
  a.boundary.vary = parse_interval(a.interval);
  warn_if_lost(a.boundary.set, a.boundary.vary.paths);
  a.boundary.lanes = checked_lanes(a.lanes.value_or(0));
  if (!a.along.empty()) return curve_command(a);
  const auto print = [](const Trial& t) {
    fmt::print("{:<14} {:<9} {}\n", t.value, t.stable ? "stable" : "unstable", t.verdict);
    std::fflush(stdout);
  };
  const Boundary found = find_boundary(a.boundary, print, [](const Progress& p) {
    if (!progress_is_shown()) show_runs(p);  // a terminal shows the values
  });
  if (found.stable > found.unstable) fmt::print("stable from here up:\n");
  fmt::print("{} = {}\n", a.boundary.vary.name(), found.stable);
  return 0;
}

}  // namespace

void add_boundary_command(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<Arguments>();
  CLI::App& boundary = *app.add_subcommand("boundary", "Find the stability boundary of a scene along one number");
  add_scene(boundary, a->boundary.scene, a->boundary.set);
  boundary
      .add_option("--vary", a->interval,
                  "PATH=LO:HI, LO < HI; stable at one end and unstable at the other; A,B=LO:HI varies both")
      ->required();
  CLI::Option* along =
      boundary.add_option("--along", a->along, "PATH=SPEC as for sweep --vary: one boundary per value");
  boundary.add_option("--out", a->out, "With --along: folder for boundary.csv and the picture")->needs(along);
  add_jobs(boundary, a->boundary.jobs);
  add_lanes(boundary, a->lanes);
  boundary.add_option("--tolerance", a->boundary.tolerance, "Relative width of the final bracket")
      ->capture_default_str();
  boundary
      .add_option("--scan", a->boundary.scan,
                  "Values between the ends that are tried first; the first change is refined")
      ->capture_default_str();
  boundary.footer(
      R"(Prints a line for each run: value, verdict. The last line is PATH = VALUE, the largest value up to which the run is
stable (or the smallest, if it is stable at HI). Exit status 2 when both ends agree.
The verdict is the summary's `stable`. The loop needs an excitation, and near a boundary growth is slow: give the run
time after the operator's path has ended.

With --along the search is repeated at each value of a second path, and the result is a table: a row for each value, with
the boundary and a note. The note is empty if the run is stable up to the boundary, and "stable from here up" if it is
stable from there on; if both ends agree there is no boundary, the note states this, and the exit status is 0.
With --out the table is DIR/boundary.csv, and gnuplot draws DIR/boundary.png and .svg; without, it goes to stdout.
Ctrl-C leaves what is known: the note of a row then has the nearest value known to be unstable.)");
  boundary.callback([a, &chosen] { chosen = [a] { return boundary_command(*a); }; });
}

}  // namespace twoport::lab
