#include "lab/study/map.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string_view>
#include <utility>
#include <variant>

#include "common/base/check.h"
#include "common/base/file.h"
#include "common/coupling/layers.h"
#include "common/method/catalogue.h"
#include "common/scene/load.h"
#include "lab/engine/simulation.h"
#include "lab/study/parallel.h"

namespace twoport::lab {
namespace {

constexpr const char* kMapScene =
#include "lab/map_scene.inc"
    ;

SceneText base_of(const MapOptions& o) {
  return o.scene.empty() ? SceneText{kMapScene, "the map's scene", o.set}
                         : SceneText{read_text(o.scene), o.scene, o.set};
}

MapCell cell_of(const std::string& method, const MapPlace& place, const std::vector<Summary>& runs, double reference_n,
                double initial_energy_j) {
  MapCell cell{standing_of(method, runs, reference_n, initial_energy_j), place, {}};
  for (const Figure& figure : map_figures()) cell.figures.push_back(spread(figure, runs));
  return cell;
}

std::vector<MapPlace> places_of(const MapOptions& o) {
  std::vector<MapPlace> all;
  for (const double round_trip : o.round_trips_ms)
    for (const double loss : o.losses)
      for (std::size_t b = 0; b < (loss > 0.0 ? o.bursts_packets.size() : 1); ++b)
        for (const double stiffness : o.stiffnesses_n_per_m)
          all.push_back({round_trip, loss, loss > 0.0 ? o.bursts_packets[b] : 1.0, stiffness, o.link != nullptr});
  return all;
}

/// Is it TRANSPARENCY+PASSIVITY?
bool is_pair(std::string_view method) {
  const std::size_t plus = method.find('+');
  return plus != method.npos && find_name(kTransparencyLayers, method.substr(0, plus)) != nullptr &&
         find_name(kPassivityLayers, method.substr(plus + 1)) != nullptr;
}

void check(const MapOptions& o) {
  const auto need = [](const char* option, const std::vector<double>& values, double low, double high) {
    for (const double v : values)
      if (!(v >= low && v <= high))
        throw ConfigError{fmt::format("{} has {}; it must be between {} and {}", option, v, low, high)};
    if (values.empty()) throw ConfigError{fmt::format("{} is empty; it needs a value", option)};
  };
  need("--round-trip-ms", o.round_trips_ms, 0.0, 1e5);
  need("--loss", o.losses, 0.0, 0.99);
  need("--burst-packets", o.bursts_packets, 1.0, 1e6);
  if (o.robot != nullptr && o.stiffnesses_n_per_m != std::vector{0.0})
    throw ConfigError{"--stiffness: the world of --robot has its own"};
  if ((o.link == nullptr && o.robot == nullptr) || o.stiffnesses_n_per_m != std::vector{0.0})
    need("--stiffness", o.stiffnesses_n_per_m, 1e-3, 1e9);
  if (o.seeds < 1) throw ConfigError{fmt::format("--seeds is {}; it must be at least 1", o.seeds)};
}

}  // namespace

ConfidenceInterval wilson(int k, int n) {
  constexpr double z = 1.959963984540054;
  const double p = static_cast<double>(k) / n, z2n = z * z / n;
  const double middle = p + 0.5 * z2n, half = z * std::sqrt(p * (1.0 - p) / n + 0.25 * z2n / n);
  return {std::max(0.0, (middle - half) / (1.0 + z2n)), std::min(1.0, (middle + half) / (1.0 + z2n))};
}

const std::vector<Figure>& map_figures() {
  static const std::vector<Figure> all = [] {
    std::vector<Figure> figures;
    for (const char* name :
         {"environment_force_mean_n", "felt_force_error_rms_n", "held_force_ratio", "muted_share", "drift_m",
          "position_error_rms_m", "force_direction_error_rms_deg", "felt_force_direction_error_rms_deg",
          "chatter_rms_n", "free_force_rms_n", "penetration_max_m", "hand_min_energy_j", "two_port_min_energy_j",
          "robot_min_energy_j", "dissipated_j"})
      figures.push_back(Figure::named(name));
    return figures;
  }();
  return all;
}

std::vector<std::string> rendering_methods() {
  return names_of(kControllers);
}

void check_names(const char* option, const std::vector<std::string>& names, const std::vector<std::string>& allowed) {
  for (auto name = names.begin(); name != names.end(); ++name) {
    if (std::find(allowed.begin(), allowed.end(), *name) == allowed.end())
      throw ConfigError{fmt::format("{} has {}; it must be one of {}", option, *name, fmt::join(allowed, ", "))};
    if (std::find(names.begin(), name, *name) != name)
      throw ConfigError{fmt::format("{} has {} twice; it must have each once", option, *name)};
  }
}

void check_methods(const std::vector<std::string>& methods, const std::vector<std::string>& allowed) {
  std::vector<std::string> known = allowed;
  for (const std::string& method : methods)
    if (is_pair(method)) known.push_back(method);
  check_names("--methods", methods, known);
}

std::vector<std::string> method_overrides(const std::string& method) {
  if (!is_pair(method)) return {"control.passivity.method=" + method};
  const std::size_t plus = method.find('+');
  return {"control.transparency.layer=" + method.substr(0, plus), "control.passivity.layer=" + method.substr(plus + 1)};
}

std::vector<std::string> map_overrides(const Scene& scene, const std::string& method, const MapPlace& p,
                                       std::uint64_t seed) {
  const double round_trip_s = 1e-3 * p.round_trip_ms;
  std::vector<std::string> all = method_overrides(method);
  all.push_back(fmt::format("seed={}", seed));
  if (p.stiffness_n_per_m > 0.0)
    all.push_back(
        fmt::format("environment[0].{}.stiffness_n_per_m={}", name(scene.environment.at(0)), p.stiffness_n_per_m));
  for (const char* way : {"to_slave", "to_master"}) {
    if (p.recorded) break;
    all.push_back(fmt::format("{}.delay_ms={}", way, 0.5 * p.round_trip_ms));
    if (p.burst_packets > 1.0 && p.loss > 0.0) {
      // Two states: lost with r = 1/length to end, so that the share of the bad state p/(p + r) is the loss.
      const double r = 1.0 / p.burst_packets;
      all.push_back(fmt::format("{}.burst={{ p: {} r: {} }}", way, r * p.loss / (1.0 - p.loss), r));
    } else {
      all.push_back(fmt::format("{}.loss={}", way, p.loss));
    }
  }
  all.push_back(
      fmt::format("control.passivity.initial_energy_j={}", shared_initial_energy(scene, Seconds{round_trip_s}).si()));
  double duration_s = scene.duration_s;
  const double longer_s = p.recorded ? 0.0 : round_trip_s - scene.to_slave.delay_s - scene.to_master.delay_s;
  if (scene.operator_model)
    for (std::size_t i = 0; i < scene.operator_model->path.size(); ++i)
      if (const auto* hold = std::get_if<HoldSpec>(&scene.operator_model->path[i])) {
        const double rest_s = std::max(0.0, hold->duration_s + longer_s);
        all.push_back(fmt::format("operator.path[{}].hold.duration_s={}", i, rest_s));
        duration_s += rest_s - hold->duration_s;
      }
  all.push_back(fmt::format("duration_s={}", duration_s));
  return all;
}

namespace {

/// Runs the cells of a map, whose places are known.
void run_map(const MapOptions& o, const SceneText& base, const Scene& scene, const Heard& heard, Map& map) {
  const std::size_t places = map.places.size(), count = map.cells.size();
  // Without a link a place is its path, whose rests grow with the round trip, and its wall.
  std::map<std::pair<double, double>, double> references;
  for (const MapPlace& p : map.places) references[{p.round_trip_ms, p.stiffness_n_per_m}] = 0.0;
  std::vector<std::pair<const std::pair<double, double>, double>*> to_run;
  for (auto& each : references) to_run.push_back(&each);
  for_each_parallel(to_run.size(), o.jobs, [&](std::size_t i) {
    const MapPlace place{.round_trip_ms = to_run[i]->first.first,
                         .stiffness_n_per_m = to_run[i]->first.second,
                         .recorded = o.link != nullptr};
    to_run[i]->second = reference_force_n(base.with(map_overrides(scene, std::string{kPlainMethod}, place, scene.seed)),
                                          o.stop, o.robot);
  });
  if (o.link != nullptr) map.parts = worst_parts(*o.link, scene.duration_s);
  const auto scene_of = [&](const std::string& method, const MapPlace& place, std::size_t part) {
    Scene of_place = base.with(map_overrides(scene, method, place, scene.seed));
    if (o.link != nullptr) {
      const double from_s = map.parts[part].from_s;
      of_place.to_slave = of_place.to_master = {};
      of_place.to_slave.recorded_delay_s = delays_from(o.link->to_slave, from_s, of_place.master_rate_hz);
      of_place.to_master.recorded_delay_s = delays_from(o.link->to_master, from_s, of_place.slave_rate_hz);
    }
    return of_place;
  };
  for (const MapPlace& p : map.places) {
    map.reference_n.push_back(references.at({p.round_trip_ms, p.stiffness_n_per_m}));
    map.initial_energy_j.push_back(scene_of(map.methods[0], p, 0).control.initial_energy.si());
  }
  const Refinement refinement{map.sides};
  std::vector<signed char> holds(count, -1);
  // Of a link each part is a cell of its own to run.
  const std::size_t parts = std::max<std::size_t>(map.parts.size(), 1);
  std::vector<std::vector<Summary>> ran(count * parts);
  Cells cells{count * parts,
              static_cast<std::size_t>(o.seeds),
              [&](std::size_t i) {
                const std::size_t cell = i / parts;
                return scene_of(map.methods[cell / places], map.places[cell % places], i % parts);
              },
              {},
              [&] {
                map.stopped = true;
                if (o.coarse) o.coarse(map);
                map.stopped = false;
              },
              [&] {
                const std::vector<bool> edges = refinement.edges(holds);
                std::vector<bool> first(count * parts);
                for (std::size_t i = 0; i < first.size(); ++i) first[i] = edges[i / parts];
                return first;
              }};
  for (std::size_t i = 0; i < count * parts; ++i) cells.levels.push_back(refinement.level(i / parts));
  Tally tally{count * parts, heard, 0, static_cast<std::size_t>(o.seeds)};
  map.use = run_cells(cells, {.lanes = o.lanes, .jobs = o.jobs, .verdict = o.verdict, .stop = o.stop, .robot = o.robot},
                      tally, [&](std::size_t i, std::uint64_t, std::vector<Summary> runs) {
                        const std::size_t cell = i / parts, place = cell % places;
                        ran[i] = std::move(runs);
                        runs.clear();
                        for (std::size_t part = cell * parts; part < (cell + 1) * parts; ++part) {
                          if (ran[part].empty()) return;
                          runs.insert(runs.end(), ran[part].begin(), ran[part].end());
                        }
                        for (std::size_t part = cell * parts; part < (cell + 1) * parts; ++part) ran[part] = {};
                        map.cells[cell] = cell_of(map.methods[cell / places], map.places[place], runs,
                                                  map.reference_n[place], map.initial_energy_j[place]);
                        holds[cell] = map.cells[cell].holds() ? 1 : 0;
                      });
}

}  // namespace

Map make_map(const MapOptions& o, const Heard& heard) {
  check(o);
  check_methods(o.methods, method_names());
  const SceneText base = base_of(o);
  const Scene scene = base.with();
  if ((scene.environment.empty() && o.robot == nullptr) || scene.control.architecture == Architecture::render ||
      scene.control.architecture == Architecture::uncontrolled)
    throw ConfigError{fmt::format("{}: a map needs a link and an environment with a stiffness", o.scene)};
  Map map{.scene = scene.name,
          .methods = o.methods.empty() ? method_names() : o.methods,
          .places = places_of(o),
          .reference_n = {},
          .parts = {},
          .initial_energy_j = {},
          .cells = {},
          .use = {}};
  const std::size_t round_trips = o.round_trips_ms.size(), stiffnesses = o.stiffnesses_n_per_m.size();
  map.sides = {{map.methods.size(), false},
               {round_trips, is_ordered(o.round_trips_ms)},
               {map.places.size() / round_trips / stiffnesses, is_ordered(o.losses)},
               {stiffnesses, is_ordered(o.stiffnesses_n_per_m)}};
  map.cells.resize(map.methods.size() * map.places.size());
  // A combination without a meaning is refused before anything runs.
  for (const std::string& method : map.methods) static_cast<void>(base.with(method_overrides(method)));

  try {
    run_map(o, base, scene, heard, map);
  } catch (const Stopped&) {
    map.stopped = true;
  }
  return map;
}

std::optional<Map> filled(const Map& some) {
  std::vector<bool> known;
  for (const MapCell& cell : some.cells) known.push_back(cell.runs() > 0);
  const std::vector<std::size_t> stand_ins = Refinement{some.sides}.stand_ins(known);
  if (std::find(stand_ins.begin(), stand_ins.end(), Refinement::kNone) != stand_ins.end()) return std::nullopt;
  Map all = some;
  for (std::size_t i = 0; i < all.cells.size(); ++i) all.cells[i] = some.cells[stand_ins[i]];
  return all;
}

std::vector<Standing> standings(const Map& map, std::size_t place) {
  std::vector<Standing> all;
  for (std::size_t m = 0; m < map.methods.size(); ++m) all.push_back(map.at(m, place));
  return all;
}

Table to_table(const Map& map) {
  Table table;
  table.columns = {
      "method",         "round_trip_ms",    "loss",           "burst_packets", "stiffness_n_per_m", "stable_seeds",
      "restless_seeds", "undecided_seeds",  "unstable_seeds", "stable_low",    "stable_high",       "holds",
      "good",           "reference_force_n"};
  const auto add_columns = [&](const std::string& name) {
    table.columns.insert(table.columns.end(), {name, name + "_sd", name + "_worst"});
  };
  add_columns("pressed_share");
  add_columns("error_n");
  for (const Figure& figure : map_figures()) add_columns(figure.name());
  for (const MapCell& c : map.cells) {
    if (c.runs() == 0) continue;
    const ConfidenceInterval stable = wilson(c.stable, c.runs());
    Values& row = table.rows.emplace_back(
        Values{c.method, c.place.round_trip_ms, c.place.loss, c.place.burst_packets, c.place.stiffness_n_per_m,
               c.stable, c.restless, c.undecided, c.unstable, fmt::format("{:.4f}", stable.low),
               fmt::format("{:.4f}", stable.high), c.holds(), c.good(), c.reference_n});
    const auto add = [&](const Spread& s) {
      row.insert(row.end(), {Value::finite(s.mean), Value::finite(s.sd), Value::finite(s.worst)});
    };
    add(c.pressed);
    add(c.error_n);
    for (const Spread& each : c.figures) add(each);
  }
  return table;
}

std::string to_text(const Map& map) {
  std::vector<std::size_t> places;
  for (std::size_t p = 0; p < map.places.size(); ++p) {
    std::size_t m = 0;
    while (m < map.methods.size() && map.at(m, p).runs() > 0) ++m;
    if (m == map.methods.size()) places.push_back(p);
  }
  const int runs_each = places.empty() ? 0 : map.at(0, places[0]).runs();
  std::string out = fmt::format(
      "{}: {} places, {} seed{} each\n", map.scene,
      map.stopped ? fmt::format("{} of {}", places.size(), map.places.size()) : std::to_string(places.size()),
      runs_each, runs_each == 1 ? "" : "s");
  out += fmt::format("{:<24} {:>7} {:>9} {:>9} {:>9} {:>17} {:>7} {:>7} {:>7} {:>9} {:>14}\n", "method", "stable",
                     "restless", "undecided", "unstable", "stable runs, 95 %", "holds", "good", "best", "within 5 %",
                     "least hand mJ");
  std::map<std::size_t, std::size_t> best;
  for (const std::size_t p : places) best[p] = best_of(standings(map, p));
  for (std::size_t m = 0; m < map.methods.size(); ++m) {
    int stable = 0, restless = 0, undecided = 0, unstable = 0, holds = 0, good = 0, first = 0, near = 0, runs = 0,
        stable_runs = 0;
    double least = 0.0;
    for (const std::size_t p : places) {
      const MapCell& c = map.at(m, p);
      ++(c.unstable > 0 ? unstable : c.restless > 0 ? restless : c.undecided > 0 ? undecided : stable);
      runs += c.runs(), stable_runs += c.stable;
      holds += c.holds();
      good += c.good();
      first += best[p] == m;
      near += c.may_be_best() && c.error_n.mean <= 1.05 * map.at(best[p], p).error_n.mean;
      least = std::min(least, c.hand_min_energy_j);
    }
    const ConfidenceInterval share = wilson(stable_runs, runs);
    out += fmt::format("{:<24} {:>7} {:>9} {:>9} {:>9} {:>17} {:>7} {:>7} {:>7} {:>9} {:>14.4g}\n", map.methods[m],
                       stable, restless, undecided, unstable,
                       fmt::format("{:.1f} - {:.1f} %", 100.0 * share.low, 100.0 * share.high), holds, good, first,
                       near, 1e3 * least);
  }
  if (map.places.size() == 1 && places.size() == 1) out += in_a_line(recommend(standings(map, 0)));
  return out;
}

}  // namespace twoport::lab
