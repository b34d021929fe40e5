#include "lab/plot/page.h"

#include <fmt/format.h>

#include <utility>

#include "lab/plot/gnuplot.h"

namespace twoport::lab {
namespace {

constexpr int kFont = 10;
// Pixels.
constexpr double kCharacter = 6.7, kMark = 26.0, kEntryGap = 28.0;  // of the legend, at that font
constexpr std::size_t kLeft = 100, kAcross = 30, kDown = 60, kPanelTitle = 22;
constexpr std::size_t kBarGap = 25, kBarWidth = 22, kBarRight = 150;

/// Characters that UTF-8 text shows.
double characters(const std::string& text) {
  double count = 0.0;
  for (const char c : text) count += (static_cast<unsigned char>(c) & 0xc0) == 0x80 ? 0.0 : 1.0;
  return count;
}

}  // namespace

Page::Page(std::string title, std::vector<LegendEntry> legend) : title_{std::move(title)}, legend_{std::move(legend)} {}

Page& Page::panels(std::size_t count) {
  count_ = count;
  if (count == 1) return *this;
  panel_width_ = 340, panel_height_ = 300;
  across_ = count <= 3 ? count : 2;
  while (across_ * across_ < count) ++across_;
  down_ = (count + across_ - 1) / across_;
  return *this;
}

Page& Page::panel_size(std::size_t width, std::size_t height) {
  panel_width_ = width, panel_height_ = height;
  return *this;
}

bool Page::slants(const Scale& x) {
  const double room = static_cast<double>(panel_width_) / static_cast<double>(x.size());
  const double word = kCharacter * static_cast<double>(x.longest_word());
  if (word < 1.15 * room) return false;
  bottom_ += static_cast<std::size_t>(0.6 * word);
  return true;
}

Page& Page::colour_bar(const Label& label, double low, double high, bool logarithmic) {
  right_ = kBarRight;
  colour_bar_ = fmt::format("set cblabel {} offset 2,0\nset cbrange [{}:{}]\nset format cb '%g'\n{}",
                            gnuplot_quoted(label.text()), low, high, logarithmic ? "set logscale cb\n" : "");
  return *this;
}

std::size_t Page::top() const {
  return 40 + (legend_.empty() ? 0 : 30) + (count_ > 1 ? kPanelTitle : 0);
}
std::size_t Page::width() const {
  return kLeft + across_ * panel_width_ + (across_ - 1) * kAcross + right_;
}
std::size_t Page::height() const {
  return top() + down_ * panel_height_ + (down_ - 1) * kDown + bottom_;
}
double Page::x(double pixels) const {
  return pixels / static_cast<double>(width());
}
double Page::y(double pixels) const {
  return pixels / static_cast<double>(height());
}

// gnuplot gives every entry of a legend the width of the longest and keeps all within one panel: it is drawn by hand.
std::string Page::draw_legend() const {
  double wide = -kEntryGap;
  for (const LegendEntry& entry : legend_) wide += kMark + kCharacter * characters(entry.text) + kEntryGap;
  double at = 0.5 * (static_cast<double>(kLeft + width() - right_) - wide);
  const double up = static_cast<double>(height()) - 48.0;
  std::string gp;
  int tag = 1000;
  for (const LegendEntry& entry : legend_) {
    const double from = x(at), to = x(at + 18.0), middle = x(at + 9.0);
    ++tag;
    switch (entry.mark) {
      case LegendEntry::Mark::box:
        gp += fmt::format(
            "set object {} rectangle from screen {}, screen {} to screen {}, screen {} fc rgb '{}' "
            "fs solid noborder front\n",
            tag, from, y(up - 5.0), to, y(up + 5.0), entry.colour);
        break;
      case LegendEntry::Mark::dot:
      case LegendEntry::Mark::cross:
        gp += fmt::format("set label {} '' at screen {}, screen {} point pt {} ps 1 lc rgb '{}' front\n", tag, middle,
                          y(up), entry.mark == LegendEntry::Mark::dot ? 7 : 2, entry.colour);
        break;
      default:
        gp += fmt::format(
            "set arrow {} from screen {}, screen {} to screen {}, screen {} nohead lw 2 dt {} lc rgb '{}' "
            "front\n",
            tag, from, y(up), to, y(up), entry.mark == LegendEntry::Mark::line ? 1 : 2, entry.colour);
    }
    gp += fmt::format("set label {} {} at screen {}, screen {} left front\n", tag + 1000, gnuplot_quoted(entry.text),
                      x(at + kMark), y(up));
    at += kMark + kCharacter * characters(entry.text) + kEntryGap;
  }
  return gp;
}

std::string Page::panel(std::size_t i, const std::string& title, const Label& x_label, const Label& y_label) const {
  std::string gp;
  if (i == 1) gp += "unset label\nunset object\nunset arrow\nunset colorbox\n";  // legend and colour bar are drawn once
  if (count_ > 1) gp += fmt::format("set title {} offset 0,-0.5\n", gnuplot_quoted(title));
  const bool at_bottom = i + across_ >= count_;
  gp += fmt::format("set xlabel {}\n", at_bottom ? gnuplot_quoted(x_label.text()) : "''");
  gp += fmt::format("set ylabel {}\n", at_left(i) ? gnuplot_quoted(y_label.text()) : "''");
  return gp;
}

std::string Page::pages(const std::string& name, const std::string& body) const {
  const double left = x(kLeft), right = 1.0 - x(static_cast<double>(right_));
  const double bottom = y(static_cast<double>(bottom_)), up = 1.0 - y(static_cast<double>(top()));
  std::string gp = "unset key\n" + draw_legend() + colour_bar_;
  if (!colour_bar_.empty())
    gp += fmt::format("set colorbox user origin screen {}, screen {} size screen {}, screen {}\n", right + x(kBarGap),
                      bottom, x(kBarWidth), up - bottom);
  gp += fmt::format("set multiplot layout {},{} title {} margins screen {},{},{},{} spacing screen {},{}\n", down_,
                    across_, gnuplot_quoted(title_), left, right, bottom, up, x(kAcross), y(kDown));
  return gnuplot_pages(name, width(), height(), kFont, gp + body + "unset multiplot\n");
}

}  // namespace twoport::lab
