#include "lab/plot/picture.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>

#include "common/base/file.h"
#include "common/base/text.h"

namespace twoport::lab {

namespace {

// Pixels, at a font of 10 points.
constexpr double kCharacter = 6.7, kCapital = 9.2, kMark = 26.0, kEntryGap = 28.0, kLegendRow = 22.0;
constexpr double kTitle = 40.0, kPanelTitle = 22.0, kBarGap = 25.0, kBarWidth = 22.0, kBarRight = 150.0;

/// In single quotes for gnuplot; the only escape there is a doubled quote.
std::string gnuplot_string(std::string_view text, std::string_view quote = "''") {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? quote : std::string_view{&c, 1};
  return out + "'";
}
/// Quoted for a shell, which has no escape within single quotes.
std::string shell_word(const std::string& text) {
  return gnuplot_string(text, "'\\''");
}
/// Unlike std::system() it lets Ctrl-C stop this program meanwhile.
bool shell(const std::string& command) {
  FILE* const pipe = popen(command.c_str(), "r");
  return pipe != nullptr && pclose(pipe) == 0;
}

/// Characters that UTF-8 text shows.
double characters(std::string_view text) {
  return static_cast<double>(
      std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xc0) != 0x80; }));
}
/// Of a text in a legend [pixels].
double width_of(std::string_view text) {
  const auto capitals =
      std::count_if(text.begin(), text.end(), [](char c) { return (c >= 'A' && c <= 'Z') || c == '_'; });
  return kCharacter * characters(text) + (kCapital - kCharacter) * static_cast<double>(capitals);
}

bool is_known(const Scale& s) {
  return std::isfinite(s.low) && std::isfinite(s.high);
}

/// gnuplot's input for one picture.
class Page {
 public:
  explicit Page(const Picture& p) : p_{p}, count_{p.panels.size()} {
    across_ = p.across;
    for (across_ = across_ > 0 ? across_ : count_ <= 3 ? count_ : 2; p.across == 0 && across_ * across_ < count_;)
      ++across_;
    down_ = (count_ + across_ - 1) / across_;
    width_ = p.panel.first > 0 ? static_cast<double>(p.panel.first) : count_ == 1 ? 640.0 : 340.0;
    height_ = p.panel.second > 0 ? static_cast<double>(p.panel.second) : count_ == 1 ? 430.0 : 300.0;
    lay_out();
  }

  [[nodiscard]] const std::string& data() const { return data_; }
  [[nodiscard]] std::string input() {
    std::string body = "set multiplot\nunset key\n" + heading() + bar();
    for (std::size_t i = 0; i < count_; ++i) {
      if (i == 1) body += "unset label\nunset object\nunset arrow\nunset colorbox\n";  // what is drawn once
      body += panel(i);
    }
    body += "unset multiplot\n";
    return "set encoding utf8\n" + page("pngcairo", ".png", body) + page("svg", ".svg", body);
  }

 private:
  [[nodiscard]] bool at_left(std::size_t i) const { return i % across_ == 0 || !same(i, i - 1, &Panel::y); }
  [[nodiscard]] bool at_bottom(std::size_t i) const {
    return i + across_ >= count_ || !same(i, i + across_, &Panel::x);
  }
  [[nodiscard]] bool same(std::size_t a, std::size_t b, Scale Panel::*of) const {
    return is_known(p_.panels[a].*of) && p_.panels[a].*of == p_.panels[b].*of;
  }

