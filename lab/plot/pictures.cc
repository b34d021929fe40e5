#include "lab/plot/pictures.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <map>
#include <memory>
#include <numbers>
#include <optional>
#include <string_view>
#include <utility>

#include "common/base/check.h"
#include "common/base/text.h"
#include "common/coupling/joint_tool.h"
#include "common/record/trace_table.h"
#include "lab/plot/picture.h"
#include "lab/study/boundary.h"
#include "lab/study/chart.h"
#include "lab/study/compare.h"
#include "lab/study/impedance.h"
#include "lab/study/map.h"
#include "lab/study/trim.h"
#include "lab/study/zwidth.h"

namespace twoport::lab {
// ---- boundary

std::string draw(const BoundaryCurve& c, const std::string& folder) {
  constexpr double kBar = 0.6;  // of the distance between two values
  const Places x{c.along};
  Series stable{Look::boxes, kStableColour, "stable"}, unstable{Look::boxes, kUnstableColour, "unstable"};
  Series boundary{x.words() ? Look::dots : Look::joined_dots, "black", "boundary"};
  Series odd{Look::crosses, "black", "not as at both ends"};
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < c.found.size(); ++i) order.push_back(i);
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return x.at(a) < x.at(b); });
  bool open = false;
  for (const std::size_t i : order) {
    const BoundarySearch& found = c.found[i];
    open = open || found.open;
    const auto [left, right] = x.reach(i, kBar);
    const double change = found.boundary ? found.boundary->stable : c.vary.high;
    (found.stable_at_low ? stable : unstable).add({left, right, c.vary.low, change});
    if (found.boundary) {
      (found.stable_at_low ? unstable : stable).add({left, right, change, c.vary.high});
      boundary.add({x.at(i), change});
    } else {
      boundary.interrupt();
    }
    if (found.disagreement) odd.add({x.at(i), *found.disagreement});
  }
  return draw(Picture{.name = "boundary",
                      .title = c.scene + ": where the run stops being stable" + (open ? " (coarse)" : ""),
                      .panels = {{.title = "",
                                  .x = x.scale(),
                                  .y = {.label = label_of_paths(c.vary.paths),
                                        .low = c.vary.low,
                                        .high = c.vary.high,
                                        .logarithmic = c.vary.low > 0.0 && c.vary.high > 30.0 * c.vary.low},
                                  .series = {stable, unstable, boundary, odd}}}},
              folder);
}

// ---- z-width

std::string draw(const ZWidth& z, const std::string& folder) {
  const Places damping{z.table.grid.axes[0]}, stiffness{z.table.grid.axes[1]};
  Series border{Look::line, "black", "limit by eigenvalues, without a controller", 2.0};
  for (const auto& [b, k] : z.border) border.add({b, k});
  Picture picture{.name = "zwidth", .title = z.scene + ": stiffness and damping that are displayed stably"};
  for (std::size_t m = 0; m < z.methods.size(); ++m) {
    Series stable{Look::dots, kStableColour, "stable", 0.8}, unstable{Look::dots, kUnstableColour, "unstable", 0.8};
    for (std::size_t b = 0; b < damping.size(); ++b)
      for (std::size_t k = 0; k < stiffness.size(); ++k)
        (z.stable(b, k, m) ? stable : unstable).add({damping.at(b), stiffness.at(k)});
    picture.panels.push_back(
        {.title = z.methods[m], .x = damping.scale(), .y = stiffness.scale(), .series = {stable, unstable, border}});
  }
  return draw(picture, folder);
}

// ---- map

