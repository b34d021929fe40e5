
#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <utility>
#include <vector>

#include "lab/plot/picture.h"
#include "lab/plot/pictures.h"
#include "lab/study/chart.h"

namespace twoport::lab {
namespace {

// Pixels.
constexpr double kAcross = 735.0, kUp = 505.0, kCharacter = 6.2, kLine = 13.0, kBeside = 8.0;

// Errors at rounding level are drawn at the bottom.
constexpr double kLeast = 1e-17;

/// [µs] per simulated second; of an answer [ms].
double cost(const Point& p) {
  return p.answer ? 1e3 * p.cost : 1e6 * p.cost;
}
double error(const Point& p) {
  return std::max(p.off, kLeast);
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

/// Widens the ends of a logarithmic scale.
Scale around(Label label, double low, double high) {
  const double factor = std::max(1.5, std::pow(high / low, 0.06));
  return {.label = std::move(label), .low = low / factor, .high = high * factor, .logarithmic = true};
}

/// Names of the points of the front: to the left and below, where no point and no line can be, or to the right and above where a name is
/// there already or has no room, one below the other.
std::vector<Series> names_of(const std::vector<const Point*>& front, const Scale& x, const Scale& y) {
  const auto along = [](const Scale& s, double value) { return std::log(value / s.low) / std::log(s.high / s.low); };
  const auto moved = [](const Scale& s, double value, double part) { return value * std::pow(s.high / s.low, part); };
  Series left{Look::words, "black", "", 9.0, 1.0}, right{Look::words, "black", "", 9.0, 0.0};
  double last_up = 2.0 * kUp, last_right = 2.0 * kUp;  // of the last name at the left, at the right
  for (const Point* p : front) {
    const double at = kAcross * along(x, cost(*p)), up = kUp * along(y, error(*p));
    const bool is_free = last_up - up > kLine && at - kBeside > kCharacter * static_cast<double>(p->name.size());
    if (is_free) last_up = up;
    const double sign = is_free ? -1.0 : 1.0;
    double name_up = up + sign * 0.5 * kLine;
    if (!is_free) name_up = last_right = std::min(name_up, last_right - kLine);
    (is_free ? left : right)
        .add_text(moved(x, cost(*p), sign * kBeside / kAcross), moved(y, y.low, name_up / kUp), p->name);
  }
  return {left, right};
}

}  // namespace

std::string draw(const Chart& c, const std::string& title, const std::string& folder) {
  std::vector<const Point*> front;
  std::vector<Series> groups;
  std::vector<double> costs, errors;
  std::size_t spare = 0;
  const bool answers = !c.verdict.empty();
  const double floor = c.floor_off;
  if (floor > 0.0) errors.push_back(floor);
  for (const Point& p : c.points) {
    if (!p.impossible.empty()) continue;
    costs.push_back(cost(p));
    if (!p.counts()) continue;
    errors.push_back(error(p));
    if (p.dominated_by.empty()) front.push_back(&p);
    auto group = std::find_if(groups.begin(), groups.end(), [&](const Series& s) { return s.name == p.group; });
    if (group == groups.end())
      group = groups.insert(group, {p.peer ? Look::triangles : Look::dots, colour_of(p.group, spare), p.group, 1.3});
    group->add({costs.back(), errors.back()});
  }
  std::sort(front.begin(), front.end(), [](const Point* a, const Point* b) { return a->cost < b->cost; });
  if (errors.empty()) errors.push_back(1.0);
  const auto [least, most] = std::minmax_element(costs.begin(), costs.end());
  const auto [best, worst] = std::minmax_element(errors.begin(), errors.end());
  Panel panel{
      .title = "",
      .x = around(answers ? Label{"processor time of the answer", "ms"} : Label{"cost", "µs per simulated second"},
                  *least, *most),
      .y = around(answers ? Label{"error of the answer", "share of the reference"} : Label{"position error, rms", "m"},
                  *best, *worst)};
  Series limit{Look::line, "#a0a0a0", "uncertainty of the reference"},
      line{Look::dashes, "black", "front: best trade-offs"};
  if (floor > 0.0) limit.add({panel.x.low, floor}), limit.add({panel.x.high, floor});
  for (const Point* p : front) line.add({cost(*p), error(*p)});
  panel.series = {limit, line};
  panel.series.insert(panel.series.end(), groups.begin(), groups.end());
  Series wrong{Look::crosses, "#d62728", "wrong verdict: at the top"};
  for (const Point& p : c.points)
    if (p.impossible.empty() && !p.counts()) wrong.add({cost(p), panel.y.high / 1.05});
  panel.series.push_back(std::move(wrong));
  for (Series& names : names_of(front, panel.x, panel.y)) panel.series.push_back(std::move(names));
  return draw(Picture{.name = "chart",
                      .title = title + (answers ? ": what each way to its answer costs, and its error"
                                                : ": what each way to step it costs, and its error"),
                      .panels = {std::move(panel)},
                      .panel = {static_cast<std::size_t>(kAcross), static_cast<std::size_t>(kUp)}},
              folder);
}

}  // namespace twoport::lab