  void lay_out() {
    left_ = 100.0, right_ = p_.bar ? kBarRight : 30.0, bottom_ = 70.0, gap_x_ = 30.0, gap_y_ = 38.0;
    bool titles = false;
    for (std::size_t i = 0; i < count_; ++i) {
      const Panel& panel = p_.panels[i];
      titles = titles || !panel.title.empty();
      double y_words = 0.0, x_words = 0.0;
      for (const auto& [at, text] : panel.y.ticks) y_words = std::max(y_words, kCharacter * characters(text));
      if (panel.x.words)
        for (const auto& [at, text] : panel.x.ticks) x_words = std::max(x_words, kCharacter * characters(text));
      left_ = std::max(left_, 95.0 + y_words);
      if (x_words > 0.87 * width_ / static_cast<double>(std::max<std::size_t>(panel.x.ticks.size(), 1)))
        slanted_ = true, bottom_ = std::max(bottom_, 70.0 + 0.6 * x_words);
      if (i % across_ > 0 && at_left(i)) gap_x_ = 90.0;
      if (i + across_ < count_ && at_bottom(i)) gap_y_ = panel.x.label.text().empty() ? 52.0 : 66.0;
    }
    titles_ = titles ? kPanelTitle : 0.0;
    gap_y_ += titles_;
    total_x_ = left_ + static_cast<double>(across_) * (width_ + gap_x_) - gap_x_ + right_;
    find_legend();
    const double rows = legend_.empty() ? 0.0 : kLegendRow * (1.0 + legend_rows_) + 4.0;
    total_y_ = kTitle + rows + titles_ + static_cast<double>(down_) * (height_ + gap_y_) - gap_y_ + bottom_;
  }

  struct Entry {
    const Series* series;
    double x, row;
  };
  void find_legend() {
    double x = 0.0;
    for (const Panel& panel : p_.panels)
      for (const Series& s : panel.series) {
        if (s.name.empty() || s.rows.empty()) continue;
        if (std::any_of(legend_.begin(), legend_.end(), [&](const Entry& e) { return e.series->name == s.name; }))
          continue;
        const double wide = kMark + width_of(s.name) + kEntryGap;
        if (x > 0.0 && x + wide > total_x_ - 40.0) x = 0.0, ++legend_rows_;
        legend_.push_back({&s, x, legend_rows_});
        x += wide;
      }
  }

  [[nodiscard]] double x(double pixels) const { return pixels / total_x_; }
  [[nodiscard]] double y(double pixels) const { return pixels / total_y_; }

  // gnuplot gives every entry of a legend the width of the longest and keeps all within one panel: it is drawn by hand.
  [[nodiscard]] std::string heading() const {
    std::string gp = fmt::format("set label 999 {} at screen 0.5, screen {} center front font ',12'\n",
                                 gnuplot_string(p_.title), y(total_y_ - 0.5 * kTitle));
    int tag = 1000;
    for (const Entry& e : legend_) {
      double row_wide = 0.0;
      for (const Entry& other : legend_)
        if (other.row == e.row) row_wide = std::max(row_wide, other.x + kMark + width_of(other.series->name));
      const double at = e.x + std::max(20.0, 0.5 * (total_x_ - row_wide)),
                   up = y(total_y_ - kTitle - kLegendRow * (0.5 + e.row));
      const std::string& colour = e.series->colour;
      ++tag;
      switch (e.series->look) {
        case Look::boxes:
        case Look::area:
          gp += fmt::format(
              "set object {} rectangle from screen {}, screen {} to screen {}, screen {} fc rgb '{}' fs solid noborder "
              "front\n",
              tag, x(at), up - y(5.0), x(at + 18.0), up + y(5.0), colour);
          break;
        case Look::dots:
        case Look::crosses:
        case Look::triangles:
          gp += fmt::format("set label {} '' at screen {}, screen {} point pt {} ps 1.2 lc rgb '{}' front\n", tag,
                            x(at + 9.0), up, mark(e.series->look), colour);
          break;
        default:
          gp += fmt::format(
              "set arrow {} from screen {}, screen {} to screen {}, screen {} {} lw 2 dt {} lc rgb '{}' front\n", tag,
              x(at), up, x(at + 18.0), up, e.series->look == Look::arrows ? "head" : "nohead",
              e.series->look == Look::dashes ? 2 : 1, colour);
      }
      gp += fmt::format("set label {} {} at screen {}, screen {} left front\n", tag + 1000,
                        gnuplot_string(e.series->name), x(at + kMark), up);
    }
    return gp;
  }

