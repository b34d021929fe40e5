#include "lab/plot/picture.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>

#include "common/base/file.h"

namespace twoport::lab {
namespace {

// Pixels, at a font of 10 points.
constexpr double kCharacter = 6.7, kMark = 26.0, kEntryGap = 28.0, kLegendRow = 22.0;
constexpr double kTitle = 40.0, kPanelTitle = 22.0, kBarGap = 25.0, kBarWidth = 22.0, kBarRight = 150.0;

/// In single quotes for gnuplot; the only escape there is a doubled quote.
std::string gnuplot_string(std::string_view text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? "''" : std::string(1, c);
  return out + "'";
}
/// Quoted for a shell, which has no escape within single quotes.
std::string shell_word(const std::string& text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? "'\\''" : std::string(1, c);
  return out + "'";
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
        const double wide = kMark + kCharacter * characters(s.name) + kEntryGap;
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
        if (other.row == e.row)
          row_wide = std::max(row_wide, other.x + kMark + kCharacter * characters(other.series->name));
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

}  // namespace twoport::lab
