#include "lab/plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <map>
#include <optional>
#include <string_view>
#include <utility>

#include "common/base/check.h"
#include "common/scene/summary.h"

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

/// In single quotes for gnuplot, which knows no escape there but a doubled quote.
std::string literal(std::string_view text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? "''" : std::string(1, c);
  return out + "'";
}

/// The unit that a name ends in, as in " [N/m]"; empty where it has none.
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
    if (name.ends_with(ending)) return fmt::format(" [{}]", words);
  // rtt_ms.p99
  const std::size_t dot = name.rfind('.');
  return dot == name.npos ? "" : unit(name.substr(0, dot));
}

/// Where an axis puts its values, and how far each of its cells reaches.
struct Scale {
  std::string label;
  bool logarithmic = false, words = false;
  std::vector<std::string> texts;
  std::map<std::string, double> at;
  std::map<double, std::pair<double, double>> reach;

  explicit Scale(const Axis& axis) : label{axis.path + unit(axis.path)}, texts{axis.values} {
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
    std::string out = fmt::format("set {0}label {1}\nset {0}range [{2}:{3}]\n", name, literal(label), low(), high());
    if (logarithmic) out += fmt::format("set logscale {}\n", name);
    if (words) {
      std::vector<std::string> ticks;
      for (const std::string& text : texts) ticks.push_back(fmt::format("{} {}", literal(text), at.at(text)));
      out +=
          fmt::format("set {}tics ({}){}\n", name, fmt::join(ticks, ", "), name == 'y' ? " rotate by 90 center" : "");
    }
    return out;
  }
};

struct Cell {
  double x, y, value;
  bool stable;
};

/// Where the values lie that are drawn: those of stable cells, or all where the column is `stable` itself.
struct Range {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  bool unstable = false;  ///< is there a cell that is not drawn in its value
  void add(const Cell& c) {
    unstable = unstable || !c.stable;
    if (!c.stable || !std::isfinite(c.value)) return;
    low = std::min(low, c.value);
    high = std::max(high, c.value);
  }
  [[nodiscard]] bool any() const { return low <= high; }
  [[nodiscard]] bool logarithmic() const { return low > 0.0 && high > 1e3 * low; }
};

constexpr const char* kLook =
    "set encoding utf8\n"
    "set border lc rgb '#505050'\n"
    "set tics textcolor rgb '#202020' nomirror out\n"
    "set grid lc rgb '#e4e4e4'\n"
    "set termoption noenhanced\n";
// Viridis, which reads in grey and for most eyes.
constexpr const char* kPalette =
    "set palette defined (0 '#440154', 1 '#46327e', 2 '#365c8d', 3 '#277f8e', 4 '#1fa187', 5 '#4ac16d', 6 '#a0da39', "
    "7 '#fde725')\n";
constexpr const char *kStable = "#2a788e", *kUnstable = "#f4a582", *kOut = "#d0d0d0";

std::string curve(const Scale& x, const std::string& key, const std::vector<Cell>& cells, const std::string& data) {
  Range range;
  for (const Cell& c : cells) range.add(c);
  std::string gp =
      x.commands('x') + fmt::format("set ylabel {}\nset key top left outside horizontal\n", literal(key + unit(key)));
  if (key == "stable") {
    return gp + fmt::format(
                    "set yrange [-0.2:1.2]\nset ytics ('unstable' 0, 'stable' 1)\n"
                    "plot {0} using 1:($2 > 0.5 ? $2 : NaN) with points pt 7 ps 1 lc rgb '{1}' title 'stable', "
                    "{0} using 1:($2 > 0.5 ? NaN : $2) with points pt 7 ps 1 lc rgb '{2}' title 'unstable'\n",
                    literal(data), kStable, "#ca5a32");
  }
  if (range.logarithmic()) gp += "set logscale y\n";
  if (!range.any()) gp += "set yrange [0:1]\n";
  // Unstable cells as bands from bottom to top, over the width that each stands for.
  int band = 0;
  for (const Cell& c : cells)
    if (!c.stable)
      gp += fmt::format(
          "set object {} rectangle from first {}, graph 0 to first {}, graph 1 behind fc rgb '{}' fs solid "
          "0.6 noborder\n",
          ++band, x.reach.at(c.x).first, x.reach.at(c.x).second, kUnstable);
  gp += fmt::format("plot {} using 1:($3 > 0 ? $2 : NaN) with linespoints pt 7 ps 0.8 lw 1.5 lc rgb '{}' title {}",
                    literal(data), kStable, literal(key));
  if (range.unstable)
    gp += fmt::format(", NaN with boxes fs solid 0.6 noborder lc rgb '{}' title 'unstable'", kUnstable);
  return gp + "\n";
}