namespace {

/// The values that places take, each once, in their order, a step apart.
Axis axis_of(const Map& map, double MapPlace::*of, double scale) {
  std::vector<double> values;
  for (const MapPlace& p : map.places) values.push_back(p.*of);
  std::sort(values.begin(), values.end());
  values.erase(std::unique(values.begin(), values.end()), values.end());
  Axis axis{.paths = {}, .values = {}};
  for (const double v : values) axis.values.push_back(fmt::format("{:g}", scale * v));
  return axis;
}

/// A scale of steps, each with its words.
Scale steps(Label label, const std::vector<std::string>& texts, bool words = false) {
  Scale s{.label = std::move(label), .low = -0.5, .high = static_cast<double>(texts.size()) - 0.5, .words = words};
  for (std::size_t i = 0; i < texts.size(); ++i) s.ticks.emplace_back(static_cast<double>(i), texts[i]);
  return s;
}
std::size_t step_of(const Axis& axis, double value) {
  return static_cast<std::size_t>(std::find(axis.values.begin(), axis.values.end(), fmt::format("{:g}", value)) -
                                  axis.values.begin());
}
void add_box(Series& to, std::size_t x, std::size_t y) {
  const auto at = static_cast<double>(x), up = static_cast<double>(y);
  to.add({at - 0.5, at + 0.5, up - 0.5, up + 0.5});
}
void add_box(Series& to, std::size_t x, std::size_t y, double value) {
  add_box(to, x, y);
  to.rows.back().push_back(value);
}

}  // namespace

std::string draw(const Map& map, const std::string& folder) {
  const Axis across = axis_of(map, &MapPlace::round_trip_ms, 1.0),
             up = axis_of(map, &MapPlace::stiffness_n_per_m, 1e-3);
  const Scale x = steps({"round trip", "ms"}, across.values), y = steps({"wall stiffness", "kN/m"}, up.values);
  const auto x_of = [&](std::size_t place) { return step_of(across, map.places[place].round_trip_ms); };
  const auto y_of = [&](std::size_t place) { return step_of(up, 1e-3 * map.places[place].stiffness_n_per_m); };

  const std::string scene = map.scene + (map.stopped ? " (coarse)" : "");
  Picture holds{.name = "map", .title = scene + ": share of losses at which a method is stable, quiet and presses"};
  holds.bar = {{"share of the losses", ""}, 0.0, 1.0, false, ColourBar::Palette::from_unstable};
  for (std::size_t m = 0; m < map.methods.size(); ++m) {
    std::map<std::pair<std::size_t, std::size_t>, std::pair<int, int>> share;  // holds, of
    for (std::size_t p = 0; p < map.places.size(); ++p) {
      auto& [held, of] = share[{x_of(p), y_of(p)}];
      held += map.at(m, p).holds();
      ++of;
    }
    Series boxes{Look::boxes, ""};
    for (const auto& [at, of] : share) add_box(boxes, at.first, at.second, static_cast<double>(of.first) / of.second);
    holds.panels.push_back({.title = map.methods[m], .x = x, .y = y, .series = {boxes}});
  }

  // Distinct for most eyes; the first is the first method of the list.
  constexpr const char* kColours[] = {"#2a788e", "#f4a582", "#7a5195", "#bcbd22", "#ef5675", "#1f77b4", "#8c564b",
                                      "#2ca02c", "#e377c2", "#ffa600", "#17becf", "#444444", "#a05d00", "#9edae5"};
  std::map<std::pair<double, double>, std::vector<Series>> by_loss;  // probability, burst; a series for each method
  for (std::size_t p = 0; p < map.places.size(); ++p) {
    std::vector<Series>& series = by_loss[{map.places[p].loss, map.places[p].burst_packets}];
    if (series.empty()) {
      for (std::size_t m = 0; m < map.methods.size(); ++m)
        series.push_back({Look::boxes, kColours[m % std::size(kColours)], map.methods[m]});
      series.push_back({Look::boxes, kNothingColour, "none"});
    }
    add_box(series[best_of(standings(map, p))], x_of(p), y_of(p));
  }
  Picture best{.name = "map_best", .title = scene + ": the best method"};
  for (auto& [loss, series] : by_loss)
    best.panels.push_back({.title = fmt::format("loss {:g} %{}", 100.0 * loss.first,
                                                loss.second > 1.0 ? fmt::format(", bursts of {:g}", loss.second) : ""),
                           .x = x,
                           .y = y,
                           .series = std::move(series)});
  return draw(holds, folder) + "\n" + draw(best, folder);
}

// ---- matrix