  [[nodiscard]] std::string bar() const {
    if (!p_.bar) return "unset colorbox\n";
    // Viridis, which reads in grey and for most eyes.
    constexpr const char* kPalettes[] = {
        "0 '#440154', 1 '#46327e', 2 '#365c8d', 3 '#277f8e', 4 '#1fa187', 5 '#4ac16d', 6 '#a0da39', 7 '#fde725'",
        "0 '#f4a582', 1 '#2a788e'", "0 '#f4a582', 0.5 '#f0f0f0', 1 '#2a788e'"};
    const double low = y(bottom_), high = 1.0 - y(top());
    return fmt::format(
        "set palette defined ({})\nset cblabel {} offset 2,0\nset cbrange [{}:{}]\nset format cb '%g'\n{}"
        "set colorbox user origin screen {}, screen {} size screen {}, screen {}\n",
        kPalettes[static_cast<int>(p_.bar->palette)], gnuplot_string(p_.bar->label.text()), p_.bar->low, p_.bar->high,
        p_.bar->logarithmic ? "set logscale cb\n" : "", 1.0 - x(right_ - kBarGap), low, x(kBarWidth), high - low);
  }

  [[nodiscard]] double top() const {
    return total_y_ - bottom_ - static_cast<double>(down_) * (height_ + gap_y_) + gap_y_;
  }

  /// Range, ticks and label of gnuplot's axis `name`.
  [[nodiscard]] std::string axis(char name, const Scale& s, bool labelled) const {
    const auto end = [](double v) { return std::isfinite(v) ? fmt::format("{}", v) : std::string{"*"}; };
    std::string gp =
        fmt::format("{} logscale {}\nset {}label {}\nset {}range [{}:{}]\n", s.logarithmic ? "set" : "unset", name,
                    name, labelled ? gnuplot_string(s.label.text()) : "''", name, end(s.low), end(s.high));
    // Not every tick has its number where they would touch.
    double needed = 0.0;
    for (const auto& [at, text] : s.ticks) needed += name == 'x' ? kCharacter * characters(text) + 8.0 : 16.0;
    const auto every =
        s.words ? std::size_t{1} : static_cast<std::size_t>(needed / (name == 'x' ? width_ : height_)) + 1;
    std::vector<std::string> ticks;
    for (std::size_t i = 0; i < s.ticks.size(); ++i)
      ticks.push_back(
          fmt::format("{} {}", gnuplot_string(labelled && i % every == 0 ? s.ticks[i].second : ""), s.ticks[i].first));
    // At 1, 2, 5 of each decade where gnuplot would put one or two.
    if (ticks.empty() && s.logarithmic && s.low > 0.0 && s.high < 1e3 * s.low)
      for (double decade = std::pow(10.0, std::floor(std::log10(s.low))); decade <= s.high; decade *= 10.0)
        for (const double digit : {1.0, 2.0, 5.0})
          ticks.push_back(labelled ? fmt::format("{:.12g}", digit * decade) : fmt::format("'' {}", digit * decade));
    if (ticks.empty())
      return gp + fmt::format("set {0}tics autofreq norotate\nset format {0} '{1}'\n", name, labelled ? "%h" : "");
    return gp + fmt::format("set format {0} '%h'\nset {0}tics ({1}) {2}\n", name, fmt::join(ticks, ", "),
                            name == 'x' && slanted_ && s.words ? "rotate by 35 right" : "norotate");
  }

