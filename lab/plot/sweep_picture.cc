#include "lab/plot/sweep_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <string_view>
#include <utility>

#include "common/base/check.h"
#include "common/scene/summary.h"
#include "lab/plot/gnuplot.h"

namespace twoport::lab {
namespace {

constexpr std::size_t kMostPanels = 16;
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

std::optional<double> number(const std::string& text) {
  double value = 0.0;
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || stop != text.data() + text.size()) return std::nullopt;
  return value;
}

/// The unit that a name ends in, as in "N/m"; empty where it has none.
std::string unit(std::string_view name) {
  static constexpr std::pair<std::string_view, std::string_view> kUnits[] = {{"_n_m_s_per_rad", "N m s/rad"},
                                                                             {"_n_m_per_rad", "N m/rad"},
                                                                             {"_n_s_per_m", "N s/m"},
                                                                             {"_n_per_m", "N/m"},
                                                                             {"_m_per_s", "m/s"},
                                                                             {"_kg_m2", "kg m²"},
                                                                             {"_kg", "kg"},
                                                                             {"_hz", "Hz"},
                                                                             {"_ms", "ms"},
                                                                             {"_us", "µs"},
                                                                             {"_deg", "deg"},
                                                                             {"_rms_m", "m"},
                                                                             {"_rms_n", "N"},
                                                                             {"_j", "J"},
                                                                             {"_n", "N"},
                                                                             {"_m", "m"},
                                                                             {"_s", "s"}};
  if (name.ends_with(']')) name = name.substr(0, name.rfind('['));
  for (const auto& [ending, words] : kUnits)
    if (name.ends_with(ending)) return std::string{words};
  // rtt_ms.p99
  const std::size_t dot = name.rfind('.');
  return dot == name.npos ? "" : unit(name.substr(0, dot));
}

/// A name with its unit, as an axis shows it.
std::string with_unit(const std::string& name) {
  const std::string in = unit(name);
  return in.empty() ? name : fmt::format("{} [{}]", name, in);
}

/// Where an axis puts its values, and how far each of its cells reaches.
struct Scale {
  std::string label;
  bool logarithmic = false, words = false;
  std::vector<std::string> texts;
  std::map<std::string, double> at;
  std::map<double, std::pair<double, double>> reach;

  explicit Scale(const Axis& axis) : label{with_unit(axis.name())}, texts{axis.values} {
    words = !std::all_of(axis.values.begin(), axis.values.end(), [](const std::string& v) { return number(v); });
    for (std::size_t i = 0; i < axis.values.size(); ++i)
      at.emplace(axis.values[i], words ? static_cast<double>(i) : *number(axis.values[i]));
    std::vector<double> places;
    for (const auto& [text, place] : at) places.push_back(place);
    std::sort(places.begin(), places.end());
    logarithmic = axis.logarithmic && !words && places.front() > 0.0;
    const auto half = [&](double a, double b) { return logarithmic ? std::sqrt(a * b) : 0.5 * (a + b); };
    const auto mirror = [&](double edge, double of) { return logarithmic ? of * of / edge : 2.0 * of - edge; };
    for (std::size_t i = 0; i < places.size(); ++i) {
      const double p = places[i];
      double lo = i > 0 ? half(places[i - 1], p) : kNone, hi = i + 1 < places.size() ? half(p, places[i + 1]) : kNone;
      if (std::isnan(lo) && std::isnan(hi)) {
        lo = words ? p - 0.5 : p - 0.05 * std::abs(p) - (p == 0.0 ? 0.5 : 0.0);
        hi = 2.0 * p - lo;
      }
      if (std::isnan(lo)) lo = mirror(hi, p);
      if (std::isnan(hi)) hi = mirror(lo, p);
      reach[p] = {lo, hi};
    }
  }
  [[nodiscard]] double low() const { return reach.begin()->second.first; }
  [[nodiscard]] double high() const { return reach.rbegin()->second.second; }

  /// Range, label, ticks and scale of gnuplot's axis `name`.
  [[nodiscard]] std::string commands(char name) const {
    std::string out =
        fmt::format("set {0}label {1}\nset {0}range [{2}:{3}]\n", name, gnuplot_quoted(label), low(), high());
    if (logarithmic) out += fmt::format("set logscale {}\n", name);
    if (words) {
      std::vector<std::string> ticks;
      for (const std::string& text : texts) ticks.push_back(fmt::format("{} {}", gnuplot_quoted(text), at.at(text)));
      out +=
          fmt::format("set {}tics ({}){}\n", name, fmt::join(ticks, ", "), name == 'y' ? " rotate by 90 center" : "");
    }
    return out;
  }
};

struct Cell {
  double x, y, value;
  bool stable;  ///< drawn in its value
};

/// Everything that a picture shows.
struct Picture {
  std::string key;
  std::vector<Scale> scales;                                          ///< one for each axis
  std::vector<std::vector<Cell>> panels;                              ///< one, or one for each value of the third axis
  double low = std::numeric_limits<double>::infinity(), high = -low;  ///< of the values drawn
  bool unstable = false;                                              ///< is there a cell that is not
  std::vector<Line> lines;                                            ///< over every panel

