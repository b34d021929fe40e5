#include "lab/plot/sweep_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/record/summary.h"
#include "lab/plot/gnuplot.h"
#include "lab/plot/label.h"
#include "lab/plot/page.h"
#include "lab/plot/scale.h"

namespace twoport::lab {
namespace {

constexpr std::size_t kMostPanels = 16;
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

struct Cell {
  double x, y, value;
  bool stable;       ///< over seeds: every one
  double sd, worst;  ///< over seeds
};

/// Everything that a picture shows.
struct Picture {
  std::string key, title, unstable_words;
  Label label;
  bool verdicts = false;                  ///< `stable` of one run a cell: two colours, no numbers
  bool share = false;                     ///< `stable` over seeds
  bool spread = false;                    ///< cells have sd and worst
  std::vector<Scale> scales;              ///< one for each axis
  std::vector<std::vector<Cell>> panels;  ///< one, or one for each value of the third axis
  std::vector<std::string> panel_titles;
  double low = std::numeric_limits<double>::infinity(), high = -low;  ///< of the values drawn
  bool unstable = false;                                              ///< is there a cell that is not

  [[nodiscard]] bool logarithmic() const { return low > 0.0 && high > 1e3 * low; }
  /// What the scale of values shows: from 0 on where all have one sign, unless it is logarithmic.
  [[nodiscard]] std::pair<double, double> range() const {
    if (!(low <= high)) return {0.0, 1.0};
    if (logarithmic()) return {low, high};
    const double from = std::min(low, 0.0), to = std::max(high, 0.0);
    if (low < 0.0 && high > 0.0) return {low, high};
    return {from, from < to ? to : 1.0};
  }
};

std::vector<std::string> panel_titles(const Table& table) {
  if (table.axes.size() < 3) return {""};
  const Label label = label_of_paths(table.axes[2].paths);
  std::vector<std::string> titles;
  for (const std::string& value : table.axes[2].values)
    titles.push_back(fmt::format("{}: {}{}{}", label.words, value, label.unit.empty() ? "" : " ", label.unit));
  return titles;
}

Picture picture(const Table& table, const std::string& key) {
  // The last column of a name is the summary's: a path may have the same.
  const auto find = [&](const std::string& name) -> std::optional<std::size_t> {
    const auto found = std::find(table.columns.rbegin(), table.columns.rend(), name);
    if (found == table.columns.rend()) return std::nullopt;
    return static_cast<std::size_t>(table.columns.rend() - found) - 1;
  };
  const auto column = [&](const std::string& name) {
    if (const auto found = find(name)) return *found;
    throw ConfigError{fmt::format("--plot {}: the table has no such column", name)};
  };
  const bool seeds = table.seeds > 0;
  const std::size_t of_key = column(key), of_stable = column(seeds ? "stable_worst" : "stable");
  const std::optional<std::size_t> of_scene = find("scene"), of_sd = find(key + "_sd"), of_worst = find(key + "_worst");

  Picture p;
  p.key = key;
  p.share = key == "stable" && seeds;
  p.label = p.share ? Label{"share of stable seeds", ""} : label_of_figure(key);
  p.unstable_words = seeds ? "unstable with at least one seed" : "unstable";
  p.verdicts = key == "stable" && !seeds;
  p.spread = of_sd && of_worst && !p.share;
  p.title = p.verdicts ? "where the run is stable" : p.label.words;
  if (seeds && !p.share) p.title += fmt::format(", mean of {} seeds", table.seeds);
  if (of_scene && !table.rows.empty()) p.title = table.rows.front()[*of_scene] + ": " + p.title;
  p.panel_titles = panel_titles(table);
  for (const Axis& axis : table.axes) p.scales.emplace_back(axis);
  p.panels.resize(p.panel_titles.size());
  for (const auto& row : table.rows) {
    const auto value = [&](std::size_t axis) -> const std::string& { return row[table.column_of(axis)]; };
    const auto number = [&](std::size_t of) { return number_of(row[of]).value_or(kNone); };
    std::size_t panel = 0;
    if (table.axes.size() == 3) {
      const std::vector<std::string>& values = table.axes[2].values;
      panel = static_cast<std::size_t>(std::find(values.begin(), values.end(), value(2)) - values.begin());
    }
    const Cell c{.x = p.scales[0].at(value(0)),
                 .y = table.axes.size() > 1 ? p.scales[1].at(value(1)) : 0.0,
                 .value = number(of_key),
                 .stable = p.share || p.verdicts || row[of_stable] == "1",
                 .sd = p.spread ? number(*of_sd) : 0.0,
                 .worst = p.spread ? number(*of_worst) : 0.0};
    p.panels[panel].push_back(c);
    p.unstable = p.unstable || !c.stable;
    if (!c.stable || !std::isfinite(c.value)) continue;
    p.low = std::min(p.low, c.value);
    p.high = std::max(p.high, c.value);
  }
  if (p.share) p.low = 0.0, p.high = 1.0;
  for (std::vector<Cell>& cells : p.panels)
    std::sort(cells.begin(), cells.end(),
              [](const Cell& a, const Cell& b) { return std::tie(a.x, a.y) < std::tie(b.x, b.y); });
  return p;
}

/// A block for each panel.
std::string data(const Picture& p) {
  std::string all;
  for (const std::vector<Cell>& cells : p.panels) {
    const bool curve = p.scales.size() == 1;
    all += fmt::format("# {} {} stable{}\n", curve ? "x x_low x_high" : "x y x_low x_high y_low y_high", p.key,
                       curve && p.spread ? " sd worst" : "");
    for (const Cell& c : cells) {
      const auto [x0, x1] = p.scales[0].reach(c.x);
      if (curve) {
        all += fmt::format("{} {} {} {} {} {} {}\n", c.x, x0, x1, c.value, c.stable ? 1 : 0, c.sd, c.worst);
      } else {
        const auto [y0, y1] = p.scales[1].reach(c.y);
        all += fmt::format("{} {} {} {} {} {} {} {}\n", c.x, c.y, x0, x1, y0, y1, c.value, c.stable ? 1 : 0);
      }
    }
    all += "\n\n";
  }
  return all;
}

// Viridis, which reads in grey and for most eyes.
constexpr const char* kPalette =
    "set palette defined (0 '#440154', 1 '#46327e', 2 '#365c8d', 3 '#277f8e', 4 '#1fa187', 5 '#4ac16d', 6 '#a0da39', "
    "7 '#fde725')\n";
constexpr const char* kSharePalette = "set palette defined (0 '#f4a582', 1 '#2a788e')\n";
constexpr const char *kLeftOut = "#d0d0d0", *kBandColour = "#cbdfe3", *kWorstColour = "#404040";

/// Verdicts along one axis: a strip in two colours.
std::string strip(const std::string& file) {
  const auto cells = [&](const char* test, const char* colour) {
    return fmt::format(
        "{} using ({} ? $1 : NaN):(0.5):2:3:(0):(1) with boxxyerror fs solid 1 border lc rgb 'white' "
        "fc rgb '{}'",
        file, test, colour);
  };
  return "set yrange [0:1]\nunset ytics\nplot " + cells("$4 > 0.5", kStableColour) + ", " +
         cells("$4 < 0.5", kUnstableColour) + "\n";
}

/// The range of the values along a curve: gnuplot finds the ends that standard deviations and worst seeds reach.
std::string curve_range(const Picture& p) {
  const auto [low, high] = p.range();
  if (p.logarithmic()) return "set logscale y\n";
  if (p.key == "stable" || !(p.low <= p.high)) return "set yrange [-0.05:1.05]\n";
  if (low == 0.0) return "set yrange [0:*]\n";
  return high == 0.0 ? "set yrange [*:0]\n" : "";
}

std::string curve(const Picture& p, const std::string& file) {
  const Scale& x = p.scales[0];
  std::string gp = curve_range(p);
  // Unstable cells are bands from bottom to top, as wide as their cells.
  int band = 0;
  for (const Cell& c : p.panels[0])
    if (!c.stable)
      gp += fmt::format(
          "set object {} rectangle from first {}, graph 0 to first {}, graph 1 behind fc rgb '{}' fs solid 0.6 "
          "noborder\n",
          ++band, x.reach(c.x).first, x.reach(c.x).second, kUnstableColour);
  gp += "plot ";
  if (p.spread && x.words())
    gp += fmt::format(
        "{} using 1:($5 > 0 ? $4 : NaN):($1 - 0.1):($1 + 0.1):($4 - $6):($4 + $6) with boxxyerror "
        "fs solid 1 noborder lc rgb '{}', ",
        file, kBandColour);
  if (p.spread && !x.words())
    gp +=
        fmt::format("{} using 1:($5 > 0 ? $4 - $6 : NaN):($4 + $6) with filledcurves fs solid 1 noborder lc rgb '{}', ",
                    file, kBandColour);
  gp += fmt::format("{} using 1:($5 > 0 ? $4 : NaN) with {} pt 7 ps {} lw 1.5 lc rgb '{}'", file,
                    x.words() ? "points" : "linespoints", x.words() ? 1.2 : 0.8, kStableColour);
  if (p.spread)
    gp += fmt::format(", {} using 1:($5 > 0 ? $7 : NaN) with {} lc rgb '{}'", file,
                      x.words() ? "points pt 2" : "lines lw 1.5 dt 2", kWorstColour);
  return gp + "\n";
}

/// The plot command of one map.
std::string map(const Picture& p, std::size_t panel, const std::string& file) {
  const auto boxes = [&](const char* test, const char* columns, const std::string& look) {
    return fmt::format("{} index {} using ({} ? $1 : NaN):{} with boxxyerror fs solid 1 noborder {}", file, panel, test,
                       columns, look);
  };
  const auto plain = [&](const char* test, const char* colour) {
    return boxes(test, "2:3:4:5:6", fmt::format("fc rgb '{}'", colour));
  };
  if (p.verdicts) return "plot " + plain("$7 > 0.5", kStableColour) + ", " + plain("$7 < 0.5", kUnstableColour) + "\n";
  std::string gp = "plot " + boxes("$8 > 0", "2:3:4:5:6:7", "lc palette") + ", " + plain("$8 < 1", kLeftOut);
  // The numbers themselves where they have room.
  const auto [low, high] = p.range();
  if (p.panels.size() == 1 && p.panels[0].size() <= 100 && !p.logarithmic())
    for (const auto& [test, colour] :
         {std::pair{"<=", p.share ? "black" : "white"}, std::pair{">", p.share ? "white" : "black"}})
      gp += fmt::format(
          ", {} using ($8 > 0 && $7 {} {} ? $1 : NaN):2:(sprintf('%.3g', $7)) with labels font ',8' tc rgb '{}'", file,
          test, low + 0.6 * (high - low), colour);
  return gp + "\n";
}

std::vector<LegendEntry> legend(const Picture& p) {
  using Mark = LegendEntry::Mark;
  if (p.verdicts) return {{Mark::box, kStableColour, "stable"}, {Mark::box, kUnstableColour, "unstable"}};
  std::vector<LegendEntry> all;
  const bool curve = p.scales.size() == 1;
  if (curve && p.spread)
    all = {{p.scales[0].words() ? Mark::dot : Mark::line, kStableColour, "mean"},
           {Mark::box, kBandColour, "± one standard deviation"},
           {p.scales[0].words() ? Mark::cross : Mark::dashes, kWorstColour, "worst seed"}};
  if (p.unstable) all.push_back({Mark::box, curve ? kUnstableColour : kLeftOut, p.unstable_words});
  return all;
}

/// gnuplot's input: the same page twice, PNG and SVG.
std::string pages(const Picture& p, const std::string& name) {
  const std::string file = gnuplot_quoted(name + ".dat");
  Page page{p.title, legend(p)};
  const Scale& x = p.scales[0];
  if (p.scales.size() == 1) {
    if (p.verdicts) page.panel_size(640, 60);
    const bool slanted = page.slants(x);
    const std::string head =
        x.commands('x', true, slanted) + page.panel(0, "", x.label(), p.verdicts ? Label{} : p.label);
    return page.pages(p.key, head + (p.verdicts ? strip(file) : curve(p, file)));
  }
  const auto [low, high] = p.range();
  page.panels(p.panels.size());
  if (!p.verdicts) page.colour_bar(p.label, low, high, p.logarithmic());
  const Scale& y = p.scales[1];
  const bool slanted = page.slants(x);
  std::string body = x.commands('x', true, slanted) + "unset grid\n" + (p.share ? kSharePalette : kPalette);
  for (std::size_t i = 0; i < p.panels.size(); ++i)
    body += y.commands('y', page.at_left(i)) + page.panel(i, p.panel_titles[i], x.label(), y.label()) + map(p, i, file);
  return page.pages(p.key, body);
}

}  // namespace

std::vector<std::string> columns_of_picture(const std::string& key) {
  return {key, key + "_sd", key + "_worst", "stable", "stable_worst", "scene"};
}

std::string draw(const Table& table, const std::string& key, const std::string& folder) {
  if (table.axes.size() > 3) return fmt::format("no picture: {} axes, and one shows at most three", table.axes.size());
  if (table.axes.size() == 3 && table.axes[2].values.size() > kMostPanels)
    return fmt::format("no picture: {} takes {} values, and there is room for {} maps", table.axes[2].name(),
                       table.axes[2].values.size(), kMostPanels);
  const Picture p = picture(table, key);
  const std::string stem = folder + "/" + key;
  write_whole(stem + ".dat", data(p));
  write_whole(stem + ".gp", pages(p, key));
  return run_gnuplot(folder, key);
}

}  // namespace twoport::lab
