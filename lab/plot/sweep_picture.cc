#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "common/base/check.h"
#include "lab/plot/picture.h"
#include "lab/plot/pictures.h"
#include "lab/study/table.h"

namespace twoport::lab {
namespace {

constexpr std::size_t kMostPanels = 16;
constexpr const char *kBandColour = "#cbdfe3", *kWorstColour = "#404040";

struct Cell {
  std::size_t x, y;  ///< numbers of the values of the axes
  double value;
  bool stable;       ///< over seeds: every one
  double sd, worst;  ///< over seeds
};

/// What is drawn of a table.
struct Shown {
  std::string key, title, unstable_words;
  Label label;
  bool verdicts = false;                  ///< `stable` of one run a cell: two colours, no numbers
  bool share = false;                     ///< `stable` over seeds
  bool numbers = true;                    ///< is each cell's value its own?
  bool spread = false;                    ///< cells have sd and worst
  std::vector<Places> places;             ///< one for each axis
  std::vector<std::vector<Cell>> panels;  ///< one, or one for each value of the third axis
  std::vector<std::string> titles;        ///< of the panels
  double low = std::numeric_limits<double>::infinity(), high = -low;  ///< of the values drawn

  [[nodiscard]] bool logarithmic() const { return low > 0.0 && high > 1e3 * low; }
  /// What the scale of values shows: from 0 on where all have one sign, unless it is logarithmic.
  [[nodiscard]] std::pair<double, double> range() const {
    if (!(low <= high)) return {0.0, 1.0};
    if (logarithmic() || (low < 0.0 && high > 0.0)) return {low, high};
    const double from = std::min(low, 0.0), to = std::max(high, 0.0);
    return {from, from < to ? to : 1.0};
  }
};

Shown shown(const Table& table, const std::string& key) {
  const auto column = [&](const std::string& name) {
    if (const auto found = table.find(name)) return *found;
    throw ConfigError{fmt::format("--plot {}: the table has no such column", name)};
  };
  const bool seeds = table.seeds > 0, several = table.seeds > 1;
  const std::size_t of_key = column(key), of_stable = column(seeds ? "stable_worst" : "stable");
  const std::optional<std::size_t> of_scene = table.find("scene"), of_sd = table.find(key + "_sd"),
                                   of_worst = table.find(key + "_worst");
  const std::vector<Axis>& axes = table.grid.axes;
  Shown p;
  p.key = key;
  p.share = key == "stable" && seeds;
  p.numbers = !table.stopped;
  p.label = p.share ? Label{"share of stable seeds", ""} : label_of_figure(key);
  p.unstable_words = several ? "unstable with at least one seed" : "unstable";
  p.verdicts = key == "stable" && !seeds;
  p.spread = several && of_sd && of_worst && !p.share;
  p.title = p.verdicts ? "where the run is stable" : p.label.words;
  if (several && !p.share) p.title += fmt::format(", mean of {} seeds", table.seeds);
  if (of_scene && !table.rows.empty()) p.title = table.rows.front()[*of_scene].text() + ": " + p.title;
  if (table.stopped) p.title += " (coarse)";
  for (const Axis& axis : axes) p.places.emplace_back(axis);
  p.titles = {""};
  if (axes.size() == 3) {
    const Label label = label_of_paths(axes[2].paths);
    p.titles.clear();
    for (const std::string& value : axes[2].values)
      p.titles.push_back(fmt::format("{}: {}{}{}", label.words, value, label.unit.empty() ? "" : " ", label.unit));
  }
  p.panels.resize(p.titles.size());
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    const Values& row = table.rows[i];
    const std::vector<std::size_t> at = table.grid.at(i);
    const Cell c{.x = at[0],
                 .y = at.size() > 1 ? at[1] : 0,
                 .value = row[of_key].number(),
                 .stable = p.share || p.verdicts || row[of_stable].number() == 1.0,
                 .sd = p.spread ? row[*of_sd].number() : 0.0,
                 .worst = p.spread ? row[*of_worst].number() : 0.0};
    p.panels[at.size() > 2 ? at[2] : 0].push_back(c);
    if (!c.stable || !std::isfinite(c.value)) continue;
    p.low = std::min(p.low, c.value);
    p.high = std::max(p.high, c.value);
  }
  if (p.share) p.low = 0.0, p.high = 1.0;
  for (std::vector<Cell>& cells : p.panels)
    std::sort(cells.begin(), cells.end(),
              [&](const Cell& a, const Cell& b) { return p.places[0].at(a.x) < p.places[0].at(b.x); });
  return p;
}

/// Verdicts along one axis: a strip in two colours.
Panel strip(const Shown& p) {
  Series stable{Look::boxes, kStableColour, "stable"}, unstable{Look::boxes, kUnstableColour, "unstable"};
  for (const Cell& c : p.panels[0]) {
    const auto [low, high] = p.places[0].reach(c.x);
    (c.value > 0.5 ? stable : unstable).add({low, high, 0.0, 1.0});
  }
  return {.title = "",
          .x = p.places[0].scale(),
          .y = {.label = {}, .low = 0.0, .high = 1.0, .ticks = {{0.0, ""}}},
          .series = {stable, unstable}};
}

/// The scale of values along a curve, with what standard deviations and worst seeds reach.
Scale scale_of_curve(const Shown& p) {
  Scale y{.label = p.label, .low = -0.05, .high = 1.05};
  if (p.key == "stable" || !(p.low <= p.high)) return y;
  auto [low, high] = p.range();
  y.logarithmic = p.logarithmic();
  const bool from_zero = low == 0.0, to_zero = high == 0.0;
  for (const Cell& c : p.panels[0])
    if (c.stable && p.spread)
      for (const double reached : {c.value - c.sd, c.value + c.sd, c.worst})
        if (std::isfinite(reached) && (!y.logarithmic || reached > 0.0))
          low = std::min(low, reached), high = std::max(high, reached);
  const double margin = y.logarithmic ? 1.5 : 0.06 * (high - low);
  y.low = y.logarithmic ? low / margin : from_zero && low >= 0.0 ? 0.0 : low - margin;
  y.high = y.logarithmic ? high * margin : to_zero && high <= 0.0 ? 0.0 : high + margin;
  return y;
}

Panel curve(const Shown& p) {
  const Places& x = p.places[0];
  const Scale y = scale_of_curve(p);
  Series bands{Look::boxes, kUnstableColour, p.unstable_words};
  Series spread{x.words() ? Look::boxes : Look::area, kBandColour, p.spread ? "± one standard deviation" : ""};
  Series mean{x.words() ? Look::dots : Look::joined_dots, kStableColour, p.spread ? "mean" : ""};
  Series worst{x.words() ? Look::crosses : Look::dashes, kWorstColour, p.spread ? "worst seed" : ""};
  std::vector<std::vector<double>> back;  // the upper edge of the band
  const auto end_band = [&] {
    spread.rows.insert(spread.rows.end(), back.rbegin(), back.rend());
    back.clear();
    spread.interrupt(), mean.interrupt(), worst.interrupt();
  };
  for (const Cell& c : p.panels[0]) {
    const double at = x.at(c.x);
    if (!c.stable) {
      const auto [low, high] = x.reach(c.x);
      bands.add({low, high, y.low, y.high});
      end_band();
      continue;
    }
    mean.add({at, c.value});
    if (!p.spread) continue;
    const double low = std::max(c.value - c.sd, y.low), high = c.value + c.sd;
    worst.add({at, c.worst});
    if (x.words()) {
      spread.add({at - 0.1, at + 0.1, low, high});
    } else {
      spread.add({at, low});
      back.push_back({at, high});
    }
  }
  end_band();
  return {.title = "", .x = x.scale(), .y = y, .series = {bands, spread, mean, worst}};
}

Panel map(const Shown& p, std::size_t panel) {
  const Places &x = p.places[0], &y = p.places[1];
  const auto [low, high] = p.range();
  Series valued{Look::boxes, p.verdicts ? kStableColour : "", p.verdicts ? "stable" : ""};
  Series flat{Look::boxes, p.verdicts ? kUnstableColour : kNothingColour, p.unstable_words};
  Series dark{Look::words, p.share ? "black" : "white", "", 8.0},
      light{Look::words, p.share ? "white" : "black", "", 8.0};
  for (const Cell& c : p.panels[panel]) {
    const auto [left, right] = x.reach(c.x);
    const auto [bottom, top] = y.reach(c.y);
    if (p.verdicts) {
      (c.value > 0.5 ? valued : flat).add({left, right, bottom, top});
      continue;
    }
    if (!c.stable) flat.add({left, right, bottom, top});
    if (!c.stable || std::isnan(c.value)) continue;
    valued.add({left, right, bottom, top, c.value});
    // The numbers themselves where they have room.
    if (p.numbers && p.panels.size() == 1 && p.panels[0].size() <= 100 && !p.logarithmic())
      (c.value <= low + 0.6 * (high - low) ? dark : light)
          .add_text(x.at(c.x), y.at(c.y), fmt::format("{:.3g}", c.value));
  }
  return {.title = p.titles[panel], .x = x.scale(), .y = y.scale(), .series = {valued, flat, dark, light}};
}

}  // namespace

