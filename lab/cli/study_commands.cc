#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/print_error.h"
#include "common/scene/load.h"
#include "lab/cli/commands.h"
#include "lab/lanes/lanes.h"
#include "lab/paper.h"
#include "lab/peers/peers.h"
#include "lab/plot/pictures.h"
#include "lab/study/boundary.h"
#include "lab/study/cells.h"
#include "lab/study/chart.h"
#include "lab/study/impedance.h"
#include "lab/study/parallel.h"
#include "lab/study/trim.h"
#include "lab/study/zwidth.h"

namespace twoport::lab {
namespace {

struct BoundaryArguments {
  BoundaryOptions boundary;
  std::optional<int> lanes;
  std::string interval, along, out, robot;
};

int curve_command(BoundaryArguments& a) {
  const Axis along = parse_axis(a.along, "--along");
  warn_if_lost(a.boundary.set, along.paths);
  if (!a.robot.empty()) refuse_replaced("--along " + along.name(), along.paths);
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

int boundary_command(BoundaryArguments& a) {
  a.boundary.vary = parse_interval(a.interval);
  warn_if_lost(a.boundary.set, a.boundary.vary.paths);
  a.boundary.lanes = checked_lanes(a.lanes.value_or(0));
  if (!a.robot.empty()) refuse_replaced("--vary " + a.boundary.vary.name(), a.boundary.vary.paths);
  const std::optional<HostedRobot> robot = open_robot(a.robot, a.boundary.scene, a.boundary.set);
  if (robot) a.boundary.robot = &*robot;
  if (!a.along.empty()) return curve_command(a);
  const auto print = [](const Trial& t) {
    fmt::print("{:<14} {:<9} {}\n", t.value, t.stable ? "stable" : "unstable", t.verdict);
    std::fflush(stdout);
  };
  const Boundary found = find_boundary(a.boundary, print, [](const Progress& p) {
    if (!progress_is_shown()) show_runs(p);  // a terminal shows the values
  });
  if (const std::optional<Decided> decided = what_decides(a.boundary, found))
    fmt::print("{} decides: without its environment the run is {} at {}: {}\n",
               decided->by_contact ? "contact" : "free space", decided->by_contact ? "not unstable" : "unstable",
               found.unstable, decided->verdict);
  if (found.stable > found.unstable) fmt::print("stable from here up:\n");
  fmt::print("{} = {}\n", a.boundary.vary.name(), found.stable);
  return 0;
}

struct ChartArguments {
  ChartOptions chart;
  double for_error = 0.0;
  std::string out;
  std::vector<std::string> robots;
};

int chart_command(const ChartArguments& a) {
  const Scene scene = load_scene(a.chart.scene, a.chart.set);
  std::vector<Peer> peers = peers_for(scene);
  for (const std::string& robot : a.robots) {
    if (!a.chart.boundary.empty())
      refuse_replaced("--boundary " + a.chart.boundary, parse_interval(a.chart.boundary, "--boundary").paths);
    peers.push_back({.name = "robot in MuJoCo, " + robot.substr(robot.find_last_of(":/") + 1),
                     .robot = std::make_shared<HostedRobot>(*open_robot(robot, scene))});
  }
  const Chart c =
      chart(a.chart, peers, [](const std::string& what, double spent_s) { show_line(what, spent_s, false); });
  if (progress_is_shown()) print_error("\r\033[K");
  std::fputs(to_text(c).c_str(), stdout);
  if (peers.empty() && absent_peers().empty()) fmt::print("other engines: not for a scene of this kind\n");
  if (!absent_peers().empty()) fmt::print("other engines not installed: {}\n", fmt::join(absent_peers(), ", "));
  if (!a.out.empty()) {
    make_folder(a.out);
    write_whole(a.out + "/chart.csv", to_csv(to_table(c)));
    write_whole(a.out + "/engines.csv", to_csv(to_table(c, beside_engines(c))));
    fmt::print("{}\n", draw(c, scene.name, a.out));
  }
  if (a.for_error > 0.0) {
    const char* const unit = a.chart.answer ? "" : " m";
    const ChartPoint* best = cheapest(c.points, a.for_error, c.floor_off);
    if (best == nullptr)
      throw ConfigError{fmt::format(
          "--for-error {}: no point is known to be as accurate; the reference itself is uncertain by {:.1g}{}",
          a.for_error, c.floor_off, unit)};
    fmt::print("for {}{}: {}\n", a.for_error, unit, told(c, *best));
    const auto of_peer = [](const ChartPoint& p) { return p.peer; };
    if (std::none_of(c.points.begin(), c.points.end(), of_peer)) return 0;
    const ChartPoint* engine = cheapest(c.points, a.for_error, c.floor_off, of_peer);
    best = cheapest(c.points, a.for_error, c.floor_off, std::not_fn(of_peer));
    if (engine == nullptr) {
      fmt::print("no other engine is as accurate\n");
    } else if (best != nullptr) {
      fmt::print("{}, takes {:.3g} times as long as {}\n", told(c, *engine), engine->cost / best->cost, best->name);
    }
  }
  return 0;
}

struct ImpedanceArguments {
  std::string scene, out;
  std::vector<std::string> set;
  ImpedanceOptions options;
};

int impedance_command(const ImpedanceArguments& a) {
  const Scene scene = load_scene(a.scene, a.set);
  const std::vector<DisplayedImpedance> all = displayed_impedance(scene, a.options);
  if (!a.out.empty()) make_folder(a.out);
  std::fputs(to_text(all).c_str(), stdout);
  if (a.out.empty()) return 0;
  write_whole(a.out + "/table.csv", to_csv(all));
  fmt::print("{}\n", draw(all, scene.name, a.out));
  return 0;
}

struct TrimArguments {
  std::string scene, out;
  std::vector<std::string> set;
  double tolerance = 1e-3;
  int repetitions = 2;
};

Scene prepared(const TrimArguments& a) {
  if (a.repetitions < 1) throw ConfigError{fmt::format("--repetitions is {}; it must be at least 1", a.repetitions)};
  Scene scene = load_scene(a.scene, a.set);
  if (!a.out.empty()) make_folder(a.out);
  return scene;
}

int trim_command(const TrimArguments& a) {
  const Trim found = trim(prepared(a), a.tolerance, a.repetitions, show_runs);
  std::fputs(to_text(found, a.tolerance).c_str(), stdout);
  if (!a.out.empty()) write_whole(a.out + "/trim.csv", to_csv(found));
  return 0;
}

int blocks_command(const TrimArguments& a) {
  const Scene scene = prepared(a);
  const std::vector<BlockCost> costs = block_costs(scene, a.repetitions, show_runs);
  std::fputs(to_text(costs).c_str(), stdout);
  if (a.out.empty()) return 0;
  write_whole(a.out + "/blocks.csv", to_csv(costs));
  fmt::print("{}\n", draw(costs, scene.name, a.out));
  return 0;
}

CLI::App& add(CLI::App& app, const char* name, const char* words, const char* out, TrimArguments& a) {
  CLI::App& command = *app.add_subcommand(name, words);
  add_scene(command, a.scene, a.set);
  command.add_option("--out", a.out, out);
  command.add_option("--repetitions", a.repetitions, "Timed repetitions of the eight runs")->capture_default_str();
  return command;
}

int zwidth_command(ZWidthOptions options, const std::optional<int>& lanes) {
  options.lanes = checked_lanes(lanes.value_or(0));
  const ZWidth z = z_width(options, show_progress);
  if (lanes) say_lanes(z.table.use);
  std::fputs(to_text(z).c_str(), stdout);
  if (options.out.empty()) return 0;
  fmt::print("{}\n", draw(z, options.out));
  return 0;
}

struct PaperArguments {
  std::string out;
  int jobs = all_cores();
};

void say(const std::string& line) {
  fmt::print("{}\n", line);
  std::fflush(stdout);
}

int paper_command(const PaperArguments& a) {
  if (a.jobs < 1) throw ConfigError{fmt::format("--jobs is {}; it must be at least 1", a.jobs)};
  std::error_code error;
  std::filesystem::create_directories(a.out, error);
  if (error) throw ConfigError{fmt::format("--out {}: cannot be created: {}", a.out, error.message())};

  PaperTable table;
  for (PaperCase& which : paper_cases()) table.results.push_back({std::move(which), {}});
  say(fmt::format("{} cases, {} seeds of 4 s each", table.results.size(), kPaperSeeds));
  for_each_parallel(table.results.size(), a.jobs,
                    [&](std::size_t i) { table.results[i].numbers = measure(table.results[i].which); });
  table.admittance = admittance_runs();
  table.frames = frame_checks();
  const std::string text = paper_text(table);
  write_whole(a.out + "/figures.csv", paper_csv(table));
  write_whole(a.out + "/table.txt", text);

  const std::vector<PaperFigure> figures = paper_figures();
  std::mutex guard;
  for_each_parallel(figures.size(), a.jobs, [&](std::size_t i) {
    const PaperFigure& f = figures[i];
    const std::string made = draw(f.make(), a.out);
    const std::lock_guard lock{guard};
    say(fmt::format("{}: {}", f.title, made));
  });
  say(text);
  say(fmt::format("{0}/figures.csv, {0}/table.txt", a.out));
  return 0;
}

}  // namespace

void add_boundary_command(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<BoundaryArguments>();
  CLI::App& boundary = *app.add_subcommand("boundary", "Find the stability boundary of a scene along one number");
  add_scene(boundary, a->boundary.scene, a->boundary.set);
  boundary
      .add_option("--vary", a->interval,
                  "PATH=LO:HI, LO < HI; stable at one end and unstable at the other; A,B=LO:HI varies both")
      ->required();
  add_robot(boundary, a->robot);
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
      R"(Prints a line for each run: value, verdict; then whether contact or free space decides: whether, just beyond the
boundary, the run is unstable without its environment (not with --robot). The last line is PATH = VALUE, the largest value up to which the run is
stable (or the smallest, if it is stable at HI). Exit status 2 when both ends agree.
The verdict is the summary's `stable`. The loop needs an excitation, and near a boundary growth is slow: give the run
time after the operator's path has ended.

With --along the search is repeated at each value of a second path, and the result is a table: a row for each value, with
the boundary, a note, and what decides. The note is empty if the run is stable up to the boundary, and "stable from here up" if it is
stable from there on; if both ends agree there is no boundary, the note states this, and the exit status is 0.
With --out the table is DIR/boundary.csv, and gnuplot draws DIR/boundary.png and .svg; without, it goes to stdout.
Ctrl-C leaves what is known: the note of a row then has the nearest value known to be unstable.)");
  boundary.callback([a, &chosen] { chosen = [a] { return boundary_command(*a); }; });
}

void add_chart_command(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<ChartArguments>();
  CLI::App& chart =
      *app.add_subcommand("chart", "Plot error against computing cost of integrators, rates and model details");
  add_scene(chart, a->chart.scene, a->chart.set);
  add_list(chart, "--vary", a->chart.vary,
           "PATH=a,b,c or PATH,PATH=a,b,c; integrators and substeps unless given; with --answer also "
           "verdict=tail,lean,plain");
  add_list(chart, "--robot", a->robots,
           "mujoco:FILE.xml[,site=NAME][,key=NAME][,actuators=off]: also a world of MuJoCo in place of the scene's "
           "robot and environment");
  chart.add_option("--boundary", a->chart.boundary, "PATH=LO:HI: also find the stability boundary of each point");
  chart.add_flag(
      "--answer", a->chart.answer,
      "Compare whole answers: verdict, force felt and, with --boundary, the boundary, over their processor time");
  chart
      .add_option(
          "--for-error", a->for_error,
          "Recommend the cheapest point with at most this position error [m]; with --answer an error of 0.01 is 1 "
          "% of the force felt and of the boundary, with the verdict of the reference")
      ->check(positive());
  chart.add_option("--repetitions", a->chart.repetitions, "Timed rounds; the median is used")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  chart.add_option("--reference-substeps", a->chart.reference_substeps, "Of the reference, Runge-Kutta 4")
      ->check(CLI::Range(2, 10000))
      ->capture_default_str();
  chart.add_option("--out", a->out, "Folder for chart.csv and the picture");
  chart.callback([a, &chosen] { chosen = [a] { return chart_command(*a); }; });
}

void add_impedance_command(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<ImpedanceArguments>();
  CLI::App& impedance = *app.add_subcommand(
      "impedance", "Displayed mass, damping and stiffness in free space and in contact, beside the true");
  add_scene(impedance, a->scene, a->set);
  impedance.add_option("--amplitude", a->options.amplitude_m, "Largest excursion [m]")
      ->check(CLI::Range(1e-7, 1.0))
      ->capture_default_str();
  impedance.add_option("--out", a->out, "Folder for table.csv and the picture");
  impedance.footer(
      R"(The scene is run once to find where the robot (the device under RENDER) touches. Then the handle is moved to that place,
and to free space, and excited by a random-phase multi-sine of 0.5 to 50 Hz along the environment's force. Force against
motion at the master port gives a mass, a damping and a stiffness, fitted up to 10 Hz. True are those of robot and
environment, times force_scale and motion_scale. Coherence is the share of the force that a linear law explains: below 1
where a force saturates, an encoder is coarse, controllers switch, packets are lost or contact ends. table.csv holds each
line: real and imaginary part of force / motion [N/m], displayed and true. A scene that is unstable or never coupled, or
has no free space, is refused.)");
  impedance.callback([a, &chosen] { chosen = [a] { return impedance_command(*a); }; });
}

void add_trim_commands(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<TrimArguments>();
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

void add_zwidth_command(CLI::App& app, Chosen& chosen) {
  const auto options = std::make_shared<ZWidthOptions>();
  const auto lanes = std::make_shared<std::optional<int>>();
  CLI::App& zwidth =
      *app.add_subcommand("zwidth", "Map the stiffness and damping that a scene displays stably, with theory");
  add_scene(zwidth, options->scene, options->set);
  zwidth.get_option("scene")->description("Scene file (.textproto): one axis, RENDER, one wall or spring");
  zwidth.add_option("--damping", options->damping, "Values of B [N s/m], as for --vary")->capture_default_str();
  zwidth.add_option("--stiffness", options->stiffness, "Values of K [N/m], from small to large")->capture_default_str();
  zwidth.add_option("--methods", options->methods, "Controllers; one map per controller")->capture_default_str();
  add_jobs(zwidth, options->jobs);
  add_lanes(zwidth, *lanes);
  zwidth.add_option("--out", options->out, "Folder for table.csv, the map, and the cells finished so far");
  zwidth.callback(
      [options, lanes, &chosen] { chosen = [options, lanes] { return zwidth_command(*options, *lanes); }; });
}

void add_paper_command(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<PaperArguments>();
  CLI::App& paper =
      *app.add_subcommand("paper", "Reproduce the figures and numbers of the reference paper from simulated data");
  paper.add_option("--out", a->out, "Folder for pictures, their data, figures.csv and table.txt")->required();
  paper.add_option("--jobs", a->jobs, "Threads")->capture_default_str();
  paper.footer(
      "\"Time Domain Passivity Control for 6 Degrees of Freedom Haptic Displays\": Figures 4 and 6 to 11, and claims\n"
      "without a figure: the admittance, rendered friction, the reference energy, independence of the frame.\n"
      "The scenes of scenes/paper/ are built in; each row of figures.csv lists its overrides.");
  paper.callback([a, &chosen] { chosen = [a] { return paper_command(*a); }; });
}

}  // namespace twoport::lab