  [[nodiscard]] std::string panel(std::size_t i) {
    Panel panel = p_.panels[i];
    if (panel.equal) {
      const double unit = std::max((panel.x.high - panel.x.low) / width_, (panel.y.high - panel.y.low) / height_);
      const auto widen = [&](Scale& s, double pixels) {
        const double middle = 0.5 * (s.low + s.high);
        s.low = middle - 0.5 * unit * pixels, s.high = middle + 0.5 * unit * pixels;
      };
      widen(panel.x, width_), widen(panel.y, height_);
    }
    const double left = left_ + static_cast<double>(i % across_) * (width_ + gap_x_),
                 low = bottom_ + static_cast<double>(down_ - 1 - i / across_) * (height_ + gap_y_);
    // With margins of its own a panel in three dimensions would leave the page.
    std::string gp = panel.z ? "unset margins\n"
                             : fmt::format("set margins screen {}, screen {}, screen {}, screen {}\n", x(left),
                                           x(left + width_), y(low), y(low + height_));
    gp += fmt::format("set title {} offset 0,-0.5\n", gnuplot_string(panel.title));
    gp += axis('x', panel.x, panel.z || at_bottom(i)) + axis('y', panel.y, panel.z || at_left(i));
    const bool boxes =
        std::any_of(panel.series.begin(), panel.series.end(), [](const Series& s) { return s.look == Look::boxes; });
    gp += boxes ? "unset grid\n" : "set grid\n";
    if (panel.z)
      gp += axis('z', *panel.z, true) + fmt::format("set view {},{},1.2\nset view equal xyz\nset xyplane 0\n",
                                                    panel.view_deg.first, panel.view_deg.second);
    std::vector<std::string> plots;
    for (const Series& s : panel.series)
      if (const std::string one = plot(s, panel.z.has_value()); !one.empty()) plots.push_back(one);
    // Of nothing gnuplot finds no range.
    if (plots.empty()) {
      for (const auto& [name, scale] : {std::pair{'x', panel.x}, {'y', panel.y}})
        if (!is_known(scale)) gp += fmt::format("set {}range [1:2]\n", name);
      plots.emplace_back("NaN");
    }
    return gp + fmt::format("{} {}\n", panel.z ? "splot" : "plot", fmt::join(plots, ", "));
  }

  static int mark(Look look) { return look == Look::crosses ? 2 : look == Look::triangles ? 9 : 7; }

  /// One series in gnuplot's words; its rows go into data(). Empty where it has none.
  [[nodiscard]] std::string plot(const Series& s, bool solid) {
    std::string rows;
    for (std::size_t k = 0; k < s.rows.size(); ++k) {
      const std::vector<double>& row = s.rows[k];
      if (std::isnan(row.front())) {
        if (!rows.empty() && !rows.ends_with("\n\n")) rows += '\n';
        continue;
      }
      if (s.look == Look::boxes) rows += fmt::format("{} {} ", 0.5 * (row[0] + row[1]), 0.5 * (row[2] + row[3]));
      for (const double v : row) rows += std::isnan(v) ? "NaN " : fmt::format("{:.8g} ", v);
      if (s.look == Look::words) rows += fmt::format("\"{}\"", s.texts[k]);
      rows += '\n';
    }
    if (rows.empty()) return "";
    while (rows.ends_with("\n\n")) rows.pop_back();
    const std::string from = fmt::format("{} index {} using ", gnuplot_string(p_.name + ".dat"), blocks_++);
    data_ += fmt::format("# {}\n{}\n\n", s.name.empty() ? "-" : s.name, rows);
    const std::string xyz = solid ? "1:2:3" : "1:2", ink = fmt::format("lc rgb '{}'", s.colour);
    const auto line = [&](const char* with, int dash) {
      return from + fmt::format("{} with {} lw {} dt {} {}", xyz, with, s.size, dash, ink);
    };
    switch (s.look) {
      case Look::line:
        return line("lines", 1);
      case Look::dashes:
        return line("lines", 2);
      case Look::joined_dots:
        return from + fmt::format("{} with linespoints pt 7 ps {} lw 1.5 {}", xyz, 0.5 * s.size, ink);
      case Look::dots:
      case Look::crosses:
      case Look::triangles:
        return from + fmt::format("{} with points pt {} ps {} lw 1.5 {}", xyz, mark(s.look), s.size, ink);
      case Look::boxes:
        return from + (s.colour.empty()
                           ? "1:2:3:4:5:6:7 with boxxyerror fs solid 1 noborder lc palette"
                           : fmt::format("1:2:3:4:5:6 with boxxyerror fs solid 1 noborder fc rgb '{}'", s.colour));
      case Look::area:
        return from + fmt::format("1:2 with filledcurves closed fs solid 1 noborder fc rgb '{}'", s.colour);
      case Look::arrows:
      case Look::strokes:
        return from + fmt::format("{} with vectors {} lw {} {}", solid ? "1:2:3:4:5:6" : "1:2:3:4",
                                  s.look == Look::strokes ? "nohead" : "filled head size screen 0.006,20", s.size, ink);
      case Look::words:
        return from + fmt::format("1:2:3 with labels {} font ',{}' tc rgb '{}'",
                                  s.align == 0.0   ? "left"
                                  : s.align == 1.0 ? "right"
                                                   : "center",
                                  s.size, s.colour);
    }
    return "";
  }