std::vector<std::string> columns_of_picture(const std::string& key) {
  return {key, key + "_sd", key + "_worst", "stable", "stable_worst", "scene"};
}

std::string draw(const Table& table, const std::string& key, const std::string& folder) {
  const std::vector<Axis>& axes = table.grid.axes;
  if (axes.size() > 3) return fmt::format("no picture: {} axes, and one shows at most three", axes.size());
  if (axes.size() == 3 && axes[2].values.size() > kMostPanels)
    return fmt::format("no picture: {} takes {} values, and there is room for {} maps", axes[2].name(),
                       axes[2].values.size(), kMostPanels);
  const Shown p = shown(table, key);
  Picture picture{.name = key, .title = p.title};
  if (axes.size() == 1) {
    picture.panels = {p.verdicts ? strip(p) : curve(p)};
    if (p.verdicts) picture.panel = {640, 60};
    return draw(picture, folder);
  }
  for (std::size_t i = 0; i < p.panels.size(); ++i) picture.panels.push_back(map(p, i));
  const auto [low, high] = p.range();
  using Palette = ColourBar::Palette;
  if (!p.verdicts) picture.bar = {p.label, low, high, p.logarithmic(), p.share ? Palette::share : Palette::value};
  return draw(picture, folder);
}

}  // namespace twoport::lab