  [[nodiscard]] bool any() const { return low <= high; }
  [[nodiscard]] bool logarithmic() const { return low > 0.0 && high > 1e3 * low; }
};

Picture picture(const Table& table, const std::string& key) {
  // The last column of a name is the summary's: a path may have the same.
  const auto column = [&](const std::string& name) {
    const auto found = std::find(table.columns.rbegin(), table.columns.rend(), name);
    if (found == table.columns.rend()) throw ConfigError{fmt::format("--plot {}: the table has no such column", name)};
    return static_cast<std::size_t>(table.columns.rend() - found) - 1;
  };
  const std::size_t of_key = column(key), of_stable = column("stable");
  Picture p{.key = key, .scales = {}, .panels = {}, .lines = {}};
  for (const Axis& axis : table.axes) p.scales.emplace_back(axis);
  const std::vector<std::string> titles = table.axes.size() == 3 ? table.axes[2].values : std::vector<std::string>{""};
  p.panels.resize(titles.size());
  for (const auto& row : table.rows) {
    const auto value = [&](std::size_t axis) -> const std::string& { return row[table.column_of(axis)]; };
    const auto panel =
        table.axes.size() == 3 ? std::find(titles.begin(), titles.end(), value(2)) - titles.begin() : std::ptrdiff_t{0};
    const Cell c{p.scales[0].at.at(value(0)), table.axes.size() > 1 ? p.scales[1].at.at(value(1)) : 0.0,
                 number(row[of_key]).value_or(kNone), key == "stable" || row[of_stable] == "1"};
    p.panels[static_cast<std::size_t>(panel)].push_back(c);
    p.unstable = p.unstable || !c.stable;
    if (!c.stable || !std::isfinite(c.value)) continue;
    p.low = std::min(p.low, c.value);
    p.high = std::max(p.high, c.value);
  }
  for (std::vector<Cell>& cells : p.panels)
    std::sort(cells.begin(), cells.end(), [](const Cell& a, const Cell& b) { return a.x < b.x; });
  return p;
}

/// A block for each panel: place, reach, value, stable; a curve has no y.
std::string data(const Picture& p) {
  std::string all;
  for (const std::vector<Cell>& cells : p.panels) {
    all += fmt::format("# {} {} stable\n", p.scales.size() == 1 ? "x" : "x y x_low x_high y_low y_high", p.key);
    for (const Cell& c : cells) {
      if (p.scales.size() == 1) {
        all += fmt::format("{} {} {}\n", c.x, c.value, c.stable ? 1 : 0);
      } else {
        const auto [x0, x1] = p.scales[0].reach.at(c.x);
        const auto [y0, y1] = p.scales[1].reach.at(c.y);
        all += fmt::format("{} {} {} {} {} {} {} {}\n", c.x, c.y, x0, x1, y0, y1, c.value, c.stable ? 1 : 0);
      }
    }
    all += "\n\n";
  }
  for (const Line& line : p.lines) {
    all += fmt::format("# {}\n", line.title);
    for (const auto& [x, y] : line.points) all += fmt::format("{} {}\n", x, y);
    all += "\n\n";
  }
  return all;
}

// Viridis, which reads in grey and for most eyes.
constexpr const char* kPalette =
    "set palette defined (0 '#440154', 1 '#46327e', 2 '#365c8d', 3 '#277f8e', 4 '#1fa187', 5 '#4ac16d', 6 '#a0da39', "
    "7 '#fde725')\n";
constexpr const char *kStable = "#2a788e", *kUnstable = "#f4a582", *kUnstableDot = "#ca5a32", *kLeftOut = "#d0d0d0";

std::string curve(const Picture& p, const std::string& file) {
  const Scale& x = p.scales[0];
  std::string gp = x.commands('x');
  if (p.key == "stable")
    return gp + fmt::format(
                    "set yrange [-0.2:1.2]\nset ytics ('unstable' 0, 'stable' 1)\n"
                    "plot {0} using 1:($2 > 0.5 ? $2 : NaN) with points pt 7 lc rgb '{1}' title 'stable', "
                    "{0} using 1:($2 > 0.5 ? NaN : $2) with points pt 7 lc rgb '{2}' title 'unstable'\n",
                    gnuplot_quoted(file), kStable, kUnstableDot);
  gp += fmt::format("set ylabel {}\n", gnuplot_quoted(with_unit(p.key)));
  if (p.logarithmic()) gp += "set logscale y\n";
  if (!p.any()) gp += "set yrange [0:1]\n";
  // Unstable cells are bands from bottom to top, as wide as what each stands for.
  int band = 0;
  for (const Cell& c : p.panels[0])
    if (!c.stable)
      gp += fmt::format(
          "set object {} rectangle from first {}, graph 0 to first {}, graph 1 behind fc rgb '{}' fs solid 0.6 "
          "noborder\n",
          ++band, x.reach.at(c.x).first, x.reach.at(c.x).second, kUnstable);
  gp += fmt::format("plot {} using 1:($3 > 0 ? $2 : NaN) with {} pt 7 ps {} lw 1.5 lc rgb '{}' title {}",
                    gnuplot_quoted(file), x.words ? "points" : "linespoints", x.words ? 1.2 : 0.8, kStable,
                    gnuplot_quoted(p.key));
  if (p.unstable) gp += fmt::format(", NaN with boxes fs solid 0.6 noborder lc rgb '{}' title 'unstable'", kUnstable);
  return gp + "\n";
}

/// The plot command of one panel.
std::string map(const Picture& p, std::size_t panel, const std::string& file) {
  const auto boxes = [&](const char* test, const char* columns, const std::string& look) {
    return fmt::format("{} index {} using ({} ? $1 : NaN):{} with boxxyerror fs solid 1 noborder {}",
                       gnuplot_quoted(file), panel, test, columns, look);
  };
  const auto plain = [&](const char* test, const char* colour, const char* title) {
    return boxes(test, "2:3:4:5:6", fmt::format("fc rgb '{}' title '{}'", colour, title));
  };
  std::string gp = "plot ";
  if (p.key == "stable") {
    gp += plain("$7 > 0.5", kStable, "stable") + ", " + plain("$7 < 0.5", kUnstable, "unstable");
  } else {
    gp += boxes("$8 > 0", "2:3:4:5:6:7", "lc palette notitle");
    if (p.unstable) gp += ", " + plain("$8 < 1", kLeftOut, "unstable");
  }
  for (std::size_t i = 0; i < p.lines.size(); ++i)
    gp += fmt::format(", {} index {} with lines lw 2 dt {} lc rgb 'black' title {}", gnuplot_quoted(file),
                      p.panels.size() + i, i + 1, gnuplot_quoted(p.lines[i].title));
  return gp + "\n";
}

/// One map, or a grid of them with `across` in a row.
std::string maps(const Picture& p, std::size_t across, const Axis* third, const std::string& file) {
  std::string gp = p.scales[0].commands('x') + p.scales[1].commands('y');
  if (p.key != "stable") {
    gp += kPalette + fmt::format("set cblabel {}\n", gnuplot_quoted(with_unit(p.key)));
    if (p.low < p.high) gp += fmt::format("set cbrange [{}:{}]\n", p.low, p.high);
    if (p.logarithmic()) gp += "set logscale cb\nset format cb '%g'\n";
  }
  if (third == nullptr) return gp + map(p, 0, file);
  if (p.key != "stable") gp += "set rmargin 10\nset cblabel offset 1\n";
  gp += fmt::format("set multiplot layout {},{}\n", (p.panels.size() + across - 1) / across, across);
  for (std::size_t i = 0; i < p.panels.size(); ++i)
    gp += fmt::format("set title {}\n",
                      gnuplot_quoted(third->name() + " = " + third->values[i] + " " + unit(third->name()))) +
          map(p, i, file);
  return gp + "unset multiplot\n";
}

/// gnuplot's input: the same page twice, PNG and SVG.
std::string pages(const Picture& p, const Axis* third, const std::string& file) {
  std::size_t across = 1;
  while (across * across < p.panels.size()) ++across;
  const std::size_t down = (p.panels.size() + across - 1) / across;
  const bool one = p.panels.size() == 1;
  const std::size_t width = one ? 900 : 560 * across, height = one ? 620 : 480 * down;
  const std::string body = p.scales.size() == 1 ? curve(p, file) : maps(p, across, third, file);
  return gnuplot_pages(p.key, width, height, one ? 11 : 10, body);
}

}  // namespace

void check_key(const std::string& key) {
  std::vector<std::string> known;
  for (const auto& [name, value] : numbers(Summary{}))
    if (name != "step_ns") known.push_back(name);
  if (std::find(known.begin(), known.end(), key) == known.end())
    throw ConfigError{fmt::format("--plot {}: it must be none or one of {}", key, fmt::join(known, ", "))};
}

std::string draw(const Table& table, const std::string& key, const std::string& folder,
                 const std::vector<Line>& lines) {
  if (table.axes.size() > 3) return fmt::format("no picture: {} axes, and one shows at most three", table.axes.size());
  if (table.axes.size() == 3 && table.axes[2].values.size() > kMostPanels)
    return fmt::format("no picture: {} takes {} values, and there is room for {} maps", table.axes[2].name(),
                       table.axes[2].values.size(), kMostPanels);
  Picture p = picture(table, key);
  p.lines = lines;
  const std::string stem = folder + "/" + key;
  write_whole(stem + ".dat", data(p));
  write_whole(stem + ".gp", pages(p, table.axes.size() == 3 ? &table.axes[2] : nullptr, key + ".dat"));
  return run_gnuplot(folder, key);
}

}  // namespace twoport::lab