  [[nodiscard]] std::string page(const char* terminal, const char* ending, const std::string& body) const {
    return fmt::format(
        "set terminal {} size {:.0f},{:.0f} font 'DejaVu Sans,10' background rgb 'white'\nset output {}\n"
        "set termoption noenhanced\nset border lc rgb '#505050'\nset tics textcolor rgb '#202020' nomirror out\n"
        "set grid lc rgb '#e4e4e4'\nset clip two\n{}unset output\nreset\n",
        terminal, total_x_, total_y_, gnuplot_string(p_.name + ending), body);
  }

  const Picture& p_;
  std::size_t count_, across_ = 1, down_ = 1, blocks_ = 0;
  double width_ = 0.0, height_ = 0.0, left_ = 0.0, right_ = 0.0, bottom_ = 0.0, gap_x_ = 0.0, gap_y_ = 0.0;
  double titles_ = 0.0, total_x_ = 0.0, total_y_ = 0.0, legend_rows_ = 0.0;
  bool slanted_ = false;
  std::vector<Entry> legend_;
  std::string data_;
};

}  // namespace

std::string draw(const Picture& picture, const std::string& folder) {
  const std::string stem = folder + "/" + picture.name;
  Page page{picture};
  const std::string input = page.input();
  write_whole(stem + ".dat", page.data());
  write_whole(stem + ".gp", input);
  if (!shell("command -v gnuplot > /dev/null 2>&1"))
    return fmt::format("no picture: gnuplot is not installed (apt-get install gnuplot-nox); it would be given {}.gp",
                       stem);
  if (!shell(fmt::format("cd {} && gnuplot {} > {} 2>&1", shell_word(folder), shell_word(picture.name + ".gp"),
                         shell_word(picture.name + ".log"))))
    return fmt::format("no picture: gnuplot failed, {}.log says why", stem);
  std::remove((stem + ".log").c_str());
  return fmt::format("{0}.png, {0}.svg", stem);
}

namespace {

/// Three digits, in full where that is not too long: 7920, 0.0333, 2e+07.
std::string short_number(double value) {
  const double size = std::abs(value);
  if (!(size >= 1000.0 && size < 1e7)) return fmt::format("{:.3g}", value);
  const double unit = std::pow(10.0, std::floor(std::log10(size)) - 2.0);
  return fmt::format("{:.0f}", std::round(value / unit) * unit);
}

}  // namespace