std::string draw(const Matrix& m, const std::string& folder) {
  Series valued{Look::boxes, ""}, nothing{Look::boxes, kNothingColour, "nothing to show"},
      paper{Look::boxes, "#ffffff"};
  Series broken{Look::strokes, "#d62728", "claim of energy broken", 1.6},
      unstable{Look::strokes, "#202020", "not stable", 1.6};
  Series dark{Look::words, "white", "", 9.0}, light{Look::words, "black", "", 9.0};
  double most = 0.0;
  for (const Matrix::Cell& c : m.cells)
    if (c.refused.empty() && c.summary.verdict_kind() == "STABLE")
      most = std::max(most, c.summary.felt_force_error_rms_n());
  if (most == 0.0) most = 1.0;
  // Strokes from the left edge to the right one, down or up.
  const auto hatch = [](Series& s, double x, double y, double rise) {
    for (const double shift : {-0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75}) {
      const double from = std::max(-0.5, -0.5 + shift), to = std::min(0.5, 0.5 + shift);
      s.add({x + from, y + rise * (from - shift), to - from, rise * (to - from)});
    }
  };
  for (std::size_t t = 0; t < m.transparencies.size(); ++t)
    for (std::size_t p = 0; p < m.passivities.size(); ++p) {
      const Matrix::Cell& c = m.at(t, p);
      const std::size_t row = m.transparencies.size() - 1 - t;
      const auto x = static_cast<double>(p), y = static_cast<double>(row);
      const bool is_unstable = c.refused.empty() && c.summary.verdict_kind() != "STABLE";
      const bool has_value = c.refused.empty() && c.summary.has_felt_force_error_rms_n() &&
                             std::isfinite(c.summary.felt_force_error_rms_n());
      const double value = has_value ? c.summary.felt_force_error_rms_n() : 0.0;
      if (has_value) {
        add_box(valued, p, row, std::min(value, most));
      } else {
        add_box(nothing, p, row);
      }
      if (is_unstable) hatch(unstable, x, y, -1.0);
      if (c.broken) hatch(broken, x, y, 1.0);
      const bool on_paper = is_unstable || c.broken;
      if (on_paper) paper.add({x - 0.34, x + 0.34, y - 0.17, y + 0.17});
      const std::string words = !c.refused.empty() ? "refused"
                                : has_value        ? fmt::format("{:.2g} N", value)
                                                   : "no contact";
      (has_value && !on_paper && value < 0.6 * most ? dark : light).add_text(x, y, words);
    }
  std::vector<std::string> rows{m.transparencies.rbegin(), m.transparencies.rend()};
  Picture picture{
      .name = "matrix",
      .title = m.scene + ": every transparency layer under every passivity layer",
      .panels = {{.title = "",
                  .x = steps({"passivity layer", ""}, m.passivities, true),
                  .y = steps({"transparency layer", ""}, rows, true),
                  .series = {valued, nothing, unstable, broken, paper, dark, light}}},
      .panel = {100 * std::max<std::size_t>(m.passivities.size(), 4), 52 * std::max<std::size_t>(rows.size(), 3)}};
  picture.bar = {{"felt-force error, rms", "N"}, 0.0, most};
  return draw(picture, folder);
}

// ---- compare

namespace {

/// What the picture shows of a trace.csv, of at most 3000 rows, evenly chosen.
struct Forces {
  std::vector<double> t_s, environment_n, felt_n;
};

/// The force of one port in a row of a trace.
class PortForce {
 public:
  /// Of the columns POSITION_0, …, FORCE_0, …; with the arm of a port of joints the force at its tool.
  PortForce(std::string_view position, std::string_view force, const std::shared_ptr<const ArmModel>& arm,
            const ControlOptions& control)
      : position_{position}, force_{force} {
    if (arm) tool_.emplace(arm, control.joint_scale);
  }
  void take(std::string_view name, double value) {
    take(name, value, position_, q_);
    take(name, value, force_, f_);
  }
  [[nodiscard]] double norm_n() const {
    if (!tool_) return f_.head<3>().norm();
    return tool_->at(Position<kJointPort>{q_}).force(Force<kJointPort>{f_}).vec().norm();
  }

