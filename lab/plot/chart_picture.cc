#include "lab/plot/chart_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/file.h"
#include "lab/plot/gnuplot.h"

namespace twoport::lab {
namespace {

// Pixels.
constexpr double kWidth = 1060.0, kHeight = 620.0, kLeft = 95.0, kRight = 230.0, kTop = 45.0, kBottom = 70.0;
constexpr double kCharacter = 7.3, kLine = 13.0, kDot = 6.0;

// Errors at rounding level are drawn at the bottom.
constexpr double kLeast = 1e-17;

double cost_us(const Point& p) {
  return 1e6 * p.cost;
}
double error_m(const Point& p) {
  return std::max(p.error.position_rms_m, kLeast);
}

/// An integrator or an engine has the same colour in every chart; other groups use the remaining colours in turn.
std::string colour_of(std::string_view group, std::size_t& spare) {
  static constexpr std::pair<std::string_view, const char*> kOwn[] = {
      {"EXACT_PER_TICK", "#ca5a32"},  {"EXACT", "#2a788e"}, {"SYMPLECTIC_EULER", "#7a5195"}, {"TRAPEZOIDAL", "#58a45c"},
      {"VELOCITY_VERLET", "#d9a441"}, {"RK4", "#4c72b0"},   {"DORMAND_PRINCE", "#c2185b"},   {"ODE", "#8c8c8c"},
      {"Bullet", "#b55d60"},          {"MuJoCo", "#222222"}};
  static constexpr std::array<const char*, 5> kSpare = {"#5f9e6e", "#857aab", "#64b5cd", "#c2a03f", "#a05195"};
  for (const auto& [name, colour] : kOwn)
    if (group.starts_with(name)) return colour;
  return kSpare[spare++ % kSpare.size()];
}

/// The frame of the plot: logarithmic both ways, pixels from its lower left corner.
struct Frame {
  double x_low = std::numeric_limits<double>::infinity(), x_high = 0.0, y_low = x_low, y_high = 0.0;
  static constexpr double kAcross = kWidth - kLeft - kRight, kUp = kHeight - kTop - kBottom;