Places::Places(const Axis& axis) : scale_{.label = label_of_paths(axis.paths)} {
  scale_.words =
      !std::all_of(axis.values.begin(), axis.values.end(), [](const std::string& v) { return number_from<double>(v); });
  for (std::size_t i = 0; i < axis.values.size(); ++i)
    at_.push_back(scale_.words ? static_cast<double>(i) : *number_from<double>(axis.values[i]));
  std::vector<double> places = at_;
  std::sort(places.begin(), places.end());
  places.erase(std::unique(places.begin(), places.end()), places.end());
  scale_.logarithmic = axis.logarithmic && !scale_.words && places.front() > 0.0;
  const auto along = [&](double v) { return scale_.logarithmic ? std::log(v) : v; };
  const auto back = [&](double v) { return scale_.logarithmic ? std::exp(v) : v; };
  const auto half = [&](double a, double b) { return 0.5 * (along(a) + along(b)); };
  double nearest = std::numeric_limits<double>::infinity();
  for (const double place : at_) {
    const auto found = std::lower_bound(places.begin(), places.end(), place);
    const double middle = along(place);
    double low = found != places.begin() ? half(*std::prev(found), place) : kAsDataNeed;
    double high = std::next(found) != places.end() ? half(place, *std::next(found)) : kAsDataNeed;
    if (std::isnan(low) && std::isnan(high))
      low = middle - (scale_.words || middle == 0.0 ? 0.5 : 0.05 * std::abs(middle));
    if (std::isnan(low)) low = 2.0 * middle - high;
    if (std::isnan(high)) high = 2.0 * middle - low;
    reach_.emplace_back(back(low), back(high));
    nearest = std::min({nearest, 2.0 * (middle - low), 2.0 * (high - middle)});
    scale_.low = std::isnan(scale_.low) ? back(low) : std::min(scale_.low, back(low));
    scale_.high = std::isnan(scale_.high) ? back(high) : std::max(scale_.high, back(high));
  }
  if (scale_.words || nearest > 0.065 * (along(scale_.high) - along(scale_.low)))
    for (std::size_t i = 0; i < at_.size(); ++i)
      scale_.ticks.emplace_back(at_[i], scale_.words ? axis.values[i] : short_number(at_[i]));
}

std::pair<double, double> Places::reach(std::size_t value, double part) const {
  const auto [low, high] = reach_[value];
  const auto shrunk = [&, place = at_[value]](double edge) {
    return scale_.logarithmic ? place * std::pow(edge / place, part) : place + part * (edge - place);
  };
  return {shrunk(low), shrunk(high)};
}

namespace {

using Replacement = std::pair<std::string_view, std::string_view>;

bool take_ending(std::string& name, std::string_view ending) {
  if (!name.ends_with(ending)) return false;
  name.resize(name.size() - ending.size());
  return true;
}

/// Takes the unit off the end of a name.
std::string take_unit(std::string& name) {
  static constexpr Replacement kUnits[] = {{"_n_m_s_per_rad", "N m s/rad"},
                                           {"_n_m_per_rad", "N m/rad"},
                                           {"_n_s_per_m", "N s/m"},
                                           {"_n_per_m", "N/m"},
                                           {"_rad_per_s", "rad/s"},
                                           {"_m_per_s", "m/s"},
                                           {"_kg_m2", "kg m²"},
                                           {"_n_m", "N m"},
                                           {"_rad", "rad"},
                                           {"_deg", "deg"},
                                           {"_kg", "kg"},
                                           {"_hz", "Hz"},
                                           {"_ms", "ms"},
                                           {"_us", "µs"},
                                           {"_j", "J"},
                                           {"_n", "N"},
                                           {"_m", "m"},
                                           {"_s", "s"}};
  for (const auto& [ending, unit] : kUnits)
    if (name.size() > ending.size() && take_ending(name, ending)) return std::string{unit};
  return "";
}

std::string spaced(std::string name) {
  std::replace(name.begin(), name.end(), '_', ' ');
  return name;
}

/// Takes the index off "wall[2]"; -1 where there is none.
int take_index(std::string& component) {
  const std::size_t bracket = component.find('[');
  if (bracket == component.npos) return -1;
  const int index = std::atoi(component.c_str() + bracket + 1);
  component.resize(bracket);
  return index;
}

/// The parts of a path's label.
struct PathWords {
  std::string stem;       ///< "delay"
  std::string direction;  ///< "to the slave", or empty
  std::string unit;
  [[nodiscard]] std::string text() const { return direction.empty() ? stem : stem + " " + direction; }
};

PathWords words_of(const std::string& path) {
  // What is clear from the rest, or said otherwise, is left out.
  static constexpr Replacement kBlocks[] = {{"control", ""},
                                            {"operator", ""},
                                            {"environment", ""},
                                            {"passivity", "controller"},
                                            {"virtual_coupling", "coupling"},
                                            {"force_sensor", "force sensor"}};
  static constexpr Replacement kWhole[] = {{"control.passivity.method", "passivity control"},
                                           {"control.passivity.max_gain", "largest gain of the controller"},
                                           {"rate_hz", "sampling rate"},
                                           {"simulation.substeps", "substeps a tick"}};
  PathWords w;
  const std::vector<std::string_view> all = parts_of(path, '.');
  std::vector<std::string> parts{all.begin(), all.end()};
  std::string leaf = parts.back();
  parts.pop_back();
  const int axis = take_index(leaf);
  w.unit = take_unit(leaf);
  for (const auto& [whole, words] : kWhole)
    if (path == whole) {
      w.stem = words;
      return w;
    }
  std::string number;
  for (std::string& part : parts) {
    const int index = take_index(part);
    if (part == "to_slave" || part == "to_master") {
      w.direction = part == "to_slave" ? "to the slave" : "to the master";
      continue;
    }
    if (part == "robot" && &part != &parts.back()) continue;  // the robot's force sensor
    std::string words = spaced(part);
    for (const auto& [block, instead] : kBlocks)
      if (part == block) words = instead;
    if (index > 0) number = fmt::format("no. {} ", index + 1);  // of environment[1].wall: the wall's
    if (!words.empty()) w.stem += words + " " + std::exchange(number, "");
  }
  w.stem += spaced(leaf);
  if (axis >= 0) w.stem += fmt::format(", axis {}", axis);
  return w;
}

}  // namespace