/// The plot command of one map; `block` of the data.
std::string map(const std::string& key, bool unstable, const std::string& data, std::size_t block) {
  const std::string from = fmt::format("{} index {} using 1:2:3:4:5:6", literal(data), block);
  const auto boxes = [&](const std::string& test, const std::string& colour, const std::string& title) {
    return fmt::format(
        "{} index {} using ({} ? $1 : NaN):2:3:4:5:6 with boxxyerror fs solid 1 noborder fc rgb '{}' title {}",
        literal(data), block, test, colour, literal(title));
  };
  if (key == "stable")
    return fmt::format("plot {}, {}\n", boxes("$7 > 0.5", kStable, "stable"), boxes("$7 < 0.5", kUnstable, "unstable"));
  std::string gp = fmt::format(
      "plot {} index {} using ($8 > 0 ? $1 : NaN):2:3:4:5:6:7 with boxxyerror fs solid 1 noborder "
      "lc palette notitle",
      literal(data), block);
  if (unstable) gp += ", " + boxes("$8 < 1", kOut, "unstable");
  return gp + "\n";
}

}  // namespace

void check_key(const std::string& key) {
  std::vector<std::string> known;
  for (const auto& [name, value] : numbers(Summary{}))
    if (name != "step_ns") known.push_back(name);
  if (std::find(known.begin(), known.end(), key) == known.end())
    throw ConfigError{fmt::format("--plot {}: it must be none or one of {}", key, fmt::join(known, ", "))};
}