 private:
  static void take(std::string_view name, double value, std::string_view vector, JointTool::Axes& into) {
    if (!name.starts_with(vector) || name.size() != vector.size() + 1) return;
    const int axis = name.back() - '0';
    if (axis >= 0 && axis < into.size()) into[axis] = value;
  }

  std::string_view position_, force_;
  std::optional<JointTool> tool_;
  JointTool::Axes q_ = JointTool::Axes::Zero(), f_ = JointTool::Axes::Zero();
};

Forces read_forces(const std::string& path, const ControlOptions& control) {
  std::ifstream in{path};
  std::string header, line;
  if (!std::getline(in, header)) throw ConfigError{fmt::format("{}: is no trace", path)};
  const std::vector<std::string_view> names = parts_of(header, ',');
  const auto begin = in.tellg();
  std::size_t rows = 0;
  while (std::getline(in, line)) ++rows;
  in.clear();
  in.seekg(begin);
  PortForce environment{"slave_x_", "env_f_", control.follower, control};
  PortForce felt{"master_x_", "master_f_", control.leader, control};
  Forces all;
  for (std::size_t row = 0; std::getline(in, line); ++row) {
    if (row % (rows / 3000 + 1) != 0) continue;
    const std::vector<std::string_view> values = parts_of(line, ',');
    double t_s = 0.0;
    for (std::size_t i = 0; i < std::min(names.size(), values.size()); ++i) {
      const double value = number_from<double>(values[i]).value_or(kAsDataNeed);
      if (names[i] == "t_s") t_s = value;
      environment.take(names[i], value);
      felt.take(names[i], value);
    }
    all.t_s.push_back(t_s);
    all.environment_n.push_back(environment.norm_n());
    all.felt_n.push_back(felt.norm_n());
  }
  return all;
}

}  // namespace

std::string draw(const Comparison& all, const std::string& folder) {
  std::vector<Forces> of_methods;
  for (const std::string& method : all.methods)
    of_methods.push_back(read_forces(folder + "/" + method + "/trace.csv", all.control));
  // One scale for all that is stable; what is not is cut.
  double most = 0.0;
  for (std::size_t m = 0; m < all.methods.size(); ++m)
    if (all.summaries[m].verdict_kind() != "UNSTABLE")
      for (const std::vector<double>* forces : {&of_methods[m].environment_n, &of_methods[m].felt_n})
        for (const double force_n : *forces) most = std::max(most, force_n);
  Picture picture{.name = "compare", .title = all.scene + ": force at the environment and at the hand"};
  for (std::size_t m = 0; m < all.methods.size(); ++m) {
    const Forces& forces = of_methods[m];
    Series environment{Look::line, kUnstableColour, "environment"}, felt{Look::line, kStableColour, "felt by the hand"};
    for (std::size_t i = 0; i < forces.t_s.size(); ++i) {
      environment.add({forces.t_s[i], forces.environment_n[i]});
      felt.add({forces.t_s[i], forces.felt_n[i]});
    }
    Scale y{.label = {"force", "N"}};
    if (most > 0.0) y.low = 0.0, y.high = 1.1 * most;
    picture.panels.push_back(
        {.title = all.methods[m] + ": " + all.summaries[m].verdict_kind(),
         .x = {.label = {"time", "s"}, .low = 0.0, .high = forces.t_s.empty() ? 0.0 : forces.t_s.back()},
         .y = y,
         .series = {environment, felt}});
  }
  return draw(picture, folder);
}

// ---- run