std::string Label::text() const {
  return unit.empty() ? words : fmt::format("{} [{}]", words, unit);
}

Label label_of_paths(const std::vector<std::string>& paths) {
  std::vector<PathWords> all;
  for (const std::string& path : paths) all.push_back(words_of(path));
  const PathWords& first = all.front();
  const auto each = [&](auto test) { return std::all_of(all.begin(), all.end(), test); };
  const bool one_stem = each([&](const PathWords& w) { return w.stem == first.stem; });
  if (one_stem && all.size() == 2 && !first.direction.empty() && !all[1].direction.empty())
    return {first.stem + " each way", first.unit};
  const bool one_unit = each([&](const PathWords& w) { return w.unit == first.unit; });
  Label label{.words = "", .unit = one_unit ? first.unit : ""};
  for (const PathWords& w : all) {
    if (!label.words.empty()) label.words += " and ";
    label.words += one_unit ? w.text() : Label{w.text(), w.unit}.text();
  }
  return label;
}

Label label_of_figure(std::string_view key) {
  static constexpr Replacement kWhole[] = {{"rtt", "round-trip time"},
                                           {"steps", "ticks"},
                                           {"min_observed_energy", "least energy that the observer saw"},
                                           {"hand_min_energy", "least energy through the hand's port"},
                                           {"two_port_min_energy", "least energy through both ports of the link"},
                                           {"robot_min_energy", "least energy into the robot's coupling"},
                                           {"energy_owed", "undissipated deficit"},
                                           {"dissipated", "energy dissipated by the controllers"},
                                           {"packets.to_slave", "packets to the slave"},
                                           {"packets.to_master", "packets to the master"}};
  std::string name{key}, ending;
  if (take_ending(name, "_sd")) ending = ", standard deviation over the seeds";
  if (take_ending(name, "_worst")) ending = ", worst seed";
  const std::size_t dot = name.rfind('.');
  if (dot != name.npos) {
    ending = ", " + name.substr(dot + 1) + ending;
    name.resize(dot);
  }
  Label label{.words = "", .unit = take_unit(name)};
  if (take_ending(name, "_rms")) ending = ", rms" + ending;
  if (take_ending(name, "_max")) ending = ", largest" + ending;
  const auto whole =
      std::find_if(std::begin(kWhole), std::end(kWhole), [&](const Replacement& r) { return r.first == name; });
  if (whole != std::end(kWhole)) {
    label.words = whole->second;
  } else if (name.starts_with("min_")) {
    label.words = "least " + spaced(name.substr(4));
  } else if (name.starts_with("max_")) {
    label.words = "largest " + spaced(name.substr(4));
  } else {
    label.words = spaced(name);
  }
  label.words += ending;
  return label;
}

}  // namespace twoport::lab
