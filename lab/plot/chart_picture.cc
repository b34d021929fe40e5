#include "lab/plot/chart_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <vector>

#include "common/scene/summary.h"
#include "lab/plot/gnuplot.h"

namespace twoport::lab {

std::string draw(const Chart& c, const std::string& title, const std::string& folder) {
  std::vector<std::string> groups;
  std::set<std::string> others;
  for (const Point& p : c.points)
    if (p.impossible.empty() && std::find(groups.begin(), groups.end(), p.group) == groups.end())
      groups.push_back(p.group);
  for (const Point& p : c.points)
    if (p.peer) others.insert(p.group);
  // What is equal to rounding is drawn at the bottom, not left out.
  constexpr double kLeast = 1e-17;
  std::string data;
  const auto add = [&](const Point& p) {
    data += fmt::format("{} {} \"{}\"\n", 1e6 * p.cost, std::max(p.error.position_rms_m, kLeast), p.name);
  };
  for (const std::string& group : groups) {
    for (const Point& p : c.points)
      if (p.impossible.empty() && p.group == group) add(p);
    data += "\n\n";
  }
  std::vector<const Point*> front;
  for (const Point& p : c.points)
    if (p.impossible.empty() && p.dominated_by.empty()) front.push_back(&p);
  std::sort(front.begin(), front.end(), [](const Point* a, const Point* b) { return a->cost < b->cost; });
  for (const Point* p : front) add(*p);

  constexpr const char* kColours[] = {"#2a788e", "#ca5a32", "#7a5195", "#58a45c", "#d9a441", "#4c72b0",
                                      "#8c8c8c", "#b55d60", "#5f9e6e", "#857aab", "#222222", "#64b5cd"};
  std::string plot = "plot ";
  for (std::size_t i = 0; i < groups.size(); ++i)
    plot += fmt::format("'chart.dat' index {} using 1:2 with points pt {} ps 1.3 lc rgb '{}' title '{}', ", i,
                        others.count(groups[i]) > 0 ? 9 : 7, kColours[i % std::size(kColours)], groups[i]);
  plot += fmt::format("'chart.dat' index {} using 1:2 with lines lw 1.5 dt 2 lc rgb 'black' title 'front', ",
                      groups.size());
  if (c.floor.position_rms_m > 0.0)
    plot +=
        fmt::format("{} with lines lc rgb '#a0a0a0' title 'uncertainty of the reference', ", c.floor.position_rms_m);
  plot += fmt::format("'chart.dat' index {} using 1:2:3 with labels font ',8' left offset 0.8,0.5 notitle\n",
                      groups.size());
  const std::string body = fmt::format(
      "set title '{}'\nset logscale xy\nset offsets graph 0.02, graph 0.25, graph 0.05, graph 0.05\nset format y "
      "'%g'\nset xlabel 'cost [µs per simulated second]'\n"
      "set ylabel 'position error, rms [m]'\nset key outside right top vertical\n{}",
      title, plot);
  write_whole(folder + "/chart.dat", data);
  write_whole(folder + "/chart.gp", gnuplot_pages("chart", 1000, 680, 11, body));
  return run_gnuplot(folder, "chart");
}

}  // namespace twoport::lab