std::string draw(const TraceTable& trace, const Summary& summary, const std::string& folder) {
  constexpr std::size_t kPoints = 4000;
  const auto at_row = [&](std::size_t row) { return trace.data() + row * trace.width(); };
  // Where a column begins, and its field.
  const auto column = [&](std::string_view name) {
    std::size_t at = 0;
    for (const TraceTable::Field& field : trace.fields()) {
      if (field.name == name) return std::pair{at, &field};
      at += field.size;
    }
    return std::pair{at, static_cast<const TraceTable::Field*>(nullptr)};
  };
  const auto [position, of_position] = column("master_x");
  const std::size_t other = column("slave_x").first, felt = column("master_f").first, pressed = column("env_f").first;
  const std::size_t energy = column("master_energy_j").first, step = trace.rows() / kPoints + 1;
  // Turns of a tool are not compared with its shifts.
  const bool tool = of_position->unit != of_position->rotational_unit;
  const std::size_t axes = tool ? std::min<std::size_t>(of_position->size, 3) : of_position->size;
  std::vector<double> load(axes);
  for (std::size_t row = 0; row < trace.rows(); row += step)
    for (std::size_t i = 0; i < axes; ++i) load[i] += std::pow(at_row(row)[felt + i], 2);
  const auto axis = static_cast<std::size_t>(std::max_element(load.begin(), load.end()) - load.begin());
  Series master{Look::line, kUnstableColour, "hand"}, slave{Look::line, kStableColour, "robot"};
  Series by_hand{Look::line, kUnstableColour}, by_robot{Look::line, kStableColour};
  Series put_in{Look::line, kStableColour}, least{Look::dashes, "#404040", "-E(0)"};
  const double scale = tool ? 1e3 : 1.0;
  double end_s = 0.0;
  for (std::size_t row = 0; row < trace.rows(); row += step) {
    const double* const of = at_row(row);
    end_s = of[0];
    master.add({of[0], scale * of[position + axis]});
    slave.add({of[0], scale * of[other + axis]});
    by_hand.add({of[0], of[felt + axis]});
    by_robot.add({of[0], -of[pressed + axis]});
    put_in.add({of[0], of[energy]});
  }
  if (summary.has_initial_energy_j())
    for (const double t_s : {0.0, end_s}) least.add({t_s, -summary.initial_energy_j()});
  const std::string along = tool ? fmt::format(" along {}", "xyz"[axis]) : fmt::format(" of joint {}", axis + 1);
  const auto panel = [&](const Label& label, std::vector<Series> series) {
    return Panel{.title = "",
                 .x = {.label = {"time", "s"}, .low = 0.0, .high = end_s},
                 .y = {.label = label},
                 .series = std::move(series)};
  };
  return draw(Picture{.name = "run",
                      .title = fmt::format("{}, {}: {}", summary.scene(), summary.method(), summary.verdict_kind()),
                      .panels = {panel({"position" + along, tool ? "mm" : of_position->unit}, {master, slave}),
                                 panel({(tool ? "force" : "torque") + along, tool ? "N" : "N m"}, {by_hand, by_robot}),
                                 panel({"energy put in by the hand", "J"}, {put_in, least})},
                      .across = 1,
                      .panel = {900, 260}},
              folder);
}

// ---- impedance

std::string draw(const std::vector<DisplayedImpedance>& all, const std::string& scene, const std::string& folder) {
  constexpr double kDegree = 180.0 / std::numbers::pi;
  Picture picture{
      .name = "impedance", .title = scene + ": what the hand meets", .across = all.size(), .panel = {380, 190}};
  Label labels[] = {{"force / motion", "N/m"}, {"phase", "deg"}, {"coherence", ""}};
  for (int row = 0; row < 3; ++row)
    for (const DisplayedImpedance& z : all) {
      Panel panel{.title = row == 0 ? z.place : "",
                  .x = {.label = {"frequency", "Hz"}, .low = 0.4, .high = 60.0, .logarithmic = true},
                  .y = {.label = labels[row]}};
      if (row == 1)
        panel.y.low = -180.0, panel.y.high = 180.0,
        panel.y.ticks = {{-180, "-180"}, {-90, "-90"}, {0, "0"}, {90, "90"}, {180, "180"}};
      if (row == 2) panel.y.low = 0.0, panel.y.high = 1.05;
      Series displayed{Look::joined_dots, kStableColour, "displayed", 1.2}, truth{Look::dashes, "#404040", "true", 2.0};
      const auto add = [&](Series& to, double frequency, double re, double im) {
        if (std::hypot(re, im) > 0.0) to.add({frequency, row == 0 ? std::hypot(re, im) : kDegree * std::atan2(im, re)});
      };
      for (const ImpedanceLine& l : z.lines)
        if (row < 2) {
          add(displayed, l.frequency_hz, l.displayed_re, l.displayed_im);
          add(truth, l.frequency_hz, l.true_re, l.true_im);
        } else if (std::isfinite(l.coherence)) {
          displayed.add({l.frequency_hz, l.coherence});
        }
      const bool none = displayed.rows.empty() && truth.rows.empty();
      if (row == 0 && none) panel.title += ": no force, as it should be";
      panel.y.logarithmic = row == 0 && !none;
      panel.series = {displayed, truth};
      picture.panels.push_back(std::move(panel));
    }
  return draw(picture, folder);
}