std::string draw(const Table& table, const std::string& key, const std::string& folder) {
  if (table.axes.size() > 3) return fmt::format("no picture: {} axes, and one holds at most three", table.axes.size());
  // The last column of a name is the summary's: a path may have the same.
  const auto column = [&](const std::string& name) {
    const auto found = std::find(table.columns.rbegin(), table.columns.rend(), name);
    if (found == table.columns.rend()) throw ConfigError{fmt::format("--plot {}: the table has no such column", name)};
    return static_cast<std::size_t>(table.columns.rend() - found) - 1;
  };
  const std::size_t of_key = column(key), of_stable = column("stable");
  std::vector<Scale> scales;
  for (const Axis& axis : table.axes) scales.emplace_back(axis);
  const std::size_t panels = scales.size() < 3 ? 1 : scales[2].texts.size();
  if (panels > kMostPanels)
    return fmt::format("no picture: {} has {} values, and there is room for {} maps", table.axes[2].path, panels,
                       kMostPanels);
  if (table.rows.empty()) return "no picture: the table is empty";

  std::vector<std::vector<Cell>> of_panel(panels);
  Range range;
  for (const auto& row : table.rows) {
    const Cell c{scales[0].at.at(row[0]), scales.size() > 1 ? scales[1].at.at(row[1]) : 0.0,
                 number(row[of_key]).value_or(kNone), row[of_stable] == "1" || key == "stable"};
    const auto& texts = scales.size() == 3 ? scales[2].texts : scales[0].texts;
    const std::size_t panel =
        scales.size() == 3 ? static_cast<std::size_t>(std::find(texts.begin(), texts.end(), row[2]) - texts.begin())
                           : 0;
    of_panel[panel].push_back(c);
    range.add(c);
  }

  std::string data;
  for (std::vector<Cell>& cells : of_panel) {
    std::sort(cells.begin(), cells.end(), [](const Cell& a, const Cell& b) {
      return std::pair{a.x, a.y} < std::pair{b.x, b.y};
    });
    data += scales.size() == 1 ? fmt::format("# {} {} stable\n", table.axes[0].path, key)
                               : fmt::format("# x y x_low x_high y_low y_high {} stable\n", key);
    for (const Cell& c : cells) {
      if (scales.size() == 1) {
        data += fmt::format("{} {} {}\n", c.x, c.value, c.stable ? 1 : 0);
      } else {
        const auto [x0, x1] = scales[0].reach.at(c.x);
        const auto [y0, y1] = scales[1].reach.at(c.y);
        data += fmt::format("{} {} {} {} {} {} {} {}\n", c.x, c.y, x0, x1, y0, y1, c.value, c.stable ? 1 : 0);
      }
    }
    data += "\n\n";
  }
  const std::string stem = folder + "/" + key, data_file = key + ".dat";
  write_whole(stem + ".dat", data);

  std::size_t across = 1;
  while (across * across < panels) ++across;
  const std::size_t down = (panels + across - 1) / across;
  std::string body;
  if (scales.size() == 1) {
    body = curve(scales[0], key, of_panel[0], data_file);
  } else {
    body = scales[0].commands('x') + scales[1].commands('y') + "set key top left outside horizontal\n";
    if (key != "stable") {
      body += kPalette;
      body += fmt::format("set cblabel {}\n", literal(key + unit(key)));
      if (range.any() && range.low < range.high) body += fmt::format("set cbrange [{}:{}]\n", range.low, range.high);
      if (range.logarithmic()) body += "set logscale cb\nset format cb '%.0e'\n";
    }
    if (panels == 1) {
      body += map(key, range.unstable, data_file, 0);
    } else {
      body += fmt::format("set multiplot layout {},{}\n", down, across);
      for (std::size_t i = 0; i < panels; ++i)
        body += fmt::format("set title {}\n",
                            literal(table.axes[2].path + " = " + scales[2].texts[i] + unit(table.axes[2].path))) +
                map(key, range.unstable, data_file, i);
      body += "unset multiplot\n";
    }
  }
  const std::size_t width = panels == 1 ? 900 : std::max<std::size_t>(900, 520 * across),
                    height = panels == 1 ? 620 : std::max<std::size_t>(500, 430 * down);
  const auto page = [&](const char* terminal, const char* ending) {
    return fmt::format(
        "set terminal {} size {},{} font 'DejaVu Sans,11' background rgb 'white'\nset output {}\n{}{}unset "
        "output\nreset\n",
        terminal, width, height, literal(key + ending), kLook, body);
  };
  write_whole(stem + ".gp", page("pngcairo", ".png") + page("svg", ".svg"));

  const auto shell = [](const std::string& text) {
    std::string out = "'";
    for (const char c : text) out += c == '\'' ? "'\\''" : std::string(1, c);
    return out + "'";
  };
  if (std::system("command -v gnuplot > /dev/null 2>&1") != 0)
    return fmt::format(
        "no picture: gnuplot is not installed (apt-get install gnuplot-nox); {}.gp is what it would be given", stem);
  const std::string log = stem + ".log";
  if (std::system(fmt::format("cd {} && gnuplot {} > {} 2>&1", shell(folder), shell(key + ".gp"), shell(key + ".log"))
                      .c_str()) != 0)
    return fmt::format("no picture: gnuplot failed; {} says why", log);
  std::remove(log.c_str());
  return fmt::format("{0}.png and {0}.svg", stem);
}

}  // namespace twoport::lab