  void take(double x, double y) {
    x_low = std::min(x_low, x), x_high = std::max(x_high, x);
    y_low = std::min(y_low, y), y_high = std::max(y_high, y);
  }
  /// Room around the points, as a part of what they take.
  void widen(double part) {
    const auto by = [part](double& low, double& high) {
      const double factor = std::max(1.5, std::pow(high / low, part));
      low /= factor, high *= factor;
    };
    by(x_low, x_high);
    by(y_low, y_high);
  }
  [[nodiscard]] double x(double value) const { return kAcross * std::log(value / x_low) / std::log(x_high / x_low); }
  [[nodiscard]] double y(double value) const { return kUp * std::log(value / y_low) / std::log(y_high / y_low); }
};

struct Box {
  double left, bottom, right, top;
  [[nodiscard]] bool overlaps(const Box& b) const {
    return left < b.right && b.left < right && bottom < b.top && b.bottom < top;
  }
};

/// Names of points beside them, where they cover no point, no part of the front and no other name, within the frame.
std::string labels(const std::vector<const Point*>& front, const std::vector<Box>& dots, const Frame& frame) {
  const auto place = [&](const Point* p) { return std::pair{frame.x(cost_us(*p)), frame.y(error_m(*p))}; };
  std::vector<Box> taken = dots;
  for (std::size_t i = 1; i < front.size(); ++i) {
    const auto [x0, y0] = place(front[i - 1]);
    const auto [x1, y1] = place(front[i]);
    const int pieces = 1 + static_cast<int>(std::hypot(x1 - x0, y1 - y0) / 3.0);
    for (int k = 0; k <= pieces; ++k) {
      const double part = static_cast<double>(k) / pieces, x = x0 + part * (x1 - x0), y = y0 + part * (y1 - y0);
      taken.push_back({x - 1.0, y - 1.0, x + 1.0, y + 1.0});
    }
  }
  std::string gp;
  for (const Point* p : front) {
    const auto [x, y] = place(p);
    const double wide = kCharacter * static_cast<double>(p->name.size());
    const auto try_at = [&, x = x, y = y](double up, bool at_right) {
      const double anchor = at_right ? x + kDot + 3.0 : x - kDot - 3.0;
      const Box box{at_right ? anchor : anchor - wide, y + up - 0.5 * kLine, at_right ? anchor + wide : anchor,
                    y + up + 0.5 * kLine};
      const bool inside = box.left > 0.0 && box.right < Frame::kAcross && box.bottom > 0.0 && box.top < Frame::kUp;
      if (!inside || std::any_of(taken.begin(), taken.end(), [&](const Box& b) { return b.overlaps(box); }))
        return false;
      taken.push_back(box);
      gp += fmt::format("set label {} at graph {}, graph {} {} font ',9' front\n", gnuplot_quoted(p->name),
                        anchor / Frame::kAcross, (y + up) / Frame::kUp, at_right ? "left" : "right");
      return true;
    };
    bool placed = false;
    for (const double up : {0.0, 4.0, -4.0, 8.0, -8.0, 13.0, -13.0, 20.0, -20.0, 28.0, -28.0})
      for (const bool at_right : {true, false}) placed = placed || try_at(up, at_right);
  }
  return gp;
}

}  // namespace

std::string draw(const Chart& c, const std::string& title, const std::string& folder) {
  std::vector<const Point*> shown, front;
  std::vector<std::string> groups;
  Frame frame;
  for (const Point& p : c.points) {
    if (!p.impossible.empty()) continue;
    shown.push_back(&p);
    frame.take(cost_us(p), error_m(p));
    if (p.dominated_by.empty()) front.push_back(&p);
    if (std::find(groups.begin(), groups.end(), p.group) == groups.end()) groups.push_back(p.group);
  }
  std::sort(front.begin(), front.end(), [](const Point* a, const Point* b) { return a->cost < b->cost; });
  const double floor = c.floor.position_rms_m;
  if (floor > 0.0) frame.take(frame.x_low, floor);
  frame.widen(0.06);
  std::vector<Box> dots;
  for (const Point* p : shown) {
    const double x = frame.x(cost_us(*p)), y = frame.y(error_m(*p));
    dots.push_back({x - kDot, y - kDot, x + kDot, y + kDot});
  }

  std::string data, plot = "plot ";
  const auto add = [&](const Point& p) { data += fmt::format("{} {} \"{}\"\n", cost_us(p), error_m(p), p.name); };
  if (floor > 0.0) plot += fmt::format("{} with lines lc rgb '#a0a0a0' title 'uncertainty of the reference', ", floor);
  std::size_t spare = 0;
  for (std::size_t i = 0; i < groups.size(); ++i) {
    bool engine = false;
    for (const Point* p : shown)
      if (p->group == groups[i]) add(*p), engine = p->peer;
    data += "\n\n";
    const int mark = !engine ? 7 : groups[i].ends_with("contact") ? 8 : 9;
    plot += fmt::format("'chart.dat' index {} using 1:2 with points pt {} ps 1.3 lw 1.5 lc rgb '{}' title {}, ", i,
                        mark, colour_of(groups[i], spare), gnuplot_quoted(groups[i]));
  }
  for (const Point* p : front) add(*p);
  plot += fmt::format(
      "'chart.dat' index {} using 1:2 with lines lw 1.5 dt 2 lc rgb 'black' title 'front: best trade-offs'\n",
      groups.size());

  std::string body =
      fmt::format("set title {}\n", gnuplot_quoted(title + ": what each way to step it costs, and its error"));
  body +=
      "set logscale xy\nset format y '%g'\nset xlabel 'cost [µs per simulated second]'\n"
      "set ylabel 'position error, rms [m]'\n" +
      fmt::format("set key at screen {}, screen {} left top vertical Left reverse samplen 1.5\n",
                  1.0 - (kRight - 8.0) / kWidth, 1.0 - kTop / kHeight);
  body += fmt::format("set xrange [{}:{}]\nset yrange [{}:{}]\n", frame.x_low, frame.x_high, frame.y_low, frame.y_high);
  body += fmt::format(
      "set lmargin at screen {}\nset rmargin at screen {}\nset tmargin at screen {}\nset bmargin at screen {}\n",
      kLeft / kWidth, 1.0 - kRight / kWidth, 1.0 - kTop / kHeight, kBottom / kHeight);
  body += labels(front, dots, frame) + plot;
  write_whole(folder + "/chart.dat", data);
  write_whole(folder + "/chart.gp",
              gnuplot_pages("chart", static_cast<std::size_t>(kWidth), static_cast<std::size_t>(kHeight), 10, body));
  return run_gnuplot(folder, "chart");
}

}  // namespace twoport::lab