// ---- blocks

std::string draw(const std::vector<BlockCost>& costs, const std::string& title, const std::string& folder) {
  std::vector<std::string> names;
  Series stable{Look::boxes, "#1b7f5c", "stable"}, unstable{Look::boxes, "#d9a441", "unstable"},
      words{Look::words, "black", "", 9.0, 0.0};
  double most = 0.0;
  for (std::size_t i = 0; i < costs.size(); ++i) {
    const double up = static_cast<double>(costs.size() - 1 - i);
    names.insert(names.begin(), costs[i].path);
    (costs[i].stable ? stable : unstable).add({0.0, costs[i].tick_ns, up - 0.35, up + 0.35});
    words.add_text(1.01 * costs[i].tick_ns, up, fmt::format(" {:.0f} ns, x{:.2f}", costs[i].tick_ns, costs[i].ratio));
    most = std::max(most, costs[i].tick_ns);
  }
  return draw(Picture{.name = "blocks",
                      .title = title + ": blocks of the world added one at a time",
                      .panels = {{.title = "",
                                  .x = {.label = {"cost of a master tick, both sides and the world", "ns"},
                                        .low = 0.0,
                                        .high = 1.3 * most},
                                  .y = steps({}, names, true),
                                  .series = {stable, unstable, words}}},
                      .panel = {620, 26 * costs.size() + 20}},
              folder);
}

namespace {

// Pixels.
constexpr double kAcross = 735.0, kUp = 505.0, kLetter = 6.2, kLine = 13.0, kBeside = 8.0;

// Errors at rounding level are drawn at the bottom.
constexpr double kLeast = 1e-17;

/// [µs] per simulated second; of an answer [ms].
double cost(const ChartPoint& p) {
  return p.answer ? 1e3 * p.cost : 1e6 * p.cost;
}
double error(const ChartPoint& p) {
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
std::vector<Series> names_of(const std::vector<const ChartPoint*>& front, const Scale& x, const Scale& y) {
  const auto along = [](const Scale& s, double value) { return std::log(value / s.low) / std::log(s.high / s.low); };
  const auto moved = [](const Scale& s, double value, double part) { return value * std::pow(s.high / s.low, part); };
  Series left{Look::words, "black", "", 9.0, 1.0}, right{Look::words, "black", "", 9.0, 0.0};
  double last_up = 2.0 * kUp, last_right = 2.0 * kUp;  // of the last name at the left, at the right
  for (const ChartPoint* p : front) {
    const double at = kAcross * along(x, cost(*p)), up = kUp * along(y, error(*p));
    const bool is_free = last_up - up > kLine && at - kBeside > kLetter * static_cast<double>(p->name.size());
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
  std::vector<const ChartPoint*> front;
  std::vector<Series> groups;
  std::vector<double> costs, errors;
  std::size_t spare = 0;
  const bool answers = !c.verdict.empty();
  const double floor = c.floor_off;
  if (floor > 0.0) errors.push_back(floor);
  for (const ChartPoint& p : c.points) {
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
  std::sort(front.begin(), front.end(), [](const ChartPoint* a, const ChartPoint* b) { return a->cost < b->cost; });
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
  for (const ChartPoint* p : front) line.add({cost(*p), error(*p)});
  panel.series = {limit, line};
  panel.series.insert(panel.series.end(), groups.begin(), groups.end());
  Series wrong{Look::crosses, "#d62728", "wrong verdict: at the top"};
  for (const ChartPoint& p : c.points)
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
