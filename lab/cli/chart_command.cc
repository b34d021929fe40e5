#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
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
#include "lab/study/cells.h"
#include "lab/study/chart.h"

namespace twoport::lab {
namespace {

struct Arguments {
  ChartOptions chart;
  double for_error = 0.0;
  std::string out;
};

int chart_command(const Arguments& a) {
  const Scene scene = load_scene(a.chart.scene, a.chart.set);
  const std::vector<Peer> peers = peers_for(scene);
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
    const Point* best = cheapest(c.points, a.for_error, c.floor.position_rms_m);
    if (best == nullptr)
      throw ConfigError{
          fmt::format("--for-error {}: no point is known to be as accurate; the reference itself is "
                      "uncertain by {:.1g} m",
                      a.for_error, c.floor.position_rms_m)};
    fmt::print("for {} m: {}, {:.4g} ns a tick, {:.2g} m\n", a.for_error, best->name, best->ns_per_tick,
               std::max(best->error.position_rms_m, c.floor.position_rms_m));
    std::vector<Point> engines, own;
    for (const Point& p : c.points) (p.peer ? engines : own).push_back(p);
    if (engines.empty()) return 0;
    const Point* engine = cheapest(engines, a.for_error, c.floor.position_rms_m);
    best = cheapest(own, a.for_error, c.floor.position_rms_m);
    if (engine == nullptr) {
      fmt::print("no other engine is as accurate\n");
    } else if (best != nullptr) {
      fmt::print("{} takes {:.3g} times as long as {}: {:.4g} ns a tick, {:.2g} m\n", engine->name,
                 engine->cost / best->cost, best->name, engine->ns_per_tick, engine->error.position_rms_m);
    }
  }
  return 0;
}

}  // namespace

Subcommand add_chart_command(Command app) {
  const auto a = std::make_shared<Arguments>();
  Command chart = app.add("chart", "Plot error against computing cost of integrators, rates and model details");
  add_scene(chart, a->chart.scene, a->chart.set);
  chart.list("--vary", a->chart.vary, "PATH=a,b,c or PATH,PATH=a,b,c; integrators and substeps unless given");
  chart.option("--boundary", a->chart.boundary, "PATH=LO:HI: also find the stability boundary of each point");
  chart.option("--for-error", a->for_error, "Recommend the cheapest point with at most this position error [m]")
      .positive();
  chart.option("--repetitions", a->chart.repetitions, "Timed rounds; the median is used")
      .between(1, 1000)
      .show_default();
  chart.option("--reference-substeps", a->chart.reference_substeps, "Of the reference, Runge-Kutta 4")
      .between(2, 10000)
      .show_default();
  chart.option("--out", a->out, "Folder for chart.csv and the picture");
  return {chart, [a] { return chart_command(*a); }};
}

}  // namespace twoport::lab
