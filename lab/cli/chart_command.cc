#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstdio>
#include <memory>
#include <string>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/base/print_error.h"
#include "common/scene/load.h"
#include "lab/cli/commands.h"
#include "lab/peers/peers.h"
#include "lab/plot/pictures.h"
#include "lab/study/boundary.h"
#include "lab/study/cells.h"
#include "lab/study/chart.h"

namespace twoport::lab {
namespace {

struct Arguments {
  ChartOptions chart;
  double for_error = 0.0;
  std::string out;
  std::vector<std::string> robots;
};

int chart_command(const Arguments& a) {
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
    const Point* best = cheapest(c.points, a.for_error, c.floor_off);
    if (best == nullptr)
      throw ConfigError{fmt::format(
          "--for-error {}: no point is known to be as accurate; the reference itself is uncertain by {:.1g}{}",
          a.for_error, c.floor_off, unit)};
    fmt::print("for {}{}: {}\n", a.for_error, unit, told(c, *best));
    std::vector<Point> engines, own;
    for (const Point& p : c.points) (p.peer ? engines : own).push_back(p);
    if (engines.empty()) return 0;
    const Point* engine = cheapest(engines, a.for_error, c.floor_off);
    best = cheapest(own, a.for_error, c.floor_off);
    if (engine == nullptr) {
      fmt::print("no other engine is as accurate\n");
    } else if (best != nullptr) {
      fmt::print("{}, takes {:.3g} times as long as {}\n", told(c, *engine), engine->cost / best->cost, best->name);
    }
  }
  return 0;
}

}  // namespace

void add_chart_command(CLI::App& app, Chosen& chosen) {
  const auto a = std::make_shared<Arguments>();
  CLI::App& chart =
      *app.add_subcommand("chart", "Plot error against computing cost of integrators, rates and model details");
  add_scene(chart, a->chart.scene, a->chart.set);
  add_list(chart, "--vary", a->chart.vary,
           "PATH=a,b,c or PATH,PATH=a,b,c; integrators and substeps unless given; with --answer also "
           "verdict=tail,lean,plain");
  add_list(
      chart, "--robot", a->robots,
      "mujoco:FILE.xml[,site=NAME][,key=NAME]: also a world of MuJoCo in place of the scene's robot and environment");
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

}  // namespace twoport::lab
